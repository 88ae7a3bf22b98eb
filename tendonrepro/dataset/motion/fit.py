"""Which of the simulator's shapes a recorded motion has, by least squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import Recorded, noise_peak
from tendonrepro.dataset.motion.shapes import (
    PER_JOINT,
    Turns,
    Values,
    amplitude_of,
    curve,
    movers,
    ramp_limits,
    turns_of,
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
