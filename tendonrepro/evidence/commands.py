"""The commands about evidence: what a log tells, and what experiments would."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Unpack

from tendonrepro.studies.command import DATA, MANY_ARMS, Example, study
from tendonrepro.studies.study import (
    ARGUMENT,
    Changes,
    ConfigOption,
    Destination,
    OnPlants,
    Study,
    drawn_from,
)

__all__ = ["predict", "recover"]


@study(MANY_ARMS, Example(readings=["printed", "Delta_unit=deg"]))
def predict(
    draws: int = 256,
    *,
    readings: str | None = None,
    **asked: Unpack[OnPlants],
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
    from tendonrepro.configuration.ensemble import load_plants, with_all_controllers
    from tendonrepro.evidence.predict import asked_for, default_readings_on, predict_result, predicted_cost
    from tendonrepro.monte_carlo.kept import identity_of, study_on_plants

    loaded = with_all_controllers(load_plants(*drawn_from(asked)))
    names = readings or default_readings_on(loaded)
    chosen = asked_for(loaded, draws, names)
    study = study_on_plants(
        "predict",
        loaded,
        identity_of(loaded, "evidence"),
        lambda site, kept: predict_result(loaded, draws, chosen, site.talk, kept),
        asked,
        cost=predicted_cost(loaded, len(chosen), draws),
    )
    return replace(study, decided_by={"draws": draws, "readings": names})


@study(DATA, Example("data/measured.h5"))
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
    from tendonrepro.evidence.recover import recover_result
    from tendonrepro.results.traces import read_traces

    file, loaded = read_traces(Path(log)), load_config(config, "compare", overrides=set)
    own = config is not None or bool(set)
    return Study(
        loaded,
        lambda site: recover_result(file, str(Path(log)), loaded, site, own=own),
        folder,
        decided_by={
            "log": [file.config_sha256, file.manifest.get("created", "")],
            **({"own": True} if own else {}),
        },
    )
