"""Which of the simulator's shapes a recorded motion has, by least squares."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.reference_signal import Recorded, noise_peak
from tendonrepro.dataset.reference_turns import Turns, amplitude_of, movers, turns_of
from tendonrepro.trajectory import (
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
"""Half an encoder count, rad."""

_ROUGH, _FINE = (400, 1e-8), (1500, 1e-15)
"""Most samples, and tolerance, of a search from every guess and of the one from the best."""
OUT_AND_BACK = ("raised_cosine", "minimum_jerk", "trapezoidal")
"""Shapes that return to their start in every cycle."""

_CLOSE = 5.0
"""Residual, over the smallest of all shapes, up to which a shape is searched for finely."""
_ROUNDER = 1.01
"""Growth of the residual that rounder numbers may cost."""

Values: TypeAlias = dict[str, Any]
"""Times in s, angles (n,) in rad, rates in rad/s and rad/s²; ``delay`` is the rest before the motion."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A shape laid through a recorded motion.

    Parameters
    ----------
    kind : str
        As in a configuration.
    values : dict
        Its parameters.
    largest, rms : float
        Residual, rad.
    """

    kind: str
    values: Values
    largest: float
    rms: float


def limit(record: Recorded) -> float:
    """Largest residual of a shape that is named: half a count, half the record's step and its noise, rad."""
    return HALF_COUNT + 0.5 * record.rounding + noise_peak(record)


def fits(record: Recorded, period: float) -> list[Fit]:
    """Lay every shape through a recorded motion.

    Parameters
    ----------
    record : Recorded
    period : float
        Time after which it repeats, s; 0 if unknown.

    Returns
    -------
    list of Fit
        Best first; shapes that cannot be tried are left out.
    """
    turns = turns_of(record)
    guesses: dict[str, Iterator[Values]] = {}
    if turns is not None:
        guesses = {kind: _guesses(kind, record, turns) for kind in OUT_AND_BACK}
    if period > 0.0:
        guesses["sine"] = _sines(record, period)
    cycles = {kind: turns if kind in OUT_AND_BACK else None for kind in guesses}
    rough = {kind: _rough(record, kind, cycles[kind], guesses[kind]) for kind in guesses}
    closest = min((rms for rms, _ in rough.values()), default=0.0)
    found = [
        _fine(record, kind, cycles[kind], values)
        if rms <= _CLOSE * closest
        else _judged(record, kind, cycles[kind], _physical(values))
        for kind, (rms, values) in rough.items()
    ]
    return sorted(found, key=lambda fit: fit.rms)


def _guesses(kind: str, record: Recorded, turns: Turns) -> Iterator[Values]:
    amplitude = np.where(np.isin(np.arange(record.q.shape[1]), movers(amplitude_of(record))), 1.0, 0.0)
    amplitude = amplitude * amplitude_of(record)
    away = turns.end - turns.begin
    if kind == "raised_cosine":
        period = turns.cycle or away / 0.91
        yield {"delay": turns.begin - 0.045 * period, "amplitude": amplitude, "period": period}
        return
    if kind == "minimum_jerk":
        rise = turns.rise / 0.73
        hold = max((turns.cycle or away + 0.27 * rise) / 2.0 - rise, 1e-3)
        yield {"delay": turns.begin - 0.136 * rise, "amplitude": amplitude, "rise": rise, "hold": hold}
        return
    for share in (0.1, 0.3, 0.49):
        rise = 1.15 * turns.rise
        hold = max((turns.cycle or away) / 2.0 - rise, 1e-3)
        delay = turns.begin - 0.1 * rise
        yield {"delay": delay, "amplitude": amplitude, "rise": rise, "share": share, "hold": hold}


def _sines(record: Recorded, period: float) -> Iterator[Values]:
    """Guesses from the last period, where the blend is over."""
    first, _ = record.moving()
    begin, late = float(record.time[first]), record.time >= record.time[-1] - period
    phase = 2.0 * np.pi / period * (record.time[late] - begin)
    parts = np.column_stack([np.ones_like(phase), np.sin(phase), np.cos(phase)])
    offset, along, across = np.linalg.lstsq(parts, record.q[late], rcond=None)[0]
    main = int(np.argmax(np.hypot(along, across)))
    for turn in (0.0, np.pi):
        shift = np.arctan2(across[main], along[main]) + turn
        back = (shift + np.pi) % (2.0 * np.pi) - np.pi
        amplitude = along * np.cos(shift) + across * np.sin(shift)
        for blend in (0.25, 0.5, 1.0):
            times = {"delay": begin - back * period / (2.0 * np.pi), "period": period}
            yield times | {"amplitude": amplitude, "offset": offset, "blend": blend * period}


def _rough(
    record: Recorded, kind: str, turns: Turns | None, guesses: Iterator[Values]
) -> tuple[float, Values]:
    """Best result over the guesses, and its RMS residual."""
    solved = [_solved(record, kind, turns, guess, *_ROUGH) for guess in guesses]
    sizes = [_judged(record, kind, turns, _physical(values)).rms for values in solved]
    best = int(np.argmin(sizes))
    return sizes[best], solved[best]


def _fine(record: Recorded, kind: str, turns: Turns | None, values: Values) -> Fit:
    """Fit with numbers as round as its residual allows."""
    best = _judged(record, kind, turns, _physical(_solved(record, kind, turns, values, *_FINE)))
    for digits in range(1, 8):
        rounded = _rounded(best.values, digits)
        if any(rounded.get(name) == 0.0 for name in _POSITIVE):
            continue
        rounder = _judged(record, kind, turns, rounded)
        if rounder.largest <= _ROUNDER * best.largest + 1e-9 and rounder.rms <= _ROUNDER * best.rms + 1e-9:
            return rounder
    return best


def _solved(
    record: Recorded, kind: str, turns: Turns | None, guess: Values, samples: int, tolerance: float
) -> Values:
    from scipy.optimize import least_squares

    every = -(-len(record.time) // samples)
    time, q = record.time[::every], record.q[::every]
    # The first angle of a rounded or noisy record is off, and with it all others.
    guess = {"start": np.zeros(q.shape[1])} | guess
    free = {name: np.atleast_1d(value) != 0.0 for name, value in guess.items()}
    free["delay"] = np.ones(1, bool)
    inexact = record.rounding > 0.0 or noise_peak(record) > 0.1 * HALF_COUNT
    free["start"] = np.full(q.shape[1], inexact and kind != "sine")

    def unpacked(numbers: Array) -> Values:
        filled, k = {}, 0
        for name, mask in free.items():
            values = np.zeros(len(mask))
            values[mask] = numbers[k : k + mask.sum()]
            k += mask.sum()
            filled[name] = values if name in _PER_JOINT else float(values[0])
        return filled

    start = np.concatenate([np.atleast_1d(guess[name])[mask] for name, mask in free.items()])
    low, high = _bounds(free, record)
    start = np.clip(start, low + 1e-9, high - 1e-9)

    def residual(numbers: Array) -> Array:
        return np.ravel(curve(kind, _physical(unpacked(numbers)), turns, time) - q)

    solved = least_squares(
        residual,
        start,
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=40,
    )
    return unpacked(solved.x)


def _bounds(free: Mapping[str, Array], record: Recorded) -> tuple[Array, Array]:
    end = float(record.time[-1])
    known = {"delay": (-2.0 * record.step, end), "share": (1e-3, 0.5), "hold": (0.0, end)}
    times = dict.fromkeys(("period", "rise", "blend"), (2.0 * record.step, 2.0 * end))
    angles = dict.fromkeys(_PER_JOINT, (-20.0, 20.0))
    every = known | times | angles
    low, high = zip(*(every[name] for name, mask in free.items() for _ in range(mask.sum())), strict=True)
    return np.array(low), np.array(high)


def _physical(values: Values) -> Values:
    """Replace rise and share of a ramp by the limits of velocity and acceleration they mean."""
    if "share" not in values:
        return values
    rise, share, size = values["rise"], values["share"], np.abs(values["amplitude"]).max()
    velocity = size / (rise * (1.0 - share))
    kept = {name: value for name, value in values.items() if name not in ("rise", "share")}
    return kept | {"velocity": float(velocity), "acceleration": float(velocity / (share * rise))}


def _judged(record: Recorded, kind: str, turns: Turns | None, values: Values) -> Fit:
    residual = curve(kind, values, turns, record.time) - record.q
    return Fit(kind, values, float(np.abs(residual).max()), float(np.sqrt(np.mean(residual**2))))


_PER_JOINT = ("amplitude", "offset", "start")
_POSITIVE = ("period", "rise", "blend", "velocity", "acceleration")
ANGLES = (*_PER_JOINT, "velocity", "acceleration")
"""Parameters whose unit holds an angle; they are round in degrees."""


def _rounded(values: Values, digits: int) -> Values:
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
