"""The model run again on measured motion: configurations written, runs simulated."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.config.fields.strict_yaml import Node, dump
from tendonrepro.config.load import LoadedConfig, load_config
from tendonrepro.console import Talk
from tendonrepro.dataset.motion.knots import thinned
from tendonrepro.dataset.motion.recover import Reference, recorded_motion, zero_of
from tendonrepro.dataset.motion.written import FILE, config_tree, csv_text
from tendonrepro.experiments.loops import build_loops
from tendonrepro.experiments.run import simulate_run, trace_file
from tendonrepro.files import to_json, write_atomically
from tendonrepro.parallel import each
from tendonrepro.results.manifest import make_manifest
from tendonrepro.results.records import Trace, TraceFile

COMPARE, DECOUPLE = "compare.yaml", "decouple.yaml"
MOTION = "decouple_reference.csv"

_OF_COMPARE = {"q_encoder": "q_d", "q_d": "q_d"}
_OF_DECOUPLE = {name: name for name in ("q_encoder", "q_motor_encoder", "q_calculated")}
"""Angles of a rerun, and the measured variable whose start they get."""


def write_compare(
    base: LoadedConfig, reference: Reference, masses: Mapping[str, float], measured: str, folder: Path
) -> list[Path]:
    """Write the recovered reference as a trajectory file and as a complete configuration.

    Parameters
    ----------
    base : LoadedConfig
        Of a comparison; all but its reference and the masses of payloads is kept.
    reference : Reference
    masses : mapping
        Measured run -> mass at its end-effector, kg.
    measured : str
        Name of the measured file.
    folder : Path

    Returns
    -------
    list of Path
        ``reference.csv`` and ``compare.yaml``.
    """
    paths = [folder / FILE, folder / COMPARE]
    write_atomically(paths[0], csv_text(reference.knots, reference.record.joint))
    tree = config_tree(base.tree, reference, measured)
    write_atomically(paths[1], dump(tree | {"runs": _with_payloads(tree["runs"], masses, measured)}))
    return paths


def _with_payloads(runs: Any, masses: Mapping[str, float], measured: str) -> Node:
    """Runs of a configuration with the masses that were measured with, where they are others."""
    changed = {}
    for name, run in runs.items():
        mass = masses.get(name, run["payload"]["value"])
        if run["payload"]["unit"] == "kg" and mass != run["payload"]["value"]:
            source = f"identified: the mass stated for {measured}"
            changed[name] = run | {"payload": {"value": mass, "unit": "kg", "source": source}}
    return dict(runs) | changed


def write_decouple(base: LoadedConfig, trace: Trace, measured: str, folder: Path) -> list[Path]:
    """Write the measured motion of the decoupling experiment in the same way.

    The motors' angles drive the rerun where they were recorded, else the joints' encoders.

    Parameters
    ----------
    base : LoadedConfig
        Of a decoupling experiment.
    trace : Trace
        The measured run.
    measured : str
        Name of the measured file.
    folder : Path

    Returns
    -------
    list of Path
        ``decouple_reference.csv`` and ``decouple.yaml``.

    Raises
    ------
    DataMissingError
        If nothing moves, or too few samples were recorded.
    """
    drives, variable = (
        ("motors", "q_motor_encoder") if "q_motor_encoder" in trace else ("joints", "q_encoder")
    )
    knots = thinned(recorded_motion(trace, variable))
    tree: dict[str, Node] = dict(base.tree)
    runs: Any = tree["runs"]
    run = {"drives": drives, "reference": {"kind": "sampled", "file": MOTION}}
    tree["runs"] = {"decouple": run | {"payload": runs["decouple"]["payload"]}}
    tree["title"] = f"{tree['title']}, on the {drives}' angles measured in {measured}"
    paths = [folder / MOTION, folder / DECOUPLE]
    write_atomically(paths[0], csv_text(knots, trace.joint))
    write_atomically(paths[1], dump(tree))
    return paths


def rerun(path: Path, names: Sequence[str], talk: Talk) -> TraceFile:
    """Simulate some runs of a configuration.

    Parameters
    ----------
    path : Path
        Configuration of an experiment.
    names : sequence of str
        Runs wanted; those that the configuration does not have are left out.
    talk : Talk

    Returns
    -------
    TraceFile

    Raises
    ------
    ConfigError
        If the model cannot follow the motion, for instance out of the working half-plane.
    """
    loaded = load_config(path, None)
    loops = dict(build_loops(loaded.config, loaded.folder))
    chosen = [name for name in names if name in loops]
    total = sum(loops[name].reference.time.size for name in chosen)
    with talk.bar(f"simulating {len(chosen)} runs", total) as progress:
        traces = each(partial(simulate_run, loaded, None), chosen, progress)
    return trace_file(loaded, traces, make_manifest(loaded, 0.0))


def departure(trace: Trace, reference: Reference) -> float:
    """Largest difference of a run's desired motion from the recovered one, where both were recorded.

    Parameters
    ----------
    trace : Trace
    reference : Reference
        Of another run, as a rule.

    Returns
    -------
    float
        rad; 0 where rounding, noise and one sample of time explain it, or it was not recorded.
    """
    record = reference.record
    time = trace.time - zero_of(trace, reference) + reference.delay
    # What bridges a gap of the other record is no evidence.
    inside = np.interp(time, record.time, record.known, left=0.0, right=0.0) == 1.0
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

    Parameters
    ----------
    simulated, measured : Trace
    zero : float
        Measured time at which the rerun begins, s.

    Returns
    -------
    Trace
        With `simulated`'s errors unchanged: in a comparison all its angles are moved by the start of `q_d`.
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
