"""The mapping file: which column of which file is which variable of which run."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, StrictInt, ValidationError, model_validator

from tendonrepro.config.fields.model import Model, Number, Problems, RunName, SchemaVersion, refuse
from tendonrepro.config.fields.strict_yaml import load, read_text
from tendonrepro.config.messages import explain, nearest, places_in
from tendonrepro.dataset.readers.units import FACTORS, factor, kind_of_variable, plain_unit
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import VARIABLES

HINT = "`tendonrepro inspect PATH --suggest` writes one to begin with."

Seconds: TypeAlias = Annotated[Number, Field(ge=-1e12, le=1e12)]
"""A time on a file's clock, whenever it began to count."""
Text: TypeAlias = Annotated[str, Field(min_length=1, strict=True)]
Positive: TypeAlias = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
ColumnNumber: TypeAlias = Annotated[StrictInt, Field(ge=1, description="column of the signal, from 1")]
Because: TypeAlias = Annotated[Text | None, Field(description="reasons of a guess; delete it once checked")]


def _known_variable(name: str) -> str:
    if name not in VARIABLES:
        meant = nearest(name, VARIABLES)
        hint = f", did you mean {meant!r}?" if meant else ""
        refuse(f"is no variable of a run: {name!r}{hint}; they are {', '.join(VARIABLES)}")
    return name


Unit: TypeAlias = Annotated[Text, AfterValidator(lambda written: plain_unit(written) or written)]
"""A unit in the spelling of `units.FACTORS`, however it is written; one that is not known as it is."""


class Where(Model):
    """Which rows to take: those where a column of the same file has a value."""

    signal: Annotated[Text, Field(description="signal in the file of the column that is cut")]
    column: ColumnNumber = 1
    equals: Annotated[Number, Field(description="the value, as the file has it")]


Rows: TypeAlias = Annotated[
    tuple[Where, ...],
    BeforeValidator(lambda written: [written] if isinstance(written, dict) else written),
    Field(description="rows to take; of several conditions all have to hold"),
]


class TimeAxis(Model):
    """Sampling times: a column of a file, or an even step."""

    file: Annotated[Text | None, Field(description="file, as inspect names it")] = None
    signal: Annotated[Text | None, Field(description="signal in the file")] = None
    column: ColumnNumber = 1
    unit: Annotated[Unit, Field(description="unit of the times")] = "s"
    offset: Annotated[Number, Field(description="taken off, in the file's unit")] = 0.0
    step_s: Annotated[Positive | None, Field(description="s between samples, instead of a column")] = None
    because: Because = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = {key for key in self.model_fields_set if getattr(self, key) is not None} - {"because"}
        with Problems() as problems:
            # Whatever stands beside a step would be ignored without a word.
            if given != {"step_s"} and ("step_s" in given or not {"file", "signal"} <= given):
                problems.add((), "needs either file and signal, or step_s alone")
            if self.unit not in FACTORS["time"]:
                problems.add(("unit",), f"must be one of {', '.join(FACTORS['time'])}, found {self.unit!r}")
        return self


class Entry(Model):
    """One column and what it is: ``value = sign (number - offset)`` in `unit`, times `scale`, then in SI."""

    variable: Annotated[Text, AfterValidator(_known_variable), Field(description="variable of the run")]
    joint: Annotated[StrictInt, Field(ge=1, le=3, description="the paper's number of the joint or motor")]
    file: Annotated[Text, Field(description="file, as inspect names it")]
    signal: Annotated[Text, Field(description="signal in the file, as inspect names it")]
    column: ColumnNumber = 1
    unit: Annotated[Unit, Field(description="unit of the numbers in the file")]
    scale: Annotated[Number, Field(description="factor, such as 0.01 before a 1:100 reducer")] = 1.0
    offset: Annotated[Number, Field(description="taken off first, in the file's unit")] = 0.0
    sign: Annotated[Literal[1, -1], Field(description="-1 where the file counts the other way")] = 1
    where: Rows = ()
    time: Annotated[TimeAxis | None, Field(description="times of this column, where they are its own")] = None
    because: Because = None

    @property
    def kind(self) -> str | None:
        """Kind of quantity, a key of `units.FACTORS`."""
        return kind_of_variable(VARIABLES[self.variable][0])

    @property
    def to_si(self) -> float:
        """Factor from the file's numbers to SI, sign included."""
        return self.sign * self.scale * (factor(self.unit, self.kind) if self.kind else 1.0)

    @model_validator(mode="after")
    def _check_unit(self) -> Self:
        known = FACTORS.get(self.kind or "", {})
        with Problems() as problems:
            if known and self.unit not in known:
                message = f"of {self.variable} must be one of {', '.join(known)}, found {self.unit!r}"
                problems.add(("unit",), message)
            if self.scale == 0.0:
                problems.add(("scale",), "must not be 0")
        return self


class Run(Model):
    """One run: its signals, and what the files do not say."""

    payload_mass_kg: Annotated[Number, Field(ge=0.0, le=1e3, description="mass at the tool, kg")] = 0.0
    period_s: Annotated[Positive | None, Field(description="period of the desired motion, s")] = None
    from_s: Annotated[Seconds | None, Field(description="first time to keep, s, on the file's clock")] = None
    to_s: Annotated[Seconds | None, Field(description="last time to keep")] = None
    where: Rows = ()
    time: Annotated[TimeAxis | None, Field(description="times of all signals without their own")] = None
    signals: Annotated[tuple[Entry, ...], Field(min_length=1, description="the columns")]

    @model_validator(mode="after")
    def _check(self) -> Self:
        places: dict[tuple[str, int], int] = {}
        with Problems() as problems:
            for number, entry in enumerate(self.signals):
                before = places.setdefault((entry.variable, entry.joint), number)
                if before != number:
                    message = (
                        f"is a second {entry.variable} of joint {entry.joint}, after number {before + 1}"
                    )
                    problems.add(("signals", number), message)
            if self.from_s is not None and self.to_s is not None and self.to_s <= self.from_s:
                problems.add(("to_s",), "must be later than from_s")
        return self


class Resample(Model):
    """A common time base for every run."""

    step_s: Annotated[Positive, Field(description="s between samples, on straight lines between the file's")]


class Mapping(Model):
    """A whole mapping file."""

    schema_version: SchemaVersion
    title: Annotated[Text, Field(description="one line for a reader")]
    resample: Annotated[Resample | None, Field(description="absent: samples stay as they are")] = None
    runs: Annotated[dict[RunName, Run], Field(min_length=1, description="run name -> run")]

    def guesses(self) -> Iterator[str]:
        """Every choice that was guessed and not confirmed, with its reasons."""
        for name, run in self.runs.items():
            named: list[tuple[str, Entry | TimeAxis | None]] = [(f"{name}: time", run.time)]
            for entry in run.signals:
                place = f"{name}: {entry.variable} of joint {entry.joint}"
                named += [(place, entry), (f"{place}: time", entry.time)]
            yield from (f"{place}: {item.because}" for place, item in named if item and item.because)

    def files(self) -> set[str]:
        """Names of all files it needs."""
        entries = [entry for run in self.runs.values() for entry in run.signals]
        times = [run.time for run in self.runs.values()] + [entry.time for entry in entries]
        return {entry.file for entry in entries} | {time.file for time in times if time and time.file}


@dataclass(frozen=True)
class LoadedMapping:
    """A mapping, its text as it is, and the digest of its content whatever its layout and comments."""

    mapping: Mapping
    text: str
    sha256: str


def load_mapping(path: Path) -> LoadedMapping:
    """Read and check a mapping file; every mistake is on a line of its own, as ``file:line: key: what``."""
    return _loaded(read_text(path, hint=HINT), path)


def confirmed(loaded: LoadedMapping, path: Path) -> LoadedMapping:
    """The mapping of a file without its lines `because`, as when a person had deleted them."""
    return _loaded(re.sub("(?m)^ +because:.*\n?", "", loaded.text), path)


def _loaded(text: str, path: Path) -> LoadedMapping:
    document = load(text, str(path))
    if not isinstance(document.tree, dict):
        message = "a mapping file is a mapping of keys, beginning with 'schema_version: 1'"
        raise ConfigError(message, where=document.where(()), hint=HINT)
    if document.tree.get("runs", {}) is None:
        message = "runs: no run yet; copy entries from the comments below into a run"
        hint = "Begin it with its name, such as `controller_1:`, then `signals:` and the entries."
        raise ConfigError(message, where=document.where(("runs",)), hint=hint)

    try:
        mapping = Mapping.model_validate(document.tree)
    except ValidationError as error:
        raise explain(error, Mapping, document.tree, places_in(document)) from None
    canonical = json.dumps(mapping.model_dump(mode="json"), sort_keys=True)
    return LoadedMapping(mapping, text, hashlib.sha256(canonical.encode()).hexdigest())
