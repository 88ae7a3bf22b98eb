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

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import unloaded_run
from tendonrepro.configuration.models.manipulator import MOST_JOINTS
from tendonrepro.configuration.published import published
from tendonrepro.configuration.strict_model import Model, explain, refuse
from tendonrepro.configuration.strict_yaml import Parsed, entry, load, paths, place
from tendonrepro.console import count_of
from tendonrepro.dataset.tables import Column
from tendonrepro.dataset.words import FACTORS
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import VARIABLES

CHECK = "# CHECK:"
"""What stands before a guess that needs a look."""
VARIABLE, JOINT, UNIT = "VARIABLE", "JOINT", "UNIT"
"""What stands in a suggested line where a person has to fill something in."""
SCHEMA_VERSION = 2
LOOP_STEPS = 5e-5, 0.1
"""Sampling steps of a control loop, s; beyond them the unit of the times is in doubt."""

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_USE = re.compile(
    rf"(?P<variable>\w+)(?: (?P<joint>\d))?(?: (?P<unit>[^\s*+\-0-9][^*+\-]*?))?"
    rf"(?: \* (?P<factor>{_NUMBER}))?(?: (?P<offset>[-+] {_NUMBER}))?"
)


@dataclass(frozen=True)
class Use:
    """What a column is: variable of a trace or ``time``, joint or 0, unit, factor, offset."""

    variable: str
    joint: int
    unit: str
    factor: float = 1.0
    offset: float = 0.0

    @property
    def signal(self) -> tuple[str, int]:
        """Variable and joint."""
        return self.variable, self.joint

    @property
    def to_si(self) -> float:
        """SI value of one of its unit."""
        return FACTORS.get(kind_of(self.variable) or "", {}).get(self.unit, 1.0)

    def in_si(self, recorded: Column) -> Array:
        """Values of what was recorded; ConfigError of words."""
        if recorded.dtype.kind != "f":
            raise ConfigError(f"the column of {self} holds words: see what inspect says of it")
        return np.array((self.factor * recorded + self.offset) * self.to_si, np.float64)

    def __str__(self) -> str:
        """As the mapping writes it."""
        joint = "" if self.variable == "time" else f" {self.joint or JOINT}"
        return f"{self.variable}{joint} {self.unit}".rstrip()


def kind_of(variable: str) -> str | None:
    """Key of `FACTORS`, or None where numbers are kept as they are."""
    if variable == "time":
        return "time"
    return {"rad": "angle", "rad s-1": "rate", "N m": "torque"}.get(VARIABLES[variable][0])


def _use(text: object) -> Use:
    match = _USE.fullmatch(text.strip()) if isinstance(text, str) else None
    if match is None:
        refuse(f"{text!r} is not of the form 'variable joint unit', as in 'q_d 2 deg'")
    variable, unit, joint = match["variable"], (match["unit"] or "").strip(), int(match["joint"] or 0)
    if variable != "time" and variable not in VARIABLES:
        refuse(f"there is no variable {variable!r}, only time, {', '.join(VARIABLES)}")
    units = FACTORS.get(kind_of(variable) or "")
    if units and unit not in units:
        refuse(f"the unit of {variable} is one of {', '.join(units)}, found {unit!r}")
    if variable != "time" and not 1 <= joint <= MOST_JOINTS:
        refuse(f"{variable} needs the number of its joint, 1 to {MOST_JOINTS}, found {joint}")
    offset = float((match["offset"] or "0").replace(" ", ""))
    return Use(variable, joint, unit, float(match["factor"] or 1.0), offset)


_Uses: TypeAlias = dict[str, Annotated[Use, BeforeValidator(_use)]]
_Number: TypeAlias = Annotated[float, Field(strict=True)]
_Size: TypeAlias = Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)]
"""A number that has no sign."""
_Step: TypeAlias = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]


def _reading_error(given: object) -> object:
    angles = [variable for variable in VARIABLES if kind_of(variable) == "angle"]
    for name, degrees in given.items() if isinstance(given, dict) else [(angles[0], given)]:
        if name not in angles:
            refuse(f"there is no angle {name!r}, only {', '.join(angles)}")
        if isinstance(degrees, bool) or not isinstance(degrees, int | float) or not 0.0 <= degrees < math.inf:
            refuse(f"must be a number of degrees, 0 or more, found {degrees!r}")
    return given


_ReadingError: TypeAlias = Annotated[float | dict[str, float], BeforeValidator(_reading_error)]


class RunMapping(Model):
    """Tables of a run; a variable is taken from the first that has it.

    `columns`, if any, replace the shared ones; ``source:column`` names one of several. Rows to take have the
    values of `where`. Where the time of a table starts again, `part` counts the stretches from 1. What lies
    from `from_s` to `to_s` is kept, in the file's time. `step_s` makes times from the numbers of the samples.
    `reading_error_deg` says that the angles were read off a figure, and how well, by variable or for all.
    """

    sources: Annotated[list[str], Field(min_length=1)]
    columns: _Uses | None = None
    where: dict[str, object] = Field(default_factory=dict)
    payload_mass_kg: _Size | None = None
    period_s: _Size | None = None
    from_s: _Number = -float("inf")
    to_s: _Number = float("inf")
    step_s: _Step | None = None
    part: Annotated[int, Field(ge=1)] | None = None
    reading_error_deg: _ReadingError | None = None

    @model_validator(mode="before")
    @classmethod
    def _in_short(cls, entry: object) -> object:
        run = entry if isinstance(entry, dict) else {"sources": entry}
        source = run.get("sources")
        return run | {"sources": [source]} if isinstance(source, str) else run

    def reading_error(self, variable: str) -> float:
        """Error of a variable read off a figure, rad; 0 where it was recorded."""
        stated = self.reading_error_deg
        degrees = stated.get(variable, 0.0) if isinstance(stated, dict) else stated
        return math.radians(degrees or 0.0)


class _Tree(Model):
    schema_version: int = SCHEMA_VERSION
    title: str = "Measured data"
    columns: _Uses = Field(default_factory=dict)
    runs: Annotated[dict[Annotated[str, Field(pattern=r"^\w+$")], RunMapping], Field(min_length=1)]


@dataclass(frozen=True)
class MappingFile:
    """A checked mapping, with its guesses and where each run stands."""

    title: str
    runs: Mapping[str, RunMapping]
    guesses: list[str]
    places: Mapping[str, str]


def parse_mapping(text: str, name: str) -> MappingFile:
    """Check a mapping, called `name`; a run ``..._payload`` that names no mass has the paper's.

    Raises
    ------
    ConfigError
        With the line of every mistake.
    """
    document = load(text, name)
    _refuse_to_fill(document, name)
    try:
        tree = _Tree.model_validate(document)
    except ValidationError as error:
        raise explain(error, document, name) from None
    runs = {}
    for run, given in tree.runs.items():
        columns = tree.columns if given.columns is None else given.columns
        mass = given.payload_mass_kg
        if mass is None:
            mass = published().number("hardware.payload") if unloaded_run(run) else 0.0
        runs[run] = given.model_copy(update={"columns": columns, "payload_mass_kg": mass})
    guesses = [line.strip() for line in text.splitlines() if CHECK in line]
    places = {run: str(place(document, ("runs", run), name)) for run in runs}
    return MappingFile(tree.title, runs, guesses, places)


def _refuse_to_fill(document: Parsed, name: str) -> None:
    """Refuse a mapping with lines to fill in by one sentence, with up to three of them."""
    uses = {path: entry(document, path) for path in paths(document) if "columns" in path[:-1]}
    capitals = {VARIABLE, JOINT, UNIT}
    blanks = [path for path, use in uses.items() if isinstance(use, str) and capitals & {*use.split()}]
    if blanks:
        names = ", ".join(json.dumps(path[-1], ensure_ascii=False) for path in blanks[:3])
        raise ConfigError(
            f"{count_of(len(blanks), 'line')} to fill in: the names of the columns do not say enough",
            where=str(place(document, blanks[0], name)),
            hint=f"say what each of these is, as in 'q_d 2 deg', or delete its line: {names}",
        )


def confirmed(text: str) -> str:
    """Text without the marks behind guesses.

    >>> confirmed("a: time s  # CHECK: the unit")
    'a: time s'
    """
    return re.sub(rf"[ \t]*{CHECK}.*", "", text)
