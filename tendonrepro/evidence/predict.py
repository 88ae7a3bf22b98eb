"""Experiments on a bench, what each would give under every reading, and which readings that tells apart.

The end has what ``tendonrepro predict`` asks for by default, and its JSON, tables and picture.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
from scipy.interpolate import CubicSpline

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble, draws_rows, readings_on
from tendonrepro.configuration.models.control import FIRST, LOADED, RUNS, SECOND, THIRD, Readings
from tendonrepro.configuration.models.readings import Reading, parse_reading, under
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.files import Json
from tendonrepro.monte_carlo.kept import MOST_DRAWS, SECONDS_PER_EXPERIMENT, Kept
from tendonrepro.monte_carlo.population import population_of
from tendonrepro.parallel import processors
from tendonrepro.physics.control import Law, estimator_weights, polynomial
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.tables import Table
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.loop import DesiredMotion, Loop, TimeDelayController
from tendonrepro.studies.result import Result
from tendonrepro.studies.study import cost_of

PUBLISHED_PERIOD = 1e-3
"""Sampling period, s, of which the doubled one is a variation."""
DOUBLED_PERIOD = "controller_1_period_doubled"
"""Name of Controller 1's loop at twice the published period: its motion and filters are others, too."""

Loops: TypeAlias = Mapping[str, Loop]
"""Loops of one plant by run, and that of `DOUBLED_PERIOD`."""
Change: TypeAlias = Callable[[Loops, Readings], Loop]
"""From the loops of a plant, and the readings that they have, to the loop of the changed run."""


@dataclass(frozen=True)
class BenchExperiment:
    """``change`` makes the loop of the changed run; its error is divided by that of the run ``beside``.

    ``error`` names the statistic of both: of the whole run, or ``mae_settled`` of all after two seconds.
    """

    name: str
    about: str
    change: Change
    beside: str = FIRST
    error: str = "mae"


def _run(name: str, loops: Loops, _: Readings) -> Loop:
    return loops[name]


def with_alpha(alpha: float, loops: Loops, readings: Readings) -> Loop:
    """Controller 1 with one alpha on all joints."""
    law = law_in(loops[FIRST])
    weights = estimator_weights(np.full_like(law.M_bar, alpha), readings.weights)
    return _with_law(loops[FIRST], law._replace(weights=weights))


def _with_law(loop: Loop, law: Law) -> Loop:
    return replace(loop, controller=TimeDelayController(law))


def law_in(loop: Loop) -> Law:
    """The law of a loop of the paper's own."""
    assert isinstance(loop.controller, TimeDelayController)
    return loop.controller.law


def _slower(loops: Loops, _: Readings) -> Loop:
    loop = loops[FIRST]
    motion, L = loop.reference, loop.L
    time = L * np.arange(2 * motion.time.size - 1, dtype=np.float64)
    half = 0.5 * time
    if motion.ddq_d.any():
        angle = CubicSpline(motion.time, motion.q_d)
        rates = angle(half), 0.5 * angle(half, 1), 0.25 * angle(half, 2)
    else:
        # Straight lines keep their corners.
        before = np.arange(time.size) // 2
        q_d = np.stack([np.interp(half, motion.time, column) for column in motion.q_d.T], axis=1)
        rates = q_d, 0.5 * motion.dq_d[before], np.zeros_like(q_d)
    return replace(loop, reference=DesiredMotion(time, *rates, 2.0 * motion.period))


def _last_joint_alone(loops: Loops, _: Readings) -> Loop:
    given = loops[FIRST].reference
    last = np.arange(given.q_d.shape[1]) == given.q_d.shape[1] - 1
    q_d, dq_d, ddq_d = (np.where(last, rate, 0.0) for rate in (given.q_d, given.dq_d, given.ddq_d))
    return replace(loops[FIRST], reference=replace(given, q_d=q_d, dq_d=dq_d, ddq_d=ddq_d))


def _same_slope(loops: Loops, _: Readings) -> Loop:
    """Controller 2 with η = β / γ₁ for a Delta of 0.2 rad, 1.548 as published, in degrees too."""
    law = law_in(loops[SECOND])
    gamma_1, _gamma_2 = polynomial(law.b, np.full_like(law.b, 0.2))
    eta = law.beta / gamma_1
    rate = eta if np.array_equal(law.rate_gain, law.eta) else law.rate_gain
    return _with_law(loops[SECOND], law._replace(eta=eta, rate_gain=rate))


def _with_inertia(factor: float, loops: Loops, _: Readings) -> Loop:
    law = law_in(loops[FIRST])
    return _with_law(loops[FIRST], law._replace(M_bar=factor * law.M_bar))


def _started_elsewhere(loops: Loops, _: Readings) -> Loop:
    """Controller 1 once more, from where Controller 2 started."""
    return replace(loops[FIRST], start_offset=loops[SECOND].start_offset)


def _other_encoders(loops: Loops, _: Readings) -> Loop:
    law = law_in(loops[FIRST])
    return _with_law(loops[FIRST], law._replace(motor_side=not law.motor_side))


# Controller 2 is Controller 1 at alpha = 0, but for the reading that drops eta from its printed law.
EXPERIMENTS = (
    BenchExperiment("controllers_1_2", "Controller 1 over Controller 2", partial(_run, FIRST), SECOND),
    BenchExperiment("controllers_2_3", "Controller 2 over Controller 3", partial(_run, SECOND), THIRD),
    BenchExperiment(
        "controllers_1_2_late",
        "Controller 1 over Controller 2, first two seconds left out",
        partial(_run, FIRST),
        SECOND,
        "mae_settled",
    ),
    BenchExperiment(
        "controllers_2_3_late",
        "Controller 2 over Controller 3, first two seconds left out",
        partial(_run, SECOND),
        THIRD,
        "mae_settled",
    ),
    BenchExperiment("repeat", "Controller 1 repeated from another start", _started_elsewhere),
    *(
        BenchExperiment(
            f"alpha_{alpha:g}",
            f"Controller 1 with α = {alpha:g} over α = 0",
            partial(with_alpha, alpha),
            SECOND,
        )
        for alpha in (0.1, 0.2, 0.3, 0.5)
    ),
    BenchExperiment("same_slope", "Controller 2 with η of equal slope over Controller 3", _same_slope, THIRD),
    BenchExperiment("half_speed", "Controller 1 at half the speed over full speed", _slower),
    BenchExperiment("joint_3_alone", "Controller 1, the last joint alone over all joints", _last_joint_alone),
    BenchExperiment("inertia_up", "Controller 1 with M̄ 10 % up", partial(_with_inertia, 1.1)),
    BenchExperiment("inertia_down", "Controller 1 with M̄ 10 % down", partial(_with_inertia, 0.9)),
    BenchExperiment("period_doubled", "Controller 1 with L doubled", partial(_run, DOUBLED_PERIOD)),
    BenchExperiment("payload", "Controller 1 with its payload over without", partial(_run, LOADED)),
    BenchExperiment(
        "other_encoders", "Controller 1 on the other encoders, errors by these, over its own", _other_encoders
    ),
)


def experiments_on(loaded: LoadedEnsemble) -> Sequence[BenchExperiment]:
    """Experiments that the arm of a comparison can make."""
    if not loaded.around:
        return EXPERIMENTS
    config = loaded.compare
    left_out = {
        "repeat": not any(run.start_offset for run in config.runs.values()),
        "joint_3_alone": len(config.joints) == 1,
        "period_doubled": config.sampling_period.si != PUBLISHED_PERIOD,
        "payload": LOADED not in config.runs,
    }
    return [experiment for experiment in EXPERIMENTS if not left_out.get(experiment.name)]


LEAST = 20
"""Stable plants below which no interval is given."""
AT_ONCE = 16
"""Plants simulated together."""
Gaps: TypeAlias = Mapping[tuple[str, str], float]
"""By pair of readings."""


def predicted_cost(loaded: LoadedEnsemble, readings: int, draws: int) -> dict[str, float]:
    """Experiments of a prediction, and about how many hours of one processor they take."""
    base = [run for run in RUNS if run in loaded.compare.runs]
    experiments = draws * readings * (len(base) + len(experiments_on(loaded)))
    return cost_of(experiments, SECONDS_PER_EXPERIMENT)


def predictions(
    loaded: LoadedEnsemble, readings: Sequence[Reading], draws: int, talk: Talk, files: Path | None = None
) -> Iterator[Json]:
    """Yield every experiment's ratio of errors under every reading on every joint.

    ``errors_of`` says whose errors are divided: ``joints``, ``motors`` where the law looks at the motors'
    encoders, in joint coordinates, or one over the other. ``low`` and ``high`` are the central 90 % of the
    plants on which both runs are stable; NaN with few.

    With a folder for `files`, what was simulated is kept there, and taken up again.
    """
    experiments = experiments_on(loaded)
    base = [run for run in RUNS if run in loaded.compare.runs]
    names = [*dict.fromkeys(experiment.error for experiment in experiments)]
    runs = len(base) + len(experiments)
    values = population_of(loaded).sample(int(loaded.config.seed.si), 0, 0, draws)
    with talk.bar("simulating", draws * len(readings)) as progress:
        for reading in readings:
            kept = Kept(partial(_simulated, loaded, reading, names), files and files / f"{reading.name}.npy")
            for rows in np.split(values, range(AT_ONCE, draws, AT_ONCE)):
                kept(rows)
                progress(len(rows))
            columns = kept.table[:, values.shape[1] :]
            stable = columns[:, :runs] == STATUSES.index("ok")
            sizes = columns[:, runs:].reshape(draws, len(names), runs, -1)
            errors = dict(zip(names, np.moveaxis(sizes, 1, 0), strict=True))
            of_motors = [law_in(loop).motor_side for loop in loops_of_plants(loaded, values[:1], reading)]
            for place, experiment in enumerate(experiments, start=len(base)):
                pair = [place, base.index(experiment.beside)]
                both = stable[:, pair].all(axis=1)
                above, below = np.moveaxis(errors[experiment.error][both][:, pair], 1, 0)
                whose = " over ".join(dict.fromkeys("motors" if of_motors[run] else "joints" for run in pair))
                for joint, ratio in zip(loaded.compare.joints, (above / below).T, strict=True):
                    row: Json = {"experiment": experiment.name, "reading": reading.name, "joint": joint}
                    spread = np.quantile(ratio, (0.5, 0.05, 0.95)) if ratio.size >= LEAST else [np.nan] * 3
                    numbers = zip(("median", "low", "high"), map(float, spread), strict=True)
                    yield {**row, "errors_of": whose, "plants": ratio.size, **dict(numbers)}


def _simulated(loaded: LoadedEnsemble, reading: Reading, names: Sequence[str], values: Array) -> Array:
    """Status of each run of plants (N, P) under a reading, then each of its statistics, (N, K)."""
    loops = [*loops_of_plants(loaded, values, reading)]
    batch = simulate_batch(loops, threads=processors())
    parts = [batch.status.astype(np.float64), *(batch.statistics[name] for name in names)]
    return np.column_stack([part.reshape(len(values), -1) for part in parts])


def loops_of_plants(loaded: LoadedEnsemble, values: Array, reading: Reading) -> Iterator[Loop]:
    """Loops of plants (N, P) under a reading, plant by plant: those of `RUNS`, then of experiments."""
    plants, experiments = population_of(loaded), experiments_on(loaded)
    runs = [run for run in RUNS if run in loaded.compare.runs]
    cases = {run: (run, reading) for run in runs}
    if any(experiment.name == "period_doubled" for experiment in experiments):
        slower = Reading(DOUBLED_PERIOD, (*reading.settings, ("sampling_period", "2ms")))
        cases[DOUBLED_PERIOD] = FIRST, slower
    # What experiments ask of readings, no draw decides.
    readings = under(reading, loaded.compare, plants.named(values[0])).control.readings
    for of_plant in plants.loops(values, [*cases.values()]):
        loops = dict(zip(cases, of_plant, strict=True))
        yield from (loops[run] for run in runs)
        yield from (experiment.change(loops, readings) for experiment in experiments)


def gaps_between(rows: Sequence[Json], readings: Sequence[str]) -> Gaps:
    """Gap of 90 % ranges of an experiment by pair of readings, on the joint where it is widest.

    Pairs that overlap have a negative gap, and pairs with an unknown range none.
    """
    joints = dict.fromkeys(row["joint"] for row in rows)
    ends = {(row["reading"], row["joint"]): (row["low"], row["high"]) for row in rows}
    gaps = {}
    for pair in combinations(readings, 2):
        lows, highs = np.array([[ends[reading, joint] for reading in pair] for joint in joints]).T
        apart = lows.max(axis=0) - highs.min(axis=0)
        if not np.isnan(apart).all():
            gaps[pair] = float(np.nanmax(apart))
    return gaps


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
    experiments, told = [], dict[tuple[str, str], bool]()
    for experiment in experiments_on(loaded):
        rows = [row for row in predicted if row["experiment"] == experiment.name]
        gaps = gaps_between(rows, names)
        apart = {pair: gap for pair, gap in gaps.items() if gap > 0.0}
        told |= {pair: told.get(pair, False) or pair in apart for pair in gaps}
        experiments.append(
            {
                "name": experiment.name,
                "about": experiment.about,
                "judged_pairs": len(gaps),
                "told_apart": [[*pair] for pair in apart],
                "gaps": [*apart.values()],
                "ratios": rows,
            }
        )
    data = {
        "schema_version": SCHEMA_VERSION,
        "draws": draws,
        **({"around": around.as_data()} if around else {}),
        "joints": list(joints),
        "readings": names,
        "never_told_apart": [[*pair] for pair, is_told in told.items() if not is_told],
        "experiments": experiments,
    }
    where = around.told if around else ""
    figures = {"predictions": lambda: draw_predictions(experiments, names, joints, where)}
    return Result(data, prediction_tables(data, where), figures)


def prediction_tables(data: Json, where: str = "") -> list[Table | str]:
    """Tables of experiments, of pairs that none tells apart, and of ratios; before them what is too few."""
    telling = sorted(data["experiments"], key=lambda experiment: -max(experiment["gaps"], default=0.0))
    is_judged = any(experiment["judged_pairs"] for experiment in telling)
    experiments = []
    for experiment in telling:
        gaps = experiment["gaps"] or [0.0]
        row = {
            "widest_gap": max(gaps),
            "narrowest_gap": min(gaps),
            "pairs_told_apart": len(experiment["gaps"]),
        }
        # Where no pair could be judged, zeros would be findings.
        shown_row = row if experiment["judged_pairs"] else dict.fromkeys(row)
        experiments.append({"experiment": experiment["about"], **shown_row})
    untold = [{"interpretation": a, "and": b} for a, b in data["never_told_apart"]]
    ratios = [row for experiment in telling for row in experiment["ratios"]]
    few = sum(row["plants"] < LEAST for row in ratios)
    ranges = f"{few} of {len(ratios)} ranges have fewer than {LEAST} stable plants, and tell nothing"
    shown = ("experiment", "reading", "joint", "errors_of", "plants", "median", "low", "high")
    on = f"{data['draws']} plants {where}".strip()
    gaps_of = "Experiments, the most telling first: gaps between the 90 % ranges of interpretations."
    untold_of = "Interpretations that no experiment tells apart."
    ratios_of = f"Ratio of mean errors, median and central 90 % of the stable ones of {on}."
    in_terminal, instead = (None, ()) if is_judged else ((), shown)
    return [
        *([f"{ranges}: more --draws"] if few else []),
        Table("experiments", gaps_of, experiments, terminal=in_terminal),
        Table("never_told_apart", untold_of, untold, terminal=in_terminal),
        Table("predictions", ratios_of, ratios, terminal=instead),
    ]
