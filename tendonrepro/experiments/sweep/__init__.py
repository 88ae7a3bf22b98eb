"""One experiment over values of one or two keys; :func:`tendonrepro.experiments.sweep.command.run_sweep`."""
