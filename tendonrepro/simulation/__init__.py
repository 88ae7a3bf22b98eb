"""Closed loops in time: one by SciPy (:mod:`tendonrepro.simulation.stepper`), thousands by machine code (:mod:`tendonrepro.simulation.batch`)."""
