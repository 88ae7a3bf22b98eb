"""The commands about evidence: what a log tells, and what experiments would."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Unpack

from tendonrepro.studies.command import DATA, MANY_ARMS, study
from tendonrepro.studies.parameters import (
    ARGUMENT,
    Changes,
    ConfigOption,
    Destination,
    Folder,
    RangesOption,
    Seed,
    SpreadOption,
)
from tendonrepro.studies.study import Study

__all__ = ["predict", "recover"]


@study(MANY_ARMS, "tendonrepro predict --readings printed,Delta_unit=deg")
def predict(
    draws: int = 256,
    *,
    config: ConfigOption = None,
    set: Changes = None,
    seed: Seed = None,
    readings: str | None = None,
    spread: SpreadOption = None,
    ranges: RangesOption = None,
    **folder: Unpack[Folder],
) -> Study:
    """What experiments on a bench would give, by interpretation.

    An interrupted prediction goes on.
    With a comparison as configuration, plants are drawn around its arm.

    Parameters
    ----------
    draws
        Plants.
    readings
        Comma-separated names [default: the main ones].
    """
    from tendonrepro import __version__
    from tendonrepro.configuration.ensemble import load_plants, with_all_controllers
    from tendonrepro.evidence.predict import predicted_cost
    from tendonrepro.evidence.predict_report import asked_for, default_readings_on, predict_result
    from tendonrepro.files import digest_of
    from tendonrepro.monte_carlo.plan import ROOMS, code_digest

    loaded = with_all_controllers(load_plants(config, spread, ranges, overrides=set, seed=seed))
    names = readings or default_readings_on(loaded)
    chosen = asked_for(loaded, draws, names)
    made_by = __version__, code_digest(*ROOMS, "evidence"), loaded.sha256, loaded.base.sha256
    states = f"plants-{digest_of({'made_by': made_by})[:16]}"  # those of others are not taken up
    return Study(
        replace(loaded.base, sha256=loaded.sha256, origin=loaded.origin),
        lambda site: predict_result(loaded, draws, names, site.talk, site.files / states),
        folder,
        decided_by={"draws": draws, "readings": names},
        cost=predicted_cost(loaded, len(chosen), draws),
        keep=states,
        stored=True,
    )


@study(DATA, "tendonrepro data recover data/measured.h5")
def recover(
    log: Annotated[Path | str, ARGUMENT],
    *,
    config: ConfigOption = None,
    set: Changes = None,
    **folder: Unpack[Destination],
) -> Study:
    """Which controller made a log, or why that cannot be told.

    With a comparison as configuration, the log is compared with its gains, not with the paper's.

    Parameters
    ----------
    log
        Trace file, or results folder with one.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.evidence.recover_report import recover_result
    from tendonrepro.results.traces import read_traces

    file, loaded = read_traces(Path(log)), load_config(config, "compare", overrides=set)
    own = config is not None or bool(set)
    return Study(
        loaded,
        lambda site: recover_result(file, str(Path(log)), loaded, site, own=own),
        folder,
        decided_by={"log": [file.config_sha256, file.created], **({"own": True} if own else {})},
    )
