"""The sampled loop, linear: modes, margins, maps, and why; :func:`tendonrepro.explain.analysis.command.run_explain`."""
