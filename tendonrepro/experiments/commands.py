"""The commands around the paper's experiments: what each asks for, and what it does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeAlias, Unpack

from tendonrepro.studies.command import (
    EXPLORE,
    Changes,
    Controllers,
    Folder,
    Seed,
    Source,
    Study,
    Word,
    study,
)

Over: TypeAlias = Annotated[Sequence[str] | Mapping[str, Sequence[Any]], Word(metavar="KEY=A,B,C")]


@study(EXPLORE, 'tendonrepro sweep --over "control.gains.alpha=[0,0],[0.1,0.2],[0.3,0.4]"')
def sweep(
    over: Over,
    config: Source = None,
    *,
    set: Changes = None,
    seed: Seed = None,
    controllers: Controllers = None,
    **folder: Unpack[Folder],
) -> Study:
    """The comparison over values of one or two keys.

    Parameters
    ----------
    over
        A key and its values; once or twice.
    """
    from tendonrepro.experiments.sweep import load_grid, simulate
    from tendonrepro.experiments.sweep_report import sweep_outcome

    grid = load_grid(over, config, overrides=set, seed=seed, controllers=controllers)
    return Study(grid.base, lambda talk, _: sweep_outcome(simulate(grid, talk)), folder)


@study(EXPLORE, "tendonrepro statics --set manipulator.tensioner.force=30")
def statics(
    config: Source = None, *, set: Changes = None, seed: Seed = None, **folder: Unpack[Folder]
) -> Study:
    """Tension of every tendon over the working half-plane."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.experiments.statics import check_joints, survey
    from tendonrepro.experiments.statics_report import statics_outcome

    loaded = load_config(config, "decouple", overrides=set, seed=seed)
    check_joints(loaded.config)
    return Study(loaded, lambda *_: statics_outcome(survey(loaded)), folder)
