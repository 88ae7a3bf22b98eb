"""The command that searches plants and interpretations closest to published numbers, or to a user's."""

from pathlib import Path
from typing import Annotated, Literal, Unpack

from tendonrepro.studies.command import MANY_ARMS, Example, study
from tendonrepro.studies.parameters import Jobs, OnPlants, Word, drawn_from
from tendonrepro.studies.study import Study

__all__ = ["identify"]


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
