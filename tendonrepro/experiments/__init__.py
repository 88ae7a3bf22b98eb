"""The paper's own runs; enter by `commands`."""
