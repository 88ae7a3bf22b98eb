"""The command that runs many plausible plants."""

from typing import Annotated, Unpack

from tendonrepro.studies.command import MANY_ARMS, Example, study
from tendonrepro.studies.study import Jobs, Laws, OnPlants, Study, Word, drawn_from

__all__ = ["ensemble"]


@study(MANY_ARMS, Example(draws=512, jobs=4))
def ensemble(
    draws: int = 1024,
    *,
    readings: str = "default",
    laws: Laws = None,
    jobs: Jobs = -1,
    dask: Annotated[str | None, Word(metavar="ADDRESS")] = None,
    **asked: Unpack[OnPlants],
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
        Around your own arm, run your own controller too; its file is executed.
    dask
        Scheduler to send the work to.
    """
    from tendonrepro.experiments.user_law import laws_of
    from tendonrepro.monte_carlo.ensemble import ensemble_study, load_study

    config, spread, ranges, changes, seed = drawn_from(asked)
    ensemble = load_study(config, changes, seed, readings, spread, ranges, laws_of(laws))
    return ensemble_study(ensemble, draws, jobs=jobs, dask=dask, folder=asked)
