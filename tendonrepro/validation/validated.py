"""A measurement beside the model, which runs again on the measured motion, and beside the paper."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.published import published
from tendonrepro.configuration.strict_yaml import Tree, dump
from tendonrepro.console import Talk
from tendonrepro.dataset.motion import Knots, recorded, thinned, zero_of
from tendonrepro.errors import DataMissingError, TendonreproError, UsageError
from tendonrepro.evidence.recover import controllers_of
from tendonrepro.experiments.run import begin_all, prepared, trace_file
from tendonrepro.files import Json, write_atomically
from tendonrepro.parallel import workers
from tendonrepro.physics.drive import coupling_inverse, coupling_matrix
from tendonrepro.physics.metrics import mean
from tendonrepro.results.paper import is_arm_of_paper, of_paper
from tendonrepro.results.records import READ_OFF, PlantRecord, PlantValue, Trace, TraceFile, median_step
from tendonrepro.results.store import make_manifest
from tendonrepro.results.summary import Sizes, decoupling_errors, sizes_deg
from tendonrepro.results.tables import TableRows
from tendonrepro.results.traces import write_traces
from tendonrepro.studies.study import Site
from tendonrepro.verdicts.measurement import Measurement, judge_measured, measurement_of
from tendonrepro.verdicts.rules import Ruling

_METRICS = {"mae": "mae_deg", "rms": "rmse_deg", "max": "max_deg"}
ANOTHER_MOTION_DEG = 0.2
"""Difference of a run's desired angle from the motion that the model follows from which it is told, deg."""
_SMOOTH = 0.05
"""Half the stretch of an encoder's signal whose ends tell its rate, s."""


def comparison_rows(measured: Trace, simulated: Trace, start: float = -np.inf) -> Iterator[Json]:
    """Put a measured run beside its simulation on the measured axes: a row for each joint.

    The motion begins at `start`, s. The simulation is interpolated, not shifted to fit. ``e_*`` and ``q_*``
    are measured less simulated; ``lag_s`` is positive where the measurement is late. Of curves that were read
    off a figure the RMS has a band, by as much as the reading error.
    """
    joints = [joint for joint in measured.joint if joint in simulated.joint]
    ours, model = measured.of_joints(joints), simulated.of_joints(joints)
    edge = 1e-9 + 1e-6 * (model.time[1] - model.time[0])
    first_time = max(model.time[0] - edge, start - 0.5 * median_step(ours.time))
    inside = (ours.time >= first_time) & (ours.time <= model.time[-1] + edge)
    time = ours.time[inside]
    both = [name for name in ("e", "q_encoder", "q_d", "q_calculated") if name in ours and name in model]
    first = {name: ours[name][inside] for name in both}
    # Where the measurement has a gap, the simulation is left out too.
    second = {name: np.where(np.isfinite(first[name]), at(model, name, time), np.nan) for name in both}
    apart = {name: first[name] - second[name] for name in both}
    columns: Sizes = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        if "e" in both:
            sizes = [sizes_deg(errors["e"])["mae_deg"] for errors in (first, second)]
            columns |= {"measured_mae_deg": sizes[0], "simulated_mae_deg": sizes[1]}
            columns |= {"mae_ratio": sizes[0] / sizes[1], "e_samples": np.isfinite(apart["e"]).sum(axis=0)}
            columns |= _differences("e_", apart["e"])
            columns |= _band(columns["e_rms_deg"], reading_error(ours))
            columns["e_correlation"] = _correlation(first["e"], second["e"])
        if "q_encoder" in both:
            columns["q_samples"] = np.isfinite(apart["q_encoder"]).sum(axis=0)
            columns |= _differences("q_", apart["q_encoder"])
            columns["lag_s"] = _lag(-apart["q_encoder"], _rate(model, time))
    if "q_d" in both:
        columns["q_d_max_deg"] = sizes_deg(apart["q_d"])["max_deg"]
    if {"q_calculated", "q_encoder"} <= {*both}:
        columns["measured_calculated_mae_deg"] = decoupling_errors(ours)["mae_deg"]
        columns["simulated_calculated_mae_deg"] = decoupling_errors(model)["mae_deg"]
    for place, joint in enumerate(joints):
        yield {"run": ours.name, "joint": joint, "status": model.status} | _row(columns, place)


def start_rows(trace: Trace, begin: float) -> Iterator[dict[str, object]]:
    """Error of a run where its motion begins, at `begin`, s: a row for each joint.

    It is the last that is known until then. The model has none there.
    """
    if "e" not in trace:
        return
    until = trace.time <= begin + 0.5 * median_step(trace.time)
    for joint, errors in zip(trace.joint, trace["e"][until].T, strict=True):
        known = errors[np.isfinite(errors)]
        error = float(np.rad2deg(known[-1])) if known.size else None
        yield {"run": trace.name, "joint": joint, "begin_s": begin, "error_deg": error}


def reading_error(trace: Trace) -> float:
    """Error of a run's tracking error that was read off a figure, rad; 0 if it was recorded."""
    direct = float(trace.attributes.get(f"{READ_OFF}e", 0.0))
    parts = [float(trace.attributes.get(f"{READ_OFF}{name}", 0.0)) for name in ("q_d", "q_encoder")]
    return direct or math.hypot(*parts)


def _band(rms: Array, error: float) -> Sizes:
    """RMS of a residual less and plus the reading error, deg: that of the true one lies between."""
    if not error:
        return {}
    degrees = np.full_like(rms, np.rad2deg(error))
    band = {"e_rms_low_deg": np.maximum(rms - degrees, 0.0), "e_rms_high_deg": rms + degrees}
    return {"reading_error_deg": degrees, **band}


def at(trace: Trace, name: str, time: Array) -> Array:
    """A variable at times (T,), s: (T, n), interpolated, held beyond both ends."""
    return np.column_stack([np.interp(time, trace.time, column) for column in trace[name].T])


def _row(columns: Mapping[str, Array], place: int) -> Json:
    """Numbers of a joint, None where one cannot be told."""
    values = {name: column[place] for name, column in columns.items()}
    return {name: value.item() if np.isfinite(value) else None for name, value in values.items()}


def _differences(prefix: str, apart: Array) -> Sizes:
    sizes = sizes_deg(apart)
    return {f"{prefix}{name}_deg": sizes[key] for name, key in _METRICS.items()}


def _correlation(first: Array, second: Array) -> Array:
    first, second = first - mean(first), second - mean(second)
    return np.asarray(mean(first * second) / np.sqrt(mean(first**2) * mean(second**2)))


def _rate(trace: Trace, time: Array) -> Array:
    """Velocity of the simulated joints, rad/s.

    In a gradient the encoder's steps would count as motion, and the lag as shorter.
    """
    before, after = np.clip([time - _SMOOTH, time + _SMOOTH], trace.time[0], trace.time[-1])
    travel = at(trace, "q_encoder", after) - at(trace, "q_encoder", before)
    return np.asarray(travel / (after - before)[:, np.newaxis])


def _lag(behind: Array, rate: Array) -> Array:
    """Shift that, with an offset, explains most of the difference to first order, s."""
    rate = np.where(np.isfinite(behind), rate, np.nan)
    behind, rate = behind - mean(behind), rate - mean(rate)
    return np.asarray(mean(behind * rate) / mean(rate**2))


_OF_COMPARE = {"q_encoder": "q_d", "q_d": "q_d"}
_OF_DECOUPLE = {name: name for name in ("q_encoder", "q_motor_encoder", "q_calculated")}
"""Angles of a rerun, and the measured variable whose start they get."""


def reruns(
    measurement: Measurement, base: LoadedConfig, name: str, folder: Path, talk: Talk
) -> tuple[dict[str, Trace], list[str]]:
    """Run the model `base` on the motions of a measured file of that `name`.

    Configurations, motions and traces go into `folder`. Returns runs on the measured axes, and what could not
    be rerun, and why.
    """
    runs: dict[str, Trace] = {}
    missing: list[str] = []
    for experiment, prepare in (("compare", write_compare), ("decouple", write_decouple)):
        if measurement.file.part(experiment).runs:
            try:
                zeros = prepare(measurement, base, name, folder)
                runs |= simulated(folder / f"{experiment}.yaml", zeros, measurement.file, talk)
            except TendonreproError as error:
                told = str(error).replace("\n", "; ")
                missing.append(f"a rerun of {experiment}: {told}")
    return runs, missing


def simulated(path: Path, zeros: Mapping[str, float], measured: TraceFile, talk: Talk) -> dict[str, Trace]:
    """Simulate those runs of a configuration that begin at measured times, s."""
    # The folder it lies in has another name once the result is whole.
    loaded = replace(load_config(path, None), origin=path.name)
    whole = prepared(loaded)
    chosen = {name: loop for name, loop in whole.loops.items() if name in zeros}
    with workers(len(chosen)) as start:
        (traces,) = begin_all([whole._replace(loops=chosen)], talk, start=start)
    if traces:
        file = trace_file(loaded, traces, make_manifest(loaded, 0.0))
        write_traces(path.with_name(f"simulated_{path.stem}.h5"), file)
    return {trace.name: aligned(trace, measured.runs[trace.name], zeros[trace.name]) for trace in traces}


def write_compare(measurement: Measurement, base: LoadedConfig, name: str, folder: Path) -> dict[str, float]:
    """Write the recovered motion and a configuration on it; return when reruns begin, s, by run.

    Of `base` only the reference changes, and payloads measured with other masses.

    Raises
    ------
    DataMissingError
        If no motion was recovered.
    """
    reference, runs = measurement.reference, measurement.compare.runs
    if reference is None:
        raise DataMissingError(measurement.unrecovered)
    tree = dict(base.tree)
    tree["title"] = f"{tree['title']}, on the reference measured in {name}"
    tree["reference"] = _write_motion(reference.knots, reference.record.joint, folder / "reference.csv")
    entries = dict(tree["runs"])
    tree["runs"] = entries
    for run in runs.keys() & entries.keys():
        mass, payload = float(runs[run].attributes["payload_mass"]), entries[run]["payload"]
        if payload["unit"] == "kg" and mass != payload["value"]:
            source = f"identified: the mass stated for {name}"
            stated: Tree = {"value": mass, "unit": "kg", "source": source}
            entries[run] = entries[run] | {"payload": stated}
    zeros = {run: zero_of(trace, reference) for run, trace in runs.items()}
    write_atomically(folder / "compare.yaml", dump(tree))
    return zeros


def write_decouple(measurement: Measurement, base: LoadedConfig, name: str, folder: Path) -> dict[str, float]:
    """Do the same for the decoupling run; its motors drive the rerun, else the joints' encoders.

    If `base` is of the comparison on the paper's arm, the shipped model takes over its manipulator and seed.

    Raises
    ------
    DataMissingError
        If the joints of the model were not recorded, or it is another arm's comparison.
    """
    if base.config.experiment != "decouple":
        if not is_arm_of_paper(base.config.manipulator):
            hint = "validate its file of these runs alone, with --config decouple.yaml of this arm"
            raise DataMissingError("the configuration is of a comparison", hint=hint)
        both = [change for change in base.changes if change.path[0] in {"manipulator", "seed"}]
        base = load_config(None, "decouple", overrides=both)
    trace, joints = measurement.file.part("decouple").runs.get("decouple"), base.config.joints
    if trace is None or trace.joint != joints:
        raise DataMissingError(f"joints {', '.join(map(str, joints))} of the run decouple")
    motors = "q_motor_encoder" in trace
    drives, variable = ("motors", "q_motor_encoder") if motors else ("joints", "q_encoder")
    tree = dict(base.tree)
    tree["title"] = f"{tree['title']}, on the {drives}' angles measured in {name}"
    knots = thinned(recorded(trace, variable))
    motion = _write_motion(knots, trace.joint, folder / "decouple_reference.csv")
    tree["runs"] = {"decouple": tree["runs"]["decouple"] | {"drives": drives, "reference": motion}}
    write_atomically(folder / "decouple.yaml", dump(tree))
    return {trace.name: float(trace.time[0])}


def _write_motion(knots: Knots, joint: Sequence[int], path: Path) -> Tree:
    """Write a trajectory file, s and degrees; return the reference to it."""
    heads = ",".join(["time_s", *(f"q{number}_deg" for number in joint)])
    # A zero without its sign.
    rows = np.column_stack([knots.time, np.rad2deg(knots.angle)]) + 0.0
    np.savetxt(path, rows, "%.9g", ",", header=heads, comments="")
    return {"kind": "sampled", "file": path.name}


def aligned(simulated: Trace, measured: Trace, zero: float) -> Trace:
    """Put a rerun on the axes of its measured run: from `zero`, s, and the measured angles.

    In a comparison all angles move by the start of `q_d`; errors stay.
    """
    sources = _OF_DECOUPLE if simulated.name == "decouple" else _OF_COMPARE
    moved = {
        name: simulated[name] + start_of(measured, source, simulated.joint)
        for name, source in sources.items()
        if name in simulated and source in measured
    }
    return replace(simulated, time=simulated.time + zero, variables={**simulated.variables, **moved})


def start_of(trace: Trace, name: str, joints: Sequence[int]) -> Array:
    """First known sample, (n,); 0 for a joint without any."""
    starts = {}
    for joint, values in zip(trace.joint, trace[name].T, strict=True):
        known = values[np.isfinite(values)]
        starts[joint] = float(known[0]) if len(known) else 0.0
    return np.array([starts.get(joint, 0.0) for joint in joints])


@dataclass(frozen=True)
class Validation:
    """What a measurement says of paper and model.

    `rulings` are by the id of a claim or number, `models` are its reruns by run, and `residuals` compare with
    these. `starts` are errors where motions begin. `controllers` tells what made the runs. Of a bench that is
    not the paper's nothing is judged.
    """

    of_paper: bool
    measurement: Measurement
    rulings: Mapping[str, Ruling]
    models: Mapping[str, Trace]
    residuals: TableRows
    starts: TableRows
    controllers: TableRows
    missing: Sequence[str]


def validated(file: TraceFile, name: str, base: LoadedConfig, site: Site) -> Validation:
    """Compare the measurement of a file with that `name`; motions and traces of reruns go to the site."""
    config = base.config
    joints = max(joint for trace in file.runs.values() for joint in trace.joint)
    if joints > config.manipulator.joints:
        message = f"has joints up to {joints}, and the arm of {base.origin} has {config.manipulator.joints}"
        raise UsageError(message, where=name, hint="name a configuration of its arm with --config")
    is_papers = is_arm_of_paper(config.manipulator) and of_paper(file)
    if is_papers:
        measurement = measurement_of(file, published())
    else:
        file = with_coupling(file, config.manipulator)
        measurement = measurement_of(file, None, config.joints)
    models, not_rerun = reruns(measurement, base, name, site.files, site.talk)
    compare = measurement.compare
    starts = {run: measurement.timing[run].start for run in compare.runs}
    own = None if is_papers else base
    controllers = controllers_of(compare, site.talk, site.start, own) if compare.runs else []
    residuals = [
        row
        for run, model in models.items()
        for row in comparison_rows(file.runs[run], model, starts.get(run, -np.inf))
    ]
    elsewhere = [
        f"the motion of {row['run']}: its desired angle of joint {row['joint']} is "
        f"{row['q_d_max_deg']:.3g} deg from the one that the model follows"
        for row in residuals
        if (row.get("q_d_max_deg") or 0.0) > ANOTHER_MOTION_DEG
    ]
    expected = (*RUNS, "decouple") if is_papers else config.runs
    return Validation(
        is_papers,
        measurement,
        rulings=judge_measured(measurement, published()) if is_papers else {},
        models=models,
        residuals=residuals,
        starts=[row for run, begin in starts.items() for row in start_rows(compare.runs[run], begin)],
        controllers=controllers,
        missing=[f"the run {run}" for run in expected if run not in file.runs] + not_rerun + elsewhere,
    )


def with_coupling(file: TraceFile, arm: Manipulator) -> TraceFile:
    """A measurement with the coupling of an arm, in place of the paper's, which `ingest` takes."""
    routing = arm.routing
    S_inv = coupling_inverse(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)
    values = {
        name: PlantValue(matrix, "1", f"routing of {arm.name}", name)
        for name, matrix in (("S", coupling_matrix(S_inv)), ("S_inv", S_inv))
    }
    plant = PlantRecord(values, {"arm": arm.name})
    runs = dict(file.runs)
    for name, trace in runs.items():
        if "q_motor_encoder" in trace:
            calculated = trace["q_motor_encoder"] @ plant.matrix("S", trace.joint).T
            runs[name] = replace(trace, variables={**trace.variables, "q_calculated": calculated})
    return replace(file, runs=runs, plant=plant)
