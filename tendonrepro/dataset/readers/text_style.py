"""How the columns of a text are separated and its decimals marked."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from tendonrepro.dataset.readers.cells import Mark, mark_of, number
from tendonrepro.dataset.readers.stamps import is_stamp

BLANKS = r"\s+"
"""Separator of columns that stand apart by runs of blanks."""
COMMENTS = ("#", "%", "//")
_NAMES = {"\t": "tab", ";": "semicolon", ",": "comma", "|": "pipe", BLANKS: "blanks"}
# Of two styles that fit equally well the earlier is taken.
_STYLES = [*((mark, ".") for mark in _NAMES), *((mark, ",") for mark in _NAMES if mark != ",")]
_SAMPLE = 200
_LONGEST_LINE = 20000
# A line of these alone needs no closer look; splitting every line of a long log takes minutes.
_PLAIN = "0123456789+-.,;|eE \t"
_NO_DIGITS = "+-.,;|eE \t"


@dataclass(frozen=True)
class Style:
    """Separator and decimal mark of a text.

    Parameters
    ----------
    separator : str
        One character, or `BLANKS`.
    decimal : str
        Point or comma.
    doubt : str
        What else it could have been; empty when it is clear.
    """

    separator: str
    decimal: str
    doubt: str = ""

    @property
    def name(self) -> str:
        """For people."""
        comma = ", decimal comma" if self.decimal == "," else ""
        return f"{_NAMES[self.separator]}{comma}"

    def split(self, line: str) -> list[str]:
        """Cells of a line."""
        if self.separator == BLANKS and '"' not in line:
            return line.split()
        if '"' in line:
            return _unquoted(line, " " if self.separator == BLANKS else self.separator)
        return line.split(self.separator)

    def width(self, line: str) -> int:
        """Number of cells of a line."""
        if self.separator == BLANKS or '"' in line:
            return len(self.split(line))
        return line.count(self.separator) + 1

    def mark(self, line: str) -> Mark:
        """What a line is."""
        bare = line.strip()
        if not bare:
            return Mark.BLANK
        if bare.startswith(COMMENTS):
            return Mark.COMMENT
        if not bare.strip(_PLAIN):
            return Mark.NUMBERS if bare.strip(_NO_DIGITS) else _of_marks(bare)
        return mark_of(self.split(bare), self.decimal)


def _of_marks(bare: str) -> Mark:
    """Of a line without letters or digits: separators alone are an empty row, dashes a ruled line."""
    return Mark.WORDS if bare.strip(",;| \t") else Mark.BLANK


def _unquoted(line: str, separator: str) -> list[str]:
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return line.split(separator)
    return [cell for cell in cells if cell] if separator == " " else cells


def style_of(lines: Sequence[str]) -> Style:
    """Style under which most cells of a text are numbers.

    Parameters
    ----------
    lines : sequence of str
        The whole text.

    Returns
    -------
    Style
    """
    sample = _sample(lines)
    scored = {pair: _score(Style(*pair), sample) for pair in _STYLES}
    best = max(scored, key=lambda pair: scored[pair])
    style = Style(*best)
    if best == (",", ".") and _halves_of_decimals(sample, style):
        return Style(BLANKS, ",")
    if style.decimal == "," and _could_be_thousands(sample, style):
        return Style(*best, doubt="commas taken as decimal marks, though they could separate thousands")
    return style


def _sample(lines: Sequence[str]) -> list[str]:
    """The first lines with content, and as many spread over the rest."""
    step = max(1, len(lines) // _SAMPLE)
    candidates = [*lines[: 2 * _SAMPLE], *lines[2 * _SAMPLE :: step]]
    return [
        line[:_LONGEST_LINE] for line in candidates if line.strip() and not line.lstrip().startswith(COMMENTS)
    ]


def _score(style: Style, sample: Sequence[str]) -> float:
    """Numbers gained less cells spoilt, and the more the more rows are equally wide."""
    total, widths = 0.0, Counter[int]()
    for line in sample:
        cells = [cell for cell in style.split(line) if cell.strip()]
        read = sum(_is_read(cell, style.decimal) for cell in cells)
        if read:
            widths[style.width(line.strip())] += 1
            total += 2 * read - len(cells)
    return total * max(widths.values()) / widths.total() if widths else 0.0


def _is_read(cell: str, decimal: str) -> bool:
    # A mark between thousands is sure only in a number that also has a decimal mark.
    grouped = "," in cell and "." in cell
    return number(cell, decimal, grouped=grouped) is not None or is_stamp(cell)


def _halves_of_decimals(sample: Sequence[str], style: Style) -> bool:
    """Whether two columns of whole numbers are one column with decimal commas.

    It is when the heading is one name, or the second halves begin with a zero, as in ``1,05``.
    """
    rows = [style.split(line) for line in sample]
    numbers = [cells for cells in rows if mark_of(cells) is Mark.NUMBERS]
    halves = all(len(cells) == 2 and all(_whole(cell) for cell in cells) for cells in numbers)
    if not halves:
        return False
    words = [cells for cells in rows if mark_of(cells) is Mark.WORDS]
    one_name = bool(words) and all(len(cells) == 1 for cells in words)
    return one_name or any(
        cells[1].strip().startswith("0") and len(cells[1].strip()) > 1 for cells in numbers
    )


def _whole(cell: str) -> bool:
    return cell.strip().lstrip("+-").isdecimal()


def _could_be_thousands(sample: Sequence[str], style: Style) -> bool:
    cells = [cell.strip() for line in sample for cell in style.split(line) if "," in cell]
    parts = [cell.lstrip("+-").partition(",") for cell in cells if number(cell, ",") is not None]
    return bool(parts) and all(len(tail) == 3 and not head.startswith("0") for head, _, tail in parts)
