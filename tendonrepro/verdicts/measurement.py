"""A measured trace file, with what follows from it: its desired motion and its errors over every window."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from tendonrepro.configuration.published import COMPARED, Published
from tendonrepro.dataset.motion import Reference, recover_reference, timing_of
from tendonrepro.dataset.windows import NO_TABLES, PrintedTables, Timing, try_windows
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.results.records import TraceFile
from tendonrepro.results.traces import read_traces

_THE_WAY = "make it by tendonrepro fetch, inspect --suggest, and ingest"


def read_measured(path: Path) -> TraceFile:
    """Read a measured trace file.

    Raises
    ------
    DataMissingError
        If there is none or it cannot be read.
    UsageError
        If it is simulated, or holds no run.
    """
    try:
        file = read_traces(path)
    except DataMissingError as error:
        if path.exists():
            raise
        meant = did_you_mean(path.name, (other.name for other in path.parent.glob("*.h5")))
        raise DataMissingError(
            f"there is no measured trace file{meant}", where=str(path), hint=_THE_WAY
        ) from error
    if file.source != "measured":
        raise UsageError("holds simulated traces, not measured ones", where=str(path), hint=_THE_WAY)
    if not file.runs:
        raise UsageError("holds no runs", where=str(path), hint="name them under runs of the mapping")
    return file


@dataclass(frozen=True)
class Measurement:
    """A measured file and what follows from it; `unrecovered` says why there is no `reference`.

    `timing` is of every run of the comparison.
    """

    file: TraceFile
    tables: PrintedTables
    reference: Reference | None
    unrecovered: str = ""
    timing: Mapping[str, Timing] = field(default_factory=dict)

    @cached_property
    def compare(self) -> TraceFile:
        """Its runs of the comparison."""
        return self.file.part("compare")


def measurement_of(file: TraceFile, paper: Published | None, joints: Sequence[int] = COMPARED) -> Measurement:
    """Recover the reference of these joints; try every averaging window, where a paper prints errors."""
    reference, unrecovered = None, ""
    try:
        reference = recover_reference(file, joints)
    except DataMissingError as error:
        unrecovered = f"{error.message}; {error.hint}" if error.hint else error.message
    timing = timing_of(file, reference)
    tables = try_windows(file.part("compare"), paper, timing) if paper else NO_TABLES
    return Measurement(file, tables, reference, unrecovered, timing)
