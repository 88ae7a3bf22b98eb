"""Tables 1 to 3 and their companions; published values stand beside the paper's own experiment alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import Any, TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.published import PrintedNumber, PrintedRatio, published
from tendonrepro.results.paper import of_paper, printed_beside
from tendonrepro.results.plausible import plausible_beside
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
from tendonrepro.results.tables import NOTHING, Table, TableColumns, rounded

TableRow: TypeAlias = dict[str, Any]
"""A table row by column name; a column without a value may be left out."""

COLUMNS: TableColumns = {
    "window": ("Window", ""),
    "run": ("Run", ""),
    "load": ("Load", ""),
    "metric": ("Metric", ""),
    "joint": ("Joint", ""),
    "paper_row": ("", ""),
    "mae_pair": ("MAE (deg), joint {joints}", ""),
    "mae_printed_pair": ("printed", ""),
    "mae_plausible_pair": ("plausible", ""),
    "rmse_pair": ("RMSE (deg), joint {joints}", ""),
    "rmse_printed_pair": ("printed", ""),
    "rmse_plausible_pair": ("plausible", ""),
    # "z" keeps a rounded zero from having a sign; as many digits as the paper.
    "mae_deg": ("MAE (deg)", "z.3f"),
    "mae_printed_deg": ("printed", "z.3f"),
    "mae_ratio": ("ours/printed", "z.3f"),
    "mae_low_deg": ("plausible from", ".2g"),
    "mae_high_deg": ("to", ".2g"),
    "rmse_deg": ("RMSE (deg)", "z.3f"),
    "rmse_printed_deg": ("printed", "z.3f"),
    "rmse_ratio": ("ours/printed", "z.3f"),
    "rmse_low_deg": ("plausible from", ".2g"),
    "rmse_high_deg": ("to", ".2g"),
    "max_deg": ("Max (deg)", "z.3f"),
    "torque_rms_Nm": ("Torque RMS (N m)", "z.3f"),
    "torque_peak_Nm": ("peak", "z.3f"),
    "torque_step_rms_Nm": ("RMS of step", "z.4f"),
    "torque_at_limit": ("Share at limit", "z.3f"),
    "change_percent": ("Change (%)", "z.1f"),
    "change_printed_percent": ("printed", "z.1f"),
    "status": ("Status", ""),
    "errors": ("Error", ""),
    "order": ("Controllers, smallest first", ""),
    "as_published": ("Order 1, 2, 3 of the paper", ""),
    "tendon": ("Tendon", ""),
    "least_tension_N": ("Least tension (N)", "z.2f"),
    "least_tension_at_s": ("at (s)", ".3f"),
    "slack_s": ("Not pulling (s)", ".3f"),
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
_BESIDE = {
    name for name in COLUMNS if any(word in name for word in ("printed", "ratio", "plausible", "low", "high"))
} | {"difference", "as_published"}
"""Columns of the print, of its comparison with ours, and of plausible plants."""


def made_tables(file: TraceFile) -> list[Table]:
    """Make every table that the runs allow; tables without rows are left out."""
    origin = f"{file.source}, config {file.config_sha256[:12]}"
    if under := fitted_under(file):
        origin += f", fitted to the print under {under}"
    found = []
    for experiment, tables in _TABLES.items():
        part = file.part(experiment)
        for name, (make, caption) in tables.items() if part.runs else ():
            if rows := list(make(part)):
                joints = "/".join(map(str, next(iter(part.runs.values())).joint))
                columns = {
                    column: (heading.replace("{joints}", joints), form)
                    for column, (heading, form) in COLUMNS.items()
                    if _stands(column, rows)
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
    tension = {"least_N": "least_tension_N", "at_s": "least_tension_at_s", "slack_s": "slack_s"}
    both = {
        "status": {name: trace.status for name, trace in file.runs.items()},
        "tension": _pivot(tension_rows(file), "run", tension),
        "torque": _pivot(torque_rows(file), "run", {name.removeprefix("torque_"): name for name in _TORQUE}),
    }
    if file.experiment == "decouple":
        plant = file.plant.values
        errors = {
            f"joint_{row['joint']}": {name: row[name] for name in _ERRORS} for row in decoupling_rows(file)
        }
        matrices = {name: plant[name].value.tolist() for name in ("S", "S_inv") if name in plant}
        return {**matrices, "errors": errors, **both}
    windows: dict[str, list[TableRow]] = {}
    for row in window_rows(file, file.runs):
        windows.setdefault(str(row["window"]), []).append(row)
    windows.pop("whole")
    printed = {"mae_deg": "mae_printed_deg", "rmse_deg": "rmse_printed_deg"}
    return both | {
        "table2": _pivot(controller_rows(file), "run", _ERRORS),
        "table3": _pivot(load_rows(file), "load", _ERRORS),
        "windows": {name: _pivot(rows, "run", _ERRORS) for name, rows in windows.items()},
        "printed": {
            "table2": _pivot(controller_rows(file), "run", printed),
            "table3": _pivot(load_rows(file), "load", printed),
        },
        "plausible": {
            "table2": _pivot(controller_rows(file), "run", _RANGE),
            "table3": _pivot(load_rows(file), "load", _RANGE),
        },
        "ranking": ranking(file),
        "fitted_under": fitted_under(file),
    }


_TORQUE = ("torque_rms_Nm", "torque_peak_Nm", "torque_step_rms_Nm", "torque_at_limit")
_ERRORS = {name: name for name in ("mae_deg", "rmse_deg", "max_deg")}
_RANGE = {name: name for name in ("mae_low_deg", "mae_high_deg", "rmse_low_deg", "rmse_high_deg")}


def _pivot(rows: Iterable[TableRow], key: str, columns: Mapping[str, str]) -> dict[str, dict[str, list[Any]]]:
    """Lists over the joints, by what stands under a key and then by new names of columns."""
    found: dict[str, dict[str, list[Any]]] = {}
    for row in rows:
        held = found.setdefault(str(row[key]), {name: [] for name in columns})
        for name, column in columns.items():
            held[name].append(row.get(column))
    return found


def _stands(name: str, rows: Sequence[TableRow]) -> bool:
    """Whether a column has a place in a table: one of the print needs a value."""
    held = [row[name] for row in rows if name in row]
    return bool(held) and (name not in _BESIDE or any(rounded(value) != NOTHING for value in held))


def coupling_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``quantity``, ``printed_as``, ``printed``, ``ours``, ``difference`` of Table 1, `S_inv` and `S`.

    The print gives magnitudes, so the difference is one of magnitudes; beside another arm there is none.
    There are no rows unless the plant record holds both diameters and both matrices.
    """
    record = file.plant.values
    if not {"winch_diameter", "pulley_diameter", "S", "S_inv"} <= record.keys():
        return
    beside = of_paper(file)
    winch, pulley = record["winch_diameter"].value, record["pulley_diameter"].value
    for q in range(len(winch)):
        for p in range(q + 1):
            name = f"D_{p + 1}{q + 1}/D_{q + 1}"
            identifier = f"table1.{name.replace('/', '_over_')}"
            yield _coupling_row(name, identifier, pulley[p, q] / winch[q], beside=beside)
    for matrix in ("S_inv", "S"):
        value = record[matrix].value
        # A record of the moving joints alone holds the trailing block.
        first = len(winch) - len(value) + 1
        for i, j in zip(*np.tril_indices(len(value)), strict=True):
            place = f"{first + i}{first + j}"
            yield _coupling_row(f"{matrix}_{place}", f"{matrix}.{place}", value[i, j], beside=beside)


def controller_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield a row of Table 2 per run and joint, the payload run left out.

    Columns: ``run``, ``joint``, ``status``, and for ``mae`` and ``rmse`` ``<metric>_deg``,
    ``<metric>_printed_deg`` and ``<metric>_ratio``, ours over printed, and the columns of `torque_rows`. A
    diverged run has no errors, and its status says when it diverged.
    """
    for name, trace in compared_runs(file).items():
        for row in _error_rows(file, trace, tracking_errors(trace)["whole"], f"table2.{name}"):
            yield {"run": name} | row | _torque(file, trace, row["joint"])


def window_rows(file: TraceFile, runs: Mapping[str, Trace] | None = None) -> Iterator[TableRow]:
    """Yield Table 2 over every window of `metrics.windows`: the paper does not say what it averages over.

    A run that ended before a window has no row of it. `runs` are those of Table 2 if not given.
    """
    runs = compared_runs(file) if runs is None else runs
    errors = {name: tracking_errors(trace) for name, trace in runs.items()}
    for window in dict.fromkeys(chain.from_iterable(errors.values())):
        for name, sizes in errors.items():
            if window in sizes:
                for row in _error_rows(file, runs[name], sizes[window], f"table2.{name}"):
                    # The range of plausible plants is that of the whole run.
                    kept = {
                        key: value
                        for key, value in row.items()
                        if not key.endswith(("_low_deg", "_high_deg"))
                    }
                    yield {"window": window, "run": name} | kept


def load_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield a row of Table 3 per load and joint: as `controller_rows`, with ``load`` in place of ``run``."""
    for load, trace in loaded_runs(file).items():
        for row in _error_rows(file, trace, tracking_errors(trace)["whole"], f"table3.{load}"):
            yield {"load": load} | row


def paper_controller_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield Table 2 as the paper lays it out: a row per controller, each cell ``joint 2/joint 3``.

    Columns: ``paper_row``, ``status``, and for ``mae`` and ``rmse`` the texts ``<metric>_pair`` and
    ``<metric>_printed_pair``, rounded as printed.
    """
    for name, trace in compared_runs(file).items():
        title = "Proposed (Controller 1)" if name == CONTROLLERS[0] else run_title(trace)
        yield {"paper_row": title} | _pairs(file, trace, f"table2.{name}")


def paper_load_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield Table 3 as the paper lays it out; columns as `paper_controller_rows`."""
    for load, trace in loaded_runs(file).items():
        title = load if load not in LOADS else load.replace("_", " ").capitalize()
        yield {"paper_row": title} | _pairs(file, trace, f"table3.{load}")


def change_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield the change of each error by the payload, in percent, ours and printed (section 5.4).

    Columns: ``metric``, ``joint``, ``change_percent``, ``change_printed_percent``, ``statuses`` without and
    with payload. There are no rows unless both runs are there.
    """
    if not {*LOADS.values()} <= file.runs.keys():
        return
    without, loaded = (file.runs[run] for run in LOADS.values())
    before, after = (tracking_errors(trace)["whole"] for trace in (without, loaded))
    for metric in ("mae", "rmse"):
        printed = printed_beside(file, loaded, f"increase.with_load.{metric}")
        for index, joint in enumerate(loaded.joint):
            old, new = before[metric][index], after[metric][index]
            yield {
                "metric": metric.upper(),
                "joint": joint,
                "change_percent": 100.0 * (new - old) / old if old > 0.0 else np.nan,
                "change_printed_percent": printed[index],
                "statuses": f"{_status(without)} / {_status(loaded)}",
            }


def decoupling_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``joint``, ``mae_deg``, ``rmse_deg``, ``max_deg``, ``status`` of the run ``decouple``."""
    trace = file.runs.get("decouple")
    if trace is None or "q_calculated" not in trace or "q_encoder" not in trace:
        return
    sizes = decoupling_errors(trace)
    for index, joint in enumerate(trace.joint):
        errors = {f"{name}_deg": float(values[index]) for name, values in sizes.items()}
        yield {"joint": joint, "status": _status(trace)} | errors


def ranking_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``errors``, ``order``, ``as_published`` of each joint and metric.

    A run that diverged comes last; where two of them did there is no order to speak of.
    """
    for joint, metrics in ranking(file).items():
        for metric, found in metrics.items():
            lost = [run for run in found["order"] if file.runs[run].status == "diverged"]
            words = {True: "holds", False: "does not hold", None: None}[found["agrees"]]
            yield {
                "errors": f"{metric.upper()}, {joint.replace('_', ' ')}",
                "order": ", ".join(run.removeprefix("controller_") for run in found["order"]),
                "as_published": f"{len(lost)} diverged" if len(lost) > 1 else words,
            }


def tension_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``run``, ``tendon``, ``least_tension_N``, ``least_tension_at_s``, ``slack_s``, ``status``.

    There are no rows of a run whose transmitted torque is not known.
    """
    for name, trace in file.runs.items():
        sizes = tension_sizes(file, trace)
        for index, tendon in enumerate(trace.joint if sizes else ()):
            yield {
                "run": name,
                "tendon": tendon,
                "least_tension_N": float(sizes["least"][index]),
                "least_tension_at_s": float(sizes["at"][index]),
                "slack_s": float(sizes["slack"][index]),
                "status": _status(trace),
            }


def torque_rows(file: TraceFile) -> Iterator[TableRow]:
    """Yield ``run``, ``joint``, the columns of `_TORQUE` as far as they are known, and ``status``."""
    for name, trace in file.runs.items():
        for joint in trace.joint if "tau_m" in trace else ():
            yield {"run": name, "joint": joint, "status": _status(trace)} | _torque(file, trace, joint)


def _torque(file: TraceFile, trace: Trace, joint: int) -> TableRow:
    """Torque of one joint by column."""
    place = trace.joint.index(joint)
    sizes = torque_sizes(file, trace)
    return {column: float(values[place]) for column, values in zip(_TORQUE, sizes.values(), strict=False)}


def _coupling_row(quantity: str, identifier: str, ours: float, *, beside: bool) -> TableRow:
    found = published().entries.get(identifier) if beside else None
    entry = found if isinstance(found, PrintedNumber | PrintedRatio) else None
    printed = float(entry.value) if entry else float("nan")
    return {
        "quantity": quantity,
        "printed_as": entry.as_printed if entry else None,
        "printed": printed,
        "ours": ours,
        "difference": abs(ours) - printed,
    }


def _error_rows(file: TraceFile, trace: Trace, sizes: Sizes, identifier: str) -> Iterator[TableRow]:
    columns: dict[str, Array] = {}
    for metric in ("mae", "rmse"):
        printed = np.array(printed_beside(file, trace, f"{identifier}.{metric}"))
        columns[f"{metric}_deg"] = sizes[metric]
        columns[f"{metric}_printed_deg"] = printed
        columns[f"{metric}_ratio"] = sizes[metric] / printed
        ranges = [
            ends or (np.nan, np.nan) for ends in plausible_beside(file, trace, f"{identifier}.{metric}")
        ]
        columns[f"{metric}_low_deg"], columns[f"{metric}_high_deg"] = np.array(ranges).T
    columns["max_deg"] = sizes["max"]
    for index, joint in enumerate(trace.joint):
        numbers = {name: float(values[index]) for name, values in columns.items()}
        yield {"joint": joint, "status": _status(trace)} | numbers


def _pairs(file: TraceFile, trace: Trace, identifier: str) -> TableRow:
    """Cells of the paper's layout; a cell of the print is None where nothing stands beside the run."""
    sizes, cells = tracking_errors(trace)["whole"], dict[str, object]()
    for metric in ("mae", "rmse"):
        printed = printed_beside(file, trace, f"{identifier}.{metric}")
        form = COLUMNS[f"{metric}_deg"][1]
        cells[f"{metric}_pair"] = "/".join(rounded(float(size), form) for size in sizes[metric])
        found = None if np.isnan(printed).all() else "/".join(rounded(size, form) for size in printed)
        cells[f"{metric}_printed_pair"] = found
        ranges = plausible_beside(file, trace, f"{identifier}.{metric}")
        if all(ranges):
            ends = ("-".join(f"{end:.2g}" for end in held) for held in ranges if held)
            cells[f"{metric}_plausible_pair"] = "/".join(ends)
    return cells | {"status": _status(trace)}


def _status(trace: Trace) -> str:
    if trace.status == "diverged":
        return f"diverged at {trace.attributes['status_time']:.3f} s"
    return trace.status


_PLAUSIBLE = "; plausible: central 90 % of the stable plants"

_TABLES: Mapping[str, Mapping[str, tuple[Callable[[TraceFile], Iterator[TableRow]], str]]] = {
    "decouple": {
        "table1": (coupling_rows, "Table 1 and the coupling matrices of section 5.2"),
        "decoupling_errors": (decoupling_rows, "Calculated minus measured joint angles, Figs 10 to 12"),
        "decoupling_torque": (torque_rows, "Torque of the motors along the runs, in joint coordinates"),
        "decoupling_tension": (tension_rows, "Tension of the tendons along the runs"),
    },
    "compare": {
        "table2": (controller_rows, f"Table 2, tracking errors over the whole run{_PLAUSIBLE}"),
        "table2_paper": (paper_controller_rows, f"Table 2 as the paper lays it out{_PLAUSIBLE}"),
        "table2_windows": (window_rows, "Table 2 over other windows"),
        "table3": (
            load_rows,
            f"Table 3, tracking errors of Controller 1 without and with payload{_PLAUSIBLE}",
        ),
        "table3_paper": (paper_load_rows, f"Table 3 as the paper lays it out{_PLAUSIBLE}"),
        "table3_change": (change_rows, "Change of the tracking errors with the payload, section 5.4"),
        "ranking": (ranking_rows, "Controllers by size of error"),
        "torque": (torque_rows, "Torque of the motors along the runs, in joint coordinates"),
        "tension": (tension_rows, "Tension of the tendons along the runs"),
    },
}

_IN_THE_TERMINAL = {"table1", "table2_paper", "table3_paper", "ranking", "torque", "decoupling_errors"}
