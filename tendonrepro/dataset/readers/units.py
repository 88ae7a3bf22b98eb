"""Units as people write them, and what they are in SI."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Mapping

_DEGREE = math.pi / 180.0

FACTORS: Mapping[str, Mapping[str, float]] = {
    "angle": {"rad": 1.0, "deg": _DEGREE, "mrad": 1e-3, "rev": 2.0 * math.pi, "arcmin": _DEGREE / 60.0},
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE, "rpm": 2.0 * math.pi / 60.0},
    "acceleration": {"rad/s^2": 1.0, "deg/s^2": _DEGREE},
    "torque": {"N m": 1.0, "mN m": 1e-3, "N cm": 1e-2, "N mm": 1e-3, "kgf cm": 0.0980665},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "ns": 1e-9},
}
"""Kind of quantity -> unit -> factor to SI."""

_SPELLINGS = {
    "radian": "rad", "radians": "rad", "rads": "rad", "弧度": "rad",
    "degree": "deg", "degrees": "deg", "degs": "deg", "°": "deg", "º": "deg", "度": "deg",
    "turn": "rev", "turns": "rev", "revolution": "rev", "revolutions": "rev",
    "rad/sec": "rad/s", "rads-1": "rad/s", "rads^-1": "rad/s", "rad.s-1": "rad/s", "radpersecond": "rad/s",
    "deg/sec": "deg/s", "°/s": "deg/s", "degs-1": "deg/s", "degs^-1": "deg/s",
    "r/min": "rpm", "rev/min": "rpm",
    "rad/s2": "rad/s^2", "rads-2": "rad/s^2", "rad/sec^2": "rad/s^2", "deg/s2": "deg/s^2", "°/s2": "deg/s^2",
    "°/s^2": "deg/s^2",
    "nm": "N m", "n*m": "N m", "n.m": "N m", "n·m": "N m", "n⋅m": "N m", "newtonmeter": "N m", "牛米": "N m",
    "mnm": "mN m", "mn.m": "mN m", "mn·m": "mN m", "ncm": "N cm", "n.cm": "N cm", "n·cm": "N cm",
    "nmm": "N mm", "n.mm": "N mm", "n·mm": "N mm", "kgcm": "kgf cm", "kgfcm": "kgf cm", "kg.cm": "kgf cm",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "秒": "s",
    "msec": "ms", "msecs": "ms", "millisecond": "ms", "milliseconds": "ms", "millis": "ms", "毫秒": "ms",
    "μs": "us", "µs": "us", "usec": "us", "usecs": "us", "μsec": "us", "µsec": "us", "microsecond": "us",
    "microseconds": "us", "micros": "us", "微秒": "us",
    "nsec": "ns", "nsecs": "ns", "nanosecond": "ns", "nanoseconds": "ns", "nanos": "ns", "纳秒": "ns",
    "minute": "min", "minutes": "min", "分钟": "min",
}  # fmt: skip


def kind_of_variable(units: str) -> str | None:
    """Kind of quantity of a trace variable, from its UDUNITS unit; None for a kind without units here."""
    return {"rad": "angle", "rad s-1": "rate", "rad s-2": "acceleration", "N m": "torque"}.get(units)


def plain_unit(written: str | None) -> str | None:
    """Find the unit of `FACTORS` that someone wrote in a header; None for one that is not known.

    >>> plain_unit("Degrees"), plain_unit("[N·m]"), plain_unit("furlong")
    ('deg', 'N m', None)
    """
    if written is None:
        return None
    text = unicodedata.normalize("NFC", written).strip(" ()[]（）")
    known = {unit for units in FACTORS.values() for unit in units}
    if text in known:
        return text
    squeezed = "".join(text.lower().split())
    by_case = {"".join(unit.lower().split()): unit for unit in known}
    # "nm" and "mnm" are torques here; nobody measures a manipulator in nanometres.
    return _SPELLINGS.get(squeezed) or by_case.get(squeezed)


def factor(unit: str, kind: str) -> float:
    """Factor that turns a number in `unit` into SI; a ValueError when the unit is none of this kind."""
    if unit not in FACTORS[kind]:
        raise ValueError(f"must be one of {', '.join(FACTORS[kind])}, found {unit!r}")
    return FACTORS[kind][unit]
