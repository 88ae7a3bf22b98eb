"""Both experiments of a measurement run again by the model on the measured motion, and what could not be."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.configuration.fields.strict_yaml import Node, dump
from tendonrepro.configuration.load import LoadedConfig, load_config
from tendonrepro.configuration.published import COMPARED
from tendonrepro.console import Talk
from tendonrepro.dataset.motion import Knots, Reference, recorded, thinned, zero_of
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.experiments.run import simulate_run, trace_file
from tendonrepro.files import to_json, write_atomically
from tendonrepro.parallel import each
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.verdicts.measured import Measured

COMPARE, DECOUPLE = "compare.yaml", "decouple.yaml"
MOTION = "decouple_reference.csv"

_OF_COMPARE = {"q_encoder": "q_d", "q_d": "q_d"}
_OF_DECOUPLE = {name: name for name in ("q_encoder", "q_motor_encoder", "q_calculated")}
"""Angles of a rerun, and the measured variable whose start they get."""


@dataclass
class Work:
    """What has been done of a validation: reruns, one file an experiment, and what could not be done.

    Files go into `folder`. `zeros` has the measured time at which the rerun of each run begins, s.
    """

    folder: Path
    simulated: list[TraceFile] = field(default_factory=list)
    zeros: dict[str, float] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)

    def runs(self, measured: TraceFile) -> dict[str, Trace]:
        """Simulated runs by name, on the measured axes."""
        return {
            name: aligned(trace, measured.runs[name], self.zeros[name])
            for file in self.simulated
            for name, trace in file.runs.items()
        }


def rerun_compare(
    measured: Measured, reference: Reference | None, name: str, base: LoadedConfig, work: Work, talk: Talk
) -> None:
    """Rerun the comparison on the motion recovered from the file `name`, all runs that followed it."""
    reason, runs = measured.unrecovered, measured.compare.runs
    if reference is not None and reference.record.joint != COMPARED:
        reason = "no run holds the desired angles q_d of both joints 2 and 3"
    if reference is None or reason:
        work.missing.append(f"a rerun of the comparison: {reason}")
        return
    apart = {run: math.degrees(departure(trace, reference)) for run, trace in runs.items()}
    work.missing += [
        f"residuals of {run}: its desired motion differs from that of {reference.run} by up to {size:.3g} deg"
        for run, size in apart.items()
        if size
    ]
    try:
        masses = {run: float(trace.attributes["payload_mass"]) for run, trace in runs.items()}
        write_compare(base, reference, masses, name, work.folder)
        simulated = rerun(work.folder / COMPARE, [run for run in runs if not apart[run]], talk)
    except TendonreproError as error:
        work.missing.append(f"a rerun of the comparison: {_with_hint(error)}")
        return
    if simulated.runs:
        work.simulated.append(simulated)
        work.zeros |= {run: zero_of(runs[run], reference) for run in simulated.runs}


def rerun_decouple(trace: Trace, name: str, base: LoadedConfig, work: Work, talk: Talk) -> None:
    """Rerun the decoupling run on the motors measured in it.

    The model is the configuration given, or the shipped one with what was set of the manipulator.
    """
    if trace.joint != (1, 2, 3):
        work.missing.append("all of joints 1 to 3 in the run decouple: no rerun of it")
        return
    try:
        if base.config.experiment != "decouple":
            both = [text for text in base.overrides if text.startswith(("manipulator.", "seed="))]
            base = load_config(None, "decouple", overrides=both)
        write_decouple(base, trace, name, work.folder)
        work.simulated.append(rerun(work.folder / DECOUPLE, [trace.name], talk))
    except TendonreproError as error:
        work.missing.append(f"a rerun of the run decouple: {_with_hint(error)}")
        return
    work.zeros[trace.name] = float(trace.time[0])


def _with_hint(error: TendonreproError) -> str:
    return f"{error.message}; {error.hint}" if error.hint else error.message


def write_compare(
    base: LoadedConfig, reference: Reference, masses: Mapping[str, float], measured: str, folder: Path
) -> None:
    """Write the recovered reference as a trajectory file and as a complete configuration.

    All of `base` is kept but its reference, and payloads that were measured with other masses, kg by run.
    """
    tree = config_tree(base.tree, measured)
    runs: Any = dict(tree["runs"])  # type: ignore[arg-type]
    for name, run in runs.items():
        mass = masses.get(name, run["payload"]["value"])
        if run["payload"]["unit"] == "kg" and mass != run["payload"]["value"]:
            source = f"identified: the mass stated for {measured}"
            runs[name] = run | {"payload": {"value": mass, "unit": "kg", "source": source}}
    write_atomically(folder / FILE, csv_text(reference.knots, reference.record.joint))
    write_atomically(folder / COMPARE, dump(tree | {"runs": runs}))


def write_decouple(base: LoadedConfig, trace: Trace, measured: str, folder: Path) -> None:
    """Write the measured motion of the decoupling experiment in the same way.

    The motors' angles drive the rerun where they were recorded, else the joints' encoders.
    """
    motors = "q_motor_encoder" in trace
    drives, variable = ("motors", "q_motor_encoder") if motors else ("joints", "q_encoder")
    knots = thinned(recorded(trace, variable))
    tree: dict[str, Any] = dict(base.tree)
    run = {"drives": drives, "reference": {"kind": "sampled", "file": MOTION}}
    tree["runs"] = {"decouple": run | {"payload": tree["runs"]["decouple"]["payload"]}}
    tree["title"] = f"{tree['title']}, on the {drives}' angles measured in {measured}"
    write_atomically(folder / MOTION, csv_text(knots, trace.joint))
    write_atomically(folder / DECOUPLE, dump(tree))


def rerun(path: Path, names: Sequence[str], talk: Talk) -> TraceFile:
    """Simulate those of some runs that a configuration has."""
    # The folder it lies in has another name once the result is whole.
    loaded = replace(load_config(path, None), origin=path.name)
    known = dict(build_loops(loaded.config, loaded.folder))
    chosen = [name for name in names if name in known]
    with talk.bar(f"simulating {len(chosen)} runs", len(chosen)) as progress:
        traces = each(partial(simulate_run, loaded, ()), chosen, progress)
    return trace_file(loaded, traces, make_manifest(loaded, 0.0))


def departure(trace: Trace, reference: Reference) -> float:
    """Largest difference of a run's desired motion from one recovered of another run, rad.

    It is 0 where rounding, noise and one sample of time explain it, or it was not recorded.
    """
    record = reference.record
    time = trace.time - zero_of(trace, reference)
    inside = (time >= 0.0) & (time <= record.time[-1])
    late = max(record.step, float(np.median(np.diff(time))))
    largest = beyond = 0.0
    for place, joint in enumerate(record.joint):
        if "q_d" not in trace or joint not in trace.joint:
            continue
        ours = trace["q_d"][:, trace.joint.index(joint)] - _first(trace, "q_d", joint)
        known = inside & np.isfinite(ours)
        near = [
            np.interp(time[known] + shift, record.time, record.q[:, place]) for shift in (-late, 0.0, late)
        ]
        within = np.clip(ours[known], np.min(near, axis=0), np.max(near, axis=0))
        beyond = max(beyond, np.abs(ours[known] - within).max(initial=0.0))
        largest = max(largest, np.abs(ours[known] - near[1]).max(initial=0.0))
    # Each of the two records has its own rounding and noise.
    return float(largest) if beyond > 2.0 * reference.knots.tolerance else 0.0


def aligned(simulated: Trace, measured: Trace, zero: float) -> Trace:
    """Put a rerun on the axes of its measured run: its time, and the start angles that were taken off.

    It begins at the measured time `zero`, s. In a comparison all its angles are moved by the start of `q_d`,
    and its errors stay.
    """
    sources = _OF_DECOUPLE if simulated.name == "decouple" else _OF_COMPARE
    variables = dict(simulated.variables)
    for name, source in sources.items():
        if name in variables and source in measured:
            start = [_first(measured, source, joint) for joint in simulated.joint]
            variables[name] = variables[name] + np.array(start)
    return replace(simulated, time=simulated.time + zero, variables=variables)


def _first(trace: Trace, name: str, joint: int) -> float:
    """First sample of a variable that is there; 0 where there is none."""
    if joint not in trace.joint:
        return 0.0
    values = trace[name][:, trace.joint.index(joint)]
    known = values[np.isfinite(values)]
    return float(known[0]) if len(known) else 0.0


def together(files: Sequence[TraceFile]) -> TraceFile | None:
    """Put the runs of both experiments into one file; None without any."""
    if len(files) < 2:
        return files[0] if files else None
    runs = {name: trace for file in files for name, trace in file.runs.items()}
    title = "; ".join(file.title for file in files)
    yaml = "---\n".join(file.config_yaml for file in files)
    manifest = {"experiment": "both", "experiments": [json.loads(file.manifest_json) for file in files]}
    # Joint 1 moves in the decoupling experiment alone, whose plant record has all joints.
    return replace(
        files[-1],
        experiment="both",
        title=title,
        runs=runs,
        config_yaml=yaml,
        config_sha256=hashlib.sha256(yaml.encode()).hexdigest(),
        manifest_json=to_json(manifest),
    )


FILE = "reference.csv"


def csv_text(knots: Knots, joint: Sequence[int]) -> str:
    """Trajectory file: ``time_s`` and ``q<joint>_deg``, s and degrees, for joints of these numbers."""
    rows = np.column_stack([knots.time, np.rad2deg(knots.angle)])
    lines = [",".join(f"{number:.9g}" for number in row) for row in rows + 0.0]
    return "\n".join([",".join(["time_s", *(f"q{number}_deg" for number in joint)]), *lines]) + "\n"


def config_tree(tree: Mapping[str, Node], measured: str) -> dict[str, Node]:
    """Whole configuration of a comparison, `tree`, on the recovered motion of a measured file."""
    title = f"{tree['title']}, on the reference measured in {measured}"
    return dict(tree) | {"title": title, "reference": {"kind": "sampled", "file": FILE}}
