"""Many plausible plants under many readings; :func:`tendonrepro.ensemble.command.command.run_ensemble`."""
