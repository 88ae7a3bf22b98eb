"""The command that searches plants and interpretations closest to published numbers, or to a user's."""

from pathlib import Path
from typing import Annotated, Literal, Unpack

from tendonrepro.studies.command import MANY_ARMS, study
from tendonrepro.studies.parameters import (
    Changes,
    ConfigOption,
    Folder,
    Jobs,
    RangesOption,
    Seed,
    SpreadOption,
    Word,
)
from tendonrepro.studies.study import Study

__all__ = ["identify"]


@study(MANY_ARMS, "tendonrepro identify --readings printed,weights=extrapolating")
def identify(
    fit: Literal["controller_2", "all"] = "controller_2",
    *,
    errors: Annotated[Path | str | None, Word(metavar="FILE")] = None,
    readings: str = "printed",
    window: Literal["whole", "late"] = "whole",
    generations: int = 60,
    population: int = 48,
    seeds: int = 3,
    unknowns: int = 10,  # more than sixteen numbers could settle would be no explanation
    rows: str = "",
    config: ConfigOption = None,
    set: Changes = None,
    seed: Seed = None,
    spread: SpreadOption = None,
    ranges: RangesOption = None,
    jobs: Jobs = -1,
    **folder: Unpack[Folder],
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
    generations
        Of each search.
    population
        Members of a generation.
    seeds
        Searches of each interpretation.
    unknowns
        Parameters that are searched at most.
    rows
        Names of the parameters to search instead, comma-separated.
    """
    from tendonrepro.configuration.ensemble import load_plants
    from tendonrepro.identification.search import SearchEffort
    from tendonrepro.identification.searches import identification

    return identification(
        load_plants(config, spread, ranges, overrides=set, seed=seed),
        SearchEffort(generations, population, seeds),
        fit=fit,
        errors=None if errors is None else Path(errors),
        readings=readings,
        window=window,
        unknowns=unknowns,
        rows=rows,
        jobs=jobs,
        folder=folder,
    )
