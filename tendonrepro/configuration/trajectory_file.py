"""Trajectory files: a desired motion as samples in a CSV file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import ConfigError

FEWEST = 6
"""Fewest rows: a quintic spline with its ends at rest passes through them."""

MOST_BYTES = 32 << 20
"""Largest file: a million rows, the longest run, of three columns."""


def read_samples(path: Path) -> tuple[Array, dict[int, Array]]:
    """Read a trajectory file: CSV with the columns ``time_s`` and ``q<joint>_deg``.

    Returns
    -------
    time : array (N,)
        s.
    angles : dict of array (N,)
        Joint angles by the paper's joint number, rad.

    Raises
    ------
    ConfigError
        If the file is missing or too large, has other columns, too few rows, cells that are not finite
        numbers, or a time that does not increase.
    """
    try:
        with path.open("rb") as stream:
            raw = stream.read(MOST_BYTES + 1)
        if len(raw) > MOST_BYTES:
            message = f"is larger than {MOST_BYTES >> 20} MiB, so it holds more than the longest run"
            raise ConfigError(message, where=str(path))
        header, *body = raw.decode("utf-8-sig").splitlines() or [""]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the trajectory: {error}", where=str(path)) from error
    joints = _joints_of(header, f"{path}:1")
    places = [(f"{path}:{line}", text) for line, text in enumerate(body, start=2) if text.strip()]
    if len(places) < FEWEST:
        raise ConfigError(f"needs at least {FEWEST} rows of numbers, found {len(places)}", where=str(path))
    table = np.array([_numbers(text, len(joints) + 1, where) for where, text in places])
    for (where, _), step in zip(places[1:], np.diff(table[:, 0]), strict=True):
        if step <= 0.0:
            raise ConfigError("time must increase from row to row", where=where)
    return table[:, 0], {joint: np.deg2rad(table[:, k]) for k, joint in enumerate(joints, start=1)}


def _joints_of(header: str, where: str) -> list[int]:
    time, *names = (name.strip() for name in header.split(","))
    found = [re.fullmatch(r"q([1-9])_deg", name) for name in names]
    joints = [int(match[1]) for match in found if match]
    if time != "time_s" or not joints or len(joints) < len(names) or len(set(joints)) < len(joints):
        message = f"the first line must be time_s,q2_deg,q3_deg or the like, found {header[:80]!r}"
        raise ConfigError(message, where=where)
    return joints


def _numbers(text: str, count: int, where: str) -> list[float]:
    try:
        numbers = [float(cell) for cell in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        message = f"must hold {count} finite numbers separated by commas, found {text[:80]!r}"
        raise ConfigError(message, where=where)
    return numbers
