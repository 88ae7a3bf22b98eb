"""A measurement beside print and model; enter by `commands.validate`."""
