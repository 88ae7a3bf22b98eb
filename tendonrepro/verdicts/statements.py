"""Plants as the rules see them, and the paper's claims as statements that hold or fail on each of them.

docs/verdicts.md explains every rule.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.control import FIRST, LOADED, SECOND
from tendonrepro.configuration.models.readings import PRINTED, Reading, reading
from tendonrepro.configuration.published import Published, row_of
from tendonrepro.console import count_of
from tendonrepro.errors import DataMissingError
from tendonrepro.monte_carlo.data import CaseName
from tendonrepro.monte_carlo.shares import Share, Spread, share_of, spread_of
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.from_print import INCREASES, formula_of
from tendonrepro.verdicts.rules import MOST_UNRESOLVED, SIMILAR, Mask

OK, UNRESOLVED = STATUSES.index("ok"), STATUSES.index("unresolved")
"""Status codes."""

SHAPE = "rmse/mae"


class RunUnder(NamedTuple):
    """A run under a reading or variation of its own, such as with half of M_bar."""

    run: str
    reading: Reading

    def __str__(self) -> str:
        return f"{self.run}@{self.reading.name}"


Run: TypeAlias = str | RunUnder
"""A run under the reading that is judged, by its name, or under one of its own."""


class PlantTable(Protocol):
    """Runs of N plants by their readings: all draws of an ensemble, or the one arm that was measured."""

    @property
    def joints(self) -> tuple[int, ...]:
        """The moving joints, n of them."""

    @property
    def replicate(self) -> NDArray[np.int64]:
        """Scrambling of each plant, (N,)."""

    def has(self, run: str, reading: str) -> bool:
        """Whether there is such a run."""

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status codes, (N,); else a DataMissingError."""

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One of `results.summary.STATISTICS`, SI, (N, n); else a DataMissingError."""


class Plants:
    """The N plants of a table under one reading, with intervals from their scramblings.

    `looked_up` are the statistics that were asked for, by run and name.
    """

    def __init__(self, table: PlantTable, reading: str) -> None:
        self.joints = table.joints
        self.reading = reading
        self._table = table
        # Claims ask for the same statistics, which a large ensemble reads from all its files.
        self.looked_up: dict[tuple[Run, str], Array] = {}
        self._statuses: dict[Run, NDArray[np.int8]] = {}

    def has(self, run: Run) -> bool:
        """Whether there is such a run."""
        return self._table.has(*self._case(run))

    def status(self, run: Run) -> NDArray[np.int8]:
        """Status codes of a run, (N,); else a DataMissingError."""
        if run not in self._statuses:
            self._statuses[run] = self._table.status(*self._case(run))
        return self._statuses[run]

    def __getitem__(self, key: tuple[Run, str]) -> Array:
        """Statistic (N, n) by (run, name), SI, `SHAPE` too; else a DataMissingError."""
        run, name = key
        if name == SHAPE:
            return np.asarray(self[run, "rmse"] / self[run, "mae"])
        if key not in self.looked_up:
            self.looked_up[key] = self._table.statistic(*self._case(run), name)
        return self.looked_up[key]

    def ok(self, *runs: Run) -> Mask:
        """Where all these runs are ``ok``."""
        return np.asarray(np.logical_and.reduce([self.status(run) == OK for run in runs]))

    def resolved(self, *runs: Run) -> Mask:
        """Where all these runs could be integrated."""
        return np.asarray(np.logical_and.reduce([self.status(run) != UNRESOLVED for run in runs]))

    def share(self, holds: Mask, counted: Mask) -> Share:
        """Share of the plants counted (N,) on which something holds (N,)."""
        return share_of(holds[counted], self._table.replicate[counted])

    def spread(self, values: Array, counted: Mask) -> Spread:
        """Spread of values (N,) over the plants counted (N,)."""
        return spread_of(values[counted], self._table.replicate[counted])

    def _case(self, run: Run) -> CaseName:
        return (run.run, run.reading.name) if isinstance(run, RunUnder) else (run, self.reading)


AS_PRINTED, IDEAL, HALVED = reading({}), reading({"encoder": "ideal"}), reading({"M_bar": "halved"})
SHORTER, LONGER = reading({"sampling_period": "0.5ms"}), reading({"sampling_period": "2ms"})
IDEAL_SHORTER = reading({"encoder": "ideal", "sampling_period": "0.5ms"})
IDEAL_LONGER = reading({"encoder": "ideal", "sampling_period": "2ms"})

RIVALS = CONTROLLERS[1:]
ERRORS: Mapping[str, str] = {"mae": "MAE", "rmse": "RMSE"}
ORDERED: Mapping[str, Mapping[str, str]] = {"order": ERRORS, "rising_shape": {SHAPE: "RMSE/MAE"}}
"""Statistics by which rules put controllers in order."""
SIZES: Mapping[str, str] = {"rms": "RMS", "peak": "peak", "slow": "course below 3 Hz"}
"""What a reader of a plot may mean by the size of a signal, by words in names of statistics."""

ONE_OBSERVATION = "C5 and C6 are one observation: tau_m - H_hat = M_bar u is small"


@dataclass(frozen=True)
class Statement:
    """A statement, the plants (N,) on which it holds, and the measure of its claim."""

    text: str
    holds: Mask
    measure: str = ""


@dataclass(frozen=True)
class Claim:
    """A claim as statements, and the plants that it judges.

    `opposite`, where given, replaces that no statement holds. `beside` does not count. `untestable` says why
    no plant can tell.
    """

    statements: Sequence[Statement]
    judged: Mask
    remarks: Sequence[str] = ()
    opposite: Statement | None = None
    beside: Sequence[Statement] = ()
    untestable: str | None = None

    @property
    def measures(self) -> Mapping[str, Sequence[Statement]]:
        """Statements by measure; a claim holds by one where all of its statements do."""
        names = dict.fromkeys(statement.measure for statement in self.statements)
        return {name: [part for part in self.statements if part.measure == name] for name in names}


def claim_on(plants: Plants, paper: Published, rule: str) -> Claim:
    """Apply a rule; nothing holds of a missing number."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return CLAIMS[rule](plants, paper)


def _each_joint(plants: Plants, text: str, holds: Mask, measure: str = "") -> list[Statement]:
    """One statement a joint, from a mask (N, n)."""
    return [
        Statement(f"joint {joint}: {text}", holds[:, i], measure) for i, joint in enumerate(plants.joints)
    ]


def smaller(
    plants: Plants, name: str, first: Run, second: Run, what: str, measure: str = ""
) -> list[Statement]:
    """`first` has the smaller statistic, on each joint."""
    holds = plants[first, name] < plants[second, name]
    return _each_joint(plants, f"{what} of {first} below that of {second}", holds, measure)


def direction(plants: Plants, paper: Published, identifier: str) -> Statement | None:
    """What a percentage claims besides its size; nothing of errors that are printed alike."""
    part, whole = formula_of(paper, identifier).errors
    sizes = [paper.number(error.id) for error in (part, whole)]
    if sizes[0] == sizes[1]:
        return None
    runs = (part.run, whole.run) if sizes[0] < sizes[1] else (whole.run, part.run)
    return smaller(plants, part.metric, *runs, ERRORS[part.metric])[plants.joints.index(part.joint)]


def together(statements: Sequence[Statement]) -> Mask:
    """Where all hold."""
    return np.asarray(np.logical_and.reduce([part.holds for part in statements]))


def stable(plants: Plants, _: Published) -> Claim:
    """C1: all controllers are ``ok``."""
    resolved = plants.resolved(*CONTROLLERS)
    statements = [Statement(f"{run} is ok", plants.ok(run)) for run in CONTROLLERS]
    untestable = None
    if resolved.mean() < 1.0 - MOST_UNRESOLVED:
        untestable = f"only {100.0 * resolved.mean():.3g} % of the plants could be integrated"
    return Claim(statements, resolved, untestable=untestable)


def in_order(plants: Plants, paper: Published, statistics: Mapping[str, str]) -> Claim:
    """C2 and F1: some statistics of Controllers 1 < 2 < 3, or what other order is printed."""
    printed = printed_order(paper, plants.joints, statistics) or CONTROLLERS
    best, n = printed[0], len(plants.joints)

    def ordered(pairs: Iterable[tuple[Run, Run]]) -> list[Statement]:
        return [
            statement
            for (first, second), (name, what) in product(pairs, statistics.items())
            for statement in smaller(plants, name, first, second, what)
        ]

    published = ordered(pairwise(printed))
    reverse = ordered(pairwise(reversed(printed)))
    last = ordered((other, best) for other in printed[1:])
    # Statements of joint i are every n-th.
    beside = [
        Statement(f"joint {joint}: {text}, by chance on 1/6", together(statements[i::n]))
        for i, joint in enumerate(plants.joints)
        for text, statements in (("complete order", published), ("complete reverse order", reverse))
    ]
    largest = f"{best} has the largest {' and '.join(statistics.values())} on all joints"
    beside.append(Statement(largest, together(last)))
    opposite = Statement("the complete reverse order on all joints", together(reverse))
    return Claim(published, plants.ok(*CONTROLLERS), opposite=opposite, beside=beside)


def printed_order(
    paper: Published, joints: Sequence[int], statistics: Iterable[str]
) -> tuple[str, ...] | None:
    """Controllers in the one order that all columns of some printed statistics have, the smallest first."""
    sizes = {}
    for run in CONTROLLERS:
        mae, rmse = (np.array(paper.per_joint(f"{row_of(run)}.{metric}", joints)) for metric in ERRORS)
        printed = {"mae": mae, "rmse": rmse, SHAPE: rmse / mae}
        sizes[run] = np.concatenate([printed[name] for name in statistics])
    order = sorted(CONTROLLERS, key=lambda run: sizes[run][0])
    rises = np.diff([sizes[run] for run in order], axis=0) > 0.0
    return tuple(order) if rises.all() else None


def joints_alike(plants: Plants, paper: Published) -> Claim:
    """F2: joint 3 over joint 2 errs at least as much as in the paper."""
    least = min(float(paper.interval(name)[0]) for name in paper.entries if name.startswith("joints."))
    first, last = plants.joints[0], plants.joints[-1]
    runs = (*CONTROLLERS, LOADED)
    statements = []
    for run, (name, what) in product(runs, ERRORS.items()):
        holds = plants[run, name][:, -1] / plants[run, name][:, 0] >= least
        text = f"{what} of {run} on joint {last} at least {least:.3f} of that on joint {first}"
        statements.append(Statement(text, holds))
    return Claim(statements, plants.ok(*runs))


def rapid_advantage(plants: Plants, _: Published) -> Claim:
    """C3: Controller 1 is ahead in rapid phases, and by more than elsewhere."""
    statements: list[Statement] = []
    for rival in RIVALS:
        rapid, calm = (plants[rival, name] - plants[FIRST, name] for name in ("mae_rapid", "mae_calm"))
        text = f"{FIRST} is better than {rival} in rapid phases"
        statements += _each_joint(plants, text, rapid > 0.0)
        text = f"the lead of {FIRST} over {rival} is larger there than elsewhere, its lag smaller"
        statements += _each_joint(plants, text, rapid > calm)
    return Claim(statements, plants.ok(*CONTROLLERS))


def similar_surfaces(plants: Plants, _: Published) -> Claim:
    """C4: s is of similar size."""
    statements: list[Statement] = []
    for name, what in (("s_rms", "RMS of s"), ("s_slow_rms", "RMS of s below 3 Hz")):
        holds = _similar([plants[run, name] for run in CONTROLLERS])
        text = f"the {what} of the three laws differ by at most {100.0 * SIMILAR:.0f} %"
        statements += _each_joint(plants, text, holds, what)
    return Claim(statements, plants.ok(*CONTROLLERS))


def _similar(sizes: Sequence[Array]) -> Mask:
    return np.asarray(np.min(sizes, axis=0) >= (1.0 - SIMILAR) * np.max(sizes, axis=0))


def estimate_size(plants: Plants, _: Published) -> Claim:
    """C5: Controller 1's estimate is smaller moving up, similar moving down."""
    statements: list[Statement] = []
    for size, measure in SIZES.items():
        statements += _smaller_up(plants, "H_hat", size)
        for rival in RIVALS:
            holds = _similar([plants[run, f"H_hat_{size}_down"] for run in (FIRST, rival)])
            text = f"moving down {measure} of H_hat of {FIRST} and {rival} are similar"
            statements += _each_joint(plants, text, holds, measure)
    return Claim(statements, plants.ok(*CONTROLLERS), remarks=[ONE_OBSERVATION])


def torque_size(plants: Plants, _: Published) -> Claim:
    """C6: Controller 1's torque is significantly smaller moving up, smaller and smoother overall."""
    statements: list[Statement] = []
    for size, measure in SIZES.items():
        statements += _smaller_up(plants, "torque", size, by=SIMILAR)
        for rival in RIVALS:
            statements += smaller(plants, f"torque_{size}", FIRST, rival, f"{measure} of torque", measure)
            statements += smaller(plants, "torque_step_rms", FIRST, rival, "RMS torque step", measure)
    return Claim(statements, plants.ok(*CONTROLLERS), remarks=[ONE_OBSERVATION])


def _smaller_up(plants: Plants, signal: str, size: str, by: float = 0.0) -> list[Statement]:
    statements: list[Statement] = []
    for rival in RIVALS:
        first, second = (plants[run, f"{signal}_{size}_up"] for run in (FIRST, rival))
        text = f"moving up {SIZES[size]} of {signal} of {FIRST} is smaller than that of {rival}"
        text += f" by more than {100.0 * by:.0f} %" if by else ""
        statements += _each_joint(plants, text, first < (1.0 - by) * second, SIZES[size])
    return statements


def payload(plants: Plants, paper: Published) -> Claim:
    """P1: the payload makes errors of Controller 1 larger, or smaller where that is printed."""
    changes = (direction(plants, paper, name) for name in paper.entries if name.startswith(INCREASES))
    statements = [change for change in changes if change is not None]
    if not statements:
        raise DataMissingError("a change with the payload in the print")
    # A bench may have run Controller 1 alone.
    return Claim(statements, plants.ok(*filter(plants.has, (*CONTROLLERS, LOADED))))


def better_estimate(plants: Plants, _: Published) -> Claim:
    """E1: Controller 1's estimate is better than Controller 2's."""
    statements: list[Statement] = []
    beside: list[Statement] = []
    first, second = (RunUnder(run, IDEAL) for run in (FIRST, SECOND))
    for name, what in (("epsilon_rms", "RMS of epsilon"), ("epsilon_slow_rms", "RMS of epsilon below 3 Hz")):
        statements += smaller(plants, name, FIRST, SECOND, what, what)
        if plants.reading == PRINTED and plants.has(first):
            text, holds = f"with an ideal encoder {what}", plants[first, name] < plants[second, name]
            beside += _each_joint(plants, f"{text} of {FIRST} below that of {SECOND}", holds)
            beside.append(Statement(f"both joints: {text}", np.asarray(holds.all(axis=1))))
    return Claim(statements, plants.ok(*CONTROLLERS), beside=beside)


def robustness(plants: Plants, _: Published) -> Claim:
    """E1a: where only one of Controllers 1 and 2 is ``ok``, it is 1."""
    first, second = plants.ok(FIRST), plants.ok(SECOND)
    resolved = plants.resolved(FIRST, SECOND)
    statements = [Statement(f"{FIRST} is ok and {SECOND} is not", first & ~second)]
    remark = (
        f"both are ok on {count_of(int((first & second).sum()), 'plant')} and neither on "
        f"{int((resolved & ~first & ~second).sum())}: these do not tell the two apart"
    )
    return Claim(statements, resolved & (first != second), [remark])


def delay_time(plants: Plants, _: Published) -> Claim:
    """E2: a smaller L is better for Controller 2, a larger one worse."""
    _check_printed(plants)
    published = (RunUnder(SECOND, SHORTER), SECOND, RunUnder(SECOND, LONGER))
    ideal = tuple(RunUnder(SECOND, way) for way in (IDEAL_SHORTER, IDEAL, IDEAL_LONGER))

    def along(periods: Sequence[Run], more: str) -> list[Statement]:
        return [
            statement
            for name, what in (("mae", "MAE"), ("epsilon_slow_rms", "RMS of epsilon below 3 Hz"))
            for shorter, longer in pairwise(periods)
            for statement in smaller(plants, name, shorter, longer, f"{more}{what}", what)
        ]

    statements, beside = along(published, ""), along(ideal, "with an ideal encoder ")
    shares = ", ".join(f"{100.0 * plants.ok(run).mean():.3g} %" for run in published)
    remark = (
        f"Controller 2 is ok on {shares} of the plants with the shorter, the printed and the longer period: "
        "what a shorter one costs in stability is no part of the claim"
    )
    return Claim(statements, plants.ok(*published, *ideal), remarks=[remark], beside=beside)


def small_inertia(plants: Plants, _: Published) -> Claim:
    """E2a: half of M̄ makes Controller 2's torque smoother."""
    _check_printed(plants)
    halved = RunUnder(SECOND, HALVED)
    statements = smaller(plants, "torque_step_rms", halved, SECOND, "RMS torque step")
    return Claim(statements, plants.ok(SECOND, halved))


def _check_printed(plants: Plants) -> None:
    """Refuse to compare a variation of the printed reading with a run under another."""
    if plants.reading != PRINTED:
        raise DataMissingError(f"variations of {SECOND} are run under reading {PRINTED!r} alone")


def overshoot(plants: Plants, paper: Published) -> Claim:
    """E3: Controller 1 overshoots less than Controller 2, or neither by more than an encoder step."""
    sizes = np.array([plants[run, "overshoot"] for run in (FIRST, SECOND)])
    neither = (sizes <= np.deg2rad(paper.number("hardware.encoder_resolution"))).all(axis=0)
    counted = np.isfinite(sizes).all(axis=(0, 2)) & ~neither.all(axis=1)
    less = smaller(plants, "overshoot", FIRST, SECOND, "overshoot")
    statements = [
        Statement(f"{statement.text}, or neither", statement.holds | resting)
        for statement, resting in zip(less, neither.T, strict=True)
    ]
    ok = plants.ok(*CONTROLLERS)
    remark = (
        f"left out: {count_of(int((ok & ~counted).sum()), 'plant')} without overshoot beyond an encoder count"
    )
    return Claim(statements, ok & counted, [remark])


def bounds(plants: Plants, paper: Published) -> Claim:
    """L1: Controller 1 stays inside the bounds of section 4.3."""
    printed = [RunUnder(run, AS_PRINTED) for run in CONTROLLERS]
    first = printed[0]
    lam, eta, b, Delta = (
        np.array(paper.per_joint(f"gain.{name}", plants.joints)) for name in ("lam", "eta", "b", "Delta")
    )
    omega = plants[first, "epsilon_max"] / lam
    error = np.minimum(Delta, (omega / eta) ** (1.0 / b))
    inside = {
        "|e| inside Eq. (30) as printed": plants[first, "max_error"] <= error,
        "|de/dt| inside Eq. (31)": plants[first, "rate_max"] <= omega + eta * error**b,
    }
    statements = [
        statement
        for text, holds in inside.items()
        for statement in _each_joint(plants, f"the largest {text}", holds)
    ]
    judged = plants.ok(*printed)
    remarks = ["judged under the reading printed, whatever the reading"]
    return Claim(statements, judged, remarks, untestable=_beyond_divergence(error[judged]))


def _beyond_divergence(bound: Array) -> str | None:
    """Why no plant could fail: it diverges before it reaches Eq. (30)."""
    limit = load_config(None, "compare").config.status.divergence_limit.si
    if (bound < limit).any():
        return None
    # With |s| <= Omega, an identity, Eq. (31) then follows from the definition of s.
    least, most = np.rad2deg([bound.min(initial=np.inf), limit])
    return (
        f"a rule that could fail: Eq. (30) leaves the error at least {least:.3g} deg on every plant, and "
        f"a run beyond {most:.3g} deg is diverged and not judged"
    )


CLAIMS: Mapping[str, Callable[[Plants, Published], Claim]] = {
    rule.__name__: rule
    for rule in (
        *(stable, joints_alike, rapid_advantage, similar_surfaces, estimate_size, torque_size, payload),
        *(better_estimate, robustness, delay_time, small_inertia, overshoot, bounds),
    )
} | {name: partial(in_order, statistics=statistics) for name, statistics in ORDERED.items()}
"""Rules of claims by name."""
