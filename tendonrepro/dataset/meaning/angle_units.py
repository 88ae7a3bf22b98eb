"""Degrees or radians: by what is stated, by encoder counts, by size."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.meaning.columns import Address, Column
from tendonrepro.dataset.meaning.evidence import counted_in, sampling_step
from tendonrepro.dataset.meaning.times import SAMPLING
from tendonrepro.dataset.readers.units import FACTORS

HALF_TURN = 3.3
"""No joint of the arm turns further, rad."""
WINCH_TURN = 7.0
"""Nor does a winch, which turns up to 77/37 times as far, rad."""

_ANGLES = ("desired", "measured", "error", "motor", "calculated")
# What their units have behind that of the angles; nothing for torques.
_OTHERS = {"rate": "/s", "acceleration": "/s^2", "torque": "", "estimate": ""}
# A tracking error of some tenths of a degree, in either unit.
_SMALL_RAD = 0.02
_SPAN = 0.2
"""Time over which a rate of the error is taken, s: shorter ones show little but encoder counts."""
_ETA = 1.0
"""Weight of the error in a sliding surface, 1/s, to the order of magnitude."""
_RATES = (("rad/s", 1.0), ("deg/s", np.pi / 180.0))
_CLEAR = 2.0
"""A size that is so many times nearer to one unit than to the other is told apart."""


def find_units(columns: Sequence[Column]) -> None:
    """Settle the units of all columns of a file but its times.

    Parameters
    ----------
    columns : sequence of Column
    """
    angles = [column for column in columns if column.quantity in _ANGLES]
    for column in angles:
        if column.unit is None and (unit := counted_in(column.values)):
            column.unit = unit
            column.because.append(f"its steps are one encoder count in {unit}")
    told = {column.unit for column in angles if column.unit in {"deg", "rad"}}
    alike = "as the other angles of its file"
    shared, reason = (told.pop(), alike) if len(told) == 1 else _shared_unit(angles)
    for column in angles:
        if column.unit is None:
            column.unit = shared
            column.because.append(f"{shared}: {reason}")
    for column in columns:
        if column.unit is None and column.quantity in _OTHERS:
            power = _OTHERS[column.quantity]
            column.unit = f"{shared}{power}" if power else "N m"
            column.because.append(f"{column.unit}: no unit is given")


def _shared_unit(angles: Sequence[Column]) -> tuple[str, str]:
    """Degrees or radians by the size of the angles, else of the errors."""
    angles = [column for column in angles if np.isfinite(column.values).any()]
    for quantities, most, what in (
        ({"desired", "measured", "calculated"}, HALF_TURN, "no joint turns by more than half a turn"),
        ({"motor"}, WINCH_TURN, "no winch turns by more than a turn"),
    ):
        sizes = [largest(column.values) for column in angles if column.quantity in quantities]
        if sizes and max(sizes) > most:
            return "deg", f"an angle reaches {max(sizes):.3g}, and {what}"
        if sizes:
            return "rad", f"the largest angle is {max(sizes):.3g}; in degrees there would hardly be a motion"
    errors = [float(np.abs(_finite(c.values)).mean()) for c in angles if c.quantity == "error"]
    if errors and max(errors) > _SMALL_RAD:
        return "deg", f"a mean error of {max(errors):.2g} would be more than a degree in rad"
    return "rad", "nothing says otherwise; look at it"


def find_surface_units(columns: Sequence[Column]) -> None:
    """Settle the units of sliding surfaces by the errors they are made of, e' + eta phi(e).

    Parameters
    ----------
    columns : sequence of Column
        Of all files; joints and the units of angles are known.
    """
    axes = {column.address: column for column in columns if column.quantity == "time"}
    angles = by_joint(column for column in columns if column.quantity in {"error", "desired", "measured"})
    for surface in columns:
        if surface.quantity != "surface" or surface.unit is not None:
            continue
        alike = _nearest(angles.get(joint_of(surface), ()), surface)
        expected = _rms(_made_of(alike, axes))
        found = _rms(_averages(surface.values, _step(surface, axes)))
        # How far the size is from what it would be, in logarithms.
        off = {unit: abs(np.log(found * factor / expected)) for unit, factor in _RATES if expected and found}
        if off and abs(off["rad/s"] - off["deg/s"]) > np.log(_CLEAR):
            surface.unit = min(off, key=lambda unit: off[unit])
            surface.because.append(f"{surface.unit}: that is the size of e' + eta e of this joint")
            continue
        degrees = any(column.unit == "deg" for column in alike.values())
        surface.unit = "deg/s" if degrees else "rad/s"
        surface.because.append(f"{surface.unit}: no unit is given")
        surface.doubts.append(f"no unit of s is given and nothing tells it, {surface.unit} is taken")


def by_joint(columns: Iterable[Column]) -> dict[tuple[object, ...], list[Column]]:
    """Columns by `joint_of`."""
    found: dict[tuple[object, ...], list[Column]] = defaultdict(list)
    for column in columns:
        found[joint_of(column)].append(column)
    return found


def joint_of(column: Column) -> tuple[object, ...]:
    """Run and joint of a column, and how many samples it has: the same for what belongs together."""
    return column.controller, str(column.payload_mass), column.joint, len(column.values)


def in_radians(column: Column) -> Array:
    """Values of a column of angles, rad, NaN for what is no number; radians where nothing is known."""
    return _numbers(column.values) * FACTORS["angle"].get(column.unit or "rad", 1.0)


def _nearest(angles: Iterable[Column], surface: Column) -> dict[str | None, Column]:
    """The error and the angles next to a surface, by what they are."""
    in_order = sorted(
        angles, key=lambda column: (column.group == surface.group, column.source is surface.source)
    )
    return {column.quantity: column for column in in_order}


def _made_of(of: Mapping[str | None, Column], axes: Mapping[Address, Column]) -> Array:
    """What a sliding surface is made of, e' + eta e, rad/s; empty where no error is there."""
    parts = [of[key] for key in (("error",) if "error" in of else ("desired", "measured")) if key in of]
    if not parts or (len(parts) == 1 and "error" not in of):
        return np.empty(0)
    angles = [in_radians(column) for column in parts]
    error = _averages(angles[0] if len(angles) == 1 else angles[0] - angles[1], _step(parts[0], axes))
    return np.asarray(np.diff(error) / _SPAN + _ETA * error[1:])


def _step(column: Column, axes: Mapping[Address, Column]) -> float:
    """Sampling step of a column, s; the paper's where there is none."""
    if column.signal.time is not None:
        return sampling_step(column.signal.time) or SAMPLING
    axis = axes.get(column.time) if column.time else None
    step = None if axis is None else sampling_step(axis.values)
    return SAMPLING if step is None or axis is None else step * FACTORS["time"][axis.unit or "s"]


def _averages(values: Array, step: float) -> Array:
    """Means over spans that follow each other, which encoder counts do not disturb."""
    size = max(1, round(_SPAN / step))
    count = len(values) // size
    return np.asarray(_numbers(values)[: count * size].reshape(count, size).mean(axis=1))


def _rms(values: Array) -> float:
    """RMS of the numbers among values; 0 without any."""
    known = _finite(values)
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0


def _numbers(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def largest(values: Array) -> float:
    """Largest magnitude of the numbers among values; 0 without any."""
    return float(np.abs(_finite(values)).max(initial=0.0))
