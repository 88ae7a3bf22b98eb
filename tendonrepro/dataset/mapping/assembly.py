"""From read files and a mapping to runs: SI units, one time base, errors derived."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping.model import Entry, Mapping, Resample, Run, TimeAxis
from tendonrepro.dataset.mapping.recorded_error import complete, listed, opposed
from tendonrepro.dataset.mapping.timebase import (
    RESAMPLED,
    Timed,
    TimeProblem,
    checked,
    even,
    in_seconds,
    shared,
    within,
)
from tendonrepro.dataset.meaning.evidence import distance
from tendonrepro.dataset.meaning.words import printable
from tendonrepro.dataset.readers.signals import Signal, Source
from tendonrepro.dataset.readers.units import factor
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import MEASURED

MOST_TURN_DEG = 190.0
FAR_APART = 0.2
"""Difference of calculated and measured joint angle that no tendon stretches by, as a share of the range."""
SAME_VALUE = 1e-6
"""Relative difference within which a number is the one of a `where`; single precision makes 1e-7 of it."""
LONGEST_STEP = 0.1
"""Sampling step, s, beyond which the unit of the times is in doubt; the paper's is 1 ms."""

StatusOf = Callable[[Array, Array], tuple[str, float]]
"""Time and error without gaps to status and its time."""


@dataclass
class Assembly:
    """Runs in the making.

    Parameters
    ----------
    sources : sequence of Source
    mapping : Mapping
    where : str
        The mapping file, for messages.
    S : Array
        Coupling of all joints, (3, 3).
    status_of : callable

    Attributes
    ----------
    notes : list of str
        What was done to the numbers on the way.
    doubts : list of str
        What makes a recorded error implausible.
    """

    sources: Sequence[Source]
    mapping: Mapping
    where: str
    S: Array
    status_of: StatusOf
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    _taken: set[Source] = field(default_factory=set, init=False, repr=False)
    _pairs: dict[str, dict[int, tuple[Array, Array]]] = field(default_factory=dict, init=False, repr=False)

    def used(self) -> list[Source]:
        """Sources that `runs` has taken anything from, in their order."""
        return [source for source in self.sources if source in self._taken]

    # Numbers near the largest there are mean nothing, but a file may hold them.
    @np.errstate(over="ignore", invalid="ignore")
    def runs(self) -> dict[str, Trace]:
        """All runs of the mapping, in its order.

        Raises
        ------
        ConfigError
            When a file, signal or column is missing, times do not fit, or a run holds no number.
        """
        found = {name: self._run(name, run) for name, run in self.mapping.runs.items()}
        self.doubts += opposed(self._pairs)
        return found

    def _run(self, name: str, run: Run) -> Trace:
        try:
            time, variables, joints = self._variables(name, run)
        except TimeProblem as problem:
            raise ConfigError(str(problem), where=f"{self.where}: runs.{name}", hint=problem.hint) from None
        if time[0] != 0.0:
            start, lasts = in_seconds(time[0]), f"{time[-1] - time[0]:.6g}"
            self.notes.append(f"{name}: time starts at {start} s in the files, at 0 here; it lasts {lasts} s")
            time = time - time[0]
        self._complete(name, variables, joints)
        self._calculate(name, variables, joints)
        self._leave_out(name, variables, joints)
        status, status_time = self._status(time, variables)
        attributes = {
            "law": MEASURED,
            "gains": {},
            "readings": {},
            "payload_mass": float(run.payload_mass_kg),
            "status": status,
            "status_time": status_time,
            "reference_period": float(run.period_s or 0.0),
        }
        return Trace(name, time, joints, variables, attributes)

    def _variables(self, name: str, run: Run) -> tuple[Array, dict[str, Array], tuple[int, ...]]:
        """Time base, variables by name, and the joints in order."""
        timed = {}
        without: dict[int, list[str]] = defaultdict(list)
        for entry in run.signals:
            label = f"{entry.variable} of joint {entry.joint}"
            signal, lost = checked(self._timed(entry, run, label))
            without[lost].append(label)
            timed[entry] = within(signal, run.from_s, run.to_s)
        for lost, labels in without.items():
            of = labels[0] if len(labels) == 1 else f"each of {len(labels)} columns"
            self.notes += [f"{name}: {lost} samples without a time left out of {of}"] if lost else []
        time = self._time(name, list(timed.values()))
        joints = tuple(sorted({entry.joint for entry in run.signals}))
        variables: dict[str, Array] = {}
        for entry, signal in timed.items():
            block = variables.setdefault(entry.variable, np.full((len(time), len(joints)), np.nan))
            block[:, joints.index(entry.joint)] = self._values(signal, time)
        return time, variables, joints

    def _time(self, name: str, signals: Sequence[Timed]) -> Array:
        resample = self.mapping.resample
        if resample is None:
            return shared(signals)
        self.notes.append(f"{name}: resampled every {resample.step_s:g} s, {resample.method}")
        return even(signals, resample.step_s)

    def _values(self, signal: Timed, time: Array) -> Array:
        resample: Resample | None = self.mapping.resample
        return signal.values if resample is None else RESAMPLED[resample.method](time, signal)

    def _timed(self, entry: Entry, run: Run, label: str) -> Timed:
        signal = self._signal(entry.file, entry.signal, entry.column)
        rows = self._rows(entry, run, len(signal.values), label)
        values = (signal.column(entry.column)[rows] - entry.offset) * entry.to_si
        axis = entry.time or (run.time if signal.time is None else None)
        if axis is not None:
            return Timed(label, self._axis(axis, rows), values)
        if signal.time is not None:
            return Timed(label, signal.time[rows], values)
        message = f"{label} has no time"
        hint = "Give its run a `time: {file, signal}`, or `time: {step_s: 0.001}` with the record's own step."
        raise ConfigError(message, where=self.where, hint=hint)

    def _rows(self, entry: Entry, run: Run, samples: int, label: str) -> NDArray[np.bool_]:
        """Rows that meet every condition of a column and of its run."""
        rows = np.ones(samples, bool)
        for where in (*run.where, *entry.where):
            values = self._signal(entry.file, where.signal, where.column).column(where.column)
            if len(values) != samples:
                message = f"{label} has {samples} rows, {where.signal!r} of its `where` has {len(values)}"
                raise ConfigError(message, where=self.where)
            before, rows = rows, rows & np.isclose(values, where.equals, rtol=SAME_VALUE, atol=0.0)
            if not rows.any():
                message = f"{label} has no row left where {where.signal!r} is {where.equals:g}"
                hint = f"There {where.signal!r} holds {_few([f'{x:g}' for x in np.unique(values[before])])}"
                raise ConfigError(message, where=self.where, hint=hint)
        return rows

    def _axis(self, axis: TimeAxis, rows: NDArray[np.bool_]) -> Array:
        if axis.step_s is not None:
            return np.asarray(axis.step_s * np.arange(rows.sum()))
        assert axis.file is not None
        assert axis.signal is not None
        column = self._signal(axis.file, axis.signal, axis.column).column(axis.column)
        # Times that were saved for the chosen rows alone are whole already.
        times = column[rows] if len(column) == len(rows) else column
        return (times - axis.offset) * factor(axis.unit, "time")

    def _signal(self, file: str, path: str, column: int) -> Signal:
        source = self._source(file)
        found = next((signal for signal in source.signals if signal.path == path), None)
        if found is None:
            skipped = next((skip for skip in source.skipped if skip.path == path or not skip.path), None)
            reason = f": {printable(skipped.reason)}" if skipped else ""
            message = f"{file} holds no signal {path!r}{reason}"
            hint = f"`tendonrepro inspect` lists what it holds: {_few([s.path for s in source.signals])}"
            raise ConfigError(message, where=self.where, hint=hint)
        if column > found.columns:
            message = f"{path!r} in {file} has {found.columns} columns, not {column}"
            raise ConfigError(message, where=self.where)
        return found

    def _source(self, file: str) -> Source:
        """Find a file by its name, or by the only one that ends with it when other folders stand before."""
        exact = [source for source in self.sources if source.name == file]
        below = [source for source in self.sources if f"/{source.name}".endswith(f"/{file}")]
        above = [source for source in self.sources if f"/{file}".endswith(f"/{source.name}")]
        for found in (exact, below, above):
            if len(found) == 1:
                self._taken.add(found[0])
                return found[0]
        message = (
            f"no file {file!r} among what was given" if not below else f"{file!r} could be several files"
        )
        hint = f"Given were {_few([source.name for source in self.sources])}"
        raise ConfigError(message, where=self.where, hint=hint)

    def _complete(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        found = complete(variables, joints)
        self.notes += [f"{name}: {note}" for note in found.notes]
        self.doubts += [f"{name}: {doubt}" for doubt in found.doubts]
        self._pairs[name] = found.pairs

    def _calculate(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        """Joint angles from motors."""
        if (
            "q_motor_encoder" in variables
            and "q_calculated" not in variables
            and joints in {(1, 2, 3), (2, 3)}
        ):
            index = np.array(joints) - 1
            variables["q_calculated"] = variables["q_motor_encoder"] @ self.S[np.ix_(index, index)].T
            held = "" if len(joints) == len(self.S) else ", joint 1 held"
            self.notes.append(f"{name}: q_calculated is S q_motor_encoder{held}")

    def _leave_out(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        """Drop variables without a number, and tell of joints without one."""
        for variable, block in list(variables.items()):
            absent = np.isnan(block).all(axis=0)
            if absent.all():
                del variables[variable]
                self.notes.append(f"{name}: {variable} holds no number and is left out")
            elif absent.any():
                self.notes.append(f"{name}: no {variable} of joint {listed(joints, absent)}")
        if not variables:
            message = "no signal of the run holds a number"
            hint = "`tendonrepro inspect` shows the range of every signal"
            raise ConfigError(message, where=f"{self.where}: runs.{name}", hint=hint)

    def _status(self, time: Array, variables: dict[str, Array]) -> tuple[str, float]:
        """Status by the error; gaps in it are bridged, they are not divergence."""
        if "e" not in variables or len(time) < 2:
            return "ok", float(time[-1])
        columns = [_bridged(time, column) for column in variables["e"].T]
        known = [column for column in columns if column is not None]
        return self.status_of(time, np.stack(known, axis=1)) if known else ("ok", float(time[-1]))


@np.errstate(over="ignore", invalid="ignore")
def doubts_about(trace: Trace) -> list[str]:
    """What makes a run implausible: a wrong unit, a motor taken for a joint, a wrong sign or gear."""
    doubts = []
    step = float(np.median(np.diff(trace.time)))
    if step > LONGEST_STEP:
        doubts.append(f"it has a sample every {step:.4g} s: check the unit of the time")
    for name in ("q_encoder", "q_d", "q_calculated"):
        turn = np.rad2deg(np.nanmax(np.abs(trace[name]), initial=0.0)) if name in trace else 0.0
        if turn > MOST_TURN_DEG:
            doubts.append(f"{name} reaches {turn:.4g} deg, and no joint turns by more than half a turn")
    if {"q_calculated", "q_encoder"} <= trace.variables.keys():
        for k, joint in enumerate(trace.joint):
            calculated, encoder = (trace[name][:, k] for name in ("q_calculated", "q_encoder"))
            known = np.isfinite(encoder) & np.isfinite(calculated)
            if not known.any():
                continue
            first = int(np.argmax(known))
            apart = distance(encoder - encoder[first], calculated - calculated[first])
            if FAR_APART < apart < np.inf:
                doubts.append(
                    f"S q_motor of joint {joint} is {apart:.0%} of its range from the encoder: "
                    "unit, sign, scale or number of a motor"
                )
    return doubts


def _bridged(time: Array, values: Array) -> Array | None:
    known = np.isfinite(values)
    return np.interp(time, time[known], values[known]) if known.any() else None


def _few(names: Sequence[str]) -> str:
    shown = ", ".join(map(printable, names[:8])) or "nothing"
    return f"{shown} and {len(names) - 8} more" if len(names) > 8 else shown
