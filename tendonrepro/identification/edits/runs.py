"""Every edit on plants of the ranges: what is run, kept on disk as it comes, and what it cost."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.readings import PRINTED, Reading, parse_reading
from tendonrepro.experiments.user_law import UserLaw, refuse_memory, refused_on_lanes, with_user_laws
from tendonrepro.files import digest_of
from tendonrepro.identification.edits.recorded import EditedLaw
from tendonrepro.identification.edits.variants import Variants, controller_of, law_of, variants_of
from tendonrepro.identification.goal import Goal
from tendonrepro.monte_carlo.evaluate import stub_of
from tendonrepro.monte_carlo.plan import ROOMS, SECONDS_PER_EXPERIMENT, code_digest
from tendonrepro.monte_carlo.population import Population, population_of
from tendonrepro.parallel import as_ready
from tendonrepro.results.record_store import Records, RecordStore, RecordType
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.studies.study import Site

TOGETHER, APART = PRINTED, "starts=apart"
"""Readings under which edits run: on the reference at the start, or up to 2° beside it."""

MEASURED = ("mae", "rmse", "torque_step_rms")
"""Statistics that are kept of a run."""

PLANTS_AT_ONCE = 32
"""Plants run together: what a kill can cost. What runs beside a plant can change its last bits."""


@dataclass(frozen=True, eq=False)
class EditStudy:
    """Plants, runs whose laws are edited, and the errors that edits are ranked by.

    The runs are those of `goal`. Edits are of a user's `laws` among them, or where there are none, of all.
    """

    loaded: LoadedEnsemble
    laws: tuple[UserLaw, ...]
    goal: Goal
    plants: int

    @property
    def population(self) -> Population:
        """Where the plants come from."""
        return population_of(self.loaded)

    @property
    def readings(self) -> tuple[Reading, ...]:
        """As published, and with starts apart; around an arm of a user's own as its comparison says."""
        names = (TOGETHER,) if self.loaded.around else (TOGETHER, APART)
        return tuple(map(parse_reading, names))

    def loops(self, first: int, count: int) -> list[dict[tuple[str, str], Loop]]:
        """Loops of plants, by run and reading, their laws unedited."""
        values = self.population.sample(int(self.loaded.config.seed.si), 0, first, count)
        cases = [(run, reading) for run in self.goal.runs for reading in self.readings]
        names = [(run, reading.name) for run, reading in cases]
        drawn = self.population.loops(values, cases, self.laws)
        return [dict(zip(names, loops, strict=True)) for loops in drawn]

    @property
    def edited(self) -> tuple[str, ...]:
        """Runs whose laws are edited."""
        return tuple(law.name for law in self.laws) or self.goal.runs

    @cached_property
    def variants(self) -> Variants:
        """Edits of the laws, from those of the first plant: the gains are the same on all.

        Raises
        ------
        UsageError
            For a law that cannot run on many plants together.
        """
        first = self.loops(0, 1)[0]
        loops = {run: first[run, TOGETHER] for run in self.edited}
        for law in self.laws:
            stub = stub_of(loops[law.name])
            try:
                simulate_batch([stub])
                law_of(stub)
            except Exception as error:
                raise refused_on_lanes(law.name, error) from error
            refuse_memory(law, stub)
        return variants_of(loops)

    @cached_property
    def cells(self) -> dict[tuple[str, str], EditedLaw | None]:
        """Laws to run, by run and what was changed; the unedited ones first, where nothing was."""
        cells: dict[tuple[str, str], EditedLaw | None] = {(run, ""): None for run in self.goal.runs}
        for edit in self.variants.edits:
            for run, law in edit.laws.items():
                cells.setdefault((run, law.content), law)
        return cells

    @cached_property
    def lookup(self) -> NDArray[np.int64]:
        """Place among `cells` of each run of an edit, (1 + edits, R); the first row is without an edit."""
        place = {key: k for k, key in enumerate(self.cells)}
        edited = ({}, *(edit.laws for edit in self.variants.edits))
        contents = [[laws[run].content if run in laws else "" for run in self.goal.runs] for laws in edited]
        return np.array([[place[key] for key in zip(self.goal.runs, row, strict=True)] for row in contents])

    @property
    def record(self) -> RecordType:
        """A record of one plant: by reading and cell a status, and statistics by joint, SI."""
        shape = len(self.readings), len(self.cells)
        numbers = [(name, np.float32, (*shape, len(self.loaded.compare.joints))) for name in MEASURED]
        return np.dtype([("status", np.int8, shape), *numbers])

    @cached_property
    def identity(self) -> str:
        """SHA-256 of all that a record depends on."""
        return digest_of(
            {
                "version": __version__,
                "code": code_digest(*ROOMS),
                "config": [self.loaded.sha256, with_user_laws(self.loaded.base, self.laws).sha256],
                "readings": [reading.name for reading in self.readings],
                "edits": [*self.cells],
            }
        )

    @property
    def experiments(self) -> int:
        """Runs of the whole study."""
        return self.plants * len(self.readings) * len(self.cells)

    @property
    def cost(self) -> dict[str, float]:
        """What it takes, as a dry run says."""
        hours = self.experiments * SECONDS_PER_EXPERIMENT / 3600.0
        size = self.plants * self.record.itemsize / 1e9
        return {"experiments": self.experiments, "processor_hours": hours, "gigabytes": size}

    def run(self, site: Site, jobs: int, folder: str) -> Records:
        """Records of all plants; those that are on disk are not run again."""
        path = site.files / folder / f"plants-{self.identity[:12]}.npy"
        store = RecordStore(path, self.record, self.plants)
        missing = {*store.missing().tolist()}
        blocks = [
            block
            for first in range(0, self.plants, PLANTS_AT_ONCE)
            if missing & {*(block := range(first, min(first + PLANTS_AT_ONCE, self.plants)))}
        ]
        _CELLS[self.identity] = self.cells
        # A copy has none of the laws that were recorded, which is much to send to other processes.
        stream = as_ready(partial(_block, replace(self), self.identity, self.record), blocks, jobs)
        with site.talk.bar("simulating", len(blocks)) as progress, closing(stream):
            for block, records in stream:
                store.put(block, records)
                progress(1)
        return store.read()


_CELLS: dict[str, dict[tuple[str, str], EditedLaw | None]] = {}
"""Edited laws of a study by its identity: the same objects for all its blocks, so compiled once a process."""


def _block(study: EditStudy, identity: str, kind: RecordType, plants: range) -> tuple[range, Records]:
    """Records of some plants."""
    if identity not in _CELLS:
        _CELLS[identity] = study.cells
    cells = _CELLS[identity]
    loops = [
        _edited(of_plant[run, reading.name], law)
        for of_plant in study.loops(plants.start, len(plants))
        for reading in study.readings
        for (run, _), law in cells.items()
    ]
    batch = simulate_batch(loops)
    records = np.empty(len(plants), kind)
    records["status"] = batch.status.reshape(records["status"].shape)
    # What overflows single precision is of a diverged run, and infinite for every purpose.
    with np.errstate(over="ignore"):
        for name in MEASURED:
            records[name] = batch.statistics[name].reshape(records[name].shape)
    return plants, records


def _edited(loop: Loop, law: EditedLaw | None) -> Loop:
    if law is None:
        return loop
    controller = controller_of(loop)
    gains = controller.law._replace(lag=law.base.law.lag)
    return replace(loop, controller=replace(controller, law=gains, command=law, on_lanes=True))
