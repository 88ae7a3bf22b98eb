"""What a function gave at points, kept on disk: who asks again for the same gets the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.files import atomic_path


class Kept:
    """Values (N, K) of a function at points (N, P), in the order in which they are asked for.

    They are kept in a file, if one is named. Whoever asks once more for the same points, as a search does
    that was interrupted, gets what stands there; from the first other point on all is found anew.
    """

    def __init__(self, function: Callable[[Array], Array], path: Path | None) -> None:
        self._function, self._path = function, path
        self._table = np.load(path) if path and path.exists() else np.empty((0, 0))
        self.count = 0

    def __call__(self, points: Array) -> Array:
        """Values at points, found on disk or by the function."""
        asked, width = slice(self.count, self.count + len(points)), points.shape[1]
        if not np.array_equal(self._table[asked, :width], points, equal_nan=True):
            rows = np.column_stack([points, self._function(points)])
            self._table = np.concatenate([self._table[: self.count], rows]) if self.count else rows
            if self._path:
                with atomic_path(self._path) as temporary:
                    np.save(temporary, self._table)
        self.count += len(points)
        return self._table[asked, width:]

    @property
    def table(self) -> Array:
        """Points that were asked for, with their values, (N, P + K)."""
        return self._table[: self.count]
