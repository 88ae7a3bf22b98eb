"""Many plausible plants under many readings; enter by `commands.ensemble`."""
