"""What ``tendonrepro predict`` asks for by default, and shows: JSON, tables and picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from tendonrepro.configuration.ensemble import LoadedEnsemble, draws_rows, readings_on
from tendonrepro.configuration.models.readings import Reading, parse_reading
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.evidence.predict import (
    LEAST,
    BenchExperiment,
    Gaps,
    Prediction,
    experiments_on,
    gaps_between,
    never_told_apart,
    predictions,
    told_apart,
)
from tendonrepro.monte_carlo.plan import MOST_DRAWS
from tendonrepro.results.tables import Table
from tendonrepro.studies.result import Result

SCHEMA_VERSION = 1
READINGS = (
    "printed,Delta_unit=deg,gain_unit=phi_in_degrees,phi_branch=power,weights=extrapolating,"
    "weights=extrapolating+Delta_unit=deg,stored_torque=applied+torque_step=0.016,"
    "Delta_unit=deg+stored_torque=applied+torque_step=0.016,feedback=motor,"
    "reference_acceleration=absent,motion=ramp,starts=apart,"
    "reference_acceleration=absent+starts=apart,motion=ramp+starts=apart"
)
"""Interpretations whose predictions are asked for unless others are named."""


def asked_for(loaded: LoadedEnsemble, draws: int, readings: str) -> tuple[Reading, ...]:
    """Interpretations by name; a UsageError for an unknown one, or too few or many draws."""
    if not LEAST <= draws <= MOST_DRAWS:
        raise UsageError(f"must be {LEAST} to {MOST_DRAWS} plants, found {draws}", where="--draws")
    return readings_on(loaded, readings)


def predict_result(
    loaded: LoadedEnsemble, draws: int, readings: str, talk: Talk, files: Path | None = None
) -> Result:
    """Predict every experiment under interpretations, their names with commas between.

    What was simulated is kept in the folder `files`, if one is named.
    """
    from tendonrepro.evidence.figure_predictions import draw_predictions

    if draws & (draws - 1):
        even = 1 << draws.bit_length()
        talk.note(f"{draws} is no power of two, so plants cover their ranges less evenly than {even} would")
    chosen, joints, experiments_run = (
        readings_on(loaded, readings),
        loaded.compare.joints,
        experiments_on(loaded),
    )
    predicted = list(predictions(loaded, chosen, draws, talk, files))
    names = [reading.name for reading in chosen]
    gaps = gaps_between(predicted, names)
    told, never = told_apart(gaps), never_told_apart(gaps, names)
    experiments = [
        {
            "name": experiment.name,
            "about": experiment.about,
            "judged_pairs": len(gaps[experiment.name]),
            "told_apart": [*map(list, told[experiment.name])],
            "gaps": [*told[experiment.name].values()],
            "ratios": [vars(row) for row in predicted if row.experiment == experiment.name],
        }
        for experiment in experiments_run
    ]
    around = loaded.around
    data = {
        "schema_version": SCHEMA_VERSION,
        "draws": draws,
        **({"around": around.as_data()} if around else {}),
        "joints": list(joints),
        "readings": names,
        "never_told_apart": never,
        "experiments": experiments,
    }
    where = around.told if around else ""
    on = f"{draws} plants {where}".strip()
    figures = {"predictions": lambda: draw_predictions(experiments, names, joints, where)}
    return Result(data, prediction_tables(predicted, gaps, never, on, experiments_run), figures)


def default_readings_on(loaded: LoadedEnsemble) -> str:
    """Names of the readings that are asked for unless others are named."""
    if not loaded.around:
        return READINGS
    return ",".join(name for name in READINGS.split(",") if not draws_rows(parse_reading(name)))


def prediction_tables(
    predicted: Sequence[Prediction],
    gaps: Mapping[str, Gaps],
    never: Sequence[Sequence[str]],
    on: str,
    experiments: Sequence[BenchExperiment],
) -> list[Table | str]:
    """Tables of experiments, of pairs that none tells apart, and of ratios; before them what is too few."""
    told = told_apart(gaps)
    telling = sorted(experiments, key=lambda experiment: -max(told[experiment.name].values(), default=0.0))
    rows = []
    for experiment in telling:
        # Where no pair could be judged, zeros would be findings.
        apart = [*told[experiment.name].values()] if gaps[experiment.name] else None
        rows.append(
            {
                "experiment": experiment.about,
                "widest_gap": None if apart is None else max(apart, default=0.0),
                "narrowest_gap": None if apart is None else min(apart, default=0.0),
                "pairs_told_apart": None if apart is None else len(apart),
            }
        )
    caption = "Experiments, the most telling first: gaps between the 90 % ranges of interpretations."
    ratios = [vars(row) for experiment in telling for row in predicted if row.experiment == experiment.name]
    about = f"Ratio of mean errors, median and central 90 % of the stable ones of {on}."
    is_one = len({row.reading for row in predicted}) == 1
    # Where no pair could be judged, no row would be a finding.
    pairs = never if any(gaps.values()) or is_one else [(None, None)]
    untold = [{"interpretation": a, "and": b} for a, b in pairs]
    few = sum(row.plants < LEAST for row in predicted)
    ranges = f"{few} of {len(predicted)} ranges"
    remark = f"{ranges} have fewer than {LEAST} stable plants, and tell nothing: more --draws"
    ratio_columns = ("experiment", "joint", "plants", "median", "low", "high")
    return [
        *([remark] if few else []),
        *(["One interpretation alone: there is no other to tell it from."] if is_one else []),
        Table("experiments", caption, rows, terminal=() if is_one else None),
        Table(
            "never_told_apart",
            "Interpretations that no experiment tells apart.",
            untold,
            terminal=() if is_one else None,
        ),
        Table("predictions", about, ratios, terminal=ratio_columns if is_one else ()),
    ]
