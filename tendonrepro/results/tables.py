"""Rows of plain values as files: csv with every digit, Markdown and LaTeX rounded for reading."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from tendonrepro.console import without_controls
from tendonrepro.files import write_atomically

TableRows: TypeAlias = Sequence[Mapping[str, object]]
"""Rows by column name; where there is no value a column is left out or None."""

TableColumns: TypeAlias = Mapping[str, tuple[str, str]]
"""Name -> heading, and format of floats."""

NOTHING = "--"
"""Stands where there is no value."""

_ROUNDED = ".4g"
_TEX = str.maketrans(
    {character: f"\\{character}" for character in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {"<": r"\textless{}", ">": r"\textgreater{}"}
)


@dataclass(frozen=True)
class Table:
    """Numbers of a study, from which its files and the terminal follow.

    Attributes
    ----------
    name : str
        Of its files and of its LaTeX label.
    rows : sequence of mapping
        Numbers, texts, booleans, None, and lists of these, by column name.
    columns : mapping, optional
        In order; else all keys of the rows.
    terminal : sequence of str, optional
        Columns shown there, else all; no table if empty.
    folder : str
        Where in a result its files lie.
    printed : Table, optional
        The same laid out for readers: Markdown, LaTeX and the terminal show that.
    """

    name: str
    caption: str
    rows: TableRows
    columns: TableColumns | None = None
    terminal: Sequence[str] | None = None
    suffixes: Sequence[str] = ("csv", "md", "tex")
    folder: str = "tables"
    printed: Table | None = None

    def write(self, folder: Path) -> list[Path]:
        """Write its files into a folder; a TendonreproError where one cannot be written."""
        paths = [folder / f"{self.name}.{suffix}" for suffix in self.suffixes]
        for suffix, path in zip(self.suffixes, paths, strict=True):
            write_atomically(path, getattr(self, suffix)())
        return paths

    def text(self) -> str:
        """Caption and columns for a terminal."""
        heads, cells, numeric = self._shown(self.terminal)
        heads, *cells = [[without_controls(cell) for cell in line] for line in (heads, *cells)]
        widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
        forms = [f"{'>' if number else '<'}{width}" for width, number in zip(widths, numeric, strict=True)]
        lines = ["  ".join(map(format, line, forms)).rstrip() for line in (heads, *cells)]
        return "\n".join([self.caption, *lines])

    def csv(self) -> str:
        """Column names and all digits; nothing where there is no value."""
        names = list(self._columns())
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([_plain(row.get(name)) for name in names] for row in self.rows)
        return text.getvalue()

    def md(self) -> str:
        """Caption and a pipe table, numbers to the right."""
        heads, cells, numeric = self._shown()
        rule = ["---:" if number else ":---" for number in numeric]
        escaped = [[cell.replace("|", r"\|") for cell in line] for line in (heads, *cells)]
        lines = [f"| {' | '.join(line)} |" for line in (escaped[0], rule, *escaped[1:])]
        return "\n".join([self.caption, "", *lines, ""])

    def tex(self) -> str:
        """A ``table`` float labelled ``tab:<name>``; it needs the package booktabs."""
        heads, cells, numeric = self._shown()
        body = [[_tex(cell, number) for cell, number in zip(line, numeric, strict=True)] for line in cells]
        lines = [
            r"\begin{table}",
            r"\centering",
            rf"\caption{{{self.caption.translate(_TEX)}}}",
            rf"\label{{tab:{self.name}}}",
            rf"\begin{{tabular}}{{{''.join('r' if number else 'l' for number in numeric)}}}",
            r"\toprule",
            rf"{' & '.join(head.translate(_TEX) for head in heads)} \\",
            r"\midrule",
            *(rf"{' & '.join(line)} \\" for line in body),
            r"\bottomrule",
            r"\end{tabular}",
            r"\end{table}",
        ]
        return "\n".join([*lines, ""])

    def _columns(self) -> TableColumns:
        if self.columns is not None:
            return self.columns
        return {name: (name.replace("_", " "), _ROUNDED) for row in self.rows for name in row}

    def _shown(self, names: Sequence[str] | None = None) -> tuple[list[str], list[list[str]], list[bool]]:
        """Headings, cells as a reader sees them, and which columns hold numbers alone."""
        if self.printed is not None:
            return self.printed._shown(names)
        columns = self._columns()
        kept = list(columns) if names is None else names
        cells = [[rounded(row.get(name), columns[name][1]) for name in kept] for row in self.rows]
        return [columns[name][0] for name in kept], cells, [_is_numeric(self.rows, name) for name in kept]


def _is_numeric(rows: TableRows, name: str) -> bool:
    """Whether a column holds nothing but numbers."""
    values = [row[name] for row in rows if row.get(name) is not None]
    return bool(values) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in values)


def rounded(value: object, form: str = _ROUNDED) -> str:
    """Text of a value, a float in a format."""
    if isinstance(value, float):
        return format(value, form) if math.isfinite(value) else NOTHING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(rounded(item, form) for item in value) or NOTHING
    return NOTHING if value is None else str(value)


def _tex(cell: str, number: bool) -> str:
    """A cell in LaTeX, where a hyphen is not a minus sign."""
    return cell.replace("-", "$-$") if number and cell != NOTHING else cell.translate(_TEX)


def _plain(value: object) -> object:
    """Value as csv shows it."""
    if isinstance(value, list | tuple):
        return "; ".join(map(str, value))
    return "" if value is None or (isinstance(value, float) and math.isnan(value)) else value
