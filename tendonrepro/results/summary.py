"""Numbers of a trace file: sizes of errors in degrees, tensions, rankings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.physics.metrics import mae, max_abs, rmse, windows
from tendonrepro.physics.statics import slack_time, tendon_tension
from tendonrepro.results.paper import changed_readings, of_paper
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.statistics import saturated, statistics

CONTROLLERS = ("controller_1", "controller_2", "controller_3")
"""The compared runs, in the order in which the paper ranks them."""
PAYLOAD = "_payload"
"""End of the name of a run with payload."""

LOADS: Mapping[str, str] = {"no_load": "controller_1", "with_load": "controller_1_payload"}
"""The rows of Table 3 and their runs."""

USER_LAW = "user law "
"""Begins a run's ``law`` where that is a user's."""

MEASURED = "measured"
"""Law of a run that was measured."""

_IDENTIFIED = re.compile(r"""source: ['"]identified: (?:Tables 2 and 3|Controller 2 of Table 2), misfit""")

Sizes: TypeAlias = dict[str, Array]


def fitted_under(file: TraceFile) -> str | None:
    """Reading under which the plant was fitted to the print; None where it was not."""
    if not _IDENTIFIED.search(file.config_yaml):
        return None
    return "+".join(changed_readings(next(iter(file.runs.values())))) or PRINTED


def sizes_deg(e: Array) -> Sizes:
    """``mae``, ``rmse`` and ``max`` of each joint, degrees, (n,) each; missing samples are left out.

    `e` is the error, rad, (T, n).
    """
    degrees = np.rad2deg(e)
    return {"mae": mae(degrees), "rmse": rmse(degrees), "max": max_abs(degrees)}


def tracking_errors(trace: Trace) -> dict[str, Sizes]:
    """Sizes of `e`, as `sizes_deg`, by every window of `metrics.windows`.

    A diverged run has NaN in windows that go on to its end.
    """
    spans = windows(trace.time, trace.attributes["reference_period"])
    found = {name: sizes_deg(trace["e"][span]) for name, span in spans.items()}
    if trace.status == "diverged":
        unknown = dict.fromkeys(("mae", "rmse", "max"), np.full(len(trace.joint), np.nan))
        found |= {name: unknown for name in spans if not name.startswith("period")}
    return found


def decoupling_errors(trace: Trace) -> Sizes:
    """Sizes of ``q_calculated - q_encoder``, Figs 10 to 12, as `sizes_deg`."""
    return sizes_deg(trace["q_calculated"] - trace["q_encoder"])


def tensions(file: TraceFile, trace: Trace) -> Array:
    """Tension of each moving joint's tendon, N, (T, n); NaN where torque or routing is unknown.

    The compliance torque holds what tendon 4 adds.
    """
    if "tau_s" not in trace or not {"S", "winch_diameter"} <= file.plant.values.keys():
        return np.full((len(trace.time), len(trace.joint)), np.nan)
    S = file.plant.matrix("S", trace.joint)
    winch = file.plant.values["winch_diameter"].value[np.array(trace.joint) - 1]
    return tendon_tension(trace["tau_s"].T, S, winch).T


def tension_sizes(file: TraceFile, trace: Trace) -> Sizes:
    """``least_N``, the smallest tension of each tendon, ``at_s`` its time, ``slack_s`` how long it is slack.

    Empty where tensions are unknown.
    """
    found = tensions(file, trace)
    kept = np.isfinite(found).all(axis=1)
    if not kept.any():
        return {}
    time, tension = trace.time[kept], found[kept]
    return {
        "least_N": tension.min(axis=0),
        "at_s": time[tension.argmin(axis=0)],
        "slack_s": slack_time(time, tension.T),
    }


def torque_sizes(file: TraceFile, trace: Trace) -> Sizes:
    """``rms_Nm``, ``peak_Nm`` and ``step_rms_Nm`` of the applied torque, (n,) each, as far as known.

    ``at_limit`` is the share of samples at the motor's limit.
    """
    if "tau_m" not in trace:
        return {}
    found = statistics(trace)
    sizes = {f"{name}_Nm": found[f"torque_{name}"] for name in ("rms", "peak", "step_rms")}
    limit = file.plant.values.get("actuator_torque_limit")
    if limit is not None:
        S = file.plant.matrix("S", trace.joint)
        sizes["at_limit"] = saturated(trace, S, limit.value[np.array(trace.joint) - 1])
    return sizes


def loaded_runs(file: TraceFile) -> dict[str, Trace]:
    """Runs of Table 3 by the names of its rows; rows of a user's law begin with the law's name."""
    found = {load: file.runs[run] for load, run in LOADS.items() if run in file.runs}
    for name, trace in file.runs.items():
        loaded = file.runs.get(f"{name}{PAYLOAD}")
        if loaded is not None and name not in LOADS.values():
            found |= {f"{name}_no_load": trace, f"{name}_with_load": loaded}
    return found


def compared_runs(file: TraceFile) -> dict[str, Trace]:
    """Runs of Table 2: all but those with payload."""
    return {name: trace for name, trace in file.runs.items() if not name.endswith(PAYLOAD)}


def is_user_law(trace: Trace) -> bool:
    """Whether a run's law is a user's."""
    return str(trace.attributes["law"]).startswith(USER_LAW)


def run_title(trace: Trace) -> str:
    """Name of a run for a reader; a user's law keeps the user's."""
    return trace.name if is_user_law(trace) else trace.name.replace("_", " ").capitalize()


def ranking(file: TraceFile) -> dict[str, dict[str, dict[str, Any]]]:
    """Order of all laws by size of error, and whether the printed order 1 < 2 < 3 holds.

    Returns
    -------
    dict
        By joint and metric ``order``, names of the runs, best first and diverged ones last, and ``agrees``,
        None of another experiment than the paper's.
    """
    known = [file.runs[name] for name in CONTROLLERS if name in file.runs]
    runs = known + [trace for trace in compared_runs(file).values() if is_user_law(trace)]
    papers = len(known) > 1 and all(of_paper(file, trace) for trace in known)
    result: dict[str, dict[str, dict[str, Any]]] = {}
    for metric in ("mae", "rmse") if len(runs) > 1 else ():
        sizes = np.array([tracking_errors(trace)["whole"][metric] for trace in runs])
        for joint, column in zip(runs[0].joint, np.where(np.isnan(sizes), np.inf, sizes).T, strict=True):
            order = [runs[place].name for place in np.argsort(column, kind="stable")]
            rising = all(bool(better < worse) for better, worse in pairwise(column[: len(known)]))
            agrees = rising if papers else None
            result.setdefault(f"joint_{joint}", {})[metric] = {"order": order, "agrees": agrees}
    return result
