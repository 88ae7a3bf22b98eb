"""Shapes of the simulator as curves of their parameters, and these as round as one likes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.reference_turns import Turns
from tendonrepro.physics.trajectory import (
    Motion,
    Shape,
    at_rest,
    minimum_jerk,
    motion,
    raised_cosine,
    smooth_sine,
    trapezoid_times,
    trapezoidal,
)

OUT_AND_BACK = ("raised_cosine", "minimum_jerk", "trapezoidal")
"""Shapes that return to their start in every cycle."""
PER_JOINT = ("amplitude", "offset", "start")
"""Parameters that each joint has its own value of, (n,)."""
ANGLES = (*PER_JOINT, "velocity", "acceleration")
"""Parameters whose unit holds an angle; they are round in degrees."""
UNITS = {
    **{"period": "s", "rise": "s", "hold": "s", "blend": "s"},
    **{"amplitude": "deg", "offset": "deg", "velocity": "deg s-1", "acceleration": "deg s-2"},
}
"""Units in a configuration; what has none here is not written there."""
POSITIVE = ("period", "rise", "blend", "velocity", "acceleration")
"""Parameters that make no motion when they are zero."""

Values: TypeAlias = dict[str, Any]
"""Times in s, angles (n,) in rad, rates in rad/s and rad/s²; ``delay`` is the rest before the motion."""


def curve(kind: str, values: Values, turns: Turns | None, time: Array) -> Array:
    """Angles of a shape, rad, (T, n)."""
    motions = _motions(kind, values, turns, float(time[-1]))
    angles = motion(time - values["delay"], motions)[0]
    return np.asarray(angles + values["start"])


def cycle_of(kind: str, values: Values) -> float:
    """Duration of one turn, s."""
    if kind in ("raised_cosine", "sine"):
        return float(values["period"])
    if kind == "minimum_jerk":
        return float(2.0 * (values["rise"] + values["hold"]))
    longest = float(np.abs(values["amplitude"]).max())
    _, rise = trapezoid_times(longest, values["velocity"], values["acceleration"])
    return 2.0 * (rise + float(values["hold"]))


def _motions(kind: str, values: Values, turns: Turns | None, end: float) -> list[Motion]:
    shapes = [_SHAPES[kind](values, i) for i in range(len(values["amplitude"]))]
    if turns is None:
        return [Motion((shape,), 2.0 * end + 1.0) for shape in shapes]
    cycle = cycle_of(kind, values)
    return [
        Motion(tuple(shape if i in turn else at_rest for turn in turns.joints), cycle)
        for i, shape in enumerate(shapes)
    ]


def _trapezoid(values: Values, i: int) -> Shape:
    amplitude, limits = float(values["amplitude"][i]), (values["velocity"], values["acceleration"])
    hold = cycle_of("trapezoidal", values) / 2.0 - trapezoid_times(amplitude, *limits)[1]
    return trapezoidal(amplitude, *limits, hold)


_SHAPES: Mapping[str, Callable[[Values, int], Shape]] = {
    "raised_cosine": lambda values, i: raised_cosine(float(values["amplitude"][i]), values["period"]),
    "minimum_jerk": lambda values, i: minimum_jerk(
        float(values["amplitude"][i]), values["rise"], values["hold"]
    ),
    "trapezoidal": _trapezoid,
    "sine": lambda values, i: smooth_sine(
        float(values["amplitude"][i]), float(values["offset"][i]), values["period"], values["blend"]
    ),
}


def rounded(values: Values, digits: int) -> Values:
    """Round parameters to some digits of s, deg, deg/s and deg/s²; the start angles stay."""
    found: Values = {}
    for name, value in values.items():
        if name == "start":
            found[name] = value
        elif name in ANGLES:
            numbers = np.deg2rad(np.round(np.rad2deg(value), digits))
            found[name] = numbers if np.ndim(value) else float(numbers)
        else:
            found[name] = round(value, digits)
    return found
