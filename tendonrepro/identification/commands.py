"""The command that searches plants and interpretations closest to the published numbers."""

from typing import Literal, Unpack

from tendonrepro.studies.command import EXPLORE, study
from tendonrepro.studies.parameters import Changes, Folder, Jobs, On, Seed, Source
from tendonrepro.studies.study import Study

__all__ = ["identify"]


@study(EXPLORE, "tendonrepro identify --readings printed,weights=extrapolating")
def identify(
    fit: Literal["controller_2", "all"] = "controller_2",
    *,
    readings: str = "printed",
    window: Literal["whole", "late"] = "whole",
    generations: int = 60,
    population: int = 48,
    seeds: int = 3,
    unknowns: int = 10,  # more than sixteen numbers could settle would be no explanation
    rows: str = "",
    config: Source = None,
    set: Changes = None,
    seed: Seed = None,
    jobs: Jobs = -1,
    device: On = "cpu",
    **folder: Unpack[Folder],
) -> Study:
    """Plants and interpretations closest to the published numbers.

    An interrupted search goes on.

    Parameters
    ----------
    fit
        Fit Controller 2 alone, or all sixteen numbers.
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
    from tendonrepro.configuration.ensemble import load_ensemble
    from tendonrepro.identification.search import Effort
    from tendonrepro.identification.searches import identification

    return identification(
        load_ensemble(config, overrides=set, seed=seed),
        Effort(generations, population, seeds),
        fit=fit,
        readings=readings,
        window=window,
        unknowns=unknowns,
        rows=rows,
        jobs=jobs,
        device=device,
        folder=folder,
    )
