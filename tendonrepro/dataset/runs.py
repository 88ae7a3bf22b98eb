"""From tables and a mapping to runs in SI units on one time base."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.dataset.arrays import Source
from tendonrepro.dataset.mapping import LOOP_STEPS, MappingFile, Run, Use
from tendonrepro.errors import ConfigError, DataMissingError
from tendonrepro.physics.metrics import status_of
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import MEASURED

_ANGLES = "q_d", "q_encoder", "q_calculated"
_FAR = 0.1
"""Mean difference of two of these, over the range, beyond which they are in doubt."""
_MOST_TURN_DEG = 190.0
_HELD = float(np.deg2rad(0.03))
"""Range of a desired angle, rad, below which a joint is held: the dither of its encoder is no ringing."""
_SEVERITY = ("ok", "ringing", "diverged")


@dataclass
class Assembly:
    """Runs in the making, with `notes` of what was done to numbers, and `doubts`.

    `unread` is file -> why; `S` is the coupling matrix, (3, 3).
    """

    sources: Sequence[Source]
    unread: Mapping[str, str]
    mapping: MappingFile
    S: Array
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def runs(self) -> dict[str, Trace]:
        """All runs of the mapping.

        Raises
        ------
        ConfigError
            Where the mapping does not fit the tables.
        DataMissingError
            If a file of it was not read.
        """
        found = {}
        for name, run in self.mapping.runs.items():
            try:
                found[name] = self._run(name, run)
            except ConfigError as error:
                raise ConfigError(error.message, where=self.mapping.places[name], hint=error.hint) from None
        return found

    def _run(self, name: str, run: Run) -> Trace:
        time, found = self._signals(name, run)
        joints = tuple(sorted({use.joint for use in found}))
        variables: dict[str, Array] = {}
        for use, values in found.items():
            block = variables.setdefault(use.variable, np.full((len(time), len(joints)), np.nan))
            block[:, joints.index(use.joint)] = values
        if time[0] != 0.0:
            self.notes.append(f"{name}: time starts at {time[0]:.6g} s in the files, at 0 here")
            time = time - time[0]
        if len(variables.keys() & {"q_d", "q_encoder", "e"}) > 1:
            _complete(variables)
        if "q_motor_encoder" in variables and "q_calculated" not in variables and joints[-2:] == (2, 3):
            places = np.array(joints) - 1
            variables["q_calculated"] = variables["q_motor_encoder"] @ self.S[np.ix_(places, places)].T
            self.notes.append(f"{name}: q_calculated is S q_motor_encoder")
        attributes: dict[str, Any] = {"law": MEASURED, "gains": {}, "readings": {}}
        attributes |= {"payload_mass": run.payload_mass_kg, "reference_period": run.period_s or 0.0}
        attributes |= _status(time, variables, joints)
        trace = Trace(name, time, joints, variables, attributes)
        self.doubts += [f"{name}: {doubt}" for doubt in doubts_about(trace)]
        return trace

    def _signals(self, name: str, run: Run) -> tuple[Array, dict[Use, Array]]:
        """Common times, s, and values of all columns of a run, SI."""
        series: dict[Use, tuple[Array, Array]] = {}
        for table in run.sources:
            source = self._source(table)
            taken = {use.signal for use in series}
            uses = {column: use for column, use in _uses(source, run).items() if use.signal not in taken}
            if all(use.variable == "time" for use in uses.values()):
                continue
            rows = _rows(source, run)
            time = _times(rows, uses, source, run)
            kept = np.isfinite(time)
            for column, use in uses.items():
                if use.variable != "time":
                    series[use] = time[kept], _in_si(rows[column], use)[kept]
        if not series:
            raise ConfigError("none of its tables has a column that the mapping knows")
        return self._common(name, series)

    def _source(self, name: str) -> Source:
        """Find a table by its name, or the only one that ends with it."""
        exact = [source for source in self.sources if source.name == name]
        found = exact or [source for source in self.sources if source.name.endswith(f"/{name}")]
        if len(found) != 1:
            message = f"there is no table {name!r}" if not found else f"{name!r} could be several tables"
            for file, reason in self.unread.items():
                if f"/{file}".endswith(f"/{name.partition(':')[0]}"):
                    raise DataMissingError(f"was not read: {reason}", where=file)
            raise ConfigError(message, hint=f"tables: {', '.join(one.name for one in self.sources)}")
        return found[0]

    def _common(self, name: str, series: dict[Use, tuple[Array, Array]]) -> tuple[Array, dict[Use, Array]]:
        """All on the first table's times, as far as others go."""
        times = [time for time, _ in series.values()]
        first = times[0]
        time = first[(first >= max(one[0] for one in times)) & (first <= min(one[-1] for one in times))]
        if len(time) < 2:
            hint = "two clocks? 'time us - OFFSET' moves one of them"
            raise ConfigError("its tables have no time in common", hint=hint)
        if not all(np.array_equal(one, first) for one in times):
            self.notes.append(f"{name}: tables with other times were interpolated to those of the first")
        return time, {use: np.interp(time, *one) for use, one in series.items()}


def _complete(variables: dict[str, Array]) -> None:
    """Find the third of desired angle, measured angle and error; the difference counts."""
    absent = np.full_like(next(iter(variables.values())), np.nan)
    q_d, q, e = (variables.get(key, absent) for key in ("q_d", "q_encoder", "e"))
    # A joint is filled whole or not at all: gaps stay gaps.
    filled = np.where(np.isnan(q_d).all(axis=0), q + e, q_d)
    q = np.where(np.isnan(q).all(axis=0), q_d - e, q)
    variables |= {"q_d": filled, "q_encoder": q, "e": filled - q}


def _status(time: Array, variables: dict[str, Array], joints: tuple[int, ...]) -> dict[str, Any]:
    """Worst of the joints, by the limits of the shipped comparison."""
    limits = load_config(None, "compare").config.status
    ringing = limits.ringing_frequency.si, limits.ringing_share.si
    found: dict[int, tuple[str, float]] = {}
    for k, joint in enumerate(joints if "e" in variables else ()):
        e = variables["e"][:, k]
        known = np.isfinite(e)
        if known.any() and np.ptp(variables.get("q_d", variables["e"])[known, k]) > _HELD:
            bridged = np.interp(time, time[known], e[known])[:, np.newaxis]
            found[joint] = status_of(time, bridged, limits.divergence_limit.si, *ringing)
    worst = max((status for status, _ in found.values()), key=_SEVERITY.index, default="ok")
    of = [joint for joint, (status, _) in found.items() if status == worst]
    end = min((found[joint][1] for joint in of), default=float(time[-1]))
    judged = {"status": worst, "status_time": end}
    return judged if worst == "ok" else judged | {"status_joints": of}


def _uses(source: Source, run: Run) -> dict[str, Use]:
    found = {}
    for name, use in (run.columns or {}).items():
        table, _, column = name.rpartition(":") if name not in source.columns else ("", "", name)
        if column in source.columns and table in ("", source.name, source.last):
            found[column] = use
    return found


def _rows(source: Source, run: Run) -> pd.DataFrame:
    table = pd.DataFrame(source.columns)
    if absent := run.where.keys() - set(table):
        raise ConfigError(f"{source.name} has no column {absent.pop()!r}")
    return table[(table[list(run.where)] == pd.Series(run.where, dtype=object)).all(axis=1)]


def _times(rows: pd.DataFrame, uses: dict[str, Use], source: Source, run: Run) -> Array:
    """Times of rows, s, NaN beyond the part to keep."""
    column = next((column for column, use in uses.items() if use.variable == "time"), None)
    if column is None and run.step_s is None:
        hint = "give its column of times the line 'NAME: time s', or the run 'step_s: 0.001'"
        raise ConfigError(f"{source.name} has no times", hint=hint)
    time = (run.step_s or 0.0) * np.arange(float(len(rows)))
    if column is not None:
        time = _in_si(rows[column], uses[column])
    time[(time < run.from_s) | (time > run.to_s)] = np.nan
    kept = time[np.isfinite(time)]
    if len(kept) < 2:
        raise ConfigError(f"{source.name} has fewer than two samples that the run takes")
    if not (np.diff(kept) > 0.0).all():
        last = kept[np.argmin(np.diff(kept) > 0.0)]
        message = f"the time of {source.name} does not increase after {last:.6g} s"
        raise ConfigError(message, hint="several runs below each other? `where` takes the rows of one")
    return time


def _in_si(values: pd.Series, use: Use) -> Array:
    if values.dtype.kind != "f":
        raise ConfigError(f"the column of {use} holds words")
    return np.array((use.factor * values + use.offset) * use.to_si, np.float64)


def doubts_about(trace: Trace) -> Iterator[str]:
    """What makes a run implausible."""
    step = float(np.median(np.diff(trace.time)))
    if not LOOP_STEPS[0] <= step <= LOOP_STEPS[1]:
        yield f"it has a sample every {step:.4g} s: check the unit of the time"
    held = {name: values for name, values in trace.variables.items() if name in _ANGLES}
    for name, values in held.items():
        turn = np.rad2deg(np.nanmax(np.abs(values), initial=0.0))
        if turn > _MOST_TURN_DEG:
            yield f"{name} reaches {turn:.4g} deg, and no joint turns by more than half a turn"
    for first, other in combinations(held, 2):
        apart = np.abs(held[first] - held[other])
        for joint, size, angle in zip(trace.joint, apart.T, held[other].T, strict=True):
            known = np.isfinite(size)
            if known.any() and size[known].mean() > _FAR * max(np.ptp(angle[known]), 1e-3):
                yield f"{first} and {other} of joint {joint} differ by a tenth of its motion: check both"
