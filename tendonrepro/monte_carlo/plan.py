"""What an ensemble consists of: a population, scramblings, readings and blocks; and its plants as records."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import Reading, case_of
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.user_law import UserLaw, runs_of
from tendonrepro.monte_carlo import kept
from tendonrepro.monte_carlo.data import CaseName
from tendonrepro.monte_carlo.population import Population
from tendonrepro.results.paper import base_of_paper
from tendonrepro.results.record_store import Records, RecordType
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import Loop
from tendonrepro.simulation.streaming import STATISTICS

SCHEMA_VERSION = 1

ARMS = "arms"
"""Name of the population around an arm of a user's own."""

FEWEST_PER_SCRAMBLING = 8


@dataclass(frozen=True, eq=False)
class EnsembleStudy:
    """Everything that determines an ensemble's numbers but the number of draws.

    `name` is that of the `population`. Around an arm of a user's own a user's `laws` run too.
    `replicates` are independent scramblings. `block_draws` plants, a power of two, are stored together: the
    most work that a kill can cost a process.
    """

    loaded: LoadedEnsemble
    name: str
    population: Population
    readings: tuple[Reading, ...]
    variations: tuple[Reading, ...]
    seed: int
    replicates: int
    block_draws: int
    laws: tuple[UserLaw, ...] = ()

    @property
    def runs(self) -> tuple[str, ...]:
        """The paper's runs, or those of the comparison around whose arm plants are drawn, and of laws."""
        config = self.loaded.compare
        own = [run for law in self.laws for run in runs_of(law, config)]
        return (*config.runs, *own) if self.loaded.around else RUNS

    @cached_property
    def _asked(self) -> dict[CaseName, tuple[str, Reading]]:
        """Case of each run and reading; a variation asks only for runs that it changes."""
        return {
            (run, reading.name): (run, case)
            for reading in (*self.readings, *self.variations)
            for run in self.runs
            for case in [case_of(reading, run) if run in RUNS else reading]
            if case == reading or reading in self.readings
        }

    @cached_property
    def cases(self) -> tuple[tuple[str, Reading], ...]:
        """Distinct runs under distinct readings: what one draw costs."""
        return tuple(dict.fromkeys(self._asked.values()))

    @cached_property
    def lookup(self) -> Mapping[CaseName, int]:
        """``(run, reading or variation)`` -> place among `cases`."""
        return {asked: self.cases.index(case) for asked, case in self._asked.items()}

    @cached_property
    def identity(self) -> str:
        """SHA-256 of all that a stored number depends on."""
        return kept.identity_of(
            self.loaded,
            schema=SCHEMA_VERSION,
            seed=self.seed,
            replicates=self.replicates,
            cases=[[run, case.name] for run, case in self.cases],
            statistics=STATISTICS,
        )

    @property
    def record(self) -> RecordType:
        """A record of one plant: its numbers (P,); by case statuses (C,) and statistics (C, n), SI."""
        cases, joints = len(self.cases), len(self.loaded.compare.joints)
        return np.dtype(
            [
                ("draws", np.float64, (len(self.population.rows),)),
                *((name, np.float32, (cases, joints)) for name in STATISTICS),
                ("status", np.int8, (cases,)),
            ]
        )

    def values(self, plants: NDArray[np.int64]) -> Array:
        """Numbers (M, P) of plants, in turn of each scrambling: more draws go on where fewer ended."""
        numbers, replicates = np.divmod(plants, self.replicates)
        first, count = int(numbers.min()), int(np.ptp(numbers)) + 1
        drawn = {
            replicate: self.population.sample(self.seed, replicate, first, count)
            for replicate in np.unique(replicates).tolist()
        }
        pairs = zip(replicates.tolist(), (numbers - first).tolist(), strict=True)
        return np.stack([drawn[replicate][number] for replicate, number in pairs])

    def pieces(self, draws: int) -> list[kept.Piece]:
        """Cut so many plants into pieces of one scrambling each.

        A piece is run whole: what runs beside a plant can change its last bits, and encoder steps show them.
        """
        each, size = draws // self.replicates, self._size(draws)
        return [
            np.arange(first, min(first + size, each)) * self.replicates + replicate
            for replicate, first in product(range(self.replicates), range(0, each, size))
        ]

    def _size(self, draws: int) -> int:
        """Plants of a piece."""
        return min(draws // self.replicates, self.block_draws, kept.PLANTS_AT_ONCE)

    def file_name(self, draws: int) -> str:
        """Name of the file of records; pieces of another size give other numbers."""
        return f"{self.name}-n{self._size(draws)}-{self.identity[:12]}.npy"

    def check(self, draws: int) -> None:
        """Raise a UsageError for too few or many draws, or for no power of two."""
        fewest, most = FEWEST_PER_SCRAMBLING * self.replicates, kept.MOST_DRAWS
        if not fewest <= draws <= most or draws & (draws - 1) or draws % self.replicates:
            needed = 2 ** int(np.ceil(np.log2(min(max(draws, fewest), most))))
            message = f"the number of draws is a power of two from {fewest} to {most}, not {draws}"
            raise UsageError(message, where="--draws", hint=f"{needed} would do")

    def plan(self, draws: int) -> dict[str, object]:
        """Describe the ensemble as plain values that its reader needs."""
        around = self.loaded.around
        return {
            **({"around": around.told} if around else {}),
            "schema_version": SCHEMA_VERSION,
            "identity": self.identity,
            "draws": draws,
            "replicates": self.replicates,
            "seed": self.seed,
            "populations": {self.name: draws},
            "records": {self.name: self.file_name(draws)},
            "of_paper": not around and base_of_paper(self.loaded.compare),
            "joints": list(self.loaded.compare.joints),
            "runs": list(self.runs),
            "names": list(self.population.names),
            "readings": [reading.name for reading in self.readings],
            "variations": [reading.name for reading in self.variations],
            "lookup": [[run, name, place] for (run, name), place in self.lookup.items()],
        }

    def cost(self, plants: int) -> dict[str, float]:
        """Estimate what some plants cost."""
        return kept.cost_of(plants * len(self.cases), len(STATISTICS) * len(self.loaded.compare.joints))


def evaluated(
    study: EnsembleStudy, piece: kept.Piece, simulate: kept.Simulate = simulate_batch
) -> tuple[kept.Piece, Records]:
    """Records of the plants of a piece."""
    values = study.values(piece)
    loops = [loop for of_plant in _loops(study, piece, values) for loop in of_plant]
    records = np.empty(len(values), study.record)
    records["draws"] = values
    kept.record(simulate(loops), records)
    return piece, records


def _loops(study: EnsembleStudy, piece: kept.Piece, values: Array) -> Iterator[list[Loop]]:
    """Loops of each plant, by case; an error names the plant."""
    drawn = study.population.loops(values, study.cases, study.laws)
    for plant, row in zip(piece, values, strict=True):
        try:
            yield next(drawn)
        except TendonreproError as error:
            message = f"plant {plant} of {study.name} cannot be run: {error.message}"
            raise TendonreproError(
                message, where=error.where, hint=json.dumps(study.population.named(row))
            ) from error
