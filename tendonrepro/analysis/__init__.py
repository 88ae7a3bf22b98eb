"""The sampled loop, linear; enter by `command.run_explain`."""
