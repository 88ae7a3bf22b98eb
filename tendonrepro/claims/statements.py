"""The paper's claims as statements that hold or fail on each plant of an ensemble."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.claims.plants import DIVERGED, UNRESOLVED, Plants
from tendonrepro.claims.verdicts import SIMILAR, Mask
from tendonrepro.config.published import Published
from tendonrepro.results.summary import CONTROLLERS, LOADS

IDEAL = "encoder=ideal"
SHORTER, LONGER, HALVED = "sampling_period=0.5ms", "sampling_period=2ms", "M_bar=halved"

FIRST, SECOND, _ = CONTROLLERS
LOADED = LOADS["with_load"]


@dataclass(frozen=True)
class Statement:
    """Where a statement holds, plant by plant, read only where laws are judged.

    `last` is the same with a diverged law ranked last.
    """

    text: str
    holds: Mask
    last: Mask


@dataclass(frozen=True)
class Findings:
    """A claim's statements, the plants they are judged on, and those of the second ranking."""

    statements: Sequence[Statement]
    judged: Mask
    resolved: Mask | None
    remarks: Sequence[str] = field(default=())


def smaller(plants: Plants, name: str, first: str, second: str, what: str) -> Iterator[Statement]:
    """Yield, joint by joint, that a statistic of one run is strictly smaller than that of another."""
    with np.errstate(invalid="ignore"):
        holds = plants[first, name] < plants[second, name]
        last = plants.ranked((first, name)) < plants.ranked((second, name))
    for i, joint in enumerate(plants.joints):
        yield Statement(f"joint {joint}: {what} of {first} below that of {second}", holds[:, i], last[:, i])


def _plain(plants: Plants, texts: str, holds: Mask, *runs: str) -> Iterator[Statement]:
    """Yield a statement a joint that fails where a run it names diverged; ``{}`` stands for the joint."""
    alive = plants.none(DIVERGED, *runs)
    for i, joint in enumerate(plants.joints):
        yield Statement(texts.format(joint), holds[:, i], holds[:, i] & alive)


def _among_controllers(
    plants: Plants, statements: Sequence[Statement], remarks: Sequence[str] = ()
) -> Findings:
    resolved = plants.none(UNRESOLVED, *CONTROLLERS)
    return Findings(statements, plants.ok(*CONTROLLERS), resolved, remarks)


def stable(plants: Plants, _: Published) -> Findings:
    """C1: all controllers are ``ok``."""
    statements = [Statement(f"{run} is ok", plants.ok(run), plants.ok(run)) for run in CONTROLLERS]
    return Findings(statements, plants.none(UNRESOLVED, *CONTROLLERS), None)


def order(plants: Plants, _: Published) -> Findings:
    """C2: controllers 1 < 2 < 3 in both metrics."""
    found = [
        statement
        for (first, second), name in product(pairwise(CONTROLLERS), ("mae", "rmse"))
        for statement in smaller(plants, name, first, second, name.upper())
    ]
    return _among_controllers(plants, found)


def rapid_advantage(plants: Plants, _: Published) -> Findings:
    """C3: the advantage of Controller 1 is there in rapid phases, and largest there."""
    found: list[Statement] = []
    for rival in CONTROLLERS[1:]:
        rapid, calm = (plants[rival, name] - plants[FIRST, name] for name in ("mae_rapid", "mae_calm"))
        with np.errstate(invalid="ignore"):
            there, larger = rapid > 0.0, rapid > calm
        text = f"joint {{}}: {FIRST} is better than {rival} in rapid phases"
        found += _plain(plants, text, there, FIRST, rival)
        found += _plain(plants, f"{text}, and by more than elsewhere", larger, FIRST, rival)
    return _among_controllers(plants, found)


def similar_surfaces(plants: Plants, _: Published) -> Findings:
    """C4: the RMS of s of the three differ by at most 5 %."""
    sizes = np.array([plants[run, "s_rms"] for run in CONTROLLERS])
    with np.errstate(invalid="ignore"):
        holds = sizes.min(axis=0) >= (1.0 - SIMILAR) * sizes.max(axis=0)
    text = "joint {}: the RMS of s of the three controllers differ by at most 5 %"
    return _among_controllers(plants, list(_plain(plants, text, holds, *CONTROLLERS)))


def _phase(plants: Plants, name: str, rival: str, phase: str) -> tuple[Array, Array]:
    """Return how much smaller Controller 1's phase mean is than the rival's, and 5 % of the rival's size."""
    up, down = (np.abs(plants[rival, f"{name}_{way}"]) for way in ("up", "down"))
    less = (up if phase == "up" else down) - np.abs(plants[FIRST, f"{name}_{phase}"])
    return less, SIMILAR * np.fmax(up, down)


def _smaller_up(plants: Plants, name: str, what: str) -> Iterator[Statement]:
    for rival in CONTROLLERS[1:]:
        less, margin = _phase(plants, name, rival, "up")
        text = f"joint {{}}: moving up {what} of {FIRST} is smaller than that of {rival} by more than 5 %"
        with np.errstate(invalid="ignore"):
            yield from _plain(plants, text, less > margin, FIRST, rival)


def estimate_size(plants: Plants, _: Published) -> Findings:
    """C5: Controller 1's estimate is smaller moving up, similar moving down."""
    found = list(_smaller_up(plants, "H_hat", "the mean estimate"))
    for rival in CONTROLLERS[1:]:
        less, margin = _phase(plants, "H_hat", rival, "down")
        text = f"joint {{}}: moving down the mean estimates of {FIRST} and {rival} are similar"
        with np.errstate(invalid="ignore"):
            found += _plain(plants, text, np.abs(less) <= margin, FIRST, rival)
    return _among_controllers(plants, found)


def torque_size(plants: Plants, _: Published) -> Findings:
    """C6: Controller 1's torque is significantly smaller moving up, lower and smoother overall."""
    found = list(_smaller_up(plants, "torque", "the mean torque"))
    for (name, what), rival in product(
        (("torque_rms", "RMS torque"), ("torque_step_rms", "RMS torque step")), CONTROLLERS[1:]
    ):
        found += smaller(plants, name, FIRST, rival, what)
    return _among_controllers(plants, found)


def payload(plants: Plants, _: Published) -> Findings:
    """P1: the payload makes the errors of Controller 1 larger, as printed."""
    # On a measurement the other controllers are not asked for; over the box all claims have the same plants.
    runs = (*CONTROLLERS, LOADED)
    return Findings(larger_with_load(plants), plants.ok(*runs), plants.none(UNRESOLVED, *runs))


def larger_with_load(plants: Plants) -> list[Statement]:
    """That the payload makes the errors of Controller 1 larger, in both metrics."""
    names = ("mae", "rmse")
    return [one for name in names for one in smaller(plants, name, FIRST, LOADED, name.upper())]


def better_estimate(plants: Plants, _: Published) -> Findings:
    """E1: the estimate of Controller 1 is better than that of Controller 2."""
    return _among_controllers(plants, list(smaller(plants, "epsilon_rms", FIRST, SECOND, "RMS of epsilon")))


def delay_time(plants: Plants, _: Published) -> Findings:
    """E2: a smaller L makes Controller 2's estimate better, a larger one worse; a small M_bar is smoother."""
    shorter, longer, halved = (f"{SECOND}@{name}" for name in (SHORTER, LONGER, HALVED))
    found = [
        *smaller(plants, "epsilon_rms", shorter, SECOND, "RMS of epsilon"),
        *smaller(plants, "epsilon_rms", SECOND, longer, "RMS of epsilon"),
        *smaller(plants, "torque_step_rms", halved, SECOND, "RMS torque step"),
    ]
    runs = (SECOND, shorter, longer, halved)
    return Findings(found, plants.ok(*runs), plants.none(UNRESOLVED, *runs))


def overshoot(plants: Plants, _: Published) -> Findings:
    """E3: Controller 1 overshoots less than Controller 2, or neither does."""
    first, second = plants[FIRST, "overshoot"], plants[SECOND, "overshoot"]
    with np.errstate(invalid="ignore"):
        neither = (first <= 0.0) & (second <= 0.0)
    known = np.isfinite(first).all(axis=1) & np.isfinite(second).all(axis=1)
    counted = known & ~neither.all(axis=1)
    # A law that diverged has not rested, whatever its last excursion was.
    alive = plants.none(DIVERGED, FIRST, SECOND)
    found = [
        Statement(f"{one.text}, or neither", one.holds | neither[:, i], one.last | (neither[:, i] & alive))
        for i, one in enumerate(smaller(plants, "overshoot", FIRST, SECOND, "overshoot"))
    ]
    ok, resolved = plants.ok(*CONTROLLERS), plants.none(UNRESOLVED, *CONTROLLERS)
    left_out = int((ok & ~counted).sum())
    remark = f"left out: {left_out} plants without overshoot or without rest of the reference"
    return Findings(found, ok & counted, resolved & counted, [remark])


def bounds(plants: Plants, paper: Published) -> Findings:
    """L1: s, e and de of Controller 1 stay inside the bounds of section 4.3, with an ideal encoder."""
    ideal = Plants(plants.data, IDEAL)
    gain = {name: np.array(paper.per_joint(f"gain.{name}", plants.joints)) for name in _GAINS}
    omega = ideal[FIRST, "epsilon_max"] / gain["lam"]
    power = (omega / gain["eta"]) ** (1.0 / gain["b"])
    error = np.minimum(gain["Delta"], power)
    rate = omega + gain["eta"] * error ** gain["b"]
    with np.errstate(invalid="ignore"):
        found = [
            ("the largest |s| is at most Omega", ideal[FIRST, "s_max"] <= omega),
            ("the largest |e| is inside Eq. (30) as printed", ideal[FIRST, "max_error"] <= error),
            ("the largest |de/dt| is inside Eq. (31)", ideal[FIRST, "rate_max"] <= rate),
        ]
        wider = ideal[FIRST, "max_error"] <= np.maximum(gain["Delta"], power)
    statements = [
        statement for text, holds in found for statement in _plain(ideal, f"joint {{}}: {text}", holds, FIRST)
    ]
    judged = ideal.ok(*CONTROLLERS)
    return Findings(statements, judged, None, _bound_remarks(plants, gain["lam"], wider[judged]))


def _bound_remarks(plants: Plants, lam: Array, wider: Mask) -> list[str]:
    counted = plants.ok(*CONTROLLERS)
    remarks = ["judged under encoder=ideal, whatever the reading"]
    if len(wider):
        count = int(wider.all(axis=1).sum())
        remarks.append(f"with max for min Eq. (30) holds on {count} of {len(wider)} plants judged")
    if counted.any():
        omega = np.median(plants[FIRST, "epsilon_max"][counted] / lam, axis=0)
        sizes = ", ".join(f"{size:.3g}" for size in omega)
        remarks.append(f"under reading {plants.reading} the median Omega is {sizes} rad/s")
    return remarks


_GAINS = ("lam", "eta", "b", "Delta")

CLAIMS: Mapping[str, Callable[[Plants, Published], Findings]] = {
    rule.__name__: rule
    for rule in (
        *(stable, order, rapid_advantage, similar_surfaces, estimate_size, torque_size, payload),
        *(better_estimate, delay_time, overshoot, bounds),
    )
}
"""Rules of claims by their names in docs/verdicts.md."""
