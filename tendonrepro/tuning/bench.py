"""The laws that are tuned, and the question: plants, loads, motions, knowledge, and what is measured.

All laws but super-twisting are parameter sets of `tendonrepro.physics.control.command`; docs/theory.md
derives why, and how laws follow from one another. Gains in `PER_JOINT` have a value for each joint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from tendonrepro.arrays import Array, choose, times
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.control import SECOND
from tendonrepro.configuration.models.readings import parse_reading, under
from tendonrepro.errors import UsageError, did_you_mean
from tendonrepro.experiments.loops import Once, build_law, run_loop
from tendonrepro.experiments.rig import build_plant, start_angles
from tendonrepro.experiments.user_law import UserLaw, lane_function
from tendonrepro.physics.arm import bias_torque, mass_matrix
from tendonrepro.physics.control import Law, Memory, Surface, error_rate, estimator_weights, polynomial
from tendonrepro.physics.drive import to_joint_matrix
from tendonrepro.physics.dynamics import Plant, load_at_rest
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.physics.trajectory import Motion, minimum_jerk, motion, smooth_sine
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import CommandFunction, DesiredMotion, Loop, TimeDelayController


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


# As published a law knows nothing of the arm, and differences positions for its velocity. Where all is known
# it is given the torque of all but dry friction along the desired motion, and velocities are filtered.
CONDITIONS = PUBLISHED, KNOWN = "as published", "all known"

PAYLOAD = 0.2  # kg, as in section 5.4, where no run has one
HELD_OUT_SHARE = 0.5  # of the payload, in the held-out run
LESS_DAMPING = 0.5  # of the tendons, over the plant's own, in the run that the stability margin asks for
COUNTS = 2.0  # fast error, RMS in encoder counts, up to which a run is not ringing but counting

TUNED, ALL_RUNS = 3, 4  # loops of a plant that are tuned on, and all; the last is the held-out one

# Up and down by 33 deg as the plain arm, a fifth faster than the box allows, so that a run is short.
_STROKE, _PERIOD = np.radians(33.0), 2.4
# Held out is another shape: a sine between 0 and 40 deg that begins softly.
_HALF_SINE, _SINE_PERIOD = np.radians(20.0), 2.5


def _motions(config: CompareConfig) -> Iterator[DesiredMotion]:
    """Yield the motion of tuning and the held-out one, with strokes by which no link comes near upright."""
    n, L = len(config.joints), config.sampling_period.si
    most = float(0.9 * (np.pi - start_angles(config).max()) / n)
    half = min(_HALF_SINE, most / 2.0)
    for shape, period in (
        (minimum_jerk(min(_STROKE, most), _PERIOD / 2.0, 0.0), _PERIOD),
        (smooth_sine(half, half, _SINE_PERIOD, _SINE_PERIOD / 2.0), 2.0 * _SINE_PERIOD),
    ):
        time: Array = L * np.arange(round(period / L) + 1.0)
        yield DesiredMotion(time, *motion(time, [Motion((shape,), period)] * n), period)


class TrialPlants(NamedTuple):
    """One draw as loops to run in, and what laws are made of.

    Loops are without payload, with it, and without it at `LESS_DAMPING`; then with the held-out payload and
    motion. `controllers` are 1 to 3 with the gains and readings of the configuration, `alpha` (n,) is the
    weight of the first; `newest` is the weight of the newest value where velocities are filtered. `known` is
    what `known_along` gives for the motion of tuning and for the held-out one.
    """

    loops: tuple[Loop, ...]
    controllers: Mapping[str, Law]
    alpha: Array
    newest: float
    known: Sequence[tuple[Array, Array]]


class Candidate(NamedTuple):
    """A law with gains, under a condition; where it is one of the configuration, `given` is all of it."""

    law: TunedLaw
    condition: str
    gains: Gains
    given: Law | None = None


class Performance(NamedTuple):
    """Of C candidates in R runs: mean absolute error (C, R, n), rad, roughness (C,), N m, stability (C, R).

    Roughness is the RMS change of torque in a sample, in the rougher of the first two runs.
    """

    mae: Array
    roughness: Array
    stable: NDArray[np.bool_]


def posed(config: CompareConfig) -> TrialPlants:
    """A configuration with the motions and loads of the tuning; its own motion is not looked at.

    Nor is its ``errors_from``, which speaks of that motion: errors are of the whole of these.
    """
    config = config.model_copy(update={"errors_from": None})
    motions = [*_motions(config)]
    own = run_loop(config, next(iter(config.runs)), motions[0], Once())
    payload = max(run.payload.si for run in config.runs.values()) or PAYLOAD
    bare, carrying, other = (build_plant(config, mass) for mass in (0.0, payload, HELD_OUT_SHARE * payload))
    weak = bare._replace(drive=bare.drive._replace(damping=LESS_DAMPING * bare.drive.damping))
    loops = [replace(own, plant=plant) for plant in (bare, carrying, weak)]
    filtering = under(parse_reading("error_rate=low_pass"), config, {})
    return TrialPlants(
        loops=(*loops, replace(own, plant=other, reference=motions[1])),
        controllers={name: build_law(config, name) for name in CONTROLLERS},
        alpha=config.control.gains.alpha.si,
        newest=build_law(filtering, SECOND).rate_filter,
        known=[known_along(bare, along) for along in motions],
    )


def known_along(plant: Plant, along: DesiredMotion) -> tuple[Array, Array]:
    """What is known along a motion: torque, N m (T, n), and map of the law's torques (n, n)."""
    q, dq, ddq = along.q_d.T, along.dq_d.T, along.ddq_d.T
    weight, drive = load_at_rest(q, plant), plant.drive
    inertia = to_joint_matrix(drive.inertia, drive.S_inv)
    viscous = to_joint_matrix(drive.friction.viscous, drive.S_inv) + np.diag(plant.link_friction.viscous)
    moving = bias_torque(q, dq, plant.arm) - bias_torque(q, 0.0 * dq, plant.arm)
    M = np.moveaxis(mass_matrix(q, plant.arm), -1, 0) + inertia
    torque = weight.T + moving.T + np.einsum("tij,jt->ti", M, ddq) + dq.T @ viscous.T
    middle = M[M.shape[0] // 4]
    return torque, middle / np.mean(np.diag(middle))


def loops_of(plants: TrialPlants, candidate: Candidate, runs: int = TUNED) -> list[Loop]:
    """Loops of the first so many runs; runs of one motion share what a law is given."""
    law, command = _law_under(plants, candidate), candidate.law.command
    controller = TimeDelayController(law, command, on_lanes=command is not None)
    given = [plants.loops[0].reference, plants.loops[-1].reference]
    if candidate.condition == KNOWN:
        for place, reference in enumerate(given[: 1 + (runs == ALL_RUNS)]):
            torque, _ = plants.known[place]
            extra = _entering(torque, law, increments=command is None) @ law.from_joint.T / law.M_bar
            given[place] = replace(reference, ddq_d=reference.ddq_d + extra)
    return [
        replace(loop, controller=controller, reference=given[k == ALL_RUNS - 1])
        for k, loop in enumerate(plants.loops[:runs])
    ]


def _law_under(plants: TrialPlants, candidate: Candidate) -> Law:
    law = candidate.given or candidate.law.law(plants.controllers[SECOND], candidate.gains, plants.alpha)
    weight, to_joint = 1.0, np.eye(plants.alpha.size)
    if candidate.condition == KNOWN:
        weight, (_, to_joint) = plants.newest, plants.known[0]
    from_joint = np.asarray(np.linalg.inv(to_joint), dtype=np.float64)
    return law._replace(rate_filter=weight, ddq_filter=weight, to_joint=to_joint, from_joint=from_joint)


def _entering(torque: Array, law: Law, *, increments: bool) -> Array:
    """What to add to a law's torque (T, n) so that a known torque acts from the start.

    An estimator holds past torque already, and is given only what is new.
    """
    first = np.broadcast_to(torque[0], torque.shape)
    if not increments:
        return np.asarray(torque - first)
    past = (np.concatenate([first[:back], torque[:-back]]) for back in (law.lag, 2 * law.lag))
    past_torque = sum(weight * part for weight, part in zip(law.weights, past, strict=True))
    keeps = 1.0 - law.estimate_filter
    return np.asarray(
        torque - lfilter([1.0 - keeps], [1.0, -keeps], past_torque, axis=0, zi=keeps * first[:1])[0]
    )


def measure(plants: TrialPlants, candidates: Sequence[Candidate], runs: int = TUNED) -> Performance:
    """Run candidates on one draw, in the first so many runs."""
    loops = [loop for candidate in candidates for loop in loops_of(plants, candidate, runs)]
    batch = simulate_batch(loops)
    shape = len(candidates), runs, -1
    names = ("mae", "rmse", "fast_share", "torque_step_rms")
    mae, rmse, share, steps = (batch.statistics[name].reshape(shape) for name in names)
    # A tuned law errs by a count or so, and fast for that reason alone.
    loud = (rmse * np.sqrt(share) > COUNTS * plants.loops[0].joint_encoder.resolution).any(axis=2)
    status = batch.status.reshape(shape[:2])
    stable = (status == STATUSES.index("ok")) | (status == STATUSES.index("ringing")) & ~loud
    return Performance(mae, np.sqrt(np.mean(steps[:, :2] ** 2, axis=2)).max(axis=1), stable)


def as_published(plants: TrialPlants, condition: str = PUBLISHED) -> dict[str, Candidate]:
    """Controllers 1 to 3 with the gains and readings of the configuration, as published or a user's."""
    candidates = {}
    for name, kind in zip(CONTROLLERS, ("alpha_published", "ntsm", "tsm"), strict=True):
        law, given = LAWS[kind], plants.controllers[name]
        gains = {gain: getattr(given, gain) for gain in law.gains}
        candidates[name] = Candidate(law, condition, gains, given)
    return candidates


def usable(plants: TrialPlants) -> bool:
    """Whether these gains are stable, with and without payload."""
    return bool(measure(plants, [*as_published(plants).values()]).stable[:, :2].all())
