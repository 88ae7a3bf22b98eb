"""Every edit on plants of the ranges: what is run, kept on disk as it comes, and told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.readings import PRINTED, Reading, parse_reading
from tendonrepro.configuration.published import METRICS
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import UserLaw, with_user_laws
from tendonrepro.identification.bench import Goal, goal_of, with_input
from tendonrepro.identification.edits.rank import APART, SCHEMA_VERSION, Outcomes, edits_result
from tendonrepro.identification.edits.recorded import EditedLaw
from tendonrepro.identification.edits.rules import Variants, controller_of, law_of, variants_of
from tendonrepro.monte_carlo import kept
from tendonrepro.monte_carlo.kept import PLANTS_AT_ONCE, Piece, cost_of, identity_of, study_on_plants
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.parallel import as_ready, check_jobs
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.record_store import Records, RecordStore, RecordType
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import Folder, Site, Study

KEPT = "plants"
"""Folder of what an interrupted study goes on with, and name of its only population."""

MEASURED = ("mae", "rmse", "torque_step_rms")
"""Statistics that are kept of a run."""

Cells: TypeAlias = dict[tuple[str, str], EditedLaw | None]
"""Laws to run, by run and what was changed; None where nothing was."""

_CELLS: dict[str, Cells] = {}
"""Cells of a study by its identity: the same objects for all its pieces, so compiled once a process."""


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
    def readings(self) -> tuple[Reading, ...]:
        """As published, and with starts apart; around an arm of a user's own as its comparison says."""
        return tuple(map(parse_reading, (PRINTED,) if self.loaded.around else (PRINTED, APART)))

    def loops(self, first: int, count: int) -> list[dict[tuple[str, str], Loop]]:
        """Loops of plants, by run and reading, their laws unedited."""
        population = population_of(self.loaded)
        values = population.sample(int(self.loaded.config.seed.si), 0, first, count)
        cases = [(run, reading) for run in self.goal.runs for reading in self.readings]
        names = [(run, reading.name) for run, reading in cases]
        return [dict(zip(names, of, strict=True)) for of in population.loops(values, cases, self.laws)]

    @cached_property
    def variants(self) -> Variants:
        """Edits of the laws, from those of the first plant: the gains are the same on all.

        Raises
        ------
        UsageError
            For a law that cannot run on many plants together.
        """
        first = self.loops(0, 1)[0]
        for law in self.laws:
            kept.refuse_on_lanes(law, first[law.name, PRINTED], law_of)
        edited = [law.name for law in self.laws] or self.goal.runs
        return variants_of({run: first[run, PRINTED] for run in edited})

    @cached_property
    def cells(self) -> Cells:
        """What runs on each plant, the unedited laws first; edits may share what they change in one run."""
        edited = [(run, law) for edit in self.variants.edits for run, law in edit.laws.items()]
        unedited: Cells = {(run, ""): None for run in self.goal.runs}
        return unedited | {(run, law.content): law for run, law in edited}

    @cached_property
    def identity(self) -> str:
        """SHA-256 of all that a record depends on."""
        return identity_of(
            self.loaded, readings=[reading.name for reading in self.readings], edits=[*self.cells]
        )

    def run(self, site: Site, jobs: int) -> Records:
        """Records of all plants, a status and statistics, SI, by reading and cell; those on disk are kept."""
        path = site.files / KEPT / f"{KEPT}-{self.identity[:12]}.npy"
        shape = len(self.readings), len(self.cells)
        numbers = [(name, np.float32, (*shape, len(self.goal.joints))) for name in MEASURED]
        kind = np.dtype([("status", np.int8, shape), *numbers])
        store = RecordStore(path, kind, self.plants)
        cuts = np.split(np.arange(self.plants), range(PLANTS_AT_ONCE, self.plants, PLANTS_AT_ONCE))
        pieces = kept.still_missing(cuts, store)
        _CELLS[self.identity] = self.cells
        # A copy has none of the laws that were recorded, which is much to send to other processes.
        stream = as_ready(partial(_piece, replace(self), self.identity, kind), pieces, jobs)
        kept.fill(store, pieces, stream, site.talk)
        return store.read()

    def outcomes(self, records: Records, reading: int) -> Outcomes:
        """What all edits did under a reading."""
        place = {cell: k for k, cell in enumerate(self.cells)}
        edits = [{}, *({run: law.content for run, law in edit.laws.items()} for edit in self.variants.edits)]
        cells = np.array([[place[run, edit.get(run, "")] for run in self.goal.runs] for edit in edits])
        of = {name: records[name][:, reading][:, cells] for name in ("status", *MEASURED)}
        sizes = np.rad2deg(np.stack([of[metric] for metric in METRICS], axis=-2).astype(float))
        with np.errstate(over="ignore", invalid="ignore"):
            steps = np.sqrt((of["torque_step_rms"].astype(float) ** 2).mean(axis=-1))
        stable = (of["status"] == STATUSES.index("ok")).all(axis=-1)
        absolute = self.loaded.around is not None
        return Outcomes(sizes.swapaxes(0, 1), steps.swapaxes(0, 1), stable.T, self.goal, absolute)


def _piece(study: EditStudy, identity: str, kind: RecordType, piece: Piece) -> tuple[Piece, Records]:
    """Records of some plants."""
    cells = _CELLS.get(identity) or _CELLS.setdefault(identity, study.cells)
    loops = [
        _edited(of_plant[run, reading.name], law)
        for of_plant in study.loops(int(piece[0]), len(piece))
        for reading in study.readings
        for (run, _), law in cells.items()
    ]
    records = np.empty(len(piece), kind)
    kept.record(simulate_batch(loops), records)
    return piece, records


def _edited(loop: Loop, law: EditedLaw | None) -> Loop:
    if law is None:
        return loop
    controller = controller_of(loop)
    gains = controller.law._replace(lag=law.base.law.lag)
    return replace(loop, controller=replace(controller, law=gains, command=law, on_lanes=True))


def edits_study(
    loaded: LoadedEnsemble,
    laws: Sequence[UserLaw],
    plants: int,
    errors: Path | None,
    *,
    jobs: int,
    folder: Folder,
) -> Study:
    """Check and prepare every edit of the paper's laws, or of a user's `laws`.

    Raises
    ------
    UsageError
        For too few plants, impossible jobs, a law that cannot run on many plants together, or no errors of
        it.
    """
    if plants < 1:
        raise UsageError(f"must be at least 1, found {plants}", where="--plants")
    check_jobs(jobs)
    goal = edited_goal(loaded, laws, errors)
    loaded = with_input(replace(loaded, base=with_user_laws(loaded.base, laws)), errors)
    task = EditStudy(loaded, tuple(laws), goal, plants)

    def run(site: Site, _: Path) -> Result:
        records = task.run(site, jobs)
        outcomes = {reading.name: task.outcomes(records, k) for k, reading in enumerate(task.readings)}
        return edits_result(task.variants, outcomes, int(loaded.config.seed.si))

    experiments = plants * len(task.readings) * len(task.cells)
    cost = cost_of(experiments, len(MEASURED) * len(task.goal.joints))
    study = study_on_plants("edits", loaded, task.identity, run, folder, cost=cost, stays=KEPT)
    numbers = [task.goal.runs, task.goal.values.tolist(), task.goal.half.tolist()]
    text = f"edits: {len(task.variants.edits)} edits on {plants} plants"
    plan = {"schema_version": SCHEMA_VERSION, "experiment": "edits", "text": text}
    return replace(study, decided_by={"plants": plants, "errors": numbers}, plan=plan)


def edited_goal(loaded: LoadedEnsemble, laws: Sequence[UserLaw], errors: Path | None) -> Goal:
    """Errors to explain, of runs without payload; a UsageError where a law has none."""
    goal = goal_of(loaded, errors, laws=[law.name for law in laws])
    for law in laws:
        if law.name not in goal.runs:
            message = f"has no errors of the run {law.name}, which is edited"
            raise UsageError(message, where=str(errors), hint=f"name it in the column run: {law.name}")
    return goal.of_runs(goal.compared)
