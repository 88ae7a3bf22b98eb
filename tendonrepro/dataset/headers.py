"""Names of columns from the rows above the numbers: words, groups above them, units below."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

import pandas as pd

from tendonrepro.dataset.cells import is_number
from tendonrepro.dataset.words import is_known, plain_unit

_MOST_UNIT = 6
"""Letters of a unit that is not known."""


def names_of(head: Sequence[Sequence[str]], width: int) -> list[str]:
    """Last row of words, with a group above and a unit below."""
    rows = [list(row) for row in head]
    units = rows.pop() if rows and _are_units(rows[-1], rows[-2] if len(rows) > 1 else []) else []
    names = rows.pop() if rows else []
    groups = _groups(rows[-1], names) if rows and len(rows[-1]) == width else []
    if len(names) > 1 and names == ["X", "Y"] * (len(names) // 2) and any(groups):
        # WebPlotDigitizer's table of all curves: each under its name, over time.
        return [curve if name == "Y" else "time (s)" for curve, name in zip(groups, names, strict=True)]
    blank = [""] * width
    cells = zip_longest(groups or blank, names[:width], units[:width], fillvalue="")
    return [
        _name(place, f"{group} {name}".strip(), unit.strip("()[]"))
        for place, (group, name, unit) in enumerate(cells, start=1)
    ]


def _name(place: int, name: str, unit: str) -> str:
    if not name and plain_unit(unit) in ("s", "ms", "us", "ns"):
        name = "time"
    return (name or f"column {place}") + (f" ({unit})" if unit else "")


def _are_units(row: Sequence[str], above: Sequence[str]) -> bool:
    """Whether a row has units: known ones alone, or with others under as many names."""
    cells = [cell.strip("()[] ") for cell in row if cell.strip("()[]- ")]
    known = [cell for cell in cells if plain_unit(cell)]
    if len(known) == len(cells):
        return bool(cells) and not all(cell in "st" for cell in cells)
    others = [cell for cell in cells if not plain_unit(cell)]
    has_names = sum(map(bool, above)) >= len(cells) - 1 > 0
    return bool(known) and has_names and all(map(_is_unknown_unit, others))


def _is_unknown_unit(cell: str) -> bool:
    """Whether a word may be a unit that is not known, as inc or A."""
    return cell.isalpha() and len(cell) <= _MOST_UNIT and not is_known(cell)


def _groups(row: Sequence[str], names: Sequence[str]) -> list[str]:
    """Group of every column: an empty cell belongs to the name before it.

    A title stands alone at the left, numbers are settings, and as many names as columns are a second header.
    """
    filled = [cell for cell in row if cell]
    is_second = len(filled) == len(row) and len(set(row)) == len(row) and any(names)
    if is_second or any(map(is_number, filled)) or not filled or (len(filled) == 1 and row[0]):
        return [""] * len(row)
    return pd.Series(row).replace("", None).ffill().fillna("").tolist()
