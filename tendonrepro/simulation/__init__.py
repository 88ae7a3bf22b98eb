"""Closed loops in time: one by SciPy in `stepper`, thousands by machine code in `batch`."""
