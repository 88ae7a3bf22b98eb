"""What ``tendonrepro predict`` does: experiments on a bench, and what each would give under every reading."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tendonrepro.arrays import Array
from tendonrepro.configuration.ensemble import LoadedEnsemble
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.readings import Reading, named_readings, parse_reading, under
from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.experiments.loops import build_law, build_loops
from tendonrepro.monte_carlo.around import AroundArm, draws_rows, readings_around
from tendonrepro.monte_carlo.box import Box, configured, make_box
from tendonrepro.monte_carlo.plan import MOST_DRAWS
from tendonrepro.parallel import processors
from tendonrepro.physics.control import Law, polynomial
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.results.tables import Table
from tendonrepro.simulation.batch import simulate_batch
from tendonrepro.simulation.device import DeviceName
from tendonrepro.simulation.loop import DesiredMotion, Loop, TimeDelayController
from tendonrepro.studies.outcome import Outcome

SCHEMA_VERSION = 1
FIRST, SECOND, THIRD, LOADED = "controller_1", "controller_2", "controller_3", "controller_1_payload"
BASE = (FIRST, SECOND, THIRD, LOADED)
"""Runs as configured, before those of the experiments."""
READINGS = (
    "printed,Delta_unit=deg,gain_unit=phi_in_degrees,phi_branch=power,weights=extrapolating,"
    "weights=extrapolating+Delta_unit=deg,stored_torque=applied+torque_step=0.016,"
    "Delta_unit=deg+stored_torque=applied+torque_step=0.016,feedback=motor,"
    "reference_acceleration=absent,motion=ramp,starts=apart,"
    "reference_acceleration=absent+starts=apart,motion=ramp+starts=apart"
)
"""Interpretations whose predictions are asked for unless others are named."""
LEAST = 20
"""Stable plants below which no interval is given."""
PUBLISHED_PERIOD = 1e-3
"""Sampling period, s, of which the doubled one is a variation."""
AT_ONCE: Mapping[DeviceName, int] = {"cpu": 16, "gpu": 256}
"""Plants simulated together."""

Loops: TypeAlias = Mapping[str, Loop]
Gaps: TypeAlias = Mapping[tuple[str, str], float]
"""By pair of readings."""
Change: TypeAlias = Callable[[CompareConfig, Path, Loops], Loop]
"""From a configuration, its folder and its loops to the loop of the changed run."""


@dataclass(frozen=True)
class Experiment:
    """``change`` makes the loop of the changed run; its error is divided by that of the run ``beside``.

    ``error`` names the statistic of both: of the whole run, or ``mae_settled`` of all after two seconds.
    """

    name: str
    about: str
    change: Change
    beside: str = FIRST
    error: str = "mae"


def _run(name: str, _: CompareConfig, __: Path, loops: Loops) -> Loop:
    return loops[name]


def with_alpha(alpha: float, config: CompareConfig, _: Path, loops: Loops) -> Loop:
    """Controller 1 with one alpha on all joints."""
    value = config.control.gains.alpha.model_copy(update={"value": (alpha,) * len(config.joints)})
    gains = config.control.gains.model_copy(update={"alpha": value})
    control = config.control.model_copy(update={"gains": gains})
    return _with_law(loops[FIRST], build_law(config.model_copy(update={"control": control}), FIRST))


def _with_law(loop: Loop, law: Law) -> Loop:
    return replace(loop, controller=TimeDelayController(law))


def law_of(loop: Loop) -> Law:
    """The law of a loop of the paper's own."""
    assert isinstance(loop.controller, TimeDelayController)
    return loop.controller.law


def _slower(_: CompareConfig, __: Path, loops: Loops) -> Loop:
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


def _last_joint_alone(_: CompareConfig, __: Path, loops: Loops) -> Loop:
    loop = loops[FIRST]

    def alone(values: Array) -> Array:
        kept = np.zeros_like(values)
        kept[:, -1] = values[:, -1]
        return kept

    given = loop.reference
    motion = replace(given, q_d=alone(given.q_d), dq_d=alone(given.dq_d), ddq_d=alone(given.ddq_d))
    return replace(loop, reference=motion)


def _same_slope(_: CompareConfig, __: Path, loops: Loops) -> Loop:
    """Controller 2 with η = β / γ₁ for a Delta of 0.2 rad, 1.548 as published, in degrees too."""
    law = law_of(loops[SECOND])
    gamma_1, _gamma_2 = polynomial(law.b, np.full_like(law.b, 0.2))
    eta = law.beta / gamma_1
    rate = eta if np.array_equal(law.rate_gain, law.eta) else law.rate_gain
    return _with_law(loops[SECOND], law._replace(eta=eta, rate_gain=rate))


def _with_inertia(factor: float, _: CompareConfig, __: Path, loops: Loops) -> Loop:
    law = law_of(loops[FIRST])
    return _with_law(loops[FIRST], law._replace(M_bar=factor * law.M_bar))


def _started_elsewhere(_: CompareConfig, __: Path, loops: Loops) -> Loop:
    """Controller 1 once more, from where Controller 2 started."""
    return replace(loops[FIRST], start_offset=loops[SECOND].start_offset)


def _twice_the_period(config: CompareConfig, folder: Path, _: Loops) -> Loop:
    doubled = under(parse_reading("sampling_period=2ms"), config, {})
    return dict(build_loops(doubled, folder))[FIRST]


def _other_encoders(_: CompareConfig, __: Path, loops: Loops) -> Loop:
    law = law_of(loops[FIRST])
    return _with_law(loops[FIRST], law._replace(motor_side=not law.motor_side))


# Controller 2 is Controller 1 at alpha = 0, but for the reading that drops eta from its printed law.
EXPERIMENTS = (
    Experiment("controllers_1_2", "Controller 1 over Controller 2", partial(_run, FIRST), SECOND),
    Experiment("controllers_2_3", "Controller 2 over Controller 3", partial(_run, SECOND), THIRD),
    Experiment(
        "controllers_1_2_late",
        "Controller 1 over Controller 2, first two seconds left out",
        partial(_run, FIRST),
        SECOND,
        "mae_settled",
    ),
    Experiment(
        "controllers_2_3_late",
        "Controller 2 over Controller 3, first two seconds left out",
        partial(_run, SECOND),
        THIRD,
        "mae_settled",
    ),
    Experiment("repeat", "Controller 1 repeated from another start", _started_elsewhere),
    *(
        Experiment(
            f"alpha_{alpha:g}",
            f"Controller 1 with α = {alpha:g} over α = 0",
            partial(with_alpha, alpha),
            SECOND,
        )
        for alpha in (0.1, 0.2, 0.3, 0.5)
    ),
    Experiment("same_slope", "Controller 2 with η = 1.548 over Controller 3", _same_slope, THIRD),
    Experiment("half_speed", "Controller 1 at half the speed over full speed", _slower),
    Experiment("joint_3_alone", "Controller 1 with joint 3 alone over both joints", _last_joint_alone),
    Experiment("inertia_up", "Controller 1 with M̄ 10 % up", partial(_with_inertia, 1.1)),
    Experiment("inertia_down", "Controller 1 with M̄ 10 % down", partial(_with_inertia, 0.9)),
    Experiment("period_doubled", "Controller 1 with L doubled", _twice_the_period),
    Experiment("payload", "Controller 1 with 0.2 kg over without", partial(_run, LOADED)),
    Experiment("other_encoders", "Controller 1 with the motors' encoders over the joints'", _other_encoders),
)


@dataclass(frozen=True)
class Prediction:
    """Ratio of errors of one experiment, reading and joint.

    ``low`` and ``high`` are the central 90 % of the plants on which both runs are stable; NaN with few.
    """

    experiment: str
    reading: str
    joint: int
    plants: int
    median: float
    low: float
    high: float


def asked_for(loaded: LoadedEnsemble, draws: int, readings: str) -> None:
    """Raise a UsageError for too few or many draws, or an unknown interpretation."""
    if not LEAST <= draws <= MOST_DRAWS:
        raise UsageError(f"must be {LEAST} to {MOST_DRAWS} plants, found {draws}", where="--draws")
    _chosen(loaded, readings)


def predict_outcome(
    loaded: LoadedEnsemble, draws: int, readings: str, talk: Talk, device: DeviceName = "cpu"
) -> Outcome:
    """Predict every experiment under interpretations, their names with commas between."""
    from tendonrepro.evidence.figure_predictions import draw_predictions

    if draws & (draws - 1):
        even = 1 << draws.bit_length()
        talk.note(f"{draws} is no power of two, so plants cover their ranges less evenly than {even} would")
    chosen, joints, experiments_run = _chosen(loaded, readings), loaded.compare.joints, experiments_on(loaded)
    predicted = list(predictions(loaded, chosen, draws, talk, device))
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
    return Outcome(data, _tables(predicted, gaps, never, on, experiments_run), figures)


def _chosen(loaded: LoadedEnsemble, names: str) -> tuple[Reading, ...]:
    """Readings by their names; around an arm those that its comparison can be run under."""
    return readings_around(loaded, names) if loaded.around else named_readings(names)


def default_readings_on(loaded: LoadedEnsemble) -> str:
    """Names of the readings that are asked for unless others are named."""
    if not loaded.around:
        return READINGS
    return ",".join(name for name in READINGS.split(",") if not draws_rows(parse_reading(name)))


def experiments_on(loaded: LoadedEnsemble) -> Sequence[Experiment]:
    """Experiments that the arm of a comparison can make, named by its own joints and payload."""
    if not loaded.around:
        return EXPERIMENTS
    config = loaded.compare
    apart = any(run.start_offset for run in config.runs.values())
    left_out = {
        "repeat": not apart,
        "joint_3_alone": len(config.joints) == 1,
        "period_doubled": config.sampling_period.si != PUBLISHED_PERIOD,
        "payload": LOADED not in config.runs,
    }
    own = {
        "joint_3_alone": f"Controller 1 with joint {config.joints[-1]} alone over all joints",
        "same_slope": "Controller 2 with η of the same slope over Controller 3",
    }
    if LOADED in config.runs:
        own["payload"] = f"Controller 1 with {config.runs[LOADED].payload.si:g} kg over without"
    kept = [experiment for experiment in EXPERIMENTS if not left_out.get(experiment.name)]
    return [replace(experiment, about=own.get(experiment.name, experiment.about)) for experiment in kept]


def predictions(
    loaded: LoadedEnsemble,
    readings: Sequence[Reading],
    draws: int,
    talk: Talk,
    device: DeviceName = "cpu",
) -> Iterator[Prediction]:
    """Yield every experiment's ratio under every reading on every joint."""
    joints, experiments = loaded.compare.joints, experiments_on(loaded)
    base = [run for run in BASE if run in loaded.compare.runs]
    plants = AroundArm(loaded, loaded.around) if loaded.around else make_box(loaded.config)
    values = plants.sample(int(loaded.config.seed.si), 0, 0, draws)
    with talk.bar("simulating", draws * len(readings)) as progress:
        for reading in readings:
            errors: dict[str, list[Array]] = {experiment.error: [] for experiment in experiments}
            stable = []
            for rows in np.split(values, range(AT_ONCE[device], draws, AT_ONCE[device])):
                loops = [loop for row in rows for loop in _loops(loaded, plants, row, reading)]
                limits, threads = loaded.compare.status, processors()
                batch = simulate_batch(loops, limits, threads=threads, device=device)
                count = len(base) + len(experiments)
                for name, parts in errors.items():
                    parts.append(batch.statistics[name].reshape(-1, count, len(joints)))
                stable.append(batch.status.reshape(-1, count) == STATUSES.index("ok"))
                progress(len(rows))
            sizes = {name: np.concatenate(parts) for name, parts in errors.items()}
            yield from _ratios(experiments, base, sizes, np.concatenate(stable), reading.name, joints)


def _loops(loaded: LoadedEnsemble, plants: Box | AroundArm, row: Array, reading: Reading) -> Iterator[Loop]:
    """Loops of one plant under one reading: those of `BASE` that there are, then one for each experiment."""
    folder = loaded.base.folder
    if isinstance(plants, AroundArm):
        config, motion = under(reading, plants.configured(row), {}), plants.motion
    else:
        config, motion = under(reading, configured(loaded.base, plants, row), plants.named(row)), None
    loops = dict(build_loops(config, folder, motion))
    yield from (loops[name] for name in BASE if name in loops)
    yield from (experiment.change(config, folder, loops) for experiment in experiments_on(loaded))


def _ratios(
    experiments: Sequence[Experiment],
    base: Sequence[str],
    errors: Mapping[str, Array],
    stable: NDArray[np.bool_],
    reading: str,
    joints: Sequence[int],
) -> Iterator[Prediction]:
    """Ratios from errors (N, runs, n) by name, and stability (N, runs); runs are `base`, then experiments."""
    for place, experiment in enumerate(experiments, start=len(base)):
        beside = base.index(experiment.beside)
        kept = stable[:, place] & stable[:, beside]
        for i, joint in enumerate(joints):
            ratio = errors[experiment.error][kept, place, i] / errors[experiment.error][kept, beside, i]
            spread = np.quantile(ratio, (0.5, 0.05, 0.95)) if kept.sum() >= LEAST else np.full(3, np.nan)
            yield Prediction(experiment.name, reading, joint, int(kept.sum()), *map(float, spread))


def gaps_between(predicted: Sequence[Prediction], readings: Sequence[str]) -> dict[str, Gaps]:
    """Gap of 90 % ranges, on the joint where it is widest, by experiment and pair of readings.

    Pairs that overlap have a negative gap, and pairs with an unknown range none.
    """
    by_experiment: dict[str, Gaps] = {}
    for experiment in dict.fromkeys(row.experiment for row in predicted):
        rows = {(row.reading, row.joint): row for row in predicted if row.experiment == experiment}
        joints = dict.fromkeys(joint for _, joint in rows)
        gaps = {
            (a, b): max(_gap(rows[a, joint], rows[b, joint]) for joint in joints)
            for a, b in combinations(readings, 2)
        }
        by_experiment[experiment] = {pair: gap for pair, gap in gaps.items() if gap > -np.inf}
    return by_experiment


def told_apart(gaps: Mapping[str, Gaps]) -> dict[str, Gaps]:
    """Pairs of readings that each experiment tells apart, with their gaps."""
    return {name: {pair: gap for pair, gap in by_pair.items() if gap > 0.0} for name, by_pair in gaps.items()}


def never_told_apart(gaps: Mapping[str, Gaps], readings: Sequence[str]) -> list[list[str]]:
    """Pairs of readings that no experiment tells apart, of those with a known gap."""
    widest: dict[tuple[str, str], float] = {}
    for by_pair in gaps.values():
        for pair, gap in by_pair.items():
            widest[pair] = max(gap, widest.get(pair, gap))
    return [[*pair] for pair in combinations(readings, 2) if widest.get(pair, 1.0) <= 0.0]


def _gap(a: Prediction, b: Prediction) -> float:
    """Gap between two ranges; negative where they meet, minus infinity where one is unknown."""
    gap = max(a.low, b.low) - min(a.high, b.high)
    return gap if np.isfinite([a.low, b.low]).all() else -np.inf


def _tables(
    predicted: Sequence[Prediction],
    gaps: Mapping[str, Gaps],
    never: Sequence[Sequence[str]],
    on: str,
    experiments: Sequence[Experiment],
) -> list[Table | str]:
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
    pairs = never if any(gaps.values()) else [(None, None)]
    untold = [{"interpretation": a, "and": b} for a, b in pairs]
    few = sum(row.plants < LEAST for row in predicted)
    ranges = f"{few} of {len(predicted)} ranges"
    remark = f"{ranges} have fewer than {LEAST} stable plants, and tell nothing: more --draws"
    return [
        *([remark] if few else []),
        Table("experiments", caption, rows),
        Table("never_told_apart", "Interpretations that no experiment tells apart.", untold),
        Table("predictions", about, ratios, terminal=()),
    ]
