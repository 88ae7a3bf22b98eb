"""Degrees or radians: by what is stated, by encoder counts, by size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.columns import Column
from tendonrepro.dataset.meaning.evidence import counted_in, largest
from tendonrepro.dataset.readers.units import FACTORS

HALF_TURN = 3.3
"""No joint of the arm turns further, rad."""
_WINCH_TURN = 7.0  # nor does a winch, which turns up to 77/37 times as far, rad
_SMALL_RAD = 0.02  # a tracking error of some tenths of a degree, in either unit
_ANGLES = ("desired", "measured", "error", "motor", "calculated")
# What their units have behind that of the angles; nothing for torques.
_OTHERS = {"rate": "/s", "surface": "/s", "acceleration": "/s^2", "torque": "", "estimate": ""}


def find_units(columns: Sequence[Column]) -> None:
    """Settle the units of all columns of a file but its times."""
    angles = [column for column in columns if column.quantity in _ANGLES]
    for column in angles:
        if column.unit is None and (unit := counted_in(column.values)):
            column.unit = unit
            column.because.append(f"its steps are one encoder count in {unit}")
    told = {column.unit for column in angles if column.unit in {"deg", "rad"}}
    alike = "as the other angles of its file"
    shared, reason = (told.pop(), alike) if len(told) == 1 else _shared_unit(angles)
    for column in columns:
        if column.unit is None and column.quantity in _ANGLES:
            column.unit = shared
            column.because.append(f"{shared}: {reason}")
        elif column.unit is None and column.quantity in _OTHERS:
            power = _OTHERS[column.quantity]
            column.unit = f"{shared}{power}" if power else "N m"
            column.because.append(f"{column.unit}: no unit is given")
            if column.quantity == "surface":
                column.doubts.append(f"no unit of s is given, {column.unit} is taken: `unit` of its entries")


def _shared_unit(angles: Sequence[Column]) -> tuple[str, str]:
    """Degrees or radians by the size of the angles, else of the errors."""
    angles = [column for column in angles if np.isfinite(column.values).any()]
    for quantities, most, what in (
        ({"desired", "measured", "calculated"}, HALF_TURN, "no joint turns by more than half a turn"),
        ({"motor"}, _WINCH_TURN, "no winch turns by more than a turn"),
    ):
        sizes = [largest(column.values) for column in angles if column.quantity in quantities]
        if sizes and max(sizes) > most:
            return "deg", f"an angle reaches {max(sizes):.3g}, and {what}"
        if sizes:
            return "rad", f"the largest angle is {max(sizes):.3g}; in degrees there would hardly be a motion"
    errors = [float(np.abs(c.values[np.isfinite(c.values)]).mean()) for c in angles if c.quantity == "error"]
    if errors and max(errors) > _SMALL_RAD:
        return "deg", f"a mean error of {max(errors):.2g} would be more than a degree in rad"
    return "rad", "nothing says otherwise; look at it"


def in_radians(column: Column) -> Array:
    """Values of a column of angles, rad, NaN for what is no number; radians where nothing is known."""
    numbers = np.where(np.isfinite(column.values), column.values, np.nan)
    return numbers * FACTORS["angle"].get(column.unit or "rad", 1.0)
