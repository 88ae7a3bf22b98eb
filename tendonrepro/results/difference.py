"""What differs between two results: command, configuration, versions, numbers, sizes of errors, traces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.strict_yaml import load
from tendonrepro.files import Json
from tendonrepro.results.records import Trace
from tendonrepro.results.store import numbers_in, read_manifest
from tendonrepro.results.summary import tracking_errors
from tendonrepro.results.tables import Table
from tendonrepro.results.traces import TRACES, read_traces

BETWEEN_VERSIONS = 1e-6
"""Tolerance between results of different versions or solvers, which round differently."""

_OF_ONE_RUN = {"out", "manifest", "created", "experiments_per_second", "resumed_from", "seconds"}
"""Keys of numbers that differ when the same command runs again."""

_SHOWN = 20
"""Rows of a kind in the terminal; ``--json`` has all."""


def difference(first: Path, second: Path, tolerance: float | None = None) -> dict[str, object]:
    """Compare two trace files, or results folders.

    Parameters
    ----------
    first, second : Path
        Trace files, or results folders.
    tolerance : float, optional
        Numbers whose difference is at most this share of the larger one are equal; of a trace's variable, of
        its largest sample. Else 0 where versions and solver are equal, and `BETWEEN_VERSIONS` where not.

    Returns
    -------
    dict
        ``same``, the ``tolerance``, and rows of ``command``, ``config``, ``versions``, ``runs`` (their
        status), ``metrics`` in degrees, ``traces``: the largest difference, SI, and the time of the first;
        and ``numbers`` of commands that leave no traces.

    Raises
    ------
    DataMissingError
        Where one of them cannot be read.
    """
    (a, runs), (b, others) = map(_side, (first, second))
    rows = {kind: list(_unequal(a[kind], b[kind])) for kind in ("command", "config", "versions", "runs")}
    if tolerance is None:
        tolerance = BETWEEN_VERSIONS if rows["versions"] else 0.0
    shared = [(trace, others[name]) for name, trace in runs.items() if name in others]
    rows["metrics"] = [row for pair in shared for row in _metrics(*pair, tolerance)]
    rows["traces"] = [row for pair in shared for row in _traces(*pair, tolerance)]
    rows["numbers"] = [] if rows["command"] else list(_unequal(a["numbers"], b["numbers"], tolerance))
    about = {"first": str(first), "second": str(second), "tolerance": tolerance}
    return {"schema_version": 1, **about, "same": not any(rows.values())} | rows


def _side(path: Path) -> tuple[Mapping[str, Mapping[str, object]], Mapping[str, Trace]]:
    """What a result says, by kind and key, and its runs; numbers are of one that leaves no traces."""
    if path.is_dir() and not (path / TRACES).exists():
        manifest = read_manifest(path)
        runs: Mapping[str, Trace] = {}
        # The digest covers more than the tree: of an ensemble its box, of a validation the measured file.
        tree = {"sha256": manifest["config"]["sha256"], **manifest["config"].get("tree", {})}
        numbers, command = numbers_in(path, manifest), manifest.get("command", "")
        numbers.pop("config", None)
    else:
        file = read_traces(path)
        manifest, runs, command, numbers = file.manifest, file.runs, file.experiment, {}
        tree = load(file.config_yaml, "config_yaml")
    said = {"command": {"command": command}, "config": dict(_values(tree)), "numbers": dict(_values(numbers))}
    statuses = {name: trace.status for name, trace in runs.items()}
    return {**said, "versions": _versions(manifest), "runs": statuses}, runs


def _versions(manifest: Json) -> dict[str, object]:
    """Of this program, its libraries and the solver, as far as a manifest says."""
    libraries = manifest.get("environment", {}).get("versions", {})
    solver = (manifest.get("solver") or {}).get("name")  # of a study without one it is null
    return {"tendonrepro": manifest.get("tendonrepro_version"), **libraries, "solver": solver}


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


def _unequal(
    first: Mapping[str, object], second: Mapping[str, object], tolerance: float = 0.0
) -> Iterator[dict[str, object]]:
    for key in dict.fromkeys([*first, *second]):
        x, y = first.get(key), second.get(key)
        if x != y and not _near(x, y, tolerance):
            yield {"key": key, "first": x, "second": y}


def _near(first: object, second: object, tolerance: float) -> bool:
    """Whether these are numbers, or lists of them, each two equal to a share of the larger one."""
    a, b = np.asarray(first), np.asarray(second)
    numeric = a.dtype.kind in "if" and b.dtype.kind in "if" and a.shape == b.shape
    return numeric and not _apart(a, b, tolerance * np.maximum(np.abs(a), np.abs(b))).any()


def _apart(first: Array, second: Array, room: Array | float) -> NDArray[np.bool_]:
    """Where numbers differ by more than some room; what is missing in both is equal."""
    # A diverged run may end in infinity.
    with np.errstate(invalid="ignore"):
        far = ~(np.abs(first - second) <= room)
    return np.asarray(far & (first != second) & ~(np.isnan(first) & np.isnan(second)), np.bool_)


def _metrics(first: Trace, second: Trace, tolerance: float) -> Iterator[dict[str, object]]:
    if "e" not in first or "e" not in second or first.joint != second.joint:
        return
    a, b = (tracking_errors(trace)["whole"] for trace in (first, second))
    for name in a:
        for joint, x, y in zip(first.joint, a[name].tolist(), b[name].tolist(), strict=True):
            if not _near(x, y, tolerance):
                row = {"run": first.name, "joint": joint, "metric": name}
                yield row | {"first": x, "second": y}


def _traces(first: Trace, second: Trace, tolerance: float) -> Iterator[dict[str, object]]:
    both = [
        {"time": trace.time[:, np.newaxis], "joint": np.array([trace.joint], np.float64), **trace.variables}
        for trace in (first, second)
    ]
    for name in dict.fromkeys([*both[0], *both[1]]):
        row = {"run": first.name, "variable": name}
        a, b = (arrays.get(name, np.zeros(0)) for arrays in both)
        if a.shape != b.shape:
            yield row | {"shape_first": list(a.shape), "shape_second": list(b.shape)}
            continue
        largest = max(float(np.nanmax(np.abs(values), initial=0.0)) for values in (a, b))
        apart = _apart(a, b, tolerance * largest).any(axis=1)
        if apart.any():
            size = float(np.nanmax(np.abs(a - b), initial=0.0))
            yield row | {"largest": size, "from_s": float(first.time[np.argmax(apart)])}


def difference_text(differences: Mapping[str, object]) -> str:
    """Words for a terminal."""
    if differences["same"]:
        return "The two results have the same command, configuration, versions, numbers and traces."
    tables = [
        Table(kind, f"{kind}: {len(rows)}, of which at most {_SHOWN} are shown", rows[:_SHOWN]).text()
        for kind, rows in differences.items()
        if isinstance(rows, list) and rows
    ]
    if differences["tolerance"]:
        tables.append(f"Differences below a share of {differences['tolerance']:g} are left out.")
    return "\n\n".join(tables)
