"""The measured trace file that ``tendonrepro ingest`` writes."""

from __future__ import annotations

from pathlib import Path

from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.records import TraceFile
from tendonrepro.results.traces import read_traces

MEASURED = Path("data") / "measured.h5"
"""Where it is by default."""

_THE_WAY = "make it by tendonrepro fetch, inspect --suggest, and ingest"


def read_measured(path: Path) -> TraceFile:
    """Read a measured trace file.

    Raises
    ------
    DataMissingError
        If there is none or it cannot be read.
    UsageError
        If it is simulated.
    """
    try:
        file = read_traces(path)
    except DataMissingError as error:
        raise DataMissingError(error.message, where=error.where, hint=_THE_WAY) from error
    if file.source != "measured":
        raise UsageError("holds simulated traces, not measured ones", where=str(path), hint=_THE_WAY)
    return file
