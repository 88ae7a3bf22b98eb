"""What ``tendonrepro inspect`` does: list what is in files, and guess what it means."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tendonrepro.console import Talk
from tendonrepro.dataset.mapping.suggestion import suggest
from tendonrepro.dataset.mapping.timebase import in_seconds
from tendonrepro.dataset.meaning.assignment import runs_among, variable_of
from tendonrepro.dataset.meaning.columns import Column, sampling_step
from tendonrepro.dataset.meaning.understand import understand
from tendonrepro.dataset.meaning.words import few, printable
from tendonrepro.dataset.readers.guard import read_guarded
from tendonrepro.dataset.readers.read import files_below
from tendonrepro.dataset.readers.signals import Signal, Source
from tendonrepro.errors import UsageError
from tendonrepro.files import write_atomically

SCHEMA_VERSION = 1
_MOST_TEXTS = 40  # texts of a file that a terminal shows


def run_inspect(paths: Sequence[Path], suggest_to: Path | None, *, force: bool, talk: Talk) -> dict[str, Any]:
    """Read files, folders and archives and say what is in them.

    `suggest_to` is where to write a mapping to begin with, over one that exists only with `force`.

    Returns
    -------
    dict
        What ``--json`` prints.

    Raises
    ------
    DataMissingError
        When a path is missing.
    UsageError
        When the mapping exists and `force` is not given.
    """
    if suggest_to is not None and suggest_to.exists() and not force:
        message = "exists, and may hold work of yours"
        raise UsageError(message, where=str(suggest_to), hint="choose another --mapping, or say --force")
    sources = read_guarded(files_below(paths), talk)
    columns = understand(sources)
    found = {"schema_version": SCHEMA_VERSION, "files": _files(sources, columns)}
    if suggest_to is not None:
        title = f"Measured data from {', '.join(path.resolve().name for path in paths)}"
        suggestion = suggest(columns, title)
        write_atomically(suggest_to, suggestion.text)
        found |= {"mapping": str(suggest_to), "runs": dict(suggestion.runs)}
        found |= {"left": len(suggestion.left), "decide": list(suggestion.remarks)}
    return found


def _files(sources: Iterable[Source], columns: Sequence[Column]) -> list[dict[str, Any]]:
    runs: dict[Column, list[str]] = defaultdict(list)
    for run, members in runs_among(columns).items():
        for column in members:
            runs[column].append(run)
    of: dict[int, list[dict[str, Any]]] = defaultdict(list)
    for column in columns:
        of[id(column.signal)].append(_column(column, runs[column]))
    return [
        {
            "name": source.name,
            "kind": source.kind,
            "size": source.size,
            "md5": source.md5,
            "signals": [_signal(signal, of[id(signal)]) for signal in source.signals],
            "skipped": [asdict(skip) for skip in source.skipped],
            "texts": dict(source.texts),
        }
        for source in sources
    ]


def _signal(signal: Signal, columns: Sequence[dict[str, Any]]) -> dict[str, Any]:
    time = signal.time
    return {
        "path": signal.path,
        "shape": list(signal.values.shape),
        "dtype": signal.dtype,
        "unit": signal.unit,
        "label": signal.label,
        "step_s": None if time is None else sampling_step(time),
        "times_s": None if time is None or not len(time) else [float(time[0]), float(time[-1])],
        "note": signal.note,
        "columns": columns,
    }


def _column(column: Column, runs: Sequence[str]) -> dict[str, Any]:
    finite = column.values[np.isfinite(column.values)]
    return {
        "column": column.number,
        "range": [float(finite.min()), float(finite.max())] if finite.size else None,
        "missing": len(column.values) - len(finite),
        "meaning": column.quantity,
        "variable": variable_of(column),
        "joint": column.joint,
        "runs": list(runs),
        "unit": column.unit,
        "because": column.because,
    }


def inspect_text(found: Mapping[str, Any], *, verbose: bool = False) -> str:
    """What a terminal shows of an inspection, `found` by `run_inspect`; every column of it if `verbose`."""
    files = found["files"]
    lines = [line for file in files for line in (_file_lines(file) if verbose else _short_lines(file))]
    read, skipped = (sum(len(file[key]) for file in files) for key in ("signals", "skipped"))
    more = "" if verbose else "; -v shows every column, and why"
    lines += ["", f"{_count(len(files), 'file')}: {_count(read, 'signal')} read, {skipped} left out{more}"]
    if "mapping" in found:
        lines += [f"decide: {remark}" for remark in found["decide"]]
        runs = ", ".join(f"{name} ({count} columns)" for name, count in found["runs"].items())
        said = runs or "no column could be assigned to a run, they are all listed there as comments"
        lines.append(f"wrote {found['mapping']}: {said}; {found['left']} columns in no run")
    else:
        lines.append("--suggest writes a mapping file to edit")
    return "\n".join(map(printable, lines))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _short_lines(file: Mapping[str, Any]) -> Iterator[str]:
    """What a file is taken for, run by run, and what is missing."""
    signals = file["signals"]
    yield f"{file['name']}: {file['kind']}, {_count(len(signals), 'signal')}"
    taken: dict[str, dict[str, set[int]]] = defaultdict(lambda: defaultdict(set))
    unknown = []
    for signal in signals:
        for column in signal["columns"]:
            if column["meaning"] is None:
                number = f" {column['column']}" if len(signal["columns"]) > 1 else ""
                unknown.append(signal["path"] + number)
            elif column["meaning"] not in {"time", "index"}:
                for run in column["runs"] or ["in no run"]:
                    taken[run][column["meaning"]] |= {column["joint"]} - {None}
    for run, meanings in taken.items():
        words = (
            f"{what} {', '.join(map(str, sorted(joints)))}".rstrip() for what, joints in meanings.items()
        )
        yield f"  {run}: {'; '.join(words)}"
    if unknown:
        yield f"  not guessed: {few(unknown)}"
    yield from _skipped_lines(file["skipped"])


def _file_lines(file: Mapping[str, Any]) -> list[str]:
    lines = ["", f"{file['name']}: {file['kind']}, {file['size']:,} bytes"]
    for signal in file["signals"]:
        shape = " x ".join(map(str, signal["shape"]))
        notes = [f", {text}" for text in (_pace(signal), signal["note"]) if text]
        lines.append(f"  {signal['path']}  {shape} {signal['dtype']}{''.join(notes)}")
        lines += [f"    {_column_line(column, signal)}" for column in signal["columns"]]
    for path, text in list(file["texts"].items())[:_MOST_TEXTS]:
        first, *rest = text.splitlines() or [""]
        lines += [f"  text {path}: {first}", *(f"    {line}" for line in rest)]
    return [*lines, *_skipped_lines(file["skipped"])]


def _skipped_lines(skipped: Sequence[Mapping[str, str]]) -> Iterator[str]:
    """What was left out; much of the same on one line."""
    alike: dict[tuple[str, str], list[str]] = defaultdict(list)
    for skip in skipped:
        alike[skip["reason"], skip["advice"]].append(skip["path"])
    for (reason, advice), paths in alike.items():
        named = few([path for path in paths if path])
        place = f"{named}: " if named else ""
        yield f"  skipped {place}{reason}{'. ' + advice if advice else ''}"


def _pace(signal: Mapping[str, Any]) -> str:
    """Sampling of a signal that has its own times."""
    if signal["times_s"] is None:
        return ""
    if signal["step_s"] is not None:
        return f"every {signal['step_s'] * 1e3:g} ms"
    first, last = signal["times_s"]
    return f"times from {in_seconds(first)} to {in_seconds(last)} s, {last - first:.6g} s long"


def _column_line(column: Mapping[str, Any], signal: Mapping[str, Any]) -> str:
    is_time = column["meaning"] == "time"
    first, last = column["range"] or (0.0, 0.0)
    extent = f"{in_seconds(first)} to {in_seconds(last)}" if is_time else f"{first:.4g} to {last:.4g}"
    line = extent if column["range"] else "no numbers"
    line = f"{column['column']}: {line}" if len(signal["columns"]) > 1 else line
    line += f" {signal['unit']}" if signal["unit"] else ""
    line += f", {column['missing']} missing" if column["missing"] else ""
    if column["meaning"] is None:
        return f"{line} -> ?"
    joint = f" {column['joint']}" if column["joint"] and not is_time else ""
    run = f" of {', '.join(column['runs'])}" if column["runs"] else ""
    return f"{line} -> {column['meaning']}{joint}{run} ({'; '.join(column['because'])})"
