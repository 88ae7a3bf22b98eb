"""What ``tendonrepro predict`` asks for by default, and shows: JSON, tables and picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tendonrepro.configuration.ensemble import LoadedEnsemble, draws_rows, readings_on
from tendonrepro.configuration.models.readings import Reading, parse_reading
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.evidence.predict import LEAST, Gaps, experiments_on, gaps_between, predictions
from tendonrepro.files import Json
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


def default_readings_on(loaded: LoadedEnsemble) -> str:
    """Names of the readings that are asked for unless others are named."""
    if not loaded.around:
        return READINGS
    return ",".join(name for name in READINGS.split(",") if not draws_rows(parse_reading(name)))


def predict_result(
    loaded: LoadedEnsemble, draws: int, readings: Sequence[Reading], talk: Talk, files: Path | None = None
) -> Result:
    """Predict every experiment under interpretations.

    What was simulated is kept in the folder `files`, if one is named.
    """
    from tendonrepro.evidence.figure_predictions import draw_predictions

    names, joints, around = [reading.name for reading in readings], loaded.compare.joints, loaded.around
    predicted = list(predictions(loaded, readings, draws, talk, files))
    gaps = gaps_between(predicted, names)
    experiments = [
        {
            "name": experiment.name,
            "about": experiment.about,
            "judged_pairs": len(of_pairs),
            "told_apart": [[*pair] for pair, gap in of_pairs.items() if gap > 0.0],
            "gaps": [gap for gap in of_pairs.values() if gap > 0.0],
            "ratios": [vars(row) for row in predicted if row.experiment == experiment.name],
        }
        for experiment in experiments_on(loaded)
        for of_pairs in [gaps[experiment.name]]
    ]
    data = {
        "schema_version": SCHEMA_VERSION,
        "draws": draws,
        **({"around": around.as_data()} if around else {}),
        "joints": list(joints),
        "readings": names,
        "never_told_apart": _never_told_apart([*gaps.values()]),
        "experiments": experiments,
    }
    where = around.told if around else ""
    figures = {"predictions": lambda: draw_predictions(experiments, names, joints, where)}
    return Result(data, prediction_tables(data, where), figures)


def _never_told_apart(gaps: Sequence[Gaps]) -> list[list[str]]:
    """Pairs of readings that no experiment tells apart, of those with a known gap."""
    pairs = dict.fromkeys(pair for of_pairs in gaps for pair in of_pairs)
    return [[*pair] for pair in pairs if not any(of_pairs.get(pair, 0.0) > 0.0 for of_pairs in gaps)]


def prediction_tables(data: Json, where: str = "") -> list[Table | str]:
    """Tables of experiments, of pairs that none tells apart, and of ratios; before them what is too few."""
    telling = sorted(data["experiments"], key=lambda experiment: -max(experiment["gaps"], default=0.0))
    is_judged = any(experiment["judged_pairs"] for experiment in telling)
    experiments = [
        {
            "experiment": experiment["about"],
            # Where no pair could be judged, zeros would be findings.
            "widest_gap": max(experiment["gaps"], default=0.0) if experiment["judged_pairs"] else None,
            "narrowest_gap": min(experiment["gaps"], default=0.0) if experiment["judged_pairs"] else None,
            "pairs_told_apart": len(experiment["gaps"]) if experiment["judged_pairs"] else None,
        }
        for experiment in telling
    ]
    untold = [{"interpretation": a, "and": b} for a, b in data["never_told_apart"]]
    ratios = [row for experiment in telling for row in experiment["ratios"]]
    few = sum(row["plants"] < LEAST for row in ratios)
    ranges = f"{few} of {len(ratios)} ranges have fewer than {LEAST} stable plants, and tell nothing"
    shown = ("experiment", "reading", "joint", "errors_of", "plants", "median", "low", "high")
    on = f"{data['draws']} plants {where}".strip()
    return [
        *([f"{ranges}: more --draws"] if few else []),
        Table(
            "experiments",
            "Experiments, the most telling first: gaps between the 90 % ranges of interpretations.",
            experiments,
            terminal=None if is_judged else (),
        ),
        Table(
            "never_told_apart",
            "Interpretations that no experiment tells apart.",
            untold,
            terminal=None if is_judged else (),
        ),
        Table(
            "predictions",
            f"Ratio of mean errors, median and central 90 % of the stable ones of {on}.",
            ratios,
            terminal=() if is_judged else shown,
        ),
    ]
