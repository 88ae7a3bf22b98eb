"""Which of the simulator's shapes a recorded motion has, by least squares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.motion.record import Recorded, noise_peak
from tendonrepro.dataset.motion.reference_turns import Turns, amplitude_of, movers, turns_of
from tendonrepro.dataset.motion.shapes import (
    ANGLES,
    OUT_AND_BACK,
    PER_JOINT,
    POSITIVE,
    UNITS,
    Values,
    curve,
    rounded,
)

HALF_COUNT = float(np.deg2rad(0.011))
"""Half of the encoder's printed resolution, rad."""

_ROUGH, _FINE = (400, 1e-8), (1500, 1e-15)
"""Most samples, and tolerance, of a search from every guess and of the one from the best."""
_CLOSE = 5.0
"""Residual, over the smallest of all shapes, up to which a shape is searched for finely."""
_ROUNDER = 1.01
"""Growth of the residual that rounder numbers may cost."""


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

    def parameters(self) -> dict[str, Any]:
        """Parameters in a configuration's units."""
        known = {name: value for name, value in self.values.items() if name in UNITS}
        return {
            name: np.round(np.rad2deg(value) if name in ANGLES else value, 9).tolist()
            for name, value in known.items()
        }


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
        else judged(record, kind, cycles[kind], _physical(values))
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
    sizes = [judged(record, kind, turns, _physical(values)).rms for values in solved]
    best = int(np.argmin(sizes))
    return sizes[best], solved[best]


def _fine(record: Recorded, kind: str, turns: Turns | None, values: Values) -> Fit:
    """Fit with numbers as round as its residual allows."""
    best = judged(record, kind, turns, _physical(_solved(record, kind, turns, values, *_FINE)))
    for digits in range(1, 8):
        values = rounded(best.values, digits)
        if any(values.get(name) == 0.0 for name in POSITIVE):
            continue
        rounder = judged(record, kind, turns, values)
        if rounder.largest <= _ROUNDER * best.largest + 1e-9 and rounder.rms <= _ROUNDER * best.rms + 1e-9:
            return rounder
    return best


@dataclass(frozen=True, eq=False)
class _Free:
    """Which numbers of a shape's parameters are searched for; a zero of the guess stays zero.

    Parameters
    ----------
    guess : dict
        Parameters to start from, of a ramp by ``rise`` and ``share``.
    masks : mapping of str to bool array
    """

    guess: Values
    masks: Mapping[str, NDArray[np.bool_]]

    @classmethod
    def of(cls, record: Recorded, kind: str, guess: Values) -> _Free:
        """Numbers of a guess, and the start angles: a rounded or noisy first angle shifts all others."""
        guess = {"start": np.zeros(record.q.shape[1])} | guess
        inexact = record.rounding > 0.0 or noise_peak(record) > 0.1 * HALF_COUNT
        masks = {name: np.atleast_1d(value) != 0.0 for name, value in guess.items()}
        masks["delay"] = np.ones(1, bool)
        masks["start"] = np.full(record.q.shape[1], inexact and kind != "sine")
        return cls(guess, masks)

    def numbers(self) -> Array:
        """Guess of the free numbers, (m,)."""
        return np.concatenate([np.atleast_1d(self.guess[name])[mask] for name, mask in self.masks.items()])

    def bounds(self, record: Recorded) -> tuple[Array, Array]:
        """Lower and upper bounds of the free numbers, each (m,)."""
        end = float(record.time[-1])
        known = {"delay": (-2.0 * record.step, end), "share": (1e-3, 0.5), "hold": (0.0, end)}
        times = dict.fromkeys(("period", "rise", "blend"), (2.0 * record.step, 2.0 * end))
        every = known | times | dict.fromkeys(PER_JOINT, (-20.0, 20.0))
        pairs = [every[name] for name, mask in self.masks.items() for _ in range(mask.sum())]
        low, high = np.array(pairs).T
        return low, high

    def values(self, numbers: Array) -> Values:
        """Parameters with the free numbers put in."""
        ends = np.cumsum([mask.sum() for mask in self.masks.values()])
        found: Values = {}
        for (name, mask), part in zip(self.masks.items(), np.split(numbers, ends[:-1]), strict=True):
            filled = np.zeros(len(mask))
            filled[mask] = part
            found[name] = filled if name in PER_JOINT else float(filled[0])
        return found


def _solved(
    record: Recorded, kind: str, turns: Turns | None, guess: Values, samples: int, tolerance: float
) -> Values:
    from scipy.optimize import least_squares

    time, q = record.samples()
    every = -(-len(time) // samples)
    time, q = time[::every], q[::every]
    free = _Free.of(record, kind, guess)
    low, high = free.bounds(record)

    def residual(numbers: Array) -> Array:
        return np.ravel(curve(kind, _physical(free.values(numbers)), turns, time) - q)

    solved = least_squares(
        residual,
        np.clip(free.numbers(), low + 1e-9, high - 1e-9),
        bounds=(low, high),
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=tolerance,
        max_nfev=40,
    )
    return free.values(solved.x)


def _physical(values: Values) -> Values:
    """Replace rise and share of a ramp by the limits of velocity and acceleration they mean."""
    if "share" not in values:
        return values
    rise, share, size = values["rise"], values["share"], np.abs(values["amplitude"]).max()
    velocity = size / (rise * (1.0 - share))
    kept = {name: value for name, value in values.items() if name not in ("rise", "share")}
    return kept | {"velocity": float(velocity), "acceleration": float(velocity / (share * rise))}


def judged(record: Recorded, kind: str, turns: Turns | None, values: Values) -> Fit:
    """Residual of a shape with given parameters."""
    time, q = record.samples()
    residual = curve(kind, values, turns, time) - q
    return Fit(kind, values, float(np.abs(residual).max()), float(np.sqrt(np.mean(residual**2))))
