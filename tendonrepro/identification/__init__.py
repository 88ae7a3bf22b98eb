"""Plants closest to the print; enter by `commands.identify`."""
