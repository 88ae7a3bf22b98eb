"""The command that runs many plausible plants."""

from typing import Annotated, Unpack

from tendonrepro.studies.command import MANY_ARMS, study
from tendonrepro.studies.parameters import (
    Changes,
    ConfigOption,
    Folder,
    Jobs,
    Laws,
    RangesOption,
    Seed,
    SpreadOption,
    Word,
)
from tendonrepro.studies.study import Study

__all__ = ["ensemble"]


@study(MANY_ARMS, "tendonrepro ensemble --draws 1024 --jobs 4")
def ensemble(
    draws: int = 1024,
    *,
    config: ConfigOption = None,
    set: Changes = None,
    seed: Seed = None,
    readings: str = "default",
    spread: SpreadOption = None,
    ranges: RangesOption = None,
    laws: Laws = None,
    jobs: Jobs = -1,
    dask: Annotated[str | None, Word(metavar="ADDRESS")] = None,
    **folder: Unpack[Folder],
) -> Study:
    """Many plausible plants under many interpretations of the paper.

    An interrupted run goes on. With a comparison as configuration, plants are drawn around its arm.

    Parameters
    ----------
    draws
        Plants, a power of two; 64 at least.
    readings
        default, or comma-separated names.
    laws
        Around your own arm, run your own controller too; repeatable. FILE is executed.
    dask
        Scheduler to send the work to.
    """
    from tendonrepro.experiments.user_law import laws_of
    from tendonrepro.monte_carlo.ensemble import ensemble_study, load_study

    ensemble = load_study(config, set, seed, readings, spread, ranges, laws_of(laws))
    return ensemble_study(ensemble, draws, jobs=jobs, dask=dask, folder=folder)
