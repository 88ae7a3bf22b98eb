"""What differs between two results: configuration, versions, sizes of errors, traces."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.configuration.strict_yaml import Node, load
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import tracking_errors
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import read_traces


def difference(first: Path, second: Path) -> dict[str, Any]:
    """Compare two trace files, or results folders; a DataMissingError where one cannot be read.

    Returns
    -------
    dict
        ``same``, and rows of ``config``, ``versions``, ``runs`` (their status), ``metrics`` in degrees, and
        ``traces``: the largest difference, SI, and the time of the first.
    """
    a, b = map(read_traces, (first, second))
    shared = [(a.runs[name], b.runs[name]) for name in a.runs if name in b.runs]
    found = {
        "config": list(_unequal(_configuration(a), _configuration(b))),
        "versions": list(_unequal(_versions(a), _versions(b))),
        "runs": list(_unequal(_statuses(a), _statuses(b))),
        "metrics": [row for pair in shared for row in _metrics(*pair)],
        "traces": [row for pair in shared for row in _traces(*pair)],
    }
    same = not any(found.values())
    return {"schema_version": 1, "first": str(first), "second": str(second), "same": same} | found


def _configuration(file: TraceFile) -> dict[str, Any]:
    return _leaves(load(file.config_yaml, "config_yaml").tree)


def _versions(file: TraceFile) -> dict[str, Any]:
    environment = json.loads(file.manifest_json or "{}").get("environment", {})
    return {"tendonrepro": file.tendonrepro_version, **environment.get("versions", {})}


def _statuses(file: TraceFile) -> dict[str, Any]:
    return {name: trace.status for name, trace in file.runs.items()}


def _leaves(node: Node, path: str = "") -> dict[str, Any]:
    """Values of a tree by dotted key; a list is one value."""
    if not isinstance(node, dict):
        return {path.removeprefix("."): node}
    found: dict[str, Any] = {}
    for key, part in node.items():
        found |= _leaves(part, f"{path}.{key}")
    return found


def _unequal(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for key in dict.fromkeys([*first, *second]):
        if first.get(key) != second.get(key):
            yield {"key": key, "first": first.get(key), "second": second.get(key)}


def _metrics(first: Trace, second: Trace) -> Iterator[dict[str, Any]]:
    if "e" in first and "e" in second and first.joint == second.joint:
        a, b = (tracking_errors(trace)["whole"] for trace in (first, second))
        for name in a:
            for joint, x, y in zip(first.joint, a[name].tolist(), b[name].tolist(), strict=True):
                if not np.array_equal(x, y, equal_nan=True):
                    row = {"run": first.name, "joint": joint, "metric": f"{name}_deg"}
                    yield row | {"first": x, "second": y}


def _traces(first: Trace, second: Trace) -> Iterator[dict[str, Any]]:
    both = [
        {"time": trace.time[:, np.newaxis], "joint": np.array([trace.joint]), **trace.variables}
        for trace in (first, second)
    ]
    for name in dict.fromkeys([*both[0], *both[1]]):
        row = {"run": first.name, "variable": name}
        a, b = (arrays.get(name, np.zeros(0)) for arrays in both)
        if a.shape != b.shape:
            yield row | {"shape_first": list(a.shape), "shape_second": list(b.shape)}
        elif not np.array_equal(a, b, equal_nan=True):
            apart = ~np.isclose(a, b, rtol=0.0, atol=0.0, equal_nan=True).all(axis=1)
            largest = float(np.nanmax(np.abs(a - b), initial=0.0))
            yield row | {"largest": largest, "from_s": float(first.time[np.argmax(apart)])}


def difference_text(found: Mapping[str, Any]) -> str:
    """Words for a terminal."""
    if found["same"]:
        return "The two results have the same configuration, versions, metrics and traces."
    kinds = {kind: rows for kind, rows in found.items() if isinstance(rows, list) and rows}
    return "\n\n".join(Table(kind, f"{kind}: {len(rows)}", rows).text() for kind, rows in kinds.items())
