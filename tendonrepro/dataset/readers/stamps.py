"""Dates and clock times as seconds since the first of them."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from tendonrepro.arrays import Array

_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2})(?:[.,:](?P<fraction>\d{1,9}))?)?"
_ZONE = r"\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?"
_STAMP = re.compile(
    r"(?:(?P<year>\d{4})[-/.年](?P<month>\d{1,2})[-/.月](?P<day>\d{1,2})日?"
    r"|(?P<first>\d{1,2})[./-](?P<second_part>\d{1,2})[./-](?P<last>\d{4}))?"
    rf"[T\s_]*(?:{_CLOCK})?{_ZONE}"
)
_SHORT = re.compile(r"(?P<minute>\d{1,2}):(?P<second>\d{2})[.,](?P<fraction>\d{1,9})")
_LONGEST = 60
_NANOSECONDS = 10**9
_DAY = 86400 * _NANOSECONDS


def is_stamp(cell: Any) -> bool:
    """Whether a cell is a date or a clock time, as an object or written out."""
    return _nanoseconds(cell) is not None


def seconds(cells: Sequence[Any]) -> tuple[Array, str] | None:
    """Seconds since the first date or clock time.

    Parameters
    ----------
    cells : sequence
        Dates, times, durations or texts; others become NaN.

    Returns
    -------
    values : Array (N,)
        In s. A clock that passes midnight goes on.
    note : str
        Says where the count starts.
    None when fewer than half of the filled cells are times.
    """
    counts = [_nanoseconds(cell) for cell in cells]
    known = [count for count in counts if count is not None]
    filled = sum(cell is not None and str(cell).strip() != "" for cell in cells)
    if not known or 2 * len(known) < filled:
        return None
    first = str(next(cell for cell, count in zip(cells, counts, strict=True) if count is not None)).strip()
    if any(isinstance(cell, datetime.timedelta) for cell in cells):
        return _in_seconds(counts, 0), "durations in seconds"
    return _in_seconds(_past_midnight(counts), known[0]), f"clock times, seconds from the first, {first[:40]}"


def _in_seconds(counts: Sequence[int | None], start: int) -> Array:
    return np.array([np.nan if count is None else (count - start) / _NANOSECONDS for count in counts])


def _past_midnight(counts: Sequence[int | None]) -> list[int | None]:
    """Add a day whenever a clock without a date jumps back by more than half a day."""
    if any(count is not None and not 0 <= count < _DAY for count in counts):
        return list(counts)
    days, before = 0, 0
    followed: list[int | None] = []
    for count in counts:
        if count is not None:
            days += before - count > _DAY // 2
            before = count
        followed.append(None if count is None else count + days * _DAY)
    return followed


def _nanoseconds(cell: Any) -> int | None:
    """Time since year 1, or since midnight for a clock alone; None for what is no time."""
    if isinstance(cell, str):
        candidate = len(cell) <= _LONGEST and any(mark in cell for mark in ":-/.年")
        return _written(cell.strip()) if candidate else None
    if isinstance(cell, datetime.datetime):
        return _of_date(cell.date()) + _of_clock(cell.time())
    if isinstance(cell, datetime.date):
        return _of_date(cell)
    if isinstance(cell, datetime.time):
        return _of_clock(cell)
    if isinstance(cell, datetime.timedelta):
        return (cell.days * 86400 + cell.seconds) * _NANOSECONDS + cell.microseconds * 1000
    return None


def _of_date(date: datetime.date) -> int:
    return date.toordinal() * _DAY


def _of_clock(clock: datetime.time) -> int:
    whole = clock.hour * 3600 + clock.minute * 60 + clock.second
    return whole * _NANOSECONDS + clock.microsecond * 1000


def _written(text: str) -> int | None:
    match = _SHORT.fullmatch(text) or _STAMP.fullmatch(text)
    if match is None:
        return None
    parts = match.groupdict()
    dated = parts.get("year") or parts.get("last")
    if not dated and not parts.get("minute"):
        return None
    try:
        day = _of_date(_date(parts)) if dated else 0
    except ValueError:
        return None
    whole = sum(
        int(parts.get(name) or 0) * length for name, length in (("hour", 3600), ("minute", 60), ("second", 1))
    )
    fraction = (parts.get("fraction") or "").ljust(9, "0")
    return day + whole * _NANOSECONDS + int(fraction) - _offset(parts.get("zone"))


def _date(parts: dict[str, str | None]) -> datetime.date:
    if parts["year"]:
        return datetime.date(int(parts["year"]), int(parts["month"] or 0), int(parts["day"] or 0))
    first, second, year = int(parts["first"] or 0), int(parts["second_part"] or 0), int(parts["last"] or 0)
    # Day first, unless that cannot be: within one day, and a run lasts seconds, either gives the same.
    return datetime.date(year, second, first) if second <= 12 else datetime.date(year, first, second)


def _offset(zone: str | None) -> int:
    if not zone or zone == "Z":
        return 0
    minutes = int(zone[1:3]) * 60 + int(zone[-2:])
    return (minutes if zone[0] == "+" else -minutes) * 60 * _NANOSECONDS
