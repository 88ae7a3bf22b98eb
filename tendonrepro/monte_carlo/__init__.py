"""Many plausible plants under many readings; enter by `command.run_ensemble`."""
