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
    """Numbers and tables of an experiment.

    Parameters
    ----------
    file : TraceFile
    growing_hz : dict
        Runs whose linear loop grows, and the frequency at which, Hz.
    """
    joints = list(next(iter(file.runs.values())).joint)
    data: dict[str, Any] = {"schema_version": SCHEMA_VERSION, "experiment": file.experiment, "joints": joints}
    data |= table_data(file)
    if file.experiment == "compare":
        data["growing_hz"] = growing_hz
    notes = [*_fitted(file), *_slack(data), *_growing(data)]
    return Outcome(data, [*made_tables(file), *notes])


def _fitted(file: TraceFile) -> Iterator[str]:
    if under := fitted_under(file):
        yield f"The plant was fitted to the published tables under {under}, so agreement proves nothing."


def _slack(data: Mapping[str, Any]) -> Iterator[str]:
    for run, sizes in data["tension"].items():
        for tendon, seconds in zip(data["joints"], sizes["slack_s"], strict=True):
            if seconds:
                yield f"Tendon {tendon} does not pull in {run} for {seconds:.3f} s."


def _growing(data: Mapping[str, Any]) -> Iterator[str]:
    """A loop may grow so slowly that its run ends before the status tells."""
    status = data["status"]
    runs = [f"{run} at {hz:.1f} Hz" for run, hz in data.get("growing_hz", {}).items() if status[run] == "ok"]
    if runs:
        loops = ", ".join(runs)
        yield f"Linearised without friction these loops grow: {loops}. See tendonrepro explain."
