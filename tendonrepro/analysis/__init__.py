"""The sampled loop, linear: modes, margins, maps, and why; enter by `command.run_explain`."""
