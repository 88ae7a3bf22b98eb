"""What a trace file shows, as plain numbers: sizes of errors in degrees, rankings, the data of ``--json``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.config.models.readings import AXES, PRINTED
from tendonrepro.physics.metrics import mae, max_abs, rmse, windows
from tendonrepro.physics.statics import slack_time, tendon_tension
from tendonrepro.results.paper import of_paper, printed_beside
from tendonrepro.results.records import Trace, TraceFile

CONTROLLERS = ("controller_1", "controller_2", "controller_3")
"""The compared runs, in the order in which the paper ranks them."""
LOADS: Mapping[str, str] = {"no_load": "controller_1", "with_load": "controller_1_payload"}
"""The rows of Table 3 and their runs."""

MEASURED = "measured"
"""Law of a run that was measured."""

_IDENTIFIED = re.compile(r"""source: ['"]identified: (?:Tables 2 and 3|Controller 2 of Table 2), misfit""")

Sizes: TypeAlias = dict[str, Array]


def fitted_under(file: TraceFile) -> str | None:
    """Reading under which a configuration was fitted to what the paper prints; None where it was not."""
    if not _IDENTIFIED.search(file.config_yaml):
        return None
    readings = next(iter(file.runs.values())).attributes["readings"]
    changed = [axis for axis in AXES.values() if readings.get(axis.name, axis.printed) != axis.printed]
    return "+".join(f"{axis.name}={readings[axis.name]}" for axis in changed) or PRINTED


def sizes_deg(e: Array, *, gaps: bool = False) -> Sizes:
    """Mean absolute, root mean square and largest error of each joint, in degrees.

    Samples from the first one on that is not finite are left out: a diverged run is judged up to there.

    Parameters
    ----------
    e : array (T, n)
        Error, rad.
    gaps : bool
        Of a measured run, which goes on after a missing sample: leave out such samples alone, joint by joint.

    Returns
    -------
    dict
        ``mae``, ``rmse`` and ``max``, each an array (n,) in degrees; NaN where no sample is left.
    """
    if gaps:
        each = [sizes_deg(column[np.isfinite(column), np.newaxis]) for column in e.T]
        return {name: np.concatenate([sizes[name] for sizes in each]) for name in ("mae", "rmse", "max")}
    broken = ~np.isfinite(e).all(axis=1)
    kept = np.rad2deg(e[: np.argmax(broken)] if broken.any() else e)
    if len(kept) == 0:
        return {name: np.full(e.shape[1], np.nan) for name in ("mae", "rmse", "max")}
    return {"mae": mae(kept), "rmse": rmse(kept), "max": max_abs(kept)}


def tracking_errors(trace: Trace) -> dict[str, Sizes]:
    """Sizes of the tracking error `e`, as `sizes_deg`, by every window of `metrics.windows` that is reached.

    ``whole`` is always there.
    """
    e = trace["e"]
    spans = windows(trace.time, trace.attributes["reference_period"])
    gaps = trace.attributes["law"] == MEASURED
    return {name: sizes_deg(e[span], gaps=gaps) for name, span in spans.items()}


def decoupling_errors(trace: Trace) -> Sizes:
    """Sizes of ``q_calculated - q_encoder``, as `sizes_deg`: the difference shown in Figs 10 to 12."""
    gaps = trace.attributes["law"] == MEASURED
    return sizes_deg(trace["q_calculated"] - trace["q_encoder"], gaps=gaps)


def tensions(file: TraceFile, trace: Trace) -> Array | None:
    """Tension of each moving joint's tendon along a run, N, (T, n); None where torque or routing is unknown.

    The compliance torque holds what tendon 4 adds, so nothing else is needed; ends where a run does.
    """
    if "tau_s" not in trace or not {"S", "winch_diameter"} <= file.plant.values.keys():
        return None
    S = file.plant.matrix("S", trace.joint)
    winch = file.plant.values["winch_diameter"].value[np.array(trace.joint) - 1]
    return tendon_tension(trace["tau_s"].T, S, winch).T


def tension_sizes(file: TraceFile, trace: Trace) -> Sizes:
    """Smallest tension of each tendon, when that is, and how long the tendon does not pull.

    Returns
    -------
    dict
        ``least`` N, ``at`` s and ``slack`` s, each an array (n,); without keys where tensions are unknown.
    """
    found = tensions(file, trace)
    kept = None if found is None else np.isfinite(found).all(axis=1)
    if found is None or kept is None or not kept.any():
        return {}
    time, tension = trace.time[kept], found[kept]
    return {
        "least": tension.min(axis=0),
        "at": time[tension.argmin(axis=0)],
        "slack": slack_time(time, tension.T),
    }


def loaded_runs(file: TraceFile) -> dict[str, Trace]:
    """Return the runs of Table 3 by the names of its rows."""
    return {load: file.runs[run] for load, run in LOADS.items() if run in file.runs}


def compared_runs(file: TraceFile) -> dict[str, Trace]:
    """Return the runs of Table 2: all but the payload run."""
    return {name: trace for name, trace in file.runs.items() if name != LOADS["with_load"]}


def ranking(file: TraceFile) -> dict[str, dict[str, dict[str, Any]]]:
    """Order of the controllers by size of error, best first, and whether the printed order 1 < 2 < 3 holds.

    A diverged run comes last whatever its error up to there. Controllers that were not run are left out of
    both orders. Of another experiment than the paper's ``agrees`` is None.
    """
    runs = [file.runs[name] for name in CONTROLLERS if name in file.runs]
    papers = all(of_paper(file, trace) for trace in runs)
    result: dict[str, dict[str, dict[str, Any]]] = {}
    for metric in ("mae", "rmse") if len(runs) > 1 else ():
        sizes = np.array([tracking_errors(trace)["whole"][metric] for trace in runs])
        sizes[[trace.status == "diverged" for trace in runs]] = np.inf
        for joint, column in zip(runs[0].joint, sizes.T, strict=True):
            order = [runs[place].name for place in np.argsort(column, kind="stable")]
            agrees = all(bool(better < worse) for better, worse in pairwise(column)) if papers else None
            result.setdefault(f"joint_{joint}", {})[metric] = {"order": order, "agrees": agrees}
    return result


def ranking_rows(
    ranking: Mapping[str, Mapping[str, Mapping[str, Any]]], status: Mapping[str, str]
) -> list[tuple[str, str, str]]:
    """Joint and metric, the controllers' numbers, and what the print says of it, of every order of `ranking`.

    A run that diverged comes last; between two of them there is no order to speak of.
    """
    words = {True: "as printed", False: "not as printed", None: ""}
    rows = []
    for joint, metrics in ranking.items():
        for metric, found in metrics.items():
            names = {run: run.removeprefix("controller_") for run in found["order"]}
            lost = [name for run, name in names.items() if status[run] == "diverged"]
            verdict = f"{' and '.join(lost)} diverged" if len(lost) > 1 else words[found["agrees"]]
            rows.append((f"{joint.replace('_', ' ')} {metric.upper()}", ", ".join(names.values()), verdict))
    return rows


def table_data_compare(file: TraceFile) -> dict[str, Any]:
    """Collect the data of ``compare --json``: Tables 2 and 3, other windows, status and ranking.

    Returns
    -------
    dict
        ``table2`` run -> ``mae_deg``, ``rmse_deg``, ``max_deg``, lists in the order of the run's joints, over
        the whole run; ``table3`` ``no_load``, ``with_load`` likewise; ``windows`` window -> run -> likewise,
        payload run included; ``status`` per run; ``ranking``; ``printed`` with both tables, NaN where nothing
        is; ``tension`` run -> ``least_N``, ``at_s``, ``slack_s`` of each joint's tendon; `fitted_under`. Our
        numbers that are not finite are None; runs that are missing leave their keys out.
    """
    errors = {name: tracking_errors(trace) for name, trace in file.runs.items()}
    others = dict.fromkeys(window for found in errors.values() for window in found if window != "whole")
    return {
        "table2": {name: _numbers(errors[name]["whole"]) for name in compared_runs(file)},
        "table3": {load: _numbers(errors[run.name]["whole"]) for load, run in loaded_runs(file).items()},
        "windows": {
            window: {name: _numbers(found[window]) for name, found in errors.items() if window in found}
            for window in others
        },
        "status": _statuses(file),
        "ranking": ranking(file),
        "printed": _printed_tables(file),
        "tension": _tensions(file),
        "fitted_under": fitted_under(file),
    }


def _printed_tables(file: TraceFile) -> dict[str, Any]:
    """Tables 2 and 3 as printed, under the keys of ours; NaN where the print does not stand beside a run."""

    def sizes(trace: Trace, identifier: str) -> dict[str, list[float]]:
        return {
            f"{metric}_deg": printed_beside(file, trace, f"{identifier}.{metric}")
            for metric in ("mae", "rmse")
        }

    return {
        "table2": {name: sizes(trace, f"table2.{name}") for name, trace in compared_runs(file).items()},
        "table3": {load: sizes(trace, f"table3.{load}") for load, trace in loaded_runs(file).items()},
    }


def table_data_decouple(file: TraceFile) -> dict[str, Any]:
    """Collect the data of ``decouple --json``: coupling matrices, errors of the calculated joint angles.

    Returns
    -------
    dict
        ``S`` and ``S_inv``, lists of rows, as far as the plant record has them; ``errors``
        ``joint_<number>`` -> ``mae_deg``, ``rmse_deg``, ``max_deg`` of the run ``decouple``; ``status`` per
        run; ``tension`` as of the comparison. Numbers that are not finite are None.
    """
    plant = file.plant.values
    data: dict[str, Any] = {name: plant[name].value.tolist() for name in ("S", "S_inv") if name in plant}
    data["errors"] = {}
    if "decouple" in file.runs:
        trace = file.runs["decouple"]
        lists = _numbers(decoupling_errors(trace))
        for index, joint in enumerate(trace.joint):
            data["errors"][f"joint_{joint}"] = {key: values[index] for key, values in lists.items()}
    return data | {"status": _statuses(file), "tension": _tensions(file)}


def _numbers(sizes: Sizes) -> dict[str, list[float | None]]:
    return {
        f"{name}_deg": [float(x) if np.isfinite(x) else None for x in values]
        for name, values in sizes.items()
    }


def _tensions(file: TraceFile) -> dict[str, dict[str, list[float]]]:
    sizes = {name: tension_sizes(file, trace) for name, trace in file.runs.items()}
    return {
        name: {
            "least_N": found["least"].tolist(),
            "at_s": found["at"].tolist(),
            "slack_s": found["slack"].tolist(),
        }
        for name, found in sizes.items()
        if found
    }


def _statuses(file: TraceFile) -> dict[str, str]:
    return {name: trace.status for name, trace in file.runs.items()}
