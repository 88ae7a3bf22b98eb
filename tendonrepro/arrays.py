"""The array type of the physics, and a choice that numbers, lanes and symbols share."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Double-precision array; its shape and unit are stated where it is used."""


def choose(condition: Any, then: Any, otherwise: Any) -> Any:
    """``then`` where the condition holds, else ``otherwise``; numbers or arrays, both computed already."""
    return np.where(condition, then, otherwise)[()]
