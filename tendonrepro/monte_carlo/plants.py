"""Drawn plants as closed loops of cases: runs, each under a reading."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import LoadedConfig
from tendonrepro.experiments.loops import Case, Once, case_loops
from tendonrepro.experiments.user_law import UserLaw
from tendonrepro.monte_carlo.around import AroundArm
from tendonrepro.monte_carlo.box import Box, configured
from tendonrepro.simulation.loop import Loop


def drawn_loops(
    base: LoadedConfig,
    plants: Box | AroundArm,
    values: Array,
    cases: Sequence[Case],
    laws: Sequence[UserLaw] = (),
) -> Iterator[list[Loop]]:
    """Yield the loops of each draw (N, P), by case.

    Draws are of the ranges of the paper's arm, or around one of a user's own, where `laws` run too. What
    readings leave alone is shared, and draws share motions that are the same.

    Raises
    ------
    ConfigError
        If a draw makes no sound configuration, or leaves the workspace.
    """
    motions = Once()
    for row in values:
        if isinstance(plants, AroundArm):
            config, draw = plants.configured(row), {}
        else:
            config, draw = configured(base, plants, row), plants.named(row)
        yield case_loops(config, cases, draw, base.folder, motions, laws)
