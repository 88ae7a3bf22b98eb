"""The simulator's shapes as curves of their parameters, and which of them a recorded motion has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import Recorded, noise_peak
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

HALF_COUNT = float(np.deg2rad(0.011))
"""Half of the encoder's printed resolution, rad."""
UNITS = {
    **{"amplitude": "deg", "offset": "deg", "velocity": "deg s-1", "acceleration": "deg s-2"},
    **{"period": "s", "rise": "s", "hold": "s", "blend": "s"},
}
"""Parameters of the shapes in a configuration."""

_ROUGH, _FINE = (400, 1e-8), (1500, 1e-15)
"""Most samples, and tolerance, of a search from every guess and of the one from the best of all."""

PER_JOINT = ("amplitude", "offset", "start")
"""Parameters that each joint has its own value of, (n,)."""

Values: TypeAlias = dict[str, Any]
"""Times in s, angles (n,) in rad. ``delay`` is the rest before the motion, ``start`` the angle of that rest,
and ``share`` the part of a ramp's rise in which it speeds up."""

_AWAY = 0.02
"""Share of a joint's amplitude beyond which it has left its start."""
_STILL = 0.05
"""Share of the largest amplitude below which a joint counts as at rest."""


@dataclass(frozen=True)
class Turns:
    """Cycles of a motion that goes out and comes back: the columns that move in each, in order; times in s.

    The first excursion passes 2 % of the amplitude at `begin` on its way out and at `end` on its way back;
    `cycle` is from one excursion to the next, 0 when there is only one; `rise` from 2 % to 98 % of the
    amplitude.
    """

    joints: tuple[tuple[int, ...], ...]
    begin: float
    end: float
    cycle: float
    rise: float

    def pattern(self) -> tuple[tuple[tuple[int, ...], ...], int]:
        """Return the shortest list of turns that repeats, and how often it does."""
        count = len(self.joints)
        lengths = [k for k in range(1, count + 1) if self.joints[:k] * (count // k) == self.joints]
        return self.joints[: lengths[0]], count // lengths[0]


def turns_of(record: Recorded) -> Turns | None:
    """Cycles of a motion that leaves its start and returns; None if it is none."""
    amplitude = amplitude_of(record)
    trips = [trip for i in movers(amplitude) for trip in _trips(record, i, amplitude[i])]
    if not trips or any(np.ptp(np.sign(record.q[a:b, i])) > 0.0 for a, b, i in trips):
        return None
    groups: list[list[tuple[int, int, int]]] = []
    for trip in sorted(trips):
        if groups and trip[0] < max(end for _, end, _ in groups[-1]):
            groups[-1].append(trip)
        else:
            groups.append([trip])
    starts = record.time[[group[0][0] for group in groups]]
    cycle = float(np.median(np.diff(starts))) if len(groups) > 1 else 0.0
    a, b, i = max(groups[0], key=lambda trip: trip[1] - trip[0])
    top = a + int(np.argmax(np.abs(record.q[a:b, i]) >= (1.0 - _AWAY) * abs(amplitude[i])))
    joints = tuple(tuple(sorted({i for _, _, i in group})) for group in groups)
    begin, end, high = (float(record.time[k]) for k in (a, b - 1, top))
    return Turns(joints, begin, end, cycle, max(high - begin, 2.0 * record.step))


def amplitude_of(record: Recorded) -> Array:
    """Signed angle farthest from the start, (n,)."""
    far = np.abs(record.q).argmax(axis=0)
    return np.asarray(record.q[far, np.arange(record.q.shape[1])])


def movers(amplitude: Array) -> list[int]:
    """Joints, by column, that move far enough to count."""
    return [i for i, size in enumerate(np.abs(amplitude)) if size > _STILL * np.abs(amplitude).max() > 0.0]


def _trips(record: Recorded, i: int, amplitude: float) -> Iterator[tuple[int, int, int]]:
    """First sample, last sample + 1 and joint of each stay away from the start."""
    away = np.abs(record.q[:, i]) > _AWAY * abs(amplitude)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]])))
    yield from ((int(a), int(b), i) for a, b in zip(edges[::2], edges[1::2], strict=True))


def curve(kind: str, values: Values, turns: Turns | None, time: Array) -> Array:
    """Angles of a shape, rad, (T, n); a sine has no turns."""
    shapes = [_shape(kind, values, i) for i in range(len(values["amplitude"]))]
    if turns is None or kind == "sine":
        motions = [Motion((shape,), 2.0 * float(time[-1]) + 1.0) for shape in shapes]
    else:
        motions = [
            Motion(tuple(shape if i in turn else at_rest for turn in turns.joints), cycle_of(values))
            for i, shape in enumerate(shapes)
        ]
    return np.asarray(motion(time - values["delay"], motions)[0] + values.get("start", 0.0))


def _shape(kind: str, values: Values, i: int) -> Shape:
    amplitude = float(values["amplitude"][i])
    if kind == "raised_cosine":
        return raised_cosine(amplitude, values["period"])
    if kind == "minimum_jerk":
        return minimum_jerk(amplitude, values["rise"], values["hold"])
    if kind == "sine":
        return smooth_sine(amplitude, float(values["offset"][i]), values["period"], values["blend"])
    limits = ramp_limits(values)
    return trapezoidal(amplitude, *limits, cycle_of(values) / 2.0 - trapezoid_times(amplitude, *limits)[1])


def cycle_of(values: Values) -> float:
    """Duration of one turn, s."""
    return float(values["period"] if "period" in values else 2.0 * (values["rise"] + values["hold"]))


def ramp_limits(values: Values) -> tuple[float, float]:
    """Velocity and acceleration, rad/s and rad/s², at which the longest ramp has its rise and share."""
    velocity = float(np.abs(values["amplitude"]).max()) / (values["rise"] * (1.0 - values["share"]))
    return velocity, velocity / (values["share"] * values["rise"])


@dataclass(frozen=True, eq=False)
class Fit:
    """A shape laid through a recorded motion: `kind` and `values` as in a configuration.

    `largest` and `rms` are of its residual, rad.
    """

    kind: str
    values: Values
    largest: float
    rms: float

    def parameters(self) -> dict[str, Any]:
        """Parameters in a configuration's units."""
        values = self.values
        if self.kind == "trapezoidal":
            velocity, acceleration = ramp_limits(values)
            values = {"velocity": velocity, "acceleration": acceleration} | values
            del values["rise"]
        return {
            name: np.round(np.rad2deg(values[name]) if unit.startswith("deg") else values[name], 9).tolist()
            for name, unit in UNITS.items()
            if name in values
        }


def limit(record: Recorded) -> float:
    """Largest residual of a shape that is named: half a count, half the record's step and its noise, rad."""
    return HALF_COUNT + 0.5 * record.rounding + noise_peak(record)


def fits(record: Recorded, period: float) -> list[Fit]:
    """Lay every shape through a motion that repeats after a period, s, 0 if unknown; the best one first.

    Shapes that cannot be tried are left out.
    """
    turns = turns_of(record)
    guesses: dict[str, list[Values]] = {}
    if turns is not None:
        kinds = ("raised_cosine", "minimum_jerk", "trapezoidal")
        guesses = {kind: _guesses(kind, record, turns) for kind in kinds}
    if period > 0.0:
        guesses["sine"] = _sines(record, period)
    rough = [
        min((_solved(record, kind, turns, guess, *_ROUGH) for guess in tried), key=lambda fit: fit.rms)
        for kind, tried in guesses.items()
    ]
    found = sorted(rough, key=lambda fit: fit.rms)
    return [_solved(record, fit.kind, turns, fit.values, *_FINE) for fit in found[:1]] + found[1:]


def _guesses(kind: str, record: Recorded, turns: Turns) -> list[Values]:
    """Parameters near those of a motion that goes out and back; joints at rest keep their amplitude of 0."""
    size, away = amplitude_of(record), turns.end - turns.begin
    amplitude = np.where(np.isin(np.arange(len(size)), movers(size)), size, 0.0)
    angles = {"amplitude": amplitude, "start": np.zeros(len(size))}
    if kind == "raised_cosine":
        period = turns.cycle or away / 0.91
        return [angles | {"delay": turns.begin - 0.045 * period, "period": period}]
    # Shares of a stroke's rise that pass from 2 to 98 % of its way, and before that.
    passing, before = (0.73, 0.136) if kind == "minimum_jerk" else (0.87, 0.1)
    rise = turns.rise / passing
    hold = max((turns.cycle or away + 2.0 * before * rise) / 2.0 - rise, 1e-3)
    times = {"delay": turns.begin - before * rise, "rise": rise, "hold": hold}
    shares = [{}] if kind == "minimum_jerk" else [{"share": share} for share in (0.1, 0.3, 0.49)]
    return [angles | times | share for share in shares]


def _sines(record: Recorded, period: float) -> list[Values]:
    """Parameters from the last period, where the blend is over."""
    first, _ = record.moving()
    begin, late = float(record.time[first]), record.time >= record.time[-1] - period
    phase = 2.0 * np.pi / period * (record.time[late] - begin)
    parts = np.column_stack([np.ones_like(phase), np.sin(phase), np.cos(phase)])
    offset, along, across = np.linalg.lstsq(parts, record.q[late], rcond=None)[0]
    main = int(np.argmax(np.hypot(along, across)))
    found = []
    for turn in (0.0, np.pi):
        shift = np.arctan2(across[main], along[main]) + turn
        back = (shift + np.pi) % (2.0 * np.pi) - np.pi
        angles = {"amplitude": along * np.cos(shift) + across * np.sin(shift), "offset": offset}
        times = {"delay": begin - back * period / (2.0 * np.pi), "period": period}
        found += [angles | times | {"blend": blend * period} for blend in (0.25, 0.5, 1.0)]
    return found


def _solved(
    record: Recorded, kind: str, turns: Turns | None, guess: Values, samples: int, tolerance: float
) -> Fit:
    """Least squares in all parameters from a guess, on so many samples at most."""
    from scipy.optimize import least_squares

    time, q = (part[:: -(-len(part) // samples)] for part in record.samples())
    step, end = record.step, float(record.time[-1])
    known = {"delay": (-2.0 * step, end), "share": (1e-3, 0.5), "hold": (0.0, end)}
    known |= dict.fromkeys(PER_JOINT, (-20.0, 20.0))
    sizes = [np.size(value) for value in guess.values()]
    bounds = [known.get(name, (2.0 * step, 2.0 * end)) for name in guess]
    low, high = np.repeat(bounds, sizes, axis=0).T

    def values(numbers: Array) -> Values:
        parts = zip(guess, np.split(numbers, np.cumsum(sizes)[:-1]), strict=True)
        return {name: part if name in PER_JOINT else float(part[0]) for name, part in parts}

    def residual(numbers: Array) -> Array:
        return np.ravel(curve(kind, values(numbers), turns, time) - q)

    solved = least_squares(
        residual,
        np.clip(np.hstack(list(guess.values())), low + 1e-9, high - 1e-9),
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=40,
    )
    return judged(record, kind, turns, values(solved.x))


def judged(record: Recorded, kind: str, turns: Turns | None, values: Values) -> Fit:
    """Residual of a shape with given parameters."""
    time, q = record.samples()
    residual = curve(kind, values, turns, time) - q
    return Fit(kind, values, float(np.abs(residual).max()), float(np.sqrt(np.mean(residual**2))))
