"""The laws that are tuned, bounds of their gains, and how laws follow from one another.

All but super-twisting are parameter sets of `tendonrepro.physics.control.command`; docs/theory.md derives
why. Gains in `PER_JOINT` have a value for each joint.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array, choose, times
from tendonrepro.errors import UsageError, did_you_mean
from tendonrepro.experiments.user_law import UserLaw, lane_function
from tendonrepro.physics.control import Law, Memory, Surface, error_rate, estimator_weights, polynomial
from tendonrepro.simulation.loop import CommandFunction


class Range(NamedTuple):
    """Bounds of a gain and where searches start; positive gains are searched by their logarithm."""

    low: float
    high: float
    start: float

    def value(self, x: Array) -> Array:
        """Value at a place between the bounds, from 0 to 1."""
        if self.low > 0.0:
            return np.asarray(self.low * (self.high / self.low) ** x)
        return np.asarray(self.low + (self.high - self.low) * x)

    def place(self, value: float | Array) -> Array:
        """Where between the bounds a value is; outside below 0 or above 1."""
        if self.low > 0.0:
            return np.asarray(np.log(value / self.low) / np.log(self.high / self.low))
        return np.asarray((value - self.low) / (self.high - self.low))


# SI units. Bounds lie 1.5 decades and more around the published gains, but for the exponent.
RANGES: Mapping[str, Range] = {
    "M_bar": Range(3e-5, 1.0, 0.005),
    "lam": Range(1.0, 300.0, 30.0),
    "beta": Range(0.2, 300.0, 20.0),
    "eta": Range(0.2, 300.0, 20.0),
    "b": Range(0.5, 1.0, 0.9),
    "Delta": Range(1e-3, 0.5, 0.2),
    "K_d": Range(1.0, 600.0, 50.0),
    "K_p": Range(0.2, 9e4, 600.0),
    # Weight of the older estimate: interpolating is positive, extrapolating negative.
    "alpha": Range(-0.9, 0.9, 0.0),
    # Weight of the newest value in the observer's low-pass; 1 is none.
    "estimate_filter": Range(0.003, 1.0, 0.5),
    # Of super-twisting: of |s|^½, and of the integral of the sign.
    "k_1": Range(0.1, 300.0, 5.0),
    "k_2": Range(0.1, 3e3, 100.0),
}
PER_JOINT = frozenset({"M_bar", "alpha"})

# By name: arrays (n,) where a gain is per joint, else (1,).
Gains = Mapping[str, Array]
# The same, as other laws' gains give them: one number may stand for all.
Numbers = Mapping[str, float | Array]


def super_twisting(
    memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law
) -> tuple[Array, Array, Array, Array]:
    """Super-twisting law with equivalent control; its integral is kept where others keep their estimate.

    ``K_d`` holds ``k_1`` and ``K_p`` holds ``k_2``.
    """
    de = error_rate(memory, q, q_d, dq_d, law)
    s, tau, integral = np.empty_like(q), np.empty_like(q), np.empty_like(q)
    before = times(law.from_joint, memory.H_hat)
    for i in range(q.shape[0]):
        s[i] = de[i] + law.beta[i] * (q_d[i] - q[i])
        sign = choose(s[i] > 0.0, 1.0, choose(s[i] < 0.0, -1.0, 0.0))
        integral[i] = before[i] + law.L * law.M_bar[i] * law.K_p[i] * sign
        reach = law.K_d[i] * np.sqrt(abs(s[i])) * sign
        tau[i] = law.M_bar[i] * (ddq_d[i] + law.beta[i] * de[i] + reach) + integral[i]
    return times(law.to_joint, tau), times(law.to_joint, integral), s, de


@dataclass(frozen=True, eq=False)
class TunedLaw:
    """A law and what is tuned in it.

    Where `gains` have no ``alpha``, `alpha` is its ratio to the published one. `newest` is 0 for centred
    differences.
    """

    name: str
    title: str
    gains: Mapping[str, Range]
    surface: int = Surface.PD
    alpha: float = 0.0
    newest: int = 1
    command: CommandFunction | None = None

    def sizes(self, n: int) -> list[int]:
        """How many numbers each gain is."""
        return [n if name in PER_JOINT else 1 for name in self.gains]

    def values(self, unit: Array, n: int) -> Gains:
        """Gains at a point of the unit cube."""
        parts = np.split(unit, np.cumsum(self.sizes(n))[:-1])
        return {
            name: bounds.value(part) for (name, bounds), part in zip(self.gains.items(), parts, strict=True)
        }

    def unit(self, gains: Numbers, n: int) -> Array:
        """Point of the unit cube with these gains, or the nearest."""
        places = [bounds.place(gains[name]) for name, bounds in self.gains.items()]
        parts = [np.broadcast_to(place, size) for place, size in zip(places, self.sizes(n), strict=True)]
        return np.clip(np.concatenate(parts), 0.0, 1.0)

    def law(self, base: Law, gains: Gains, published: Array) -> Law:
        """Law with these gains; `published` (n,) is the paper's α."""
        own = {_FIELDS.get(name, name): value for name, value in gains.items()}
        alpha = own.pop("alpha", self.alpha * published)
        estimate_filter = float(own.pop("estimate_filter", np.ones(1))[0])
        tuned = {name: np.broadcast_to(own[name], base.M_bar.size) for name in own}
        return Law(**(base._asdict() | tuned))._replace(
            surface=int(self.surface),
            newest=self.newest,
            weights=estimator_weights(np.asarray(alpha)),
            rate_gain=tuned.get("eta", base.rate_gain),
            estimate_filter=estimate_filter,
        )


_FIELDS = {"k_1": "K_d", "k_2": "K_p"}  # of `Law`, for gains of another name


def _of(*names: str) -> dict[str, Range]:
    return {name: RANGES[name] for name in names}


_LINEAR, _NTSM = _of("M_bar", "K_d", "K_p"), _of("M_bar", "lam", "eta", "b", "Delta")
# Here M_bar is the gain of the whole feedback, not of an estimator that feeds back the torque.
_TWISTING = _of("M_bar", "beta", "k_1", "k_2") | {"M_bar": Range(3e-4, 10.0, 0.2)}

# The PID is plain TDC with centred differences: its derivative gain is M_bar / L, the proportional one
# M_bar K_d / L, the integral one M_bar K_p / L. With the model known it is computed torque.
_LAWS = (
    TunedLaw("pid", "PID", _LINEAR, newest=0),
    TunedLaw("tdc", "Plain TDC", _LINEAR),
    TunedLaw("dob", "Disturbance observer and PD", _LINEAR | _of("estimate_filter")),
    TunedLaw("tsm", "TDE and TSM", _of("M_bar", "lam", "beta"), Surface.TSM),
    TunedLaw("ntsm", "TDE and NTSM", _NTSM, Surface.NTSM),
    TunedLaw("alpha_published", "α-TDE and NTSM, published α", _NTSM, Surface.NTSM, 1.0),
    TunedLaw("alpha_extrapolating", "α-TDE and NTSM, extrapolating", _NTSM, Surface.NTSM, -1.0),
    TunedLaw("alpha_free", "α-TDE and NTSM, free α", _NTSM | _of("alpha"), Surface.NTSM),
    TunedLaw("super_twisting", "Super-twisting", _TWISTING, command=super_twisting),
)
LAWS = {law.name: law for law in _LAWS}


class Equivalence(NamedTuple):
    """How gains of one law, and the published α (n,), give another that does the same."""

    source: str
    target: str
    exact: bool
    change: Callable[[Gains, Array], Numbers]


def _slope(gains: Gains) -> Array:
    """Slope of the surface at zero error, s⁻¹."""
    gamma_1, _ = polynomial(gains["b"], gains["Delta"])
    return np.asarray(gains["eta"] * gamma_1)


def _linear(gains: Gains, slope: Array) -> Gains:
    return {"M_bar": gains["M_bar"], "K_d": gains["lam"] + slope, "K_p": gains["lam"] * slope}


def _scaled(gains: Gains, factor: Array) -> Gains:
    return {**gains, "M_bar": gains["M_bar"] * factor}


def _twisting(gains: Gains, ratio: float, s: float) -> Gains:
    """Super-twisting that is TSM's PI of the sliding variable, ``M_bar/L (s + lam ∫s)``, where that is `s`.

    Its ``M_bar`` is `ratio` times that of TSM.
    """
    reach = 1.0 / (SAMPLING_PERIOD * ratio)
    k_2 = reach * gains["lam"] * s
    return {**_scaled(gains, np.array(ratio)), "k_1": np.full(1, reach * s**0.5), "k_2": k_2}


SAMPLING_PERIOD = 1e-3  # s, as published; other periods only make the seeds of super-twisting worse

# In the order in which gains are handed on. An exact step makes the source a special case of the target,
# which may then not do worse; these come last, each after those that improve its source.
EQUIVALENCES: tuple[Equivalence, ...] = (
    Equivalence("ntsm", "alpha_published", False, lambda g, a: _scaled(g, 1.0 + a)),
    Equivalence("ntsm", "alpha_extrapolating", False, lambda g, a: _scaled(g, 1.0 - a)),
    Equivalence("alpha_published", "ntsm", False, lambda g, a: _scaled(g, 1.0 / (1.0 + a))),
    Equivalence("alpha_free", "ntsm", False, lambda g, _: _scaled(g, 1.0 / (1.0 + g["alpha"]))),
    Equivalence("ntsm", "tdc", False, lambda g, _: _linear(g, _slope(g))),
    Equivalence("tdc", "pid", False, lambda g, _: g),
    Equivalence("pid", "tdc", False, lambda g, _: g),
    Equivalence("tsm", "super_twisting", False, lambda g, _: _twisting(g, 10.0, 0.05)),
    Equivalence("tsm", "super_twisting", False, lambda g, _: _twisting(g, 100.0, 0.4)),
    Equivalence("tsm", "tdc", True, lambda g, _: _linear(g, g["beta"])),
    Equivalence("tsm", "ntsm", True, lambda g, _: {**g, "eta": g["beta"], "b": 1.0, "Delta": 0.2}),
    Equivalence("tdc", "dob", True, lambda g, _: {**g, "estimate_filter": 1.0}),
    Equivalence("ntsm", "alpha_free", True, lambda g, _: {**g, "alpha": 0.0}),
    Equivalence("alpha_published", "alpha_free", True, lambda g, a: {**g, "alpha": a}),
    Equivalence("alpha_extrapolating", "alpha_free", True, lambda g, a: {**g, "alpha": -a}),
)


_TUNABLE = frozenset({"M_bar", "lam", "eta", "b", "Delta", "beta", "K_d", "K_p"})


def _mistake_in(bounds: object) -> str:
    """What is wrong with a law's bounds, if anything is."""
    if not isinstance(bounds, dict) or not bounds:
        return "has no bounds for its gains"
    for name, ends in bounds.items():
        if name not in _TUNABLE:
            return f"has bounds of {name!r}, which is no gain{did_you_mean(name, sorted(_TUNABLE))}"
        if np.size(ends) != 2 or not 0.0 < ends[0] < ends[1]:
            return f"has bounds of {name} that are no range: {ends}"
    return ""


def tuned_user_law(own: UserLaw) -> TunedLaw:
    """A user's law, refused without bounds or if it asks for the plant."""
    function, _ = own.load()
    bounds = getattr(function, "bounds", {})
    if mistake := _mistake_in(bounds):
        names = ", ".join(sorted(_TUNABLE))
        hint = (
            f"give it {own.name}.bounds = {{'K_p': (1, 1000)}}: positive, the lower first, names of {names}"
        )
        raise UsageError(f"the law {own.name} {mistake}", where="--law", hint=hint)
    gains = {name: Range(low, high, float(np.sqrt(low * high))) for name, (low, high) in bounds.items()}
    return TunedLaw(own.name, own.name, gains, command=lane_function(own))
