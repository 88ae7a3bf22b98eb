"""Plants closest to the print; enter by `command.run_identify`."""
