"""Tables 1 to 3 and their companions; the print stands beside the paper's own experiment alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from typing import TypeAlias

import numpy as np

from tendonrepro.configuration.models.control import FIRST
from tendonrepro.configuration.published import METRICS, PrintedNumber, PrintedRatio, published
from tendonrepro.files import read_json, shipped
from tendonrepro.physics.metrics import START
from tendonrepro.results import summary
from tendonrepro.results.paper import changed_readings, fitted_under, of_paper
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import ERRORS, Sizes
from tendonrepro.results.tables import Table, TableColumns, rounded

TableRow: TypeAlias = dict[str, object]
"""A table row by column name; a column without a value may be left out."""


def _metric_columns(metric: str) -> TableColumns:
    head = f"{metric.upper()} (deg)"
    return {
        f"{metric}_pair": (f"{head}, joint {{joints}}", ""),
        f"{metric}_whole_pair": (f"{head}, joint {{joints}}", ""),
        f"{metric}_settled_pair": ("from {seconds:g} s on", ""),
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
    "run": ("Run", ""),
    "load": ("Load", ""),
    "joint": ("Joint", ""),
    "paper_row": ("", ""),
    **_metric_columns("mae"),
    **_metric_columns("rmse"),
    "max_deg": ("Max (deg)", "z.3f"),
    "rms_Nm": ("Torque RMS (N m)", "z.3f"),
    "peak_Nm": ("peak", "z.3f"),
    "step_rms_Nm": ("RMS of step", "z.4f"),
    "at_limit": ("Share at limit", "z.3f"),
    "least_N": ("Least tension (N)", "z.2f"),
    "at_s": ("at (s)", ".3f"),
    "slack_s": ("Not pulling (s)", ".3f"),
    "status": ("Status", ""),
    "quantity": ("Quantity", ""),
    "printed_as": ("Printed as", ""),
    "printed": ("Magnitude printed", "z.4f"),
    "ours": ("Ours", "z.4f"),
    "difference": ("Difference of magnitudes", "z.6f"),
}
"""Heading and format of every column, in the order of tables; ``{joints}`` stands for ``2/3``, ``{seconds}``
for the start that is left out."""

_PLAUSIBLE = "; plausible: central 90 % of the stable plants"
_OF_MOTORS = "; errors of the motors, at whose encoders the law looks, in joint coordinates"
_MOTORS = "Torque of the motors along the runs, in joint coordinates, and tension of the joints' tendons"


def made_tables(file: TraceFile) -> list[Table]:
    """Tables that the runs allow; those without rows and columns without values are left out."""
    origin = f"{file.source}, config {file.config_sha256[:12]}"
    if under := fitted_under(file):
        origin += f", fitted to the print under {under}"
    tables = [*_of_decoupling(file.part("decouple")), *_of_comparison(file.part("compare"))]
    return [replace(table, caption=f"{table.caption} ({origin}).") for table in tables if table.rows]


def _of_decoupling(file: TraceFile) -> Iterator[Table]:
    if not file.runs:
        return
    coupling = "Ratios of diameters, and the coupling matrices"
    differences = "Calculated minus measured joint angles"
    if of_paper(file):
        coupling = "Table 1 and the coupling matrices of section 5.2"
        differences += ", Figs 10 to 12"
    yield _table(file, "table1", coupling, coupling_rows(file))
    yield _table(file, "decoupling_errors", differences, decoupling_rows(file))
    yield replace(_table(file, "decoupling_torque", _MOTORS, motor_rows(file)), terminal=())


def _of_comparison(file: TraceFile) -> Iterator[Table]:
    if not file.runs:
        return
    over = f"from {left_out(file):g} s on" if left_out(file) else "over the whole run"
    compared, loaded = summary.compared_runs(file), summary.loaded_runs(file)
    titles = {name: summary.run_title(run) for name, run in compared.items()}
    titles |= {load: load.replace("_", " ").capitalize() for load in loaded}
    if of_paper(file):
        titles[FIRST] = "Proposed (Controller 1)"
    loads = "tracking errors of Controller 1 without and with payload,"
    for name, key, about, runs in (
        ("table2", "run", "tracking errors", compared),
        ("table3", "load", loads, loaded),
    ):
        rows = [
            {key: run} | row for run, trace in runs.items() for row in _by_joint(trace, error_columns(trace))
        ]
        caption = f"{about} {over}{_of_motors(file)}"
        caption = f"Table {name[-1]}, {caption}" if of_paper(file) else caption[0].upper() + caption[1:]
        caption += _PLAUSIBLE * any("mae_low_deg" in row for row in rows)
        laid_out = [{"paper_row": titles[run]} | _as_printed(file, trace) for run, trace in runs.items()]
        yield replace(_table(file, name, caption, rows), printed=_table(file, name, caption, laid_out))
    about = f"Tracking errors of the whole run, and without its start{_of_motors(file)}"
    yield _table(file, "without_start", about, start_rows(file))
    yield _table(file, "torque", _MOTORS, motor_rows(file))


def _of_motors(file: TraceFile) -> str:
    """What a caption says where the law looks at the motors' encoders."""
    return _OF_MOTORS * any(run.of_motors for run in file.runs.values())


def _table(file: TraceFile, name: str, caption: str, cells: Iterable[TableRow]) -> Table:
    """A table of those `COLUMNS` in which some row has a value, with their headings filled in."""
    rows = list(cells)
    joints = "/".join(map(str, next(iter(file.runs.values())).joint))
    columns = {
        column: (heading.format(joints=joints, seconds=left_out(file) or START), form)
        for column, (heading, form) in COLUMNS.items()
        if any(row.get(column) is not None for row in rows)
    }
    return Table(name, caption, rows, columns)


def table_data(file: TraceFile) -> dict[str, object]:
    """Numbers of an experiment's tables under the keys of ``--json``; lists run over a run's joints.

    ``table2`` and ``table3`` hold `ERRORS` over the run without the first ``errors_from`` seconds,
    ``windows`` over others, `printed` and `plausible` what stands beside them.
    """
    both: dict[str, object] = {"status": {name: trace.status for name, trace in file.runs.items()}}
    for key, size in (("tension", summary.tension_sizes), ("torque", summary.torque_sizes)):
        both[key] = {name: _lists(sizes) for name, trace in file.runs.items() if (sizes := size(file, trace))}
    if file.experiment == "decouple":
        plant = file.plant.values
        matrices = {name: plant[name].value.tolist() for name in ("S", "S_inv") if name in plant}
        errors = {
            f"joint_{row['joint']}": {name: row[name] for name in ERRORS} for row in decoupling_rows(file)
        }
        return {**matrices, "errors": errors, **both}
    tables = {"table2": summary.compared_runs(file), "table3": summary.loaded_runs(file)}

    def of_rows(numbers: Callable[[Trace], Sizes]) -> dict[str, dict[str, object]]:
        return {
            table: {row: _lists(numbers(trace)) for row, trace in runs.items()}
            for table, runs in tables.items()
        }

    windows: dict[str, dict[str, object]] = {}
    for name, trace in file.runs.items():
        for window, sizes in summary.tracking_errors(trace).items():
            windows.setdefault(window, {})[name] = _lists(sizes)
    # Those of the tables stand there.
    windows.pop(summary.without_start_name(left_out(file)), None)
    return {
        **both,
        **of_rows(summary.table_errors),
        "errors_from": left_out(file),
        "windows": windows,
        "printed": of_rows(printed),
        "plausible": of_rows(plausible),
        "ranking": summary.ranking(file),
        "fitted_under": fitted_under(file),
    }


def _lists(sizes: Sizes) -> dict[str, list[float]]:
    return {name: values.tolist() for name, values in sizes.items()}


def left_out(file: TraceFile) -> float:
    """Seconds at the start of the runs that errors in tables leave out."""
    return max((summary.errors_from(trace) for trace in file.runs.values()), default=0.0)


def printed(trace: Trace) -> Sizes:
    """Errors that the paper prints of a run, degrees, (n,) each; NaN where it prints none."""
    row = trace.attributes.get("printed_row", "")
    paper = published()
    return {f"{name}_deg": np.array(paper.per_joint(f"{row}.{name}", trace.joint)) for name in METRICS}


def plausible(trace: Trace) -> Sizes:
    """Ends of the central 90 % of the shipped box's plants that are stable under all controllers, degrees.

    The equations are as printed (docs/verdicts.md). Columns are ``<metric>_low_deg`` and
    ``<metric>_high_deg``, (n,) each; NaN of a run that is read otherwise, starts off its reference, has other
    friction, or leaves out its start.
    """
    has = trace.attributes
    row = has.get("printed_row", "")
    alike = (
        not np.any(has.get("start_offset", 0.0))
        and has.get("friction_scale", 1.0) == 1.0
        and not has.get("errors_from", 0.0)
    )
    ranges = _ranges() if row and alike and not changed_readings(has["readings"]) else {}
    ends: Sizes = {}
    for metric in METRICS:
        names = [f"{row}.{metric}.joint_{joint}" for joint in trace.joint]
        low, high = np.array([ranges.get(name, (np.nan, np.nan)) for name in names]).T
        ends |= {f"{metric}_low_deg": low, f"{metric}_high_deg": high}
    return ends


@cache
def _ranges() -> dict[str, tuple[float, float]]:
    """Ends by the identifiers of the stored verdicts."""
    claims = read_json(shipped("docs") / "results" / "claims.json")["claims"]
    boxes = {claim["id"]: claim["evidence"].get("box", {}) for claim in claims}
    return {name: (box["low"], box["high"]) for name, box in boxes.items() if "low" in box}


def error_columns(trace: Trace) -> Sizes:
    """`ERRORS` of a run, (n,) each, and where known what is `printed` and `plausible`.

    The print is ``<metric>_printed_deg``, ours over it ``<metric>_ratio``.
    """
    columns = {**summary.table_errors(trace)}
    columns |= {name: ends for name, ends in plausible(trace).items() if np.isfinite(ends).any()}
    for name, numbers in printed(trace).items():
        if np.isfinite(numbers).any():
            metric = name.removesuffix("_deg")
            columns |= {f"{metric}_printed_deg": numbers, f"{metric}_ratio": columns[name] / numbers}
    return columns


def start_rows(file: TraceFile) -> Iterator[TableRow]:
    """Errors of each ``run`` as a whole and without its start, each cell ``joint 2/joint 3``."""
    window = summary.without_start_name(left_out(file) or START)
    for trace in file.runs.values():
        sizes = summary.tracking_errors(trace)
        if window in sizes:
            row: TableRow = {"run": summary.run_title(trace), "status": trace.told_status}
            for metric in METRICS:
                for column, name in (("whole", "whole"), ("settled", window)):
                    cell = "/".join(rounded(size, "z.3f") for size in sizes[name][f"{metric}_deg"])
                    row[f"{metric}_{column}_pair"] = cell
            yield row


def coupling_rows(file: TraceFile) -> Iterator[TableRow]:
    """Table 1, `S_inv` and `S`, ours and printed; magnitudes are compared, since signs are not printed."""
    record = file.plant.values
    if not {"winch_diameter", "S", "S_inv"} <= record.keys():
        return
    ratios, elements = {}, {}
    for matrix in ("S_inv", "S"):
        value = record[matrix].value
        # A record of the moving joints alone holds the trailing block.
        first = len(record["winch_diameter"].value) - len(value) + 1
        for i, j in zip(*np.tril_indices(len(value)), strict=True):
            q, p = first + i, first + j
            elements[f"{matrix}_{q}{p}"] = f"{matrix}.{q}{p}", value[i, j]
            if matrix == "S_inv":
                ratios[f"D_{p}{q}/D_{q}"] = f"table1.D_{p}{q}_over_D_{q}", abs(value[i, j])
    entries = published().entries if of_paper(file) else {}
    for quantity, (identifier, size) in (ratios | elements).items():
        row = {"quantity": quantity, "ours": size}
        entry = entries.get(identifier)
        if isinstance(entry, PrintedNumber | PrintedRatio):
            printed = float(entry.value)
            row |= {"printed_as": entry.as_printed, "printed": printed, "difference": abs(size) - printed}
        yield row


def decoupling_rows(file: TraceFile) -> Iterator[TableRow]:
    """``joint``, `ERRORS` and ``status`` of the run ``decouple``."""
    trace = file.runs.get("decouple")
    if trace is not None and "q_calculated" in trace and "q_encoder" in trace:
        yield from _by_joint(trace, summary.decoupling_errors(trace))


def _as_printed(file: TraceFile, trace: Trace) -> TableRow:
    """Errors of a run as the paper prints them, each cell ``joint 2/joint 3``."""
    all_ok = all(run.status == "ok" for run in file.runs.values())
    cells: TableRow = {"status": None if all_ok else trace.told_status}
    columns = _lists(error_columns(trace))
    for metric in METRICS:
        for which in ("", "_printed"):
            if sizes := columns.get(f"{metric}{which}_deg"):
                cells[f"{metric}{which}_pair"] = "/".join(rounded(size, "z.3f") for size in sizes)
        if low := columns.get(f"{metric}_low_deg"):
            ends = zip(low, columns[f"{metric}_high_deg"], strict=True)
            cells[f"{metric}_plausible_pair"] = "/".join(f"{a:.2g}-{b:.2g}" for a, b in ends)
    return cells


def motor_rows(file: TraceFile) -> Iterator[TableRow]:
    """``run``, ``joint``, ``status``, `torque_sizes` and `tension_sizes` of runs that have any."""
    for name, trace in file.runs.items():
        if sizes := summary.torque_sizes(file, trace) | summary.tension_sizes(file, trace):
            for row in _by_joint(trace, sizes):
                yield {"run": name} | row


def _by_joint(trace: Trace, columns: Sizes) -> Iterator[TableRow]:
    """A row per joint of a run."""
    for place, joint in enumerate(trace.joint):
        numbers = {name: float(values[place]) for name, values in columns.items()}
        yield {"joint": joint, "status": trace.told_status} | numbers
