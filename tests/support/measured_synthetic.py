"""SYNTHETIC measured files: shaped like those of ingest, made from formulas, never anybody's data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from support.synthetic import make_compare_file
from tendonrepro.configuration.published import published
from tendonrepro.results.records import Trace, TraceFile

Array = NDArray[np.float64]
CONTROLLERS = ("controller_1", "controller_2", "controller_3")
LOADED = "controller_1_payload"


def measured_trace(trace: Trace, **variables: Array) -> Trace:
    """The run as ingest would store it, with other variables."""
    attributes = dict(trace.attributes) | {"law": "measured", "gains": {}, "readings": {}}
    return replace(trace, variables={**trace.variables, **variables}, attributes=attributes)


def with_runs(file: TraceFile, **runs: Trace) -> TraceFile:
    """The file with some runs replaced or added."""
    return replace(file, runs={**file.runs, **runs})


def moved(trace: Trace, q_d: Array, by: float = 0.0) -> Trace:
    """The run on another desired motion, without what else was recorded, by some seconds later."""
    before = trace.time - by
    late = np.column_stack([np.interp(before, trace.time, column) for column in q_d.T])
    return replace(measured_trace(trace), variables={"q_d": late, "e": trace["e"]})


def errors_of(mae: float, rmse: float, count: int, *, centred: bool) -> Array:
    """Error that is zero or of one size, of zero mean or mostly positive, with an MAE and an RMSE."""
    share = 2 * round((mae / rmse) ** 2 * count / 2.0)
    e = np.zeros(count)
    places = np.random.default_rng(0).permutation(count)[:share]
    e[places] = mae * count / share * np.where(np.arange(share) % (2 if centred else 5), 1.0, -1.0)
    return e


def printed_file(inside: Callable[[Array], NDArray[np.bool_]], *, centred: bool = False) -> TraceFile:
    """Errors with the printed sizes where `inside` holds of the time, and twice as large elsewhere."""
    file = make_compare_file(step=0.01, source="measured")
    runs = {}
    for name, trace in file.runs.items():
        table = f"table2.{name}" if name in CONTROLLERS else "table3.with_load"
        where = inside(trace.time)
        e = np.empty_like(trace["e"])
        for column, joint in enumerate(trace.joint):
            sizes = [published().number(f"{table}.{metric}.joint_{joint}") for metric in ("mae", "rmse")]
            e[where, column] = np.deg2rad(errors_of(*sizes, int(where.sum()), centred=centred))
            e[~where, column] = np.deg2rad(2.0 * sizes[1])
        runs[name] = measured_trace(trace, e=e, q_encoder=trace["q_d"] - e)
    return replace(file, runs=runs)
