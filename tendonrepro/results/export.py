"""Traces for other programs: one table of all runs as csv or Parquet, or MATLAB structures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.io import savemat

from tendonrepro.errors import UsageError
from tendonrepro.files import atomic_path
from tendonrepro.results.records import VARIABLES, TraceFile
from tendonrepro.results.store import TRACES, refuse_existing, stored_traces
from tendonrepro.results.traces import dataset_of

if TYPE_CHECKING:
    from pandas import DataFrame


def export_traces(source: Path, form: str, out: Path | None = None, *, force: bool = False) -> Path:
    """Write a trace file in another format, in SI units, and return the path.

    Parameters
    ----------
    source : Path
        Trace file, or a results folder.
    form : str
        ``csv`` and ``parquet`` have a row per run, sample and joint; ``mat`` a structure per run.
    out : Path, optional
        Else beside the trace file.

    Raises
    ------
    DataMissingError
        If the trace file cannot be read.
    UsageError
        For a format that is unknown or lacks its library, and a file that is there.
    """
    if form not in _WRITERS:
        message = f"must be one of {', '.join(_WRITERS)}, found {form!r}"
        raise UsageError(message, where="--format")
    if out is not None and out.suffix != f".{form}":
        message = f"a file of the format {form} ends in .{form}, found {str(out)!r}"
        raise UsageError(message, where="--out")
    target = out or (source / TRACES if source.is_dir() else source).with_suffix(f".{form}")
    refuse_existing(target, force=force)
    file = stored_traces(source)
    with atomic_path(target) as temporary:
        _WRITERS[form](file, temporary)
    return target


def _table(file: TraceFile) -> DataFrame:
    """A row per run, sample and joint; what a run does not hold is missing there."""
    import pandas as pd

    runs = {name: dataset_of(trace).to_dataframe() for name, trace in file.runs.items()}
    return pd.concat(runs, names=["run"]).reset_index()


def _csv(file: TraceFile, path: Path) -> None:
    _table(file).to_csv(path, index=False, lineterminator="\n")


def _parquet(file: TraceFile, path: Path) -> None:
    if find_spec("pyarrow") is None:
        message = "parquet needs the library pyarrow, which is not installed"
        raise UsageError(message, where="--format", hint="pip install 'tendonrepro[parquet]'")
    _table(file).to_parquet(path, engine="pyarrow", index=False)


def _mat(file: TraceFile, path: Path) -> None:
    held = {
        name: {"time": trace.time, "joint": np.array(trace.joint), **trace.variables}
        | {key: trace.attributes[key] for key in ("law", "status", "payload_mass")}
        for name, trace in file.runs.items()
    }
    held["units"] = {"time": "s"} | {name: unit for name, (unit, _) in VARIABLES.items()}
    savemat(str(path), held, long_field_names=True, do_compression=True, oned_as="column")


_WRITERS: Mapping[str, Callable[[TraceFile, Path], None]] = {"csv": _csv, "parquet": _parquet, "mat": _mat}
