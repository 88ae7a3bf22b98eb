"""A measurement beside print and model; :func:`tendonrepro.validation.command.run_validate`."""
