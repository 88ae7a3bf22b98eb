"""The paper's own runs; :func:`tendonrepro.experiments.command.run_experiment` makes one."""
