"""The command that tunes every controller."""

from typing import Unpack

from tendonrepro.studies.command import MANY_ARMS, Example, study
from tendonrepro.studies.study import Jobs, Laws, OnPlants, Study, drawn_from

__all__ = ["tune"]


@study(MANY_ARMS, Example(plants=24))
def tune(
    plants: int = 16,
    *,
    searches: int = 4,
    generations: int = 4,
    population: int = 6,
    laws: Laws = None,
    any_plant: bool = False,
    only: str = "",
    jobs: Jobs = -1,
    **asked: Unpack[OnPlants],
) -> Study:
    """Controllers at their best: each one tuned, then compared.

    An interrupted tuning goes on. With a comparison as configuration, plants are drawn around its arm.

    Parameters
    ----------
    plants
        Plants to tune on.
    searches
        Of each law on each plant.
    generations
        Of each search.
    population
        Members of a generation.
    laws
        Tune your own controller too; its file is executed.
    any_plant
        Also plants where the gains of the configuration are unstable.
    only : ntsm,alpha_free
        Tune only these controllers [default: all].
    seed
        Seed of the searches; it draws no other plants.
    """
    from tendonrepro.configuration.ensemble import load_plants
    from tendonrepro.experiments.user_law import laws_of
    from tendonrepro.tuning.search import TuningEffort
    from tendonrepro.tuning.tuning import tuning_study

    config, spread, ranges, changes, seed = drawn_from(asked)
    return tuning_study(
        load_plants(config, spread, ranges, changes),
        laws_of(laws),
        plants,
        TuningEffort(searches, generations, population),
        any_plant=any_plant,
        seed=seed or 0,
        jobs=jobs,
        only=only,
        folder=asked,
    )
