"""The one array type of the package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Double-precision array; its shape and unit are stated where it is used."""
