"""Plants closest to the print; :func:`tendonrepro.identify.command.command.run_identify`."""
