"""The paper's own runs; enter by `command.run_experiments`."""
