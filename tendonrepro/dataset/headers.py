"""Where the numbers of a table begin, and the names above them: words, their groups above, units below."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import zip_longest

import pandas as pd

from tendonrepro.dataset.cells import is_number
from tendonrepro.dataset.words import is_known, is_other_unit, meaning_of, plain_unit, variable_of

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
    width = max(map(len, sample))
    shares = [_share(row, numbers, width) for row in rows]
    for place in range(len(rows) - 1):
        if shares[place] > 0.5 and all(share > 0.0 for share in shares[place + 1 : place + 3]):
            return _with_words(rows, place, numbers[0])
    return None


def _with_words(rows: Sequence[Sequence[str]], first: int, leading: int) -> int:
    """First row, if those directly above begin like one, as with a time, but have words."""
    width = len(rows[first])
    has_header = any(len(row) == width and not any(map(is_number, row)) for row in rows[: first - 1])
    while has_header and len(rows[first - 1]) == width and is_number(rows[first - 1][leading]):
        first -= 1
    return first


def _share(row: Sequence[str], places: Sequence[int], width: int) -> float:
    """Share of numbers in those places that are filled; 0 if the first holds a word, as of a setting.

    A row of fewer than `width` cells has to fill half of the places.
    """
    first = row[places[0]] if len(row) > places[0] else "absent"
    filled = [row[k] for k in places if k < len(row) and row[k]]
    is_short = len(row) < width and 2 * len(filled) < len(places)
    if (first and not is_number(first)) or is_short or not filled:
        return 0.0
    return sum(map(is_number, filled)) / len(filled)


def names_of(head: Sequence[Sequence[str]], width: int) -> list[str]:
    """Last row of words, with a group above and a unit below; else rows that are called names and units."""
    rows = [list(row) for row in head]
    labelled = {row[0].casefold().strip(" :"): row for row in rows if row and len(row) == width}
    if {"name", "unit"} <= labelled.keys():
        # A scope's export: what a row is stands in it above the times.
        names, units = labelled["name"], labelled["unit"]
        rows = [
            ["time" if cell == names[0] else cell for cell in names],
            ["" if cell == units[0] else cell for cell in units],
        ]
    units = rows.pop() if rows and _are_units(rows[-1], rows[-2] if len(rows) > 1 else []) else []
    names = rows.pop() if rows else []
    if rows and _is_header(rows[-1]) and _told_by(rows[-1]) > _told_by(names):
        # Below a header a row of words holds commands, or values of another kind.
        names = rows.pop()
    groups = _groups(rows[-1], names) if rows and len(rows[-1]) == width else []
    if len(names) > 1 and names == ["X", "Y"] * (len(names) // 2) and any(groups):
        # WebPlotDigitizer's table of all curves: each under its name, over time.
        return [curve if name == "Y" else "time (s)" for curve, name in zip(groups, names, strict=True)]
    blank = [""] * width
    cells = zip_longest(groups or blank, names[:width], units[:width], fillvalue="")
    return [
        _name(place, f"{group} {name}".strip(), _bare(unit))
        for place, (group, name, unit) in enumerate(cells, start=1)
    ]


def _name(place: int, name: str, unit: str) -> str:
    if not name and plain_unit(unit) in ("s", "ms", "us", "ns"):
        name = "time"
    return (name or f"column {place}") + (f" ({unit})" if unit else "")


def _is_header(row: Sequence[str]) -> bool:
    """Whether every column has a name of its own."""
    return all(row) and len(set(row)) == len(row)


def _told_by(names: Sequence[str]) -> int:
    """How much names tell of columns: variables, joints, units."""
    meanings = [meaning_of(name) for name in names if name]
    return sum(
        (variable_of(said.says) is not None) + (said.joint is not None) + (said.unit is not None)
        for said in meanings
    )


def _bare(unit: str) -> str:
    """A unit without brackets, or what they explain."""
    bare = unit.strip("()[] ")
    short = re.sub(r"\s*\(.*", "", bare)
    return short if plain_unit(bare) is None and plain_unit(short) else bare


def angle_unit_of(lines: Iterable[str]) -> str:
    """Unit of angles by a setting above a table, as OpenSim writes it, or an empty text."""
    told = (re.match(r"\W*in_?degrees\W+(yes|no|true|false)\b", line, re.IGNORECASE) for line in lines)
    answers = [match[1].casefold() for match in told if match]
    return ("deg" if answers[-1] in ("yes", "true") else "rad") if answers else ""


def _are_units(row: Sequence[str], above: Sequence[str]) -> bool:
    """Whether a row has units: known ones alone, or with others under as many names."""
    cells = [_bare(cell) for cell in row if cell.strip("()[]- ")]
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
    is_second = _is_header(row) and any(names)
    if is_second or any(map(is_number, filled)) or not filled or (len(filled) == 1 and row[0]):
        return [""] * len(row)
    return pd.Series(row).replace("", None).ffill().fillna("").tolist()
