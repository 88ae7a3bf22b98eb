"""A measurement run again by the model, on the measured motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.configuration.strict_yaml import Tree, dump, section
from tendonrepro.console import Talk
from tendonrepro.dataset.motion import Knots, Reference, recorded, thinned, zero_of
from tendonrepro.errors import DataMissingError, TendonreproError
from tendonrepro.experiments.run import begin_all, prepared, trace_file
from tendonrepro.parallel import workers
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.store import make_manifest
from tendonrepro.results.traces import write_traces
from tendonrepro.verdicts.measurement import Measurement

_Prepared: TypeAlias = tuple[Path, dict[str, float]]
"""A configuration, and by run when its rerun begins on the measured time axis, s."""

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
    reference, compared = measurement.reference, measurement.compare.runs
    apart = {run: departure(trace, reference) for run, trace in compared.items() if reference}
    for experiment, prepare in (("compare", write_compare), ("decouple", write_decouple)):
        if measurement.file.part(experiment).runs:
            try:
                path, zeros = prepare(measurement, base, name, folder)
                followed = {run: zero for run, zero in zeros.items() if not apart.get(run)}
                runs |= simulated(path, followed, measurement.file, talk)
            except TendonreproError as error:
                hint = f"; {error.hint}" if error.hint else ""
                missing.append(f"a rerun of {experiment}: {error.message}{hint}")
    for run, size in apart.items():
        if reference and size:
            other = f"{np.rad2deg(size):.3g} deg from that of {reference.run}"
            missing.append(f"residuals of {run}: its desired motion is {other}")
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


def write_compare(measurement: Measurement, base: LoadedConfig, name: str, folder: Path) -> _Prepared:
    """Write the recovered motion and a configuration on it; return its path, and when reruns begin, s.

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
    entries = dict(section(tree, "runs"))
    tree["runs"] = entries
    for run in runs.keys() & entries.keys():
        mass, payload = float(runs[run].attributes["payload_mass"]), section(entries, run, "payload")
        if payload["unit"] == "kg" and mass != payload["value"]:
            source = f"identified: the mass stated for {name}"
            stated: Tree = {"value": mass, "unit": "kg", "source": source}
            entries[run] = section(entries, run) | {"payload": stated}
    zeros = {run: zero_of(trace, reference) for run, trace in runs.items()}
    return _write_config(tree, folder / "compare.yaml"), zeros


def write_decouple(measurement: Measurement, base: LoadedConfig, name: str, folder: Path) -> _Prepared:
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
    payload = section(tree, "runs", "decouple")["payload"]
    tree["runs"] = {"decouple": {"drives": drives, "reference": motion, "payload": payload}}
    return _write_config(tree, folder / "decouple.yaml"), {trace.name: float(trace.time[0])}


def _write_config(tree: Tree, path: Path) -> Path:
    path.write_text(dump(tree), encoding="utf-8")
    return path


def _write_motion(knots: Knots, joint: Sequence[int], path: Path) -> Tree:
    """Write a trajectory file, s and degrees; return the reference to it."""
    heads = ",".join(["time_s", *(f"q{number}_deg" for number in joint)])
    # A zero without its sign.
    rows = np.column_stack([knots.time, np.rad2deg(knots.angle)]) + 0.0
    np.savetxt(path, rows, "%.9g", ",", header=heads, comments="")
    return {"kind": "sampled", "file": path.name}


def departure(trace: Trace, reference: Reference) -> float:
    """Largest difference of a run's desired motion from a recovered one, rad.

    It is 0 if rounding, noise and one sample of time explain it, or nothing was recorded.
    """
    record, ours = reference.record, trace.of_joints(reference.record.joint)
    if "q_d" not in ours or ours.joint != record.joint:
        return 0.0
    time = ours.time - zero_of(trace, reference)
    inside = (time >= 0.0) & (time <= record.time[-1])
    q_d = ours["q_d"] - start_of(ours, "q_d", ours.joint)
    apart = float(np.nanmax(np.abs(q_d - record.at(time))[inside], initial=0.0))
    late = max(record.step, float(np.median(np.diff(time))))
    fastest = np.abs(np.diff(record.q, axis=0)).max() / record.step
    # Each of the two records has its own rounding and noise.
    return apart if apart > 2.0 * reference.knots.tolerance + late * fastest else 0.0


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
