"""The command that tries every small change of the equations."""

from pathlib import Path
from typing import Annotated, Unpack

from tendonrepro.studies.command import MANY_ARMS, Example, study
from tendonrepro.studies.parameters import Jobs, Laws, OnPlants, Word, drawn_from
from tendonrepro.studies.study import Study

__all__ = ["edits"]


@study(MANY_ARMS, Example(plants=64))
def edits(
    plants: int = 256,
    *,
    laws: Laws = None,
    errors: Annotated[Path | str | None, Word(metavar="FILE")] = None,
    jobs: Jobs = -1,
    **asked: Unpack[OnPlants],
) -> Study:
    """Which small change of an equation explains a table of errors.

    An interrupted run goes on. With a comparison as configuration, plants are drawn around its arm.

    Parameters
    ----------
    plants
        Plants on which every edit runs.
    laws
        Edit your own controller instead of the paper's; its file is executed.
    errors
        Table of errors to explain [default: the paper's Table 2].
    """
    from tendonrepro.configuration.ensemble import load_plants
    from tendonrepro.experiments.user_law import laws_of
    from tendonrepro.identification.edits.study import edits_study

    return edits_study(
        load_plants(*drawn_from(asked)),
        laws_of(laws),
        plants,
        None if errors is None else Path(errors),
        jobs=jobs,
        folder=asked,
    )
