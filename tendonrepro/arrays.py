"""The array type of the physics, and a choice that numbers, lanes and symbols share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Double-precision array; its shape and unit are stated where it is used."""


def choose(condition: Any, then: Any, otherwise: Any) -> Any:
    """``then`` where the condition holds, else ``otherwise``; numbers or arrays, both computed already."""
    return np.where(condition, then, otherwise)[()]


def pick(values: Sequence[Any] | NDArray[Any], place: Any) -> Any:
    """Entry at a place, from 0; experiments side by side may each have a place of their own."""
    if isinstance(place, int):
        return values[place]
    found = values[0]
    for k in range(1, len(values)):
        found = choose(place >= float(k), values[k], found)
    return found
