"""The sampled loop, linear; enter by `commands.explain`."""
