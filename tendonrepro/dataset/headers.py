"""Where the numbers of a table begin, and the names above them: words, their groups above, units below."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import zip_longest

import pandas as pd

from tendonrepro.dataset.cells import is_number
from tendonrepro.dataset.words import is_known, is_other_unit, plain_unit

_MOST_UNIT = 6
"""Letters of a unit that is not known."""


def first_numbers(rows: Sequence[Sequence[str]], sample: Sequence[Sequence[str]]) -> int | None:
    """First row with numbers where most of the `sample` has some, and so in the two rows behind it."""
    counts: Counter[int] = Counter()
    filled: Counter[int] = Counter()
    for row in sample:
        filled.update(k for k, cell in enumerate(row) if cell)
        counts.update(k for k, cell in enumerate(row) if is_number(cell))
    numbers = [k for k in sorted(counts) if counts[k] > 0.5 * filled[k] and filled[k] > 0.2 * len(sample)]
    if not numbers:
        return None
    for place, row in enumerate(rows[:-1]):
        if _share(row, numbers) > 0.5 and all(
            _share(after, numbers) > 0.0 for after in rows[place + 1 : place + 3]
        ):
            return place
    return None


def _share(row: Sequence[str], places: Sequence[int]) -> float:
    """Share of numbers in those places that are filled; 0 if the first holds a word, as of a setting."""
    first = row[places[0]] if len(row) > places[0] else "absent"
    filled = [row[k] for k in places if k < len(row) and row[k]]
    if (first and not is_number(first)) or 2 * len(filled) < len(places):
        return 0.0
    return sum(map(is_number, filled)) / len(filled)


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
    """Whether a word may be a unit of no variable, as A, or one that is not known, as inc."""
    return is_other_unit(cell) or (cell.isalpha() and len(cell) <= _MOST_UNIT and not is_known(cell))


def _groups(row: Sequence[str], names: Sequence[str]) -> list[str]:
    """Group of every column: an empty cell belongs to the name before it.

    A title stands alone at the left, numbers are settings, and as many names as columns are a second header.
    """
    filled = [cell for cell in row if cell]
    is_second = len(filled) == len(row) and len(set(row)) == len(row) and any(names)
    if is_second or any(map(is_number, filled)) or not filled or (len(filled) == 1 and row[0]):
        return [""] * len(row)
    return pd.Series(row).replace("", None).ffill().fillna("").tolist()
