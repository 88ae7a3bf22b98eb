"""Rows of plain values as files: csv with every digit, Markdown and LaTeX rounded for reading."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from tendonrepro.files import write_atomically

TableRows: TypeAlias = Sequence[Mapping[str, Any]]
"""Rows of a table by column name; a column without a value may be left out of a row, or be None."""

TableColumns: TypeAlias = Mapping[str, tuple[str, str]]
"""Name -> heading for a reader, and format of its floats."""

NOTHING = "--"
"""What a reader finds where there is no value."""

SUFFIXES = ("csv", "md", "tex")

_ROUNDED = ".4g"
_TEX = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


@dataclass(frozen=True)
class Table:
    """Numbers of a study, from which its files and what the terminal shows follow.

    Attributes
    ----------
    name : str
        Of its files; its LaTeX label too.
    caption : str
        What it shows, and of what.
    rows : sequence of mapping
        Numbers, texts, booleans, None, and lists of these, by column name.
    columns : mapping, optional
        Columns in order; every key of any row under its own name if not given.
    terminal : sequence of str, optional
        Columns that the terminal shows: all if not given, nothing of the table if empty.
    suffixes : sequence of str
        Files to write: ``csv``, ``md`` and ``tex``.
    """

    name: str
    caption: str
    rows: TableRows
    columns: TableColumns | None = None
    terminal: Sequence[str] | None = None
    suffixes: Sequence[str] = SUFFIXES

    def write(self, folder: Path) -> list[Path]:
        """Write its files into a folder.

        Raises
        ------
        TendonreproError
            When a file cannot be written.
        """
        write: Mapping[str, Callable[[], str]] = {
            "csv": lambda: csv_text(self.rows, self.columns),
            "md": lambda: markdown(self.rows, self.caption, self.columns),
            "tex": lambda: latex(self.rows, self.caption, self.name, self.columns),
        }
        paths = [folder / f"{self.name}.{suffix}" for suffix in self.suffixes]
        for suffix, path in zip(self.suffixes, paths, strict=True):
            write_atomically(path, write[suffix]())
        return paths

    def text(self) -> str:
        """Caption and columns for a terminal."""
        held = _columns(self.rows, self.columns)
        kept = held if self.terminal is None else {name: held[name] for name in self.terminal}
        heads, cells, numeric = shown(self.rows, kept)
        widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
        lines = [
            "  ".join(
                cell.rjust(width) if number else cell.ljust(width)
                for cell, width, number in zip(line, widths, numeric, strict=True)
            ).rstrip()
            for line in (heads, *cells)
        ]
        return "\n".join([self.caption, *lines])


def write_table(
    rows: TableRows,
    folder: Path,
    stem: str,
    caption: str,
    columns: TableColumns | None = None,
    suffixes: Sequence[str] = ("csv", "md"),
) -> list[Path]:
    """Write a table that no `Outcome` holds; see `Table`."""
    return Table(stem, caption, rows, columns, suffixes=suffixes).write(folder)


def csv_text(rows: TableRows, columns: TableColumns | None = None) -> str:
    """Column names and all digits; nothing where there is no value."""
    names = list(_columns(rows, columns))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([_plain(row.get(name)) for name in names] for row in rows)
    return text.getvalue()


def markdown(rows: TableRows, caption: str, columns: TableColumns | None = None) -> str:
    """Caption and a pipe table, numbers to the right."""
    heads, cells, numeric = shown(rows, columns)
    rule = ["---:" if numbers else ":---" for numbers in numeric]
    escaped = [[cell.replace("|", r"\|") for cell in line] for line in (heads, *cells)]
    lines = [f"| {' | '.join(line)} |" for line in (escaped[0], rule, *escaped[1:])]
    return "\n".join([caption, "", *lines, ""])


def shown(
    rows: TableRows, columns: TableColumns | None = None
) -> tuple[list[str], list[list[str]], list[bool]]:
    """Headings, cells as a reader sees them, and which columns hold numbers alone."""
    held = _columns(rows, columns)
    cells = [[rounded(row.get(name), form) for name, (_, form) in held.items()] for row in rows]
    return [heading for heading, _ in held.values()], cells, [_is_numeric(rows, name) for name in held]


def latex(rows: TableRows, caption: str, label: str, columns: TableColumns | None = None) -> str:
    """Write a ``table`` float that needs the package booktabs; its label is ``tab:<label>``."""
    heads, cells, numeric = shown(rows, columns)
    head = " & ".join(map(_tex, heads))
    body = [
        " & ".join(_tex_number(cell) if n else _tex(cell) for cell, n in zip(line, numeric, strict=True))
        for line in cells
    ]
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{_tex(caption)}}}",
        rf"\label{{tab:{label}}}",
        rf"\begin{{tabular}}{{{''.join('r' if n else 'l' for n in numeric)}}}",
        r"\toprule",
        rf"{head} \\",
        r"\midrule",
        *(rf"{line} \\" for line in body),
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join([*lines, ""])


def _columns(rows: TableRows, columns: TableColumns | None) -> TableColumns:
    if columns is not None:
        return columns
    return {name: (name.replace("_", " "), _ROUNDED) for row in rows for name in row}


def _is_numeric(rows: TableRows, name: str) -> bool:
    """Whether a column holds numbers and nothing else."""
    held = [row[name] for row in rows if row.get(name) is not None]
    return bool(held) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in held)


def rounded(value: Any, form: str = _ROUNDED) -> str:
    """Text of a value for a reader; a float in a format."""
    if isinstance(value, float):
        return format(value, form) if math.isfinite(value) else NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(rounded(item, form) for item in value) or NOTHING
    return NOTHING if value is None else str(value)


def _plain(value: Any) -> Any:
    """Value as csv shows it."""
    if isinstance(value, list | tuple):
        return "; ".join(map(str, value))
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value


def _tex(text: str) -> str:
    return "".join(_TEX.get(character, character) for character in text)


def _tex_number(text: str) -> str:
    # A hyphen is not a minus sign.
    return text if text == NOTHING else text.replace("-", "$-$")
