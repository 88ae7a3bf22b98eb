"""Many closed loops at once, by the compiled stepper.

Loops that share the law's branches run through one piece of code, in bundles of lanes. What a run leaves
behind are statistics and a status; traces are kept on request. Every lane is worked out alone: neither its
neighbours nor the number of processors change a bit of it. What acts in none of a batch's loops is left out
of their code, which rounds otherwise: beside loops with a part more, a run moves by some 1e-15 of itself.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.physics.control import Law, Surface
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation import streaming
from tendonrepro.simulation.codegen.machine import LANES
from tendonrepro.simulation.controllers import TimeDelayController
from tendonrepro.simulation.loop import Loop, trace_variables
from tendonrepro.simulation.pack import Ended, run_pack
from tendonrepro.simulation.parts import CompiledPart, Rest, plant_parts, sample_part
from tendonrepro.simulation.resolution import TOLERANCE

PACK = 1536
"""Most experiments that are taken through time together: the more, the fuller the lanes of rare laws."""

LINES_PER_RINGING = 32
"""The error is summed up over blocks this many times shorter than a period of the ringing frequency."""


class RingingLimits(Protocol):
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
        Variables of every run, as `stepper.simulate` returns them; None of an unresolved
        one. Only on request.
    """

    statistics: Mapping[str, Array]
    status: NDArray[np.int8]
    status_time: Array
    steps: NDArray[np.int64]
    traces: tuple[dict[str, Array] | None, ...] | None = None


def simulate_batch(
    loops: Sequence[Loop],
    limits: RingingLimits,
    *,
    progress: Callable[[int], None] | None = None,
    threads: int = 1,
    record: bool = False,
    tolerance: float = TOLERANCE,
) -> Batch:
    """Run many closed loops.

    Parameters
    ----------
    loops : sequence of Loop
        All with the same number of joints and a :class:`TimeDelayController`.
    limits : RingingLimits
    progress : callable, optional
        Called with the number of runs done since its last call.
    threads : int
        Packs worked on at the same time.
    record : bool
        Keep the traces.
    tolerance : float
        Of the integration, see `tendonrepro.simulation.resolution`. The default leaves q mostly
        within 1e-6 rad of the truth and always within a tenth of an encoder count, as long as no count
        differs; 1e-8 brings runs with ideal encoders within 1e-9 rad.

    Returns
    -------
    Batch
        In the order of the loops.

    Raises
    ------
    TendonreproError
        If there is no loop, or one has another controller: only the package's own law runs on lanes.
    """
    _refuse_others(loops)
    results, report = _Results(loops, limits, record=record), progress or (lambda _: None)

    def run(places: Sequence[int]) -> int:
        pack, first = {place: loops[place] for place in places}, places[0]
        block = results.block(loops[first].L)
        results.keep(pack, run_pack(pack, samples, plants, block, record=record))
        return len(places)

    size = LANES if record else max(LANES, min(PACK, len(loops) // (4 * threads)))
    with ThreadPoolExecutor(threads) as pool:
        samples, plants, steps = _parts(loops, tolerance, pool.map, results, record=record)
        results.steps[:] = np.where((steps > 0).all(axis=1), steps.max(axis=1), 0)
        for done in pool.map(run, _packs(loops, steps, size)):
            report(done)
    return results.batch()


def _refuse_others(loops: Sequence[Loop]) -> None:
    if not loops:
        message = "there are no loops to run"
        raise TendonreproError(message)
    for loop in loops:
        controller = loop.controller
        own = isinstance(controller, TimeDelayController) and controller.command is None
        if not own and not getattr(controller, "on_lanes", False):
            message = "only the paper's own control laws run on lanes"
            raise TendonreproError(message, hint="use the SciPy stepper, --solver scipy")


def _parts(
    loops: Sequence[Loop],
    tolerance: float,
    for_each: Callable[..., Iterator[Any]],
    results: _Results,
    *,
    record: bool,
) -> tuple[dict[int, CompiledPart], dict[int, CompiledPart], NDArray[np.int64]]:
    """Compiled law and plant of every loop, by its place, and its steps per sample, (N, levels)."""
    samples: dict[int, CompiledPart] = {}
    plants: dict[int, CompiledPart] = {}
    steps: dict[int, NDArray[np.int64]] = {}
    rest: dict[int, Rest] = {}
    for alike in _alike(loops, lambda loop: (loop.plant.preload.size, loop.plant.disturbance.omega.size)):
        parts, needed, at_rest = plant_parts(alike, tolerance, for_each)
        plants |= parts
        steps |= needed
        rest |= at_rest
    for alike in _alike(loops, _branches):
        part = sample_part(alike, rest, results.block, statistics=True, record=record)
        samples |= dict.fromkeys(alike, part)
    return samples, plants, np.array([steps[place] for place in range(len(loops))])


def _alike(loops: Sequence[Loop], key: Callable[[Loop], Hashable]) -> Iterable[dict[int, Loop]]:
    """Loops by place, those of one key together."""
    found: dict[Hashable, dict[int, Loop]] = {}
    for place, loop in enumerate(loops):
        found.setdefault(key(loop), {})[place] = loop
    return found.values()


def _branches(loop: Loop) -> Hashable:
    """What the code of a sample depends on, besides what is zero or one in all its loops."""
    law = loop.controller.law
    if isinstance(law, Law) and law.surface != Surface.NTSM:
        # There is no phi in it.
        law = law._replace(phi_is_odd=True, power_inside=True)
    switches = tuple(value for value in law if isinstance(value, int))
    return loop.plant.preload.size, loop.actuator.delay, loop.controller.command, switches


def _packs(loops: Sequence[Loop], steps: NDArray[np.int64], size: int) -> Iterator[list[int]]:
    """Places of each pack: loops of one sampling period, those that move alike side by side."""
    found: dict[float, list[int]] = {}
    motions = {id(loop.reference): k for k, loop in enumerate(reversed(loops))}
    for place in np.flatnonzero((steps > 0).all(axis=1)).tolist():
        found.setdefault(loops[place].L, []).append(place)
    for places in found.values():
        places.sort(key=lambda place: (motions[id(loops[place].reference)], *steps[place][::-1]))
        for start in range(0, len(places), size):
            yield places[start : start + size]


class _Results:
    """Results being filled in, each by its place in the batch."""

    def __init__(self, loops: Sequence[Loop], limits: RingingLimits, *, record: bool) -> None:
        count, n = len(loops), loops[0].plant.preload.size
        self.limits = limits
        self.statistics = {name: np.full((count, n), np.nan) for name in streaming.STATISTICS}
        self.status = np.full(count, STATUSES.index("unresolved"), dtype=np.int8)
        self.status_time = np.zeros(count)
        self.steps = np.zeros(count, dtype=np.int64)
        self.traces: list[dict[str, Array] | None] | None = [None] * count if record else None

    def block(self, L: float) -> int:
        """Samples over which errors are summed up for the spectrum."""
        return _block(L, self.limits.ringing_frequency.si)

    def keep(self, loops: Mapping[int, Loop], ended: Ended) -> None:
        """Keep what the experiments of a pack, by place, left behind."""
        places, lanes = list(loops), [*loops.values()]
        fast = _fast_shares(ended, self.block(lanes[0].L), lanes[0].L, self.limits.ringing_frequency.si)
        for name, values in streaming.finished(ended.sums, ended.count, fast).items():
            self.statistics[name][places] = values.T
        ringing = (fast > self.limits.ringing_share.si).any(axis=0)
        codes = [STATUSES.index(name) for name in ("diverged", "ringing", "ok")]
        self.status[places] = np.select([ended.diverged, ringing], codes[:2], codes[2])
        for member, (place, loop) in enumerate(loops.items()):
            self.status_time[place] = loop.reference.time[ended.count[member] - 1]
            if self.traces is not None:
                recorded = ended.trace[member, : ended.count[member]]
                self.traces[place] = trace_variables(recorded, loop)

    def batch(self) -> Batch:
        """Everything as one value."""
        traces = None if self.traces is None else tuple(self.traces)
        return Batch(self.statistics, self.status, self.status_time, self.steps, traces)


def _block(L: float, ringing_frequency: float) -> int:
    return max(1, int(1.0 / (L * LINES_PER_RINGING * ringing_frequency)))


def _fast_shares(ended: Ended, block: int, L: float, frequency: float) -> Array:
    """Share of the error's power above a frequency, (n, M): all of it less the slow lines of its spectrum.

    The slow lines come from sums over blocks; what a block does to a line is divided out. A last block that
    is not full counts as filled up with zeros.
    """
    slow = np.empty_like(ended.sums.sq_e)
    for samples in np.unique(ended.count):
        alike = ended.count == samples
        blocks = np.moveaxis(ended.blocks[alike, : -(-samples // block)], 0, -1)
        count = block * len(blocks)
        lines = np.arange(min(int(frequency * (1.0 + 1e-9) * count * L), len(blocks) // 2) + 1)
        half = np.pi * np.maximum(lines, 1e-9) / count
        response = np.sin(block * half) / (block * np.sin(half))
        spectrum = np.fft.rfft(blocks, axis=0)[: lines.size] / response[:, np.newaxis, np.newaxis]
        power = np.abs(spectrum) ** 2 / count
        power[1:] *= 2.0
        slow[:, alike] = power.sum(axis=0)
    total = ended.sums.sq_e
    share = np.divide(slow, total, out=np.ones_like(total), where=total > 0.0)
    return np.asarray(np.maximum(1.0 - share, 0.0))
