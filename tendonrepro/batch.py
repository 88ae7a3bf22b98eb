"""Many closed loops at once, by the compiled stepper.

Loops that share the law's branches run through one piece of code, in bundles of lanes. What a run leaves
behind are statistics and a status; traces are kept on request. Every lane is worked out alone: neither its
neighbours nor the number of processors change a bit of it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tendonrepro import compiled, streaming
from tendonrepro.arrays import Array
from tendonrepro.bundle import Ended, Group, compiled_group, run_bundle
from tendonrepro.control import Law
from tendonrepro.controllers import TimeDelayController
from tendonrepro.errors import TendonreproError
from tendonrepro.lanes import LANES
from tendonrepro.simulate import Loop, motor_angles, trace_variables

STATUSES = ("ok", "ringing", "diverged", "unresolved")
"""Statuses of a run by their number; an unresolved plant is too fast for the largest number of steps."""

STATISTICS = streaming.STATISTICS

LINES_PER_RINGING = 32
"""The error is summed up over blocks this many times shorter than a period of the ringing frequency."""


class Limits(Protocol):
    """What makes a run ringing: the configuration's status section, or anything like it."""

    @property
    def ringing_frequency(self) -> Any:
        """Frequency above which error is ringing, with ``.si`` in Hz."""

    @property
    def ringing_share(self) -> Any:
        """Share of the error's power that is ringing, with ``.si``."""


@dataclass(frozen=True)
class Batch:
    """Results of many runs.

    Attributes
    ----------
    statistics : mapping of str to array (N, n)
        By the names of `STATISTICS`, SI units; NaN where not defined; of a diverged run, up to its end.
    status : array (N,) of int8
        Index into `STATUSES`.
    status_time : array (N,)
        Time of the last sample, s.
    steps : array (N,) of int64
        Integration steps per sample; 0 where unresolved.
    traces : tuple of dict, or None
        Variables of every run, as :func:`tendonrepro.simulate.simulate` returns them; None of an unresolved
        one. Only on request.
    """

    statistics: Mapping[str, Array]
    status: NDArray[np.int8]
    status_time: Array
    steps: NDArray[np.int64]
    traces: tuple[dict[str, Array] | None, ...] | None = None


def simulate_batch(
    loops: Sequence[Loop],
    limits: Limits,
    *,
    progress: Callable[[int], None] | None = None,
    threads: int = 1,
    record: bool = False,
    refine: int = 1,
) -> Batch:
    """Run many closed loops.

    Parameters
    ----------
    loops : sequence of Loop
        All with the same number of joints and a :class:`TimeDelayController`.
    limits : Limits
    progress : callable, optional
        Called with the number of runs done since its last call.
    threads : int
        Bundles worked on at the same time.
    record : bool
        Keep the traces.
    refine : int
        Multiplies the number of integration steps, to see what they leave.

    Returns
    -------
    Batch
        In the order of the loops.

    Raises
    ------
    TendonreproError
        If a loop has another controller: only the package's own law runs on lanes.
    """
    _refuse_others(loops)
    results, report = _Results(loops, limits, record=record), progress or (lambda _: None)
    block = _block(loops[0].L, limits.ringing_frequency.si)

    def run(group: Group, members: NDArray[np.int64]) -> int:
        ended = run_bundle(group, members, block, refine=refine, record=record)
        for member, one in zip(members, ended, strict=True):
            results.keep(int(group.index[member]), group.loops[member], one)
        return members.size

    with ThreadPoolExecutor(threads) as pool:
        for group in _groups(loops):
            results.steps[group.index] = group.steps
            waiting = [pool.submit(run, group, members) for members in _bundles(group)]
            for future in waiting:
                report(future.result())
    return results.batch()


def _refuse_others(loops: Sequence[Loop]) -> None:
    for loop in loops:
        controller = loop.controller
        if not isinstance(controller, TimeDelayController) or controller.command is not compiled.command:
            message = "only the paper's own control laws run on lanes"
            raise TendonreproError(message, hint="use the reference stepper, --solver scipy")


def _groups(loops: Sequence[Loop]) -> Iterator[Group]:
    """Loops by the branches of their code."""
    members: dict[Hashable, list[int]] = {}
    for place, loop in enumerate(loops):
        members.setdefault(_branches(loop), []).append(place)
    for index in members.values():
        chosen = [loops[i] for i in index]
        yield compiled_group(chosen, [_law(loop) for loop in chosen], index)


def _law(loop: Loop) -> Law:
    assert isinstance(loop.controller, TimeDelayController)
    return loop.controller.law


def _branches(loop: Loop) -> Hashable:
    """What the generated code depends on, besides features that are off in a whole group."""
    return (
        loop.plant.preload.size,
        loop.L,
        loop.plant.disturbance.omega.size,
        tuple(part for part in _law(loop) if isinstance(part, bool | int)),
        loop.actuator.delay,
        loop.joint_encoder.resolution == 0.0,
        loop.actuator.resolution == 0.0,
    )


def _bundles(group: Group) -> Iterator[NDArray[np.int64]]:
    """Members of each bundle: equal steps, and lengths as equal as can be."""
    lengths = np.array([loop.reference.time.size for loop in group.loops])
    order = np.lexsort((lengths, group.steps))
    order = order[group.steps[order] > 0]
    for steps in np.unique(group.steps[order]):
        alike = order[group.steps[order] == steps]
        for start in range(0, alike.size, LANES):
            yield alike[start : start + LANES]


class _Results:
    """Results being filled in, each by its place in the batch."""

    def __init__(self, loops: Sequence[Loop], limits: Limits, *, record: bool) -> None:
        count, n = len(loops), loops[0].plant.preload.size
        self.limits = limits
        self.statistics = {name: np.full((count, n), np.nan) for name in STATISTICS}
        self.status = np.full(count, STATUSES.index("unresolved"), dtype=np.int8)
        self.status_time = np.zeros(count)
        self.steps = np.zeros(count, dtype=np.int64)
        self.traces: list[dict[str, Array] | None] | None = [None] * count if record else None

    def keep(self, place: int, loop: Loop, ended: Ended) -> None:
        """Keep what one experiment left behind."""
        period = round(loop.reference.period / loop.L) or loop.reference.time.size
        fast = _fast_share(ended, loop.L, self.limits.ringing_frequency.si)
        for name, values in streaming.finished(ended.sums, ended.count, period, fast).items():
            self.statistics[name][place] = values
        ringing = bool((fast > self.limits.ringing_share.si).any())
        status = "diverged" if ended.diverged else "ringing" if ringing else "ok"
        self.status[place] = STATUSES.index(status)
        self.status_time[place] = loop.reference.time[ended.count - 1]
        if self.traces is not None:
            self.traces[place] = _trace(loop, ended)

    def batch(self) -> Batch:
        """Everything as one value."""
        traces = None if self.traces is None else tuple(self.traces)
        return Batch(self.statistics, self.status, self.status_time, self.steps, traces)


def _block(L: float, ringing_frequency: float) -> int:
    return max(1, int(1.0 / (L * LINES_PER_RINGING * ringing_frequency)))


def _fast_share(ended: Ended, L: float, frequency: float) -> Array:
    """Share of the error's power above a frequency, (n,): all of it less the slow lines of its spectrum.

    The slow lines come from sums over blocks; what a block does to a line is divided out. A last block that
    is not full counts as filled up with zeros.
    """
    block = _block(L, frequency)
    blocks = ended.blocks[: -(-ended.count // block)]
    count = block * len(blocks)
    lines = np.arange(min(int(frequency * (1.0 + 1e-9) * count * L), len(blocks) // 2) + 1)
    half = np.pi * np.maximum(lines, 1e-9) / count
    response = np.sin(block * half) / (block * np.sin(half))
    power = np.abs(np.fft.rfft(blocks, axis=0)[: lines.size] / response[:, np.newaxis]) ** 2 / count
    power[1:] *= 2.0
    total = ended.sums.sq_e
    slow = np.divide(power.sum(axis=0), total, out=np.ones_like(total), where=total > 0.0)
    return np.asarray(np.maximum(1.0 - slow, 0.0))


def _trace(loop: Loop, ended: Ended) -> dict[str, Array]:
    """Variables of a run's trace."""
    n, recorded = loop.plant.preload.size, dict(ended.recorded)
    theta = recorded["state"][:, 2 * n : 3 * n]
    recorded["q_motor_encoder"] = motor_angles(theta, loop)
    return {"time": loop.reference.time[: ended.count]} | trace_variables(recorded, loop)
