"""Tables 1 to 3 and their companions as frames and files: ours beside the printed values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from tendonrepro.files import write_atomically
from tendonrepro.results.comparison import (
    Row,
    change_rows,
    controller_rows,
    coupling_rows,
    decoupling_rows,
    load_rows,
)
from tendonrepro.results.records import TraceFile
from tendonrepro.results.summary import compared_runs, tracking_errors
from tendonrepro.results.typeset import NOTHING, Sheet, latex, markdown

# Heading, and digits behind the point, of every column as a reader sees it; csv keeps names and all digits.
_COLUMNS: Mapping[str, tuple[str, int]] = {
    "window": ("Window", 0),
    "run": ("Run", 0),
    "load": ("Load", 0),
    "joint": ("Joint", 0),
    "metric": ("Metric", 0),
    "mae_deg": ("MAE (deg)", 3),
    "mae_printed_deg": ("printed", 3),
    "mae_ratio": ("ours/printed", 3),
    "rmse_deg": ("RMSE (deg)", 3),
    "rmse_printed_deg": ("printed", 3),
    "rmse_ratio": ("ours/printed", 3),
    "max_deg": ("Max (deg)", 3),
    "change_percent": ("Change (%)", 1),
    "change_printed_percent": ("printed", 1),
    "status": ("Status", 0),
    "statuses": ("Status without / with", 0),
    "quantity": ("Quantity", 0),
    "printed_as": ("Printed as", 0),
    "printed": ("Magnitude printed", 4),
    "ours": ("Ours", 4),
    "difference": ("Difference of magnitudes", 6),
}
_ERROR_COLUMNS = (
    *("joint", "mae_deg", "mae_printed_deg", "mae_ratio"),
    *("rmse_deg", "rmse_printed_deg", "rmse_ratio", "status"),
)


def table1(file: TraceFile) -> pd.DataFrame:
    """Table 1 and the coupling matrices of section 5.2; printed are magnitudes, ours have signs.

    Parameters
    ----------
    file : TraceFile
        Its plant record needs ``winch_diameter``, ``pulley_diameter``, ``S`` and ``S_inv``.

    Returns
    -------
    DataFrame
        A row per diameter ratio and per entry of `S_inv` and `S`; empty unless all four are there.
    """
    return _frame(coupling_rows(file), "quantity", "printed_as", "printed", "ours", "difference")


def table2(file: TraceFile) -> pd.DataFrame:
    """Table 2: errors of the controllers over the whole run.

    Parameters
    ----------
    file : TraceFile
        Experiment ``compare``.

    Returns
    -------
    DataFrame
        A row per run and joint, the payload run left out. A diverged run has its errors up to the end, and
        its status says when that was.
    """
    return _frame(controller_rows(file, "whole"), "run", *_ERROR_COLUMNS)


def table2_windows(file: TraceFile) -> pd.DataFrame:
    """Table 2 over every window of `metrics.windows`, since the paper does not say what it averages over.

    Parameters
    ----------
    file : TraceFile
        Experiment ``compare``.

    Returns
    -------
    DataFrame
        Rows as in `table2` for each window; a run that ended before a window has no row there.
    """
    names = dict.fromkeys(name for trace in compared_runs(file).values() for name in tracking_errors(trace))
    rows = (row for name in names for row in controller_rows(file, name))
    return _frame(rows, "window", "run", *_ERROR_COLUMNS)


def table3(file: TraceFile) -> pd.DataFrame:
    """Table 3: errors of Controller 1 without and with the payload, over the whole run.

    Parameters
    ----------
    file : TraceFile
        Experiment ``compare``.

    Returns
    -------
    DataFrame
        A row per load and joint.
    """
    return _frame(load_rows(file), "load", *_ERROR_COLUMNS)


def table3_change(file: TraceFile) -> pd.DataFrame:
    """Percentages by which the payload changes the errors, section 5.4.

    Parameters
    ----------
    file : TraceFile
        Experiment ``compare``.

    Returns
    -------
    DataFrame
        A row per metric and joint; empty unless both runs are there.
    """
    columns = ("metric", "joint", "change_percent", "change_printed_percent", "statuses")
    return _frame(change_rows(file), *columns)


def table_decouple(file: TraceFile) -> pd.DataFrame:
    """Differences between calculated and measured joint angles, Figs 10 to 12.

    Parameters
    ----------
    file : TraceFile
        Experiment ``decouple``.

    Returns
    -------
    DataFrame
        A row per joint; empty without the run ``decouple``.
    """
    return _frame(decoupling_rows(file), "joint", "mae_deg", "rmse_deg", "max_deg", "status")


def write_tables(file: TraceFile, folder: Path) -> list[Path]:
    """Write every table the runs allow.

    Parameters
    ----------
    file : TraceFile
        Either experiment.
    folder : Path
        Where to; made when missing.

    Returns
    -------
    list of Path
        The files written; tables without rows are left out.

    Raises
    ------
    TendonreproError
        When a file cannot be written.
    """
    origin = f"{file.source}, config {file.config_sha256[:12]}"
    paths = []
    for experiment, tables in _TABLES.items():
        part = file.part(experiment)
        for stem, (make, caption) in tables.items() if part.runs else ():
            frame = make(part)
            if len(frame):
                paths += write_table(frame, folder, stem, f"{caption} ({origin}).")
    return paths


def write_table(frame: pd.DataFrame, folder: Path, stem: str, caption: str) -> list[Path]:
    """Write a table as csv (full digits), Markdown and LaTeX with booktabs (rounded for reading).

    Parameters
    ----------
    frame : DataFrame
        As made by this module.
    folder : Path
        Where to; made when missing.
    stem : str
        File name without suffix, and the LaTeX label.
    caption : str
        Plain text.

    Returns
    -------
    list of Path
        The three files.

    Raises
    ------
    TendonreproError
        When a file cannot be written.
    """
    sheet = _sheet(frame, caption)
    texts = {
        "csv": frame.to_csv(index=False, lineterminator="\n"),
        "md": markdown(sheet),
        "tex": latex(sheet, stem),
    }
    paths = [folder / f"{stem}.{suffix}" for suffix in texts]
    for path, text in zip(paths, texts.values(), strict=True):
        write_atomically(path, text)
    return paths


_TABLES: Mapping[str, Mapping[str, tuple[Callable[[TraceFile], pd.DataFrame], str]]] = {
    "decouple": {
        "table1": (table1, "Table 1 and the coupling matrices of section 5.2"),
        "decoupling_errors": (table_decouple, "Calculated minus measured joint angles, Figs 10 to 12"),
    },
    "compare": {
        "table2": (table2, "Table 2, tracking errors over the whole run"),
        "table2_windows": (table2_windows, "Table 2 over other windows"),
        "table3": (table3, "Table 3, tracking errors of Controller 1 without and with payload"),
        "table3_change": (table3_change, "Change of the tracking errors with the payload, section 5.4"),
    },
}


def _frame(rows: Iterable[Row], *columns: str) -> pd.DataFrame:
    return pd.DataFrame(list(rows), columns=list(columns))


def _sheet(frame: pd.DataFrame, caption: str) -> Sheet:
    columns = [_COLUMNS[str(name)] for name in frame.columns]
    rows = frame.itertuples(index=False, name=None)
    return Sheet(
        caption=caption,
        headings=[heading for heading, _ in columns],
        numeric=[pd.api.types.is_numeric_dtype(kind) for kind in frame.dtypes],
        rows=[[_cell(x, digits) for x, (_, digits) in zip(row, columns, strict=True)] for row in rows],
    )


def _cell(value: object, digits: int) -> str:
    if not isinstance(value, float):
        return str(value)
    # "z" keeps a rounded zero from having a sign.
    return f"{value:z.{digits}f}" if np.isfinite(value) else NOTHING
