"""The paper's claims as statements that hold or fail on each plant of an ensemble."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from math import factorial
from typing import Any

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import Published
from tendonrepro.results.summary import CONTROLLERS, LOADS
from tendonrepro.verdicts.plants import DIVERGED, UNRESOLVED, Plants
from tendonrepro.verdicts.rules import SIMILAR, Mask

IDEAL = "encoder=ideal"
SHORTER, LONGER, HALVED = "sampling_period=0.5ms", "sampling_period=2ms", "M_bar=halved"

SIZES: Mapping[str, str] = {"rms": "RMS", "peak": "peak", "slow": "course below 3 Hz"}
"""What a reader of a plot may mean by the size of a signal, by words in the names of statistics."""

ONE_OBSERVATION = "C5 and C6 are one observation: tau_m - H_hat = M_bar u is small"

FIRST, SECOND, _ = CONTROLLERS
LOADED = LOADS["with_load"]


@dataclass(frozen=True)
class Statement:
    """Where a statement holds, plant by plant, read only where laws are judged.

    `last` is the same with a diverged law ranked last, `measure` the one of several ways to judge a claim
    that the statement belongs to.
    """

    text: str
    holds: Mask
    last: Mask
    measure: str = ""


@dataclass(frozen=True)
class Findings:
    """A claim's statements, the plants they are judged on, and those ranked with a diverged law last.

    `opposite` is a stated opposite of the whole claim, where it is more than that no statement holds;
    `beside` are statements that are shown and do not count; `chance` are the shares that laws which do not
    differ would give, for joints that are independent and for joints that go together; `cannot_fail` says
    why no plant judged could have failed.
    """

    statements: Sequence[Statement]
    judged: Mask
    rankable: Mask | None
    remarks: Sequence[str] = field(default=())
    opposite: Statement | None = None
    beside: Sequence[Statement] = field(default=())
    chance: tuple[float, float] | None = None
    cannot_fail: str | None = None

    @property
    def measures(self) -> Mapping[str, Sequence[Statement]]:
        """Statements by the measure they belong to; a claim holds by one when all of these do."""
        names = dict.fromkeys(statement.measure for statement in self.statements)
        return {name: [one for one in self.statements if one.measure == name] for name in names}


def together(text: str, statements: Sequence[Statement]) -> Statement:
    """Make one statement of several, that all of them hold."""
    holds, last = (
        np.logical_and.reduce([getattr(s, name) for s in statements]) for name in ("holds", "last")
    )
    return Statement(text, holds, last)


def smaller(
    plants: Plants, name: str, first: str, second: str, what: str, measure: str = ""
) -> Iterator[Statement]:
    """Yield, joint by joint, that a statistic of one run is strictly smaller than that of another."""
    yield from below(
        plants, {run: plants[run, name] for run in (first, second)}, first, second, what, measure
    )


def below(
    plants: Plants, sizes: Mapping[str, Array], first: str, second: str, what: str, measure: str = ""
) -> Iterator[Statement]:
    """Yield, joint by joint, that one run's size (N, n) is strictly smaller than another's."""
    with np.errstate(invalid="ignore"):
        holds = sizes[first] < sizes[second]
        last = plants.ranked(first, sizes[first]) < plants.ranked(second, sizes[second])
    for i, joint in enumerate(plants.joints):
        text = f"joint {joint}: {what} of {first} below that of {second}"
        yield Statement(text, holds[:, i], last[:, i], measure)


def _plain(plants: Plants, texts: str, holds: Mask, *runs: str, measure: str = "") -> Iterator[Statement]:
    """Yield a statement a joint that fails where a run it names diverged; ``{}`` stands for the joint."""
    alive = plants.none(DIVERGED, *runs)
    for i, joint in enumerate(plants.joints):
        yield Statement(texts.format(joint), holds[:, i], holds[:, i] & alive, measure)


def _among_controllers(plants: Plants, statements: Sequence[Statement], **more: Any) -> Findings:
    return Findings(statements, plants.ok(*CONTROLLERS), plants.rankable(*CONTROLLERS), **more)


def _by_chance(plants: Plants, orders: int) -> tuple[float, float]:
    """Shares on which laws that do not differ stand in one order of so many on every joint."""
    return float(orders) ** -len(plants.joints), 1.0 / orders


def stable(plants: Plants, _: Published) -> Findings:
    """C1: all controllers are ``ok``."""
    statements = [Statement(f"{run} is ok", plants.ok(run), plants.ok(run)) for run in CONTROLLERS]
    return Findings(statements, plants.none(UNRESOLVED, *CONTROLLERS), None)


def order(plants: Plants, _: Published) -> Findings:
    """C2: controllers 1 < 2 < 3 in both metrics."""
    sizes = {name: {run: plants[run, name] for run in CONTROLLERS} for name in ("mae", "rmse")}
    return _in_order(plants, {name.upper(): found for name, found in sizes.items()})


def rising_shape(plants: Plants, _: Published) -> Findings:
    """F1: RMSE/MAE of controllers 1 < 2 < 3."""
    return _in_order(plants, {"RMSE/MAE": {run: shape_of(plants, run) for run in CONTROLLERS}})


def joints_alike(plants: Plants, paper: Published) -> Findings:
    """F2: on the last joint every run errs, against the first, at least as much as the paper's runs do."""
    least = min(float(paper.interval(name)[0]) for name in paper.entries if name.startswith("joints."))
    first, last = plants.joints[0], plants.joints[-1]
    found = []
    for run, metric in product((*CONTROLLERS, LOADED), ("mae", "rmse")):
        with np.errstate(invalid="ignore"):
            holds = joints_apart(plants, run, metric) >= least
        text = f"{metric.upper()} of {run} on joint {last} at least {least:.3f} of that on joint {first}"
        found.append(Statement(text, holds, holds & plants.none(DIVERGED, run)))
    runs = (*CONTROLLERS, LOADED)
    return Findings(found, plants.ok(*runs), plants.rankable(*runs))


def joints_apart(plants: Plants, run: str, metric: str) -> Array:
    """Error of a run on the last joint over that on the first, (N,); NaN without error there."""
    sizes = plants[run, metric]
    ratio = np.full(len(sizes), np.nan)
    np.divide(sizes[:, -1], sizes[:, 0], out=ratio, where=sizes[:, 0] > 0.0)
    return ratio


def shape_of(plants: Plants, run: str) -> Array:
    """RMSE over MAE of a run, (N, n); NaN without error."""
    mae, rmse = plants[run, "mae"], plants[run, "rmse"]
    return np.divide(rmse, mae, out=np.full_like(mae, np.nan), where=mae > 0.0)


def _in_order(plants: Plants, sizes: Mapping[str, Mapping[str, Array]]) -> Findings:
    """Controllers 1 < 2 < 3 in sizes by name and run, each joint's order and its reverse beside."""
    found, reverse = (
        [
            statement
            for run, rival in pairwise(runs)
            for what, values in sizes.items()
            for statement in below(plants, values, run, rival, what)
        ]
        for runs in (CONTROLLERS, CONTROLLERS[::-1])
    )
    n = len(plants.joints)
    beside = [
        together(f"joint {joint}: {text}, by chance on 1/6", statements[i::n])
        for i, joint in enumerate(plants.joints)
        for text, statements in (("complete order", found), ("complete reverse order", reverse))
    ]
    opposite = together("the complete reverse order on all joints", reverse)
    return _among_controllers(
        plants, found, opposite=opposite, beside=beside, chance=_by_chance(plants, factorial(3))
    )


def rapid_advantage(plants: Plants, _: Published) -> Findings:
    """C3: Controller 1 is ahead in rapid phases, and its lead there larger than elsewhere."""
    found: list[Statement] = []
    for rival in CONTROLLERS[1:]:
        rapid, calm = (plants[rival, name] - plants[FIRST, name] for name in ("mae_rapid", "mae_calm"))
        with np.errstate(invalid="ignore"):
            there, larger = rapid > 0.0, rapid > calm
        text = f"joint {{}}: {FIRST} is better than {rival} in rapid phases"
        found += _plain(plants, text, there, FIRST, rival)
        text = f"joint {{}}: the lead of {FIRST} over {rival} is larger there than elsewhere, its lag smaller"
        found += _plain(plants, text, larger, FIRST, rival)
    return _among_controllers(plants, found)


def similar_surfaces(plants: Plants, _: Published) -> Findings:
    """C4: the RMS of s of the three differ by at most 5 %; twice as much stands beside."""
    measures = {"s_rms": "RMS of s", "s_slow_rms": "RMS of s below 3 Hz"}

    def within(limit: float) -> Iterator[Statement]:
        for name, measure in measures.items():
            sizes = np.array([plants[run, name] for run in CONTROLLERS])
            with np.errstate(invalid="ignore"):
                holds = sizes.min(axis=0) >= (1.0 - limit) * sizes.max(axis=0)
            text = f"joint {{}}: the {measure} of the three laws differ by at most {100.0 * limit:.0f} %"
            yield from _plain(plants, text, holds, *CONTROLLERS, measure=measure)

    return _among_controllers(plants, [*within(SIMILAR)], beside=[*within(2.0 * SIMILAR)])


def _smaller_up(plants: Plants, signal: str, size: str, *, by: float = 0.0) -> Iterator[Statement]:
    """Yield that Controller 1's signal is smaller than the rivals' moving up, by more than a share."""
    first = plants[FIRST, f"{signal}_{size}_up"]
    for rival in CONTROLLERS[1:]:
        with np.errstate(invalid="ignore"):
            holds = first < (1.0 - by) * plants[rival, f"{signal}_{size}_up"]
        what = f"moving up {SIZES[size]} of {signal} of {FIRST}"
        text = f"joint {{}}: {what} is smaller than that of {rival}"
        text += f" by more than {100.0 * by:.0f} %" if by else ""
        yield from _plain(plants, text, holds, FIRST, rival, measure=SIZES[size])


def estimate_size(plants: Plants, _: Published) -> Findings:
    """C5: Controller 1's estimate is smaller moving up, similar moving down."""
    found: list[Statement] = []
    for size, measure in SIZES.items():
        found += _smaller_up(plants, "H_hat", size)
        for rival in CONTROLLERS[1:]:
            pair = [plants[run, f"H_hat_{size}_down"] for run in (FIRST, rival)]
            with np.errstate(invalid="ignore"):
                holds = np.minimum(*pair) >= (1.0 - SIMILAR) * np.maximum(*pair)
            text = f"joint {{}}: moving down {measure} of H_hat of {FIRST} and {rival} are similar"
            found += _plain(plants, text, holds, FIRST, rival, measure=measure)
    return _among_controllers(plants, found, beside=_rest(plants, "H_hat", ""), remarks=[ONE_OBSERVATION])


def torque_size(plants: Plants, _: Published) -> Findings:
    """C6: Controller 1's torque is significantly smaller moving up, lower and smoother overall."""
    found: list[Statement] = []
    for size, measure in SIZES.items():
        found += _smaller_up(plants, "torque", size, by=SIMILAR)
        for rival in CONTROLLERS[1:]:
            found += smaller(plants, f"torque_{size}", FIRST, rival, f"{measure} of torque", measure)
            found += smaller(plants, "torque_step_rms", FIRST, rival, "RMS torque step", measure)
    return _among_controllers(
        plants, found, beside=_rest(plants, "torque", "_down"), remarks=[ONE_OBSERVATION]
    )


def _rest(plants: Plants, signal: str, phase: str) -> list[Statement]:
    """Comparisons of a phase of which the claim says nothing."""
    when = " moving down" if phase else " overall"
    return [
        statement
        for (size, measure), rival in product(SIZES.items(), CONTROLLERS[1:])
        for statement in smaller(
            plants, f"{signal}_{size}{phase}", FIRST, rival, f"{measure} of {signal}{when}"
        )
    ]


def payload(plants: Plants, _: Published) -> Findings:
    """P1: the payload makes the errors of Controller 1 larger, as printed."""
    # On a measurement the other controllers are not asked for; over the box all claims have the same plants.
    runs = (*CONTROLLERS, LOADED)
    found, chance = larger_with_load(plants), _by_chance(plants, 2)
    return Findings(found, plants.ok(*runs), plants.rankable(*runs), chance=chance)


def larger_with_load(plants: Plants) -> list[Statement]:
    """That the payload makes the errors of Controller 1 larger, in both metrics."""
    names = ("mae", "rmse")
    return [one for name in names for one in smaller(plants, name, FIRST, LOADED, name.upper())]


def better_estimate(plants: Plants, _: Published) -> Findings:
    """E1: the estimate of Controller 1 is better than that of Controller 2."""
    measures = {"epsilon_rms": "RMS of epsilon", "epsilon_slow_rms": "RMS of epsilon below 3 Hz"}
    found: list[Statement] = []
    beside: list[Statement] = []
    ideal = Plants(plants.data, IDEAL)
    for name, measure in measures.items():
        found += smaller(plants, name, FIRST, SECOND, measure, measure)
        if plants.reading == PRINTED and plants.data.has(FIRST, IDEAL):
            both = [*smaller(ideal, name, FIRST, SECOND, f"with an ideal encoder {measure}")]
            beside += [*both, together(f"both joints: with an ideal encoder {measure}", both)]
    return _among_controllers(plants, found, beside=beside, chance=_by_chance(plants, 2))


def robustness(plants: Plants, _: Published) -> Findings:
    """E1a: where one of Controllers 1 and 2 tracks and the other does not, it is Controller 1."""
    first, second = plants.ok(FIRST), plants.ok(SECOND)
    resolved = plants.none(UNRESOLVED, FIRST, SECOND)
    found = [Statement(f"{FIRST} is ok and {SECOND} is not", first & ~second, first & ~second)]
    remark = (
        f"both are ok on {int((first & second).sum())} plants and neither on "
        f"{int((resolved & ~first & ~second).sum())}: these do not tell the two apart"
    )
    return Findings(found, resolved & (first != second), None, [remark], chance=(0.5, 0.5))


def delay_time(plants: Plants, _: Published) -> Findings:
    """E2: a smaller L is better for Controller 2, a larger one worse, by error and estimate."""
    measures = {"mae": "MAE", "epsilon_slow_rms": "RMS of epsilon below 3 Hz"}
    published = (f"{SECOND}@{SHORTER}", SECOND, f"{SECOND}@{LONGER}")
    ideal = tuple(f"{SECOND}@{IDEAL}{period}" for period in (f"+{SHORTER}", "", f"+{LONGER}"))
    runs = (*published, *ideal)

    def along(chain: Sequence[str], more: str) -> Iterator[Statement]:
        for (name, what), pair in product(measures.items(), pairwise(chain)):
            yield from smaller(plants, name, *pair, f"{more}{what}", what)

    found, beside = [*along(published, "")], [*along(ideal, "with an ideal encoder ")]
    chance = _by_chance(plants, factorial(3))
    shares = ", ".join(f"{100.0 * plants.ok(run).mean():.3g} %" for run in runs[:3])
    remark = (
        f"Controller 2 is ok on {shares} of the plants with the shorter, the printed and the longer period: "
        "what a shorter one costs in stability is no part of the claim"
    )
    judged, rankable = plants.ok(*runs), plants.rankable(*runs)
    return Findings(found, judged, rankable, [remark], beside=beside, chance=chance)


def small_inertia(plants: Plants, _: Published) -> Findings:
    """E2a: half of M_bar makes Controller 2's torque smoother."""
    halved = f"{SECOND}@{HALVED}"
    found = list(smaller(plants, "torque_step_rms", halved, SECOND, "RMS torque step"))
    runs, chance = (SECOND, halved), _by_chance(plants, 2)
    return Findings(found, plants.ok(*runs), plants.rankable(*runs), chance=chance)


def overshoot(plants: Plants, paper: Published) -> Findings:
    """E3: Controller 1 overshoots less than Controller 2, or neither does by more than an encoder count."""
    first, second = plants[FIRST, "overshoot"], plants[SECOND, "overshoot"]
    count = np.deg2rad(paper.number("hardware.encoder_resolution"))
    with np.errstate(invalid="ignore"):
        neither = (first <= count) & (second <= count)
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    counted = known & ~neither.all(axis=1)
    # A law that diverged has not rested, whatever its last excursion was.
    alive = plants.none(DIVERGED, FIRST, SECOND)
    found = [
        Statement(f"{one.text}, or neither", one.holds | neither[:, i], one.last | (neither[:, i] & alive))
        for i, one in enumerate(smaller(plants, "overshoot", FIRST, SECOND, "overshoot"))
    ]
    ok, rankable = plants.ok(*CONTROLLERS), plants.rankable(*CONTROLLERS)
    left_out = int((ok & ~counted).sum())
    remark = f"left out: {left_out} plants without overshoot beyond an encoder count"
    return Findings(found, ok & counted, rankable & counted, [remark])


def bounds(plants: Plants, paper: Published) -> Findings:
    """L1: e and de of Controller 1 stay inside the bounds of section 4.3, as printed."""
    printed = Plants(plants.data, PRINTED)
    gain = {name: np.array(paper.per_joint(f"gain.{name}", plants.joints)) for name in _GAINS}
    omega = printed[FIRST, "epsilon_max"] / gain["lam"]
    power = (omega / gain["eta"]) ** (1.0 / gain["b"])
    error = np.minimum(gain["Delta"], power)
    rate = omega + gain["eta"] * error ** gain["b"]
    largest, widest = printed[FIRST, "max_error"], np.maximum(gain["Delta"], power)
    with np.errstate(invalid="ignore", divide="ignore"):
        used = {
            "|e| inside Eq. (30) as printed": largest / error,
            "|de/dt| inside Eq. (31)": printed[FIRST, "rate_max"] / rate,
        }
        wider = {
            "|s| inside Omega, which follows identically": printed[FIRST, "s_max"] / omega,
            "|e| inside Eq. (30) with max for min": largest / widest,
        }
    found, beside = (
        [
            one
            for text, share in parts.items()
            for one in _plain(printed, f"joint {{}}: the largest {text}", share <= 1.0, FIRST)
        ]
        for parts in (used, wider)
    )
    judged = printed.ok(*CONTROLLERS)
    limit = load_config(None, "compare").config.status.divergence_limit.si
    remarks = ["judged under the reading printed, whatever the reading"]
    cannot_fail = None
    if (error[judged] >= limit).all():
        # With |s| <= Omega, an identity, Eq. (31) then follows from the definition of s.
        least, most = np.rad2deg([error[judged].min(), limit])
        cannot_fail = (
            f"a rule that could fail: Eq. (30) leaves the error at least {least:.3g} deg on every plant, and "
            f"a run beyond {most:.3g} deg is diverged and not judged"
        )
    if judged.any():
        remarks.append(f"the median Omega is {_medians(omega[judged])} rad/s")
        remarks += [
            f"the largest {text}: uses {_medians(share[judged])} of it" for text, share in used.items()
        ]
    return Findings(found, judged, None, remarks, beside=beside, cannot_fail=cannot_fail)


def _medians(values: Array) -> str:
    return ", ".join(f"{size:.3g}" for size in np.median(values, axis=0))


_GAINS = ("lam", "eta", "b", "Delta")

CLAIMS: Mapping[str, Callable[[Plants, Published], Findings]] = {
    rule.__name__: rule
    for rule in (
        *(stable, order, rising_shape, joints_alike, rapid_advantage, similar_surfaces, estimate_size),
        *(torque_size, payload, better_estimate, robustness, delay_time, small_inertia, overshoot, bounds),
    )
}
"""Rules of claims by their names in docs/verdicts.md."""
