"""The command that runs many plausible plants."""

from dataclasses import replace
from typing import Annotated, Unpack

from tendonrepro.studies.command import EXPLORE, study
from tendonrepro.studies.parameters import Changes, Folder, Jobs, On, Seed, Source, Word
from tendonrepro.studies.study import Study

__all__ = ["ensemble"]


@study(EXPLORE, "tendonrepro ensemble --draws 1024 --jobs 4")
def ensemble(
    draws: int = 1024,
    *,
    config: Source = None,
    set: Changes = None,
    seed: Seed = None,
    readings: str = "default",
    jobs: Jobs = -1,
    device: On = "cpu",
    dask: Annotated[str | None, Word(metavar="ADDRESS")] = None,
    **folder: Unpack[Folder],
) -> Study:
    """Many plausible plants under many interpretations of the paper.

    An interrupted run goes on.

    Parameters
    ----------
    draws
        Plants, a power of two; as shipped 256 at least.
    readings
        default, or comma-separated names.
    dask
        Scheduler to send the work to.
    """
    from tendonrepro.monte_carlo.ensemble import ensemble_study, load_study
    from tendonrepro.simulation.device import require

    require(device)
    ensemble = replace(load_study(config, set, seed, readings), device=device)
    return ensemble_study(ensemble, draws, jobs=jobs, dask=dask, folder=folder)
