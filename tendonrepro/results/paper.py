"""What a run is: the paper's own experiment or not, with or without payload, of a fitted plant or not.

That is decided once, when a trace file is made, and each run carries it. Only beside the paper's own stand
the print and the range of plausible plants.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import shipped_folder
from tendonrepro.configuration.models.control import RUNS, unloaded_run
from tendonrepro.configuration.models.experiment import CompareConfig
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.readings import AXES, PRINTED
from tendonrepro.configuration.published import (
    COMPARED,
    PrintedText,
    coupling_of,
    published,
    row_of,
    table_1,
)
from tendonrepro.configuration.strict_yaml import Tree, load
from tendonrepro.console import count_of
from tendonrepro.physics.drive import coupling_inverse
from tendonrepro.results.records import Trace, TraceFile

_IDENTIFIED = ("identified: Tables 2 and 3, misfit", "identified: Controller 2 of Table 2, misfit")
"""How the source of a value begins that was fitted to the print."""

_LONGEST_CHANGES = 60

OTHER_BASE = (
    "The base has not the paper's arm, gains and payload, or its runs start apart or with other friction. So "
    "nothing here speaks of the paper, although its numbers stand beside."
)
"""Conclusion of an ensemble or a search where `base_of_paper` does not hold."""


def with_what_they_are(file: TraceFile, tree: Tree | None = None) -> TraceFile:
    """Let each run of a file say what it is, once, when the file is made; `tree` is its configuration.

    Each gets three texts, empty where there is none. ``printed_row`` is how the ids of the printed errors
    begin that stand beside it, which needs the paper's arm, joints, gains, payload and motion; masses and
    readings may differ. ``unloaded_run`` is the run that it repeats with payload. ``fitted_under`` has the
    choices under which its plant was fitted to the print.
    """
    simulated, traces = file.source == "simulated", [*file.runs.values()]
    tree = (load(file.config_yaml, "configuration") if tree is None else tree) if simulated else {}
    motion = tree.get("reference")
    fitted = _fitted_under(traces, motion) if _is_fitted(tree) else ""
    # Of a measurement the arm alone is known.
    papers = of_paper(file) and (not simulated or motion in _shipped_motions() or _is_fitted(motion))
    runs = {}
    for trace in traces:
        has = trace.attributes
        driven = not simulated or (
            trace.joint == COMPARED
            and _driven_as_paper(trace.name, has["law"], has["gains"], has["payload_mass"])
        )
        said = {
            "printed_row": row_of(trace.name) if papers and trace.name in RUNS and driven else "",
            "unloaded_run": unloaded_run(trace.name),
            "fitted_under": fitted,
        }
        runs[trace.name] = replace(trace, attributes={**has, **said})
    return replace(file, runs=runs)


def _is_fitted(part: object) -> bool:
    """Whether the source of a value in a configuration says that it was fitted to the print."""
    text = json.dumps(part)
    return any(f'"{source}' in text for source in _IDENTIFIED)


def _fitted_under(traces: Sequence[Trace], motion: object) -> str:
    """Name of the reading under which the runs of a fitted plant are."""
    attributes = [trace.attributes for trace in traces]
    changed = changed_readings(attributes[0]["readings"])
    if isinstance(motion, dict) and motion.get("kind") == "ramp":
        changed.append("motion=ramp")
    if any(np.any(run.get("start_offset", 0.0)) for run in attributes):
        changed.append("starts=apart")
    if any(run.get("friction_scale", 1.0) != 1.0 for run in attributes):
        changed.append("run_friction=drawn")
    return "+".join(changed) or PRINTED


@cache
def _shipped_motions() -> list[object]:
    texts = (path.read_text(encoding="utf-8") for path in shipped_folder().glob("*.yaml"))
    return [load(text, "configuration").get("reference") for text in texts]


def of_paper(file: TraceFile) -> bool:
    """Whether the arm of a file is the paper's; a run that is the paper's has a ``printed_row``."""
    S_inv = file.plant.values.get("S_inv")
    return _arm_of_paper(file.plant.attributes.get("arm"), None if S_inv is None else S_inv.value)


def fitted_under(file: TraceFile) -> str | None:
    """Reading under which the plant was fitted to the print; None where it was not."""
    return next(iter(file.runs.values())).attributes.get("fitted_under") or None


def origin_of(file: TraceFile) -> str:
    """Simulated or measured, and by which configuration with which changes."""
    if file.source == "measured":
        return "Measured"
    name = Path(file.manifest.get("config", {}).get("origin", file.experiment)).name
    changes = list(file.manifest.get("overrides", ()))
    if sum(map(len, changes)) > _LONGEST_CHANGES:
        changes = [f"{count_of(len(changes), 'setting')} changed"]
    if under := fitted_under(file):
        changes.append(f"fitted to the print under {under}")
    return f"Simulated, configuration {', '.join([name, *changes])} ({file.config_sha256[:8]})"


def base_of_paper(config: CompareConfig) -> bool:
    """Whether plants that are drawn around a comparison speak of the paper.

    It has the paper's arm, gains and payload, and its runs start on their reference with equal friction:
    what is said of interpretations that leave starts and friction alone rests on that.
    """
    scales = [run.friction_scale.si for run in config.runs.values() if run.friction_scale]
    starts = [run.start_offset.si for run in config.runs.values() if run.start_offset]
    alike = all(scale == 1.0 for scale in scales) and not any(np.any(start) for start in starts)
    return alike and compares_as_paper(config)


def compares_as_paper(config: CompareConfig) -> bool:
    """Whether a comparison has the paper's arm, gains and payload."""
    if config.joints != COMPARED:
        return False
    gains = {name: gain.si for name, gain in config.control.gains if gain}
    return is_arm_of_paper(config.manipulator) and all(
        _driven_as_paper(name, run.law, gains, run.payload.si)
        for name, run in config.runs.items()
        if name in RUNS
    )


def is_arm_of_paper(arm: Manipulator) -> bool:
    """Whether an arm has the paper's name and coupling."""
    routing = arm.routing
    S_inv = coupling_inverse(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)
    return _arm_of_paper(arm.name, S_inv)


def _arm_of_paper(name: object, S_inv: Array | None) -> bool:
    """By name and coupling, as far as they are known."""
    arm = published().entries["hardware.arm"]
    assert isinstance(arm, PrintedText)
    if S_inv is not None:
        # A record of the moving joints alone holds the trailing block.
        block = coupling_of(table_1(published()))[1][-len(S_inv) :, -len(S_inv) :]
        if S_inv.shape != block.shape or not np.allclose(S_inv, block, rtol=1e-9, atol=1e-12):
            return False
    return name in {None, arm.text}


def _driven_as_paper(run: str, law: str, gains: Mapping[str, ArrayLike], payload: float) -> bool:
    """By its law's name, its gains, as far as they are printed, and its payload, kg."""
    paper = published()
    same = (
        np.allclose(ours, paper.per_joint(f"gain.{name}", COMPARED), rtol=1e-9)
        for name, ours in gains.items()
        if f"gain.{name}.joint_{COMPARED[0]}" in paper.entries
    )
    loaded = paper.number("hardware.payload") if unloaded_run(run) else 0.0
    return law == (unloaded_run(run) or run) and bool(np.isclose(payload, loaded)) and all(same)


def changed_readings(readings: Mapping[str, str]) -> list[str]:
    """``axis=value`` of every reading that is not as printed."""
    return [
        f"{name}={readings[name]}"
        for name, axis in AXES.items()
        if readings.get(name, axis.printed) != axis.printed
    ]
