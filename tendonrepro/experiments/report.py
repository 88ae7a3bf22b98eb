"""What a user sees of an experiment: its tables, and notes that no table holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from tendonrepro.results.paper_tables import made_tables, table_data
from tendonrepro.results.records import TraceFile
from tendonrepro.results.study import Outcome
from tendonrepro.results.summary import fitted_under

SCHEMA_VERSION = 1


def outcome_of(file: TraceFile, growing_hz: dict[str, float]) -> Outcome:
    """Numbers and tables of an experiment; `growing_hz` is of runs whose linear loop grows, in Hz."""
    joints = list(next(iter(file.runs.values())).joint)
    data: dict[str, Any] = {"schema_version": SCHEMA_VERSION, "experiment": file.experiment, "joints": joints}
    data |= table_data(file)
    if file.experiment == "compare":
        data["growing_hz"] = growing_hz
    return Outcome(data, [*made_tables(file), *_notes(file, data)])


def _notes(file: TraceFile, data: Mapping[str, Any]) -> Iterator[str]:
    if under := fitted_under(file):
        yield f"The plant was fitted to the published tables under {under}, so agreement proves nothing."
    for run, sizes in data["tension"].items():
        for tendon, seconds in zip(data["joints"], sizes["slack_s"], strict=True):
            if seconds:
                yield f"Tendon {tendon} does not pull in {run} for {seconds:.3f} s."
    # A loop may grow so slowly that its run ends before the status tells.
    growing, status = data.get("growing_hz", {}), data["status"]
    if runs := [f"{run} at {hz:.1f} Hz" for run, hz in growing.items() if status[run] == "ok"]:
        loops = ", ".join(runs)
        yield f"Linearised without friction these loops grow: {loops}. See tendonrepro explain."
