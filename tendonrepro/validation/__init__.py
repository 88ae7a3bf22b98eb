"""A measurement beside print and model; enter by `command.run_validate`."""
