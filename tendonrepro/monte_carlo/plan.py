"""What an ensemble consists of: populations, scramblings, readings and blocks."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import cache, cached_property
from pathlib import Path

import numpy as np

from tendonrepro import __version__
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import Reading, case_of
from tendonrepro.errors import UsageError
from tendonrepro.experiments.user_law import UserLaw, runs_of
from tendonrepro.files import digest_of
from tendonrepro.monte_carlo.data import Block, CaseName
from tendonrepro.monte_carlo.population import Population
from tendonrepro.results.paper import base_of_paper
from tendonrepro.simulation.streaming import STATISTICS

SCHEMA_VERSION = 1

ARMS = "arms"
"""Name of the population around an arm of a user's own."""

FEWEST_PER_SCRAMBLING = 8

MOST_DRAWS = 2**20
"""Weeks of work, and as many blocks as memory holds with ease."""

SECONDS_PER_EXPERIMENT = 6e-3
"""Time on a fast processor, for estimates before anything has run; of the same order is all that is needed.

Measured: 17 ms on slow processors that had other work too.
"""

_COMPRESSION = 0.9


ROOMS = ("configuration", "experiments", "monte_carlo", "physics", "simulation")
"""Packages whose code decides what a draw is and what its runs give."""


@cache
def code_digest(*rooms: str) -> str:
    """SHA-256 of the code of some packages, without comments and docstrings."""
    package = Path(__file__).parents[1]
    files = [path for room in rooms for path in sorted((package / room).rglob("*.py"))]
    return digest_of({path.relative_to(package).as_posix(): _bare_code(path) for path in files})


def _bare_code(path: Path) -> str:
    tree = ast.parse(path.read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            node.body = node.body[1:]
    # Unlike a dump of the tree it is the same under every version of Python.
    return ast.unparse(tree)


@dataclass(frozen=True, eq=False)
class EnsembleStudy:
    """Everything that determines an ensemble's numbers but the number of draws.

    Claims are judged by the first of the `populations`, whose `shares` are their parts of the number asked
    for. Around an arm of a user's own a user's `laws` run too.
    `replicates` are independent scramblings. A block of `block_draws`, a power of two, is the most work
    that a kill can cost a process.
    """

    loaded: LoadedEnsemble
    populations: Mapping[str, Population]
    shares: Mapping[str, float]
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
        """SHA-256 of all that a stored number depends on, the version included."""
        content = {
            "schema": SCHEMA_VERSION,
            "version": __version__,
            "code": code_digest(*ROOMS),
            "config": self.loaded.sha256,
            "base": self.loaded.base.sha256,
            "seed": self.seed,
            "replicates": self.replicates,
            "cases": [[run, case.name] for run, case in self.cases],
            "statistics": STATISTICS,
        }
        return digest_of(content)

    def blocks(self, draws: int) -> list[Block]:
        """Cut the draws of every population, `draws` at a share of 1, into blocks; see `draws_of`."""
        return [
            Block(population, replicate, first, min(each, self.block_draws))
            for population in self.populations
            for each in [self.draws_of(population, draws) // self.replicates]
            for replicate in range(self.replicates)
            for first in range(0, each, self.block_draws)
        ]

    def draws_of(self, population: str, draws: int) -> int:
        """Draws of one population; a UsageError for too few or many, or for no power of two."""
        share = min(self.shares.values())
        fewest = FEWEST_PER_SCRAMBLING * self.replicates / share
        if not fewest <= draws <= MOST_DRAWS or draws & (draws - 1) or (draws * share) % self.replicates:
            needed = 2 ** int(np.ceil(np.log2(min(max(draws, fewest), MOST_DRAWS))))
            message = f"the number of draws is a power of two from {fewest:g} to {MOST_DRAWS}, not {draws}"
            raise UsageError(message, where="--draws", hint=f"{needed} would do")
        return int(draws * self.shares[population])

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
            "populations": {name: self.draws_of(name, draws) for name in self.populations},
            "of_paper": not around and base_of_paper(self.loaded.compare),
            "joints": list(self.loaded.compare.joints),
            "alpha": self.loaded.compare.control.gains.alpha.si.tolist(),
            "runs": list(self.runs),
            "names": list(next(iter(self.populations.values())).names),
            "readings": [reading.name for reading in self.readings],
            "variations": [reading.name for reading in self.variations],
            "lookup": [[run, name, place] for (run, name), place in self.lookup.items()],
            "blocks": [astuple(block) for block in self.blocks(draws)],
        }

    def cost(self, blocks: Sequence[Block]) -> dict[str, float]:
        """Estimate what some blocks cost."""
        draws = sum(block.count for block in blocks)
        experiments = draws * len(self.cases)
        seconds = experiments * SECONDS_PER_EXPERIMENT
        numbers = len(STATISTICS) * len(self.loaded.compare.joints) * 4 + 1
        return {
            "experiments": experiments,
            "processor_hours": seconds / 3600.0,
            "gigabytes": experiments * numbers * _COMPRESSION / 1e9,
        }
