"""A desired motion as samples in a CSV file."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import ConfigError

FEWEST = 6
"""Fewest rows: a quintic spline with its ends at rest passes through them."""


def read_samples(path: Path) -> tuple[Array, dict[int, Array]]:
    """Read columns ``time_s`` and ``q<joint>_deg``.

    Returns
    -------
    time : array (N,)
        s.
    angles : dict of array (N,)
        By the paper's joint number, rad.
    """
    try:
        header, *rest = path.read_text(encoding="utf-8-sig").splitlines() or [""]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read the trajectory: {error}", where=str(path)) from None
    names = [name.strip() for name in header.split(",")]
    joints = [int(name[1]) for name in names if re.fullmatch("q[1-9]_deg", name)]
    if not joints or names != ["time_s", *(f"q{joint}_deg" for joint in dict.fromkeys(joints))]:
        message = f"the first line must be time_s,q2_deg,q3_deg or the like, found {header[:80]!r}"
        raise ConfigError(message, where=f"{path}:1")
    lines = [line for line, text in enumerate(rest, 2) if text.partition("#")[0].strip()]
    if len(lines) < FEWEST:
        raise ConfigError(f"needs at least {FEWEST} rows of numbers, found {len(lines)}", where=str(path))
    try:
        table = np.loadtxt(rest, delimiter=",", ndmin=2)
        time, *angles = table.T
        if len(angles) != len(joints):
            raise ValueError(f"{table.shape[1]} in each row")
        found = {joint: np.deg2rad(angle) for joint, angle in zip(joints, angles, strict=True)}
    except ValueError as error:
        message = f"rows must hold {len(names)} numbers with commas between: {error}"
        raise ConfigError(message, where=str(path)) from None
    wrong = ~np.isfinite(table).all(axis=1) | (np.diff(time, prepend=-np.inf) <= 0.0)
    if wrong.any():
        message = "numbers must be finite, and time must increase from row to row"
        raise ConfigError(message, where=f"{path}:{lines[np.argmax(wrong)]}")
    return time, found
