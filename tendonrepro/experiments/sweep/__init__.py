"""One experiment over values of one or two keys; enter by `command.run_sweep`."""
