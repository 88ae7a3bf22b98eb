"""The mapping file: which column is which variable, and which table is which run.

Each column name stands once::

    columns:
      time (ms): time ms
      q2 desired: q_d 2 deg
      e2: e 2 deg * -1
      m1: q_motor_encoder 1 deg * 0.01 - 3.5
    runs:
      controller_1: "runs.xlsx:C1"
      controller_2: {sources: [c2_desired.csv, c2_encoder.csv], payload_mass_kg: 0.2}

A value is factor times number plus offset, in the unit of the file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from tendonrepro.configuration.fields.strict_yaml import Document, load, read_text
from tendonrepro.dataset.words import FACTORS
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import VARIABLES

CHECK = "# CHECK:"
"""What stands before a guess that needs a look."""
SCHEMA_VERSION = 2

_KEYS = {"schema_version", "title", "columns", "runs", "resample_s"}
_RUN_KEYS = {"sources", "columns", "where", "payload_mass_kg", "period_s", "from_s", "to_s", "step_s"}
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_USE = re.compile(
    rf"(?P<variable>\w+)(?: (?P<joint>\d))?(?: (?P<unit>[^\s*+\-0-9][^*+\-]*?))?"
    rf"(?: \* (?P<factor>{_NUMBER}))?(?: (?P<sign>[-+]) (?P<offset>{_NUMBER}))?"
)


@dataclass(frozen=True)
class Use:
    """What a column is: variable of a trace or ``time``, joint, unit, factor and offset."""

    variable: str
    joint: int
    unit: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def to_si(self) -> float:
        """SI value of one of its unit."""
        return FACTORS.get(kind_of(self.variable) or "", {}).get(self.unit, 1.0)

    def __str__(self) -> str:
        """As the mapping writes it."""
        joint = "" if self.variable == "time" else f" {self.joint}"
        return f"{self.variable}{joint} {self.unit}".rstrip()


@dataclass(frozen=True)
class Run:
    """Tables of a run and what to do with them.

    Attributes
    ----------
    sources : tuple of str
        Names of tables; a column is taken from the first that has it.
    columns : mapping
        Of this run alone, instead of those that all runs share. ``source:column`` names one of several.
    where : mapping
        Column -> value that the rows to take have there.
    payload_mass : float
        kg.
    period, first, last, step : float or None
        Period of the motion; part to keep, in the file's own time; step where there are no times, s.
    place : str
        Of the run in the mapping, for messages.
    """

    sources: tuple[str, ...]
    columns: Mapping[str, Use]
    where: Mapping[str, Any]
    payload_mass: float
    period: float | None
    first: float | None
    last: float | None
    step: float | None
    place: str


@dataclass(frozen=True)
class MappingFile:
    """A checked mapping, its text, and the guesses in it that nobody has confirmed."""

    title: str
    runs: Mapping[str, Run]
    resample: float | None
    text: str
    guesses: list[str] = field(default_factory=list)


def kind_of(variable: str) -> str | None:
    """Kind of quantity of a variable: a key of `FACTORS`, or None where numbers are taken as they are."""
    if variable == "time":
        return "time"
    unit = VARIABLES[variable][0]
    return {"rad": "angle", "rad s-1": "rate", "N m": "torque"}.get(unit)


def read_mapping(path: Path, payload: float) -> MappingFile:
    """Read and check a mapping.

    Parameters
    ----------
    path : Path
    payload : float
        Mass of a run called ``..._payload`` that names none, kg.

    Raises
    ------
    ConfigError
        With the line of the first mistake.
    """
    hint = "tendonrepro inspect FILES --suggest writes one"
    return parse_mapping(read_text(path, hint), str(path), payload)


def parse_mapping(text: str, name: str, payload: float) -> MappingFile:
    """Check the text of a mapping; see `read_mapping`."""
    document = load(text, name)
    tree = _dict(document, document.tree, ())
    _known(document, tree, _KEYS, ())
    shared = _uses(document, tree.get("columns", {}), ("columns",))
    runs = {
        run: _run(document, run, entry, shared, payload)
        for run, entry in _dict(document, tree.get("runs"), ("runs",)).items()
    }
    guesses = [
        line.strip() for line in text.splitlines() if CHECK in line and not line.lstrip().startswith("#")
    ]
    resample = _number(document, tree, "resample_s", ())
    return MappingFile(str(tree.get("title", "Measured data")), runs, resample, text, guesses)


def confirmed(text: str) -> str:
    """Text without the marks behind guesses.

    >>> confirmed("a: time s  # CHECK: the unit")
    'a: time s'
    """
    return re.sub(rf"[ \t]*{CHECK}.*", "", text)


def _run(document: Document, name: str, entry: Any, shared: Mapping[str, Use], payload: float) -> Run:
    place: tuple[str, ...] = ("runs", name)
    if not re.fullmatch(r"\w+", name):
        _refuse(document, place, f"{name!r} is no name of a run: letters, digits and _")
    held = {"sources": entry} if isinstance(entry, str | list) else _dict(document, entry, place)
    _known(document, held, _RUN_KEYS, place)
    sources = held.get("sources")
    names = [sources] if isinstance(sources, str) else sources
    if not isinstance(names, list) or not names or not all(isinstance(one, str) for one in names):
        _refuse(document, place, "needs the name of a table, or a list of several")
    mass = _number(document, held, "payload_mass_kg", place)
    return Run(
        sources=tuple(names),
        columns=_uses(document, held["columns"], (*place, "columns")) if "columns" in held else shared,
        where=_dict(document, held.get("where", {}), (*place, "where")),
        payload_mass=(payload if name.endswith("_payload") else 0.0) if mass is None else mass,
        period=_number(document, held, "period_s", place),
        first=_number(document, held, "from_s", place),
        last=_number(document, held, "to_s", place),
        step=_number(document, held, "step_s", place),
        place=document.where(place),
    )


def _uses(document: Document, tree: Any, place: tuple[str, ...]) -> dict[str, Use]:
    return {
        column: _use(document, text, (*place, column))
        for column, text in _dict(document, tree, place).items()
    }


def _use(document: Document, text: Any, place: tuple[str, ...]) -> Use:
    """Read what a column is."""
    found = _USE.fullmatch(text.strip()) if isinstance(text, str) else None
    if found is None:
        _refuse(document, place, f"{text!r} is not of the form 'variable joint unit', as in 'q_d 2 deg'")
    variable, unit = found["variable"], (found["unit"] or "").strip()
    if variable != "time" and variable not in VARIABLES:
        _refuse(document, place, f"there is no variable {variable!r}", f"time, {', '.join(VARIABLES)}")
    units = FACTORS.get(kind_of(variable) or "")
    if units and unit not in units:
        _refuse(document, place, f"the unit of {variable} is one of {', '.join(units)}, found {unit!r}")
    joint = int(found["joint"] or 0)
    if variable != "time" and joint not in (1, 2, 3):
        _refuse(document, place, f"{variable} needs the number of its joint, 1 to 3, found {joint}")
    offset = float(f"{found['sign']}{found['offset']}") if found["offset"] else 0.0
    return Use(variable, joint, unit, float(found["factor"] or 1.0), offset)


def _number(document: Document, tree: Mapping[str, Any], key: str, place: tuple[str, ...]) -> float | None:
    value = tree.get(key)
    if value is not None and (not isinstance(value, int | float) or isinstance(value, bool)):
        _refuse(document, (*place, key), f"must be a number, found {value!r}")
    return None if value is None else float(value)


def _dict(document: Document, value: Any, place: tuple[str, ...]) -> dict[str, Any]:
    if not isinstance(value, dict):
        _refuse(document, place, "must be keys with values")
    return value


def _known(document: Document, tree: Mapping[str, Any], keys: set[str], place: tuple[str, ...]) -> None:
    for key in tree:
        if key not in keys:
            _refuse(document, (*place, key), f"unknown key {key!r}", f"keys: {', '.join(sorted(keys))}")


def _refuse(document: Document, place: tuple[str, ...], message: str, hint: str | None = None) -> NoReturn:
    raise ConfigError(message, where=document.where(place), hint=hint)
