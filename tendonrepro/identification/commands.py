"""The commands that explain published errors, or a user's: by plants, and by small changes of equations."""

from pathlib import Path
from typing import Annotated, Literal, Unpack

from tendonrepro.studies.command import MANY_ARMS, Example, study
from tendonrepro.studies.study import Jobs, Laws, OnPlants, Study, Word, drawn_from

__all__ = ["edits", "identify"]


@study(MANY_ARMS, Example(readings=["printed", "weights=extrapolating"]))
def identify(
    fit: Literal["controller_2", "all"] = "controller_2",
    *,
    errors: Annotated[Path | str | None, Word(metavar="FILE")] = None,
    readings: str = "printed",
    window: Literal["whole", "late"] = "whole",
    budget: int = 1500,
    rows: str = "",
    jobs: Jobs = -1,
    **asked: Unpack[OnPlants],
) -> Study:
    """Plants closest to the published errors, or to your own.

    An interrupted search goes on. With a comparison as configuration, your arm is fitted to your errors.

    Parameters
    ----------
    fit
        Of the paper's numbers those of Controller 2, or all sixteen.
    errors
        Fit these instead: a table of errors, or a folder with traces.
    readings
        printed, default, shown (in findings), or comma-separated names.
    window
        Whole run, or after the first period.
    budget
        Plants of each of the two searches.
    rows
        Names of the parameters to search, comma-separated; else all.
    """
    from tendonrepro.configuration.ensemble import load_plants
    from tendonrepro.identification.study import identification

    return identification(
        load_plants(*drawn_from(asked)),
        fit=fit,
        errors=None if errors is None else Path(errors),
        readings=readings,
        window=window,
        budget=budget,
        rows=rows,
        jobs=jobs,
        folder=asked,
    )


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
