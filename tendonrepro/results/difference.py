"""What differs between two results: command, configuration, versions, numbers, sizes of errors, traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tendonrepro.configuration.strict_yaml import load
from tendonrepro.files import Json
from tendonrepro.results.on_disk import read_result
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import tracking_errors
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, read_traces

_OF_ONE_RUN = {"out", "manifest", "created", "experiments_per_second", "resumed_from", "seconds"}
"""Keys of numbers that differ when the same command runs again."""

_SHOWN = 20
"""Rows of a kind in the terminal; ``--json`` has all."""


@dataclass(frozen=True)
class _Side:
    """What one of two results says; `numbers` are of a command that leaves no traces."""

    command: str
    config: Mapping[str, object]
    versions: Mapping[str, object]
    numbers: Mapping[str, object]
    runs: Mapping[str, Trace]


def difference(first: Path, second: Path) -> dict[str, object]:
    """Compare two trace files, or results folders; a DataMissingError where one cannot be read.

    Returns
    -------
    dict
        ``same``, and rows of ``command``, ``config``, ``versions``, ``runs`` (their status), ``metrics`` in
        degrees, ``traces``: the largest difference, SI, and the time of the first; and ``numbers`` of
        commands that leave no traces.
    """
    a, b = map(_side, (first, second))
    shared = [(a.runs[name], b.runs[name]) for name in a.runs if name in b.runs]
    same_command = a.command == b.command
    rows = {
        "command": list(_unequal({"command": a.command}, {"command": b.command})),
        "config": list(_unequal(a.config, b.config)),
        "versions": list(_unequal(a.versions, b.versions)),
        "runs": list(_unequal(_statuses(a.runs), _statuses(b.runs))),
        "metrics": [row for pair in shared for row in _metrics(*pair)],
        "traces": [row for pair in shared for row in _traces(*pair)],
        "numbers": list(_unequal(a.numbers, b.numbers)) if same_command else [],
    }
    same = not any(rows.values())
    return {"schema_version": 1, "first": str(first), "second": str(second), "same": same} | rows


def _side(path: Path) -> _Side:
    if path.is_dir() and not (path / TRACES).exists():
        result = read_result(path)
        config_of_run = result.manifest["config"]
        # It covers more than the tree: of an ensemble its box, of a validation the measured file.
        config = {"sha256": config_of_run["sha256"], **dict(_values(config_of_run.get("tree", {})))}
        numbers = {key: value for key, value in result.data.items() if key != "config"}
        version = result.manifest.get("tendonrepro_version")
        versions = {"tendonrepro": version, **_libraries(result.manifest)}
        return _Side(result.command, config, versions, dict(_values(numbers)), {})
    file = read_traces(path)
    versions = {"tendonrepro": file.tendonrepro_version, **_libraries(file.manifest)}
    tree = load(file.config_yaml, "config_yaml")
    return _Side(file.experiment, dict(_values(tree)), versions, {}, file.runs)


def _libraries(manifest: Json) -> dict[str, object]:
    versions: dict[str, object] = manifest.get("environment", {}).get("versions", {})
    return versions


def _values(node: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Values by dotted key; an item of a list by its name, if it has one, else by its place."""
    if isinstance(node, dict):
        for key, part in node.items():
            if key not in _OF_ONE_RUN:
                yield from _values(part, f"{path}.{key}")
    elif isinstance(node, list) and any(isinstance(part, dict | list) for part in node):
        for place, part in enumerate(node):
            named = isinstance(part, dict) and (part.get("name") or part.get("id"))
            yield from _values(part, f"{path}.{named or place}")
    else:
        yield path.removeprefix("."), node


def _statuses(runs: Mapping[str, Trace]) -> dict[str, object]:
    return {name: trace.status for name, trace in runs.items()}


def _unequal(first: Mapping[str, object], second: Mapping[str, object]) -> Iterator[dict[str, object]]:
    for key in dict.fromkeys([*first, *second]):
        if first.get(key) != second.get(key):
            yield {"key": key, "first": first.get(key), "second": second.get(key)}


def _metrics(first: Trace, second: Trace) -> Iterator[dict[str, object]]:
    if "e" in first and "e" in second and first.joint == second.joint:
        a, b = (tracking_errors(trace)["whole"] for trace in (first, second))
        for name in a:
            for joint, x, y in zip(first.joint, a[name].tolist(), b[name].tolist(), strict=True):
                if not np.array_equal(x, y, equal_nan=True):
                    row = {"run": first.name, "joint": joint, "metric": f"{name}_deg"}
                    yield row | {"first": x, "second": y}


def _traces(first: Trace, second: Trace) -> Iterator[dict[str, object]]:
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


def difference_text(differences: Mapping[str, object]) -> str:
    """Words for a terminal."""
    if differences["same"]:
        return "The two results have the same command, configuration, versions, numbers and traces."
    kinds = {kind: rows for kind, rows in differences.items() if isinstance(rows, list) and rows}
    return "\n\n".join(_kind_text(kind, rows) for kind, rows in kinds.items())


def _kind_text(kind: str, rows: list[dict[str, object]]) -> str:
    left = len(rows) - _SHOWN
    table = Table(kind, f"{kind}: {len(rows)}", rows[:_SHOWN]).text()
    return f"{table}\n({left} more, --json shows them all)" if left > 0 else table
