"""Tables 1 to 3 and their companions; published values stand beside the paper's own experiment alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import groupby
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.configuration.published import PrintedNumber, PrintedRatio, published
from tendonrepro.results.paper import identifier_of, of_paper, plausible_beside, printed_beside
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import (
    CONTROLLERS,
    LOADS,
    Sizes,
    compared_runs,
    decoupling_errors,
    fitted_under,
    loaded_runs,
    ranking,
    run_title,
    tension_sizes,
    torque_sizes,
    tracking_errors,
)
from tendonrepro.results.tables import Table, TableColumns, rounded

TableRow: TypeAlias = dict[str, Any]
"""A table row by column name; a column without a value may be left out."""

METRICS = ("mae", "rmse")


def _metric_columns(metric: str) -> TableColumns:
    head = f"{metric.upper()} (deg)"
    return {
        f"{metric}_pair": (f"{head}, joint {{joints}}", ""),
        f"{metric}_printed_pair": ("printed", ""),
        f"{metric}_plausible_pair": ("plausible", ""),
        # "z" keeps a rounded zero from having a sign; as many digits as the paper.
        f"{metric}_deg": (head, "z.3f"),
        f"{metric}_printed_deg": ("printed", "z.3f"),
        f"{metric}_ratio": ("ours/printed", "z.3f"),
        f"{metric}_low_deg": ("plausible from", ".2g"),
        f"{metric}_high_deg": ("to", ".2g"),
    }


COLUMNS: TableColumns = {
    "window": ("Window", ""),
    "run": ("Run", ""),
    "load": ("Load", ""),
    "metric": ("Metric", ""),
    "joint": ("Joint", ""),
    "paper_row": ("", ""),
    **_metric_columns("mae"),
    **_metric_columns("rmse"),
    "max_deg": ("Max (deg)", "z.3f"),
    "torque_rms_Nm": ("Torque RMS (N m)", "z.3f"),
    "torque_peak_Nm": ("peak", "z.3f"),
    "torque_step_rms_Nm": ("RMS of step", "z.4f"),
    "torque_at_limit": ("Share at limit", "z.3f"),
    "least_tension_N": ("Least tension (N)", "z.2f"),
    "least_tension_at_s": ("at (s)", ".3f"),
    "slack_s": ("Not pulling (s)", ".3f"),
    "change_percent": ("Change (%)", "z.1f"),
    "change_printed_percent": ("printed", "z.1f"),
    "status": ("Status", ""),
    "errors": ("Error", ""),
    "order": ("Controllers, smallest first", ""),
    "as_published": ("Order 1, 2, 3 of the paper", ""),
    "statuses": ("Status without / with", ""),
    "quantity": ("Quantity", ""),
    "printed_as": ("Printed as", ""),
    "printed": ("Magnitude printed", "z.4f"),
    "ours": ("Ours", "z.4f"),
    "difference": ("Difference of magnitudes", "z.6f"),
}
"""Heading and format of every column, in the order in which tables show them.

``{joints}`` in a heading are the numbers of the joints, as in ``2/3``.
"""


def made_tables(file: TraceFile) -> list[Table]:
    """Make every table that the runs allow; tables without rows and columns without values are left out."""
    origin = f"{file.source}, config {file.config_sha256[:12]}"
    if under := fitted_under(file):
        origin += f", fitted to the print under {under}"
    found = []
    for name, (experiment, make, caption) in _TABLES.items():
        part = file.part(experiment)
        if part.runs and (rows := list(make(part))):
            joints = "/".join(map(str, next(iter(part.runs.values())).joint))
            columns = {
                column: (heading.format(joints=joints), form)
                for column, (heading, form) in COLUMNS.items()
                if any(column in row for row in rows)
            }
            terminal = None if name in _IN_THE_TERMINAL else ()
            found.append(Table(name, f"{caption} ({origin}).", rows, columns, terminal))
    return found


def table_data(file: TraceFile) -> dict[str, Any]:
    """Collect the numbers of an experiment's tables under the keys of ``--json``.

    Returns
    -------
    dict
        Of the comparison: ``table2`` run -> ``mae_deg``, ``rmse_deg``, ``max_deg``, lists in the order of the
        run's joints, over the whole run; ``table3`` ``no_load``, ``with_load`` likewise; ``windows``
        window -> run -> likewise, payload run included; ``printed`` and ``plausible`` with both tables, NaN
        where nothing stands beside a run; ``ranking``; `fitted_under`. Of the decoupling experiment: ``S``
        and ``S_inv``, lists of rows, as far as the plant record has them; ``errors`` ``joint_<number>`` ->
        ``mae_deg``, ``rmse_deg``, ``max_deg``. Of both: ``status`` per run; ``tension`` run ->
        ``least_N``, ``at_s``, ``slack_s`` of each joint's tendon; ``torque`` run -> `torque_sizes`, in N m.
        Runs that are missing leave their keys out.
    """
    motors = list(motor_rows(file))
    both = {
        "status": {name: trace.status for name, trace in file.runs.items()},
        "tension": _pivot((row for row in motors if "slack_s" in row), "run", _TENSIONS),
        "torque": _pivot((row for row in motors if "torque_rms_Nm" in row), "run", _TORQUES),
    }
    if file.experiment == "decouple":
        plant = file.plant.values
        matrices = {name: plant[name].value.tolist() for name in ("S", "S_inv") if name in plant}
        errors = {
            f"joint_{row['joint']}": {name: row[name] for name in _ERRORS} for row in decoupling_rows(file)
        }
        return {**matrices, "errors": errors, **both}
    windows = groupby(window_rows(file, file.runs), key=lambda row: row["window"])
    tables = {"table2": (list(controller_rows(file)), "run"), "table3": (list(load_rows(file)), "load")}
    printed = {f"{metric}_deg": f"{metric}_printed_deg" for metric in METRICS}
    ends = {name: name for metric in METRICS for name in (f"{metric}_low_deg", f"{metric}_high_deg")}
    return {
        **both,
        **{name: _pivot(rows, key, _ERRORS) for name, (rows, key) in tables.items()},
        "windows": {name: _pivot(rows, "run", _ERRORS) for name, rows in windows},
        "printed": {name: _pivot(rows, key, printed) for name, (rows, key) in tables.items()},
        "plausible": {name: _pivot(rows, key, ends) for name, (rows, key) in tables.items()},
        "ranking": ranking(file),
        "fitted_under": fitted_under(file),
    }


_ERRORS = {name: name for name in ("mae_deg", "rmse_deg", "max_deg")}
_TENSIONS = {"least_N": "least_tension_N", "at_s": "least_tension_at_s", "slack_s": "slack_s"}
_TORQUES = {name: f"torque_{name}" for name in ("rms_Nm", "peak_Nm", "step_rms_Nm", "at_limit")}
"""Keys of ``--json`` and the columns they are taken from."""


def _pivot(rows: Iterable[TableRow], key: str, columns: Mapping[str, str]) -> dict[str, dict[str, list[Any]]]:
    """Lists over the joints, by what stands under a key and then by new names of columns."""
    found: dict[str, dict[str, list[Any]]] = {}
    for row in rows:
        held = found.setdefault(row[key], {name: [] for name in columns})
        for name, column in columns.items():
            held[name].append(row.get(column, np.nan))
    return found


def coupling_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``quantity``, ``printed_as``, ``printed``, ``ours``, ``difference`` of Table 1, `S_inv` and `S`.

    The print gives magnitudes, so the difference is one of magnitudes; beside another arm there is none.
    There are no rows unless the plant record holds both diameters and both matrices.
    """
    record = file.plant.values
    if not {"winch_diameter", "pulley_diameter", "S", "S_inv"} <= record.keys():
        return
    winch, pulley = record["winch_diameter"].value, record["pulley_diameter"].value
    ours = {
        f"D_{p + 1}{q + 1}/D_{q + 1}": (f"table1.D_{p + 1}{q + 1}_over_D_{q + 1}", pulley[p, q] / winch[q])
        for q in range(len(winch))
        for p in range(q + 1)
    }
    for matrix in ("S_inv", "S"):
        value = record[matrix].value
        # A record of the moving joints alone holds the trailing block.
        first = len(winch) - len(value) + 1
        for i, j in zip(*np.tril_indices(len(value)), strict=True):
            place = f"{first + i}{first + j}"
            ours[f"{matrix}_{place}"] = f"{matrix}.{place}", value[i, j]
    entries = published().entries if of_paper(file) else {}
    for quantity, (identifier, size) in ours.items():
        row = {"quantity": quantity, "ours": size}
        entry = entries.get(identifier)
        if isinstance(entry, PrintedNumber | PrintedRatio):
            printed = float(entry.value)
            row |= {"printed_as": entry.as_printed, "printed": printed, "difference": abs(size) - printed}
        yield row


def error_rows(file: TraceFile, runs: Mapping[str, Trace]) -> Iterator[TableRow]:
    """Yield the tracking errors of runs by every window of `metrics.windows` and joint, beside the print.

    Columns: ``run``, ``window``, ``joint``, ``status``, ``max_deg``; for ``mae`` and ``rmse``
    ``<metric>_deg`` and, where the print has the run, ``<metric>_printed_deg``, ``<metric>_ratio``, ours over
    printed, and over the whole run the ends of the plausible range. A run that ended before a window has no
    row of it. A diverged run has no errors, and its status says when it diverged.
    """
    for name, trace in runs.items():
        for window, sizes in tracking_errors(trace).items():
            columns = {f"{metric}_deg": values for metric, values in sizes.items()}
            for metric in METRICS:
                identifier = f"{identifier_of(trace)}.{metric}"
                printed = printed_beside(file, trace, identifier)
                if np.isfinite(printed).any():
                    columns[f"{metric}_printed_deg"] = printed
                    columns[f"{metric}_ratio"] = sizes[metric] / printed
                low, high = plausible_beside(file, trace, identifier).T
                if window == "whole" and np.isfinite(low).any():
                    columns |= {f"{metric}_low_deg": low, f"{metric}_high_deg": high}
            for row in _by_joint(trace, columns):
                yield {"run": name, "window": window} | row


def _whole_runs(file: TraceFile, runs: Mapping[str, Trace]) -> Iterator[TableRow]:
    for row in error_rows(file, runs):
        if row.pop("window") == "whole":
            yield row


def controller_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield a row of Table 2 per run and joint, runs with a payload left out, with sizes of the torque."""
    motors = {(row["run"], row["joint"]): row for row in motor_rows(file)}
    for row in _whole_runs(file, compared_runs(file)):
        found = motors.get((row["run"], row["joint"]), {})
        yield row | {name: found[name] for name in _TORQUES.values() if name in found}


def window_rows(file: TraceFile, runs: Mapping[str, Trace] | None = None) -> Iterator[TableRow]:
    """Yield Table 2 over every other window: the paper does not say what it averages over.

    `runs` are those of Table 2 if not given.
    """
    rows = list(error_rows(file, compared_runs(file) if runs is None else runs))
    for window in dict.fromkeys(row["window"] for row in rows if row["window"] != "whole"):
        yield from (row for row in rows if row["window"] == window)


def load_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield a row of Table 3 per load and joint: as `error_rows`, with ``load`` in place of ``run``."""
    for row in _whole_runs(file, loaded_runs(file)):
        yield {"load": row.pop("run")} | row


def paper_controller_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield Table 2 as the paper lays it out: a row per controller, each cell ``joint 2/joint 3``.

    Columns: ``paper_row``, ``status``, and for ``mae`` and ``rmse`` the texts ``<metric>_pair``,
    ``<metric>_printed_pair`` and ``<metric>_plausible_pair``, rounded as printed.
    """
    titles = {name: run_title(trace) for name, trace in file.runs.items()}
    titles[CONTROLLERS[0]] = "Proposed (Controller 1)"
    return _as_printed(controller_rows(file), "run", titles)


def paper_load_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield Table 3 as the paper lays it out; columns as `paper_controller_rows`."""
    titles = {load: load.replace("_", " ").capitalize() for load in LOADS}
    return _as_printed(load_rows(file), "load", titles)


def _as_printed(rows: Iterable[TableRow], key: str, titles: Mapping[str, str]) -> Iterator[TableRow]:
    """Join the cells of a run's joints; a run beside which nothing stands lacks these cells."""
    for name, group in groupby(rows, key=lambda row: row[key]):
        joints = list(group)
        cells: TableRow = {"paper_row": titles.get(name, name), "status": joints[0]["status"]}
        for metric in METRICS:
            for which in ("", "_printed"):
                if f"{metric}{which}_deg" in joints[0]:
                    numbers = [rounded(row[f"{metric}{which}_deg"], "z.3f") for row in joints]
                    cells[f"{metric}{which}_pair"] = "/".join(numbers)
            if f"{metric}_low_deg" in joints[0]:
                ends = [f"{row[f'{metric}_low_deg']:.2g}-{row[f'{metric}_high_deg']:.2g}" for row in joints]
                cells[f"{metric}_plausible_pair"] = "/".join(ends)
        yield cells


def change_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield the change of each error by the payload, in percent, ours and printed (section 5.4).

    Columns: ``metric``, ``joint``, ``change_percent``, ``change_printed_percent``, ``statuses`` without and
    with payload. There are no rows unless both runs are there.
    """
    if not {*LOADS.values()} <= file.runs.keys():
        return
    runs = [file.runs[run] for run in LOADS.values()]
    before, after = (tracking_errors(trace)["whole"] for trace in runs)
    for metric in METRICS:
        old = np.where(before[metric] > 0.0, before[metric], np.nan)
        changes = {"change_percent": 100.0 * (after[metric] - old) / old}
        printed = printed_beside(file, runs[1], f"increase.with_load.{metric}")
        if np.isfinite(printed).any():
            changes["change_printed_percent"] = printed
        for row in _by_joint(runs[1], changes):
            del row["status"]
            yield {"metric": metric.upper(), **row, "statuses": " / ".join(map(_status, runs))}


def decoupling_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``joint``, ``mae_deg``, ``rmse_deg``, ``max_deg``, ``status`` of the run ``decouple``."""
    trace = file.runs.get("decouple")
    if trace is not None and "q_calculated" in trace and "q_encoder" in trace:
        yield from _by_joint(trace, {f"{name}_deg": size for name, size in decoupling_errors(trace).items()})


def ranking_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``errors``, ``order``, ``as_published`` of each joint and metric.

    A run that diverged comes last; where two of them did there is no order to speak of.
    """
    for joint, metrics in ranking(file).items():
        for metric, found in metrics.items():
            row = {
                "errors": f"{metric.upper()}, {joint.replace('_', ' ')}",
                "order": ", ".join(run.removeprefix("controller_") for run in found["order"]),
            }
            lost = [run for run in found["order"] if file.runs[run].status == "diverged"]
            if len(lost) > 1:
                row["as_published"] = f"{len(lost)} diverged"
            elif found["agrees"] is not None:
                row["as_published"] = "holds" if found["agrees"] else "does not hold"
            yield row


def motor_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``run``, ``joint``, ``status``, `torque_sizes` and `tension_sizes` of runs that have any."""
    for name, trace in file.runs.items():
        if sizes := torque_sizes(file, trace) | tension_sizes(file, trace):
            for row in _by_joint(trace, sizes):
                yield {"run": name} | row


def _by_joint(trace: Trace, columns: Sizes) -> Iterator[TableRow]:
    """A row per joint of a run."""
    for place, joint in enumerate(trace.joint):
        numbers = {name: float(values[place]) for name, values in columns.items()}
        yield {"joint": joint, "status": _status(trace)} | numbers


def _status(trace: Trace) -> str:
    if trace.status == "diverged":
        return f"diverged at {trace.attributes['status_time']:.3f} s"
    return trace.status


_PLAUSIBLE = "; plausible: central 90 % of the stable plants"
_MOTORS = "Torque of the motors along the runs, in joint coordinates, and tension of the joints' tendons"

_TABLES: Mapping[str, tuple[str, Callable[[TraceFile], Iterator[TableRow]], str]] = {
    "table1": ("decouple", coupling_rows, "Table 1 and the coupling matrices of section 5.2"),
    "decoupling_errors": (
        "decouple",
        decoupling_rows,
        "Calculated minus measured joint angles, Figs 10 to 12",
    ),
    "decoupling_torque": ("decouple", motor_rows, _MOTORS),
    "table2": ("compare", controller_rows, f"Table 2, tracking errors over the whole run{_PLAUSIBLE}"),
    "table2_paper": ("compare", paper_controller_rows, f"Table 2 as the paper lays it out{_PLAUSIBLE}"),
    "table2_windows": ("compare", window_rows, "Table 2 over other windows"),
    "table3": (
        "compare",
        load_rows,
        f"Table 3, tracking errors of Controller 1 without and with payload{_PLAUSIBLE}",
    ),
    "table3_paper": ("compare", paper_load_rows, f"Table 3 as the paper lays it out{_PLAUSIBLE}"),
    "table3_change": ("compare", change_rows, "Change of the tracking errors with the payload, section 5.4"),
    "ranking": ("compare", ranking_rows, "Controllers by size of error"),
    "torque": ("compare", motor_rows, _MOTORS),
}

_IN_THE_TERMINAL = {"table1", "table2_paper", "table3_paper", "ranking", "torque", "decoupling_errors"}
