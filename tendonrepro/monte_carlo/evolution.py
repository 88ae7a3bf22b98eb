"""CMA-ES in the unit cube, with random numbers of its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from tendonrepro.arrays import Array


def evolution(start: Array, width: float, population: int, generator: np.random.Generator) -> Any:
    """A ``cma.CMAEvolutionStrategy`` from a point (P,) with a first standard deviation."""
    import cma

    options = {
        "bounds": [0.0, 1.0],
        "popsize": population,
        "randn": lambda *shape: generator.standard_normal(shape),
        "seed": np.nan,  # else it would seed a generator that all of NumPy shares
        "verbose": -9,
    }
    return cma.CMAEvolutionStrategy(start, width, options)
