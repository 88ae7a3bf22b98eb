"""From read files and a mapping to runs: SI units, one time base, errors derived."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping import timebase
from tendonrepro.dataset.mapping.model import Entry, Mapping, Run, TimeAxis
from tendonrepro.dataset.mapping.timebase import Timed, TimeProblem, in_seconds
from tendonrepro.dataset.meaning.words import few, printable
from tendonrepro.dataset.readers.signals import Signal, Source
from tendonrepro.dataset.readers.units import factor
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import MEASURED

_MOST_TURN_DEG = 190.0
_FAR_BEHIND = 0.1  # of the error, on average over the range: laws that track err by a hundredth
_REST = 0.1  # before the motion begins, s
_LEAP, _LEAPS = 0.1, 20.0  # of a value from one sample to the next, over the range and over nearly all others
_FAR_APART = 0.2  # of calculated and measured joint angle, over the range: no tendon stretches by so much
_SAME_VALUE = 1e-6  # relative difference from the number of a `where`; single precision makes 1e-7 of it
_STEPS = 5e-5, 0.1  # s, beyond which the unit of the times is in doubt; the paper's is 1 ms
# RMS of recorded error less difference, over that of the difference, from which on the error is not believed;
# fewer samples prove nothing.
_CONTRADICTS, _FEWEST = 0.5, 8
_MOST_PERIODS = 100_000
"""Periods in a run; every one is a window that results may be of."""
_COUNT = 1.01 * np.deg2rad(0.022)  # an encoder's count as printed, rad, which a held joint may dither by
_SHAKES = np.deg2rad(1.0)  # span of the error of a held joint that is no dither any more
_OF_THE_OTHERS = {"q_d": "q_encoder + e", "q_encoder": "q_d - e", "e": "q_d - q_encoder"}

StatusOf = Callable[[Array, Array], tuple[str, float]]
"""Time and error without gaps to status and its time."""


@dataclass
class Assembly:
    """Runs in the making: what was read, the mapping and its name, the coupling (3, 3), how a run is judged.

    Its notes say what was done to the numbers on the way, its doubts what makes a recorded error implausible.
    """

    sources: Sequence[Source]
    mapping: Mapping
    where: str
    S: Array
    status_of: StatusOf
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    _taken: set[Source] = field(default_factory=set, init=False, repr=False)

    def used(self) -> list[Source]:
        """Sources that `runs` has taken anything from, in their order."""
        return [source for source in self.sources if source in self._taken]

    # Numbers near the largest there are mean nothing, but a file may hold them.
    @np.errstate(over="ignore", invalid="ignore")
    def runs(self) -> dict[str, Trace]:
        """All runs of the mapping, in its order."""
        return {name: self._run(name, run) for name, run in self.mapping.runs.items()}

    def _run(self, name: str, run: Run) -> Trace:
        try:
            time, variables, joints = self._variables(name, run)
        except TimeProblem as problem:
            raise ConfigError(str(problem), where=f"{self.where}: runs.{name}", hint=problem.hint) from None
        if time[0] != 0.0:
            start, lasts = in_seconds(time[0]), f"{time[-1] - time[0]:.6g}"
            self.notes.append(f"{name}: time starts at {start} s in the files, at 0 here; it lasts {lasts} s")
            time = time - time[0]
        if run.period_s and time[-1] > _MOST_PERIODS * run.period_s:
            message = (
                f"a period of {run.period_s:g} s would be over {_MOST_PERIODS} times in {time[-1]:.6g} s"
            )
            raise ConfigError(message, where=f"{self.where}: runs.{name}.period_s", hint="give it in seconds")
        self._complete(name, variables, joints)
        self._calculate(name, variables, joints)
        self._leave_out(name, variables, joints)
        self._ask_for_measured(name, variables, joints)
        attributes = {
            "law": MEASURED,
            "gains": {},
            "readings": {},
            "payload_mass": float(run.payload_mass_kg),
            "reference_period": float(run.period_s or 0.0),
            **self._status(time, variables, joints),
        }
        return Trace(name, time, joints, variables, attributes)

    def _variables(self, name: str, run: Run) -> tuple[Array, dict[str, Array], tuple[int, ...]]:
        """Time base, variables by name, and the joints in order."""
        timed = {}
        without: dict[int, list[str]] = defaultdict(list)
        seen: dict[tuple[str, str, int, str], str] = {}
        for entry in run.signals:
            label = f"{entry.variable} of joint {entry.joint}"
            first = seen.setdefault((entry.file, entry.signal, entry.column, str(entry.where)), label)
            if first != label:
                self.doubts.append(f"{name}: {first} and {label} are one column of {entry.file}")
            signal, lost = timebase.checked(self._timed(entry, run, label))
            without[lost].append(label)
            timed[entry] = timebase.within(signal, run.from_s, run.to_s)
        for lost, labels in without.items():
            of = labels[0] if len(labels) == 1 else f"each of {len(labels)} columns"
            self.notes += [f"{name}: {lost} samples without a time left out of {of}"] if lost else []
        signals, resample = list(timed.values()), self.mapping.resample
        if resample is None:
            time = timebase.shared(signals)
        else:
            time = timebase.even(signals, resample.step_s)
            kept = timebase.resampled(signals, time)
            self.notes.append(f"{name}: resampled every {resample.step_s:g} s: {kept}")
        joints = tuple(sorted({entry.joint for entry in run.signals}))
        variables: dict[str, Array] = {}
        for entry, signal in timed.items():
            block = variables.setdefault(entry.variable, np.full((len(time), len(joints)), np.nan))
            values = np.interp(time, signal.time, signal.values) if resample else signal.values
            block[:, joints.index(entry.joint)] = values
        return time, variables, joints

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
            before, rows = rows, rows & np.isclose(values, where.equals, rtol=_SAME_VALUE, atol=0.0)
            if not rows.any():
                message = f"{label} has no row left where {where.signal!r} is {where.equals:g}"
                hint = f"There {where.signal!r} holds {few([f'{x:g}' for x in np.unique(values[before])])}"
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
            held = few([signal.path for signal in source.signals]) or "nothing"
            hint = f"`tendonrepro inspect` lists what it holds: {held}"
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
        message = f"{file!r} could be several files" if below else f"no file {file!r} among what was given"
        hint = f"Given were {few([source.name for source in self.sources]) or 'nothing'}"
        raise ConfigError(message, where=self.where, hint=hint)

    def _complete(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        """Of desired angle, measured angle and error find the third, joint by joint.

        Where all were recorded the difference has the last word, and an error that contradicts it is doubted.
        """
        if len(variables.keys() & _OF_THE_OTHERS.keys()) < 2:
            return
        absent = np.full_like(next(iter(variables.values())), np.nan)
        q_d, q, e = (variables.get(key, absent).copy() for key in _OF_THE_OTHERS)
        variables |= {"q_d": q_d, "q_encoder": q, "e": e}
        for k, joint in enumerate(joints):
            for key, found in (("q_d", q + e), ("q_encoder", q_d - e)):
                if np.isnan(variables[key][:, k]).all() and not np.isnan(found[:, k]).all():
                    variables[key][:, k] = found[:, k]
                    turned = "if e was recorded as measured less desired, `sign: -1`"
                    self.notes.append(f"{name}: {key} of joint {joint} is {_OF_THE_OTHERS[key]}; {turned}")
            difference = q_d[:, k] - q[:, k]
            if np.isnan(difference).all():
                continue
            known = np.isfinite(difference - e[:, k])
            apart = (e[:, k] - difference)[known]
            off = f"up to {np.rad2deg(np.abs(apart).max(initial=0.0)):.3g} deg off q_d - q_encoder"
            if known.sum() >= _FEWEST and np.linalg.norm(apart) > _CONTRADICTS * np.linalg.norm(
                difference[known]
            ):
                look = "look at column, `unit`, `sign` and run of all three"
                self.doubts.append(f"{name}: e of joint {joint} is {off}: {look}")
            elif np.abs(apart).max(initial=0.0) > 1e-9:
                self.notes.append(f"{name}: e of joint {joint} is q_d - q_encoder; the recorded one is {off}")
            e[:, k] = difference

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
                self.notes.append(f"{name}: no {variable} of joint {_listed(joints, absent)}")
        if not variables:
            message = "no signal of the run holds a number"
            hint = "`tendonrepro inspect` shows the range of every signal"
            raise ConfigError(message, where=f"{self.where}: runs.{name}", hint=hint)

    def _ask_for_measured(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        """Doubt desired angles without measured ones, and say which line of the mapping brings these."""
        absent = np.full((1, len(joints)), np.nan)
        q_d, q = (np.isfinite(variables.get(key, absent)).any(axis=0) for key in ("q_d", "q_encoder"))
        judged = name.startswith("controller_") and "e" not in variables
        if judged and (alone := q & ~q_d).any():
            self.doubts.append(
                f"{name}: joint {_listed(joints, alone)} has a measured angle and no desired one, so there "
                "is no error: `variable: q_d` under `signals` names its column"
            )
        if (alone := q_d & ~q).any():
            self.doubts.append(
                f"{name}: joint {_listed(joints, alone)} has a desired angle and no measured one, so there "
                "is no error: `variable: q_encoder` under `signals` names its column"
            )

    def _status(self, time: Array, variables: dict[str, Array], joints: tuple[int, ...]) -> dict[str, Any]:
        """Status by the error, with the joints it is of; gaps are bridged, they are not divergence.

        A joint that is held is in the dither of its encoder, which is no ringing.
        """
        found: dict[str, tuple[float, list[int]]] = {}
        for k, joint in enumerate(joints if "e" in variables and len(time) > 1 else ()):
            known = np.isfinite(e := variables["e"][:, k])
            if known.any():
                bridged = np.interp(time, time[known], e[known])
                status, end = self.status_of(time, bridged[:, np.newaxis])
                held = _span(variables.get("q_d", variables["e"])[:, k]) <= _COUNT
                if status == "ringing" and held and _span(e) <= _SHAKES:
                    continue
                first, of = found.get(status, (end, []))
                found[status] = (min(first, end), [*of, joint])
        worst = next((status for status in ("diverged", "ringing") if status in found), "ok")
        end, of = found.get(worst, (float(time[-1]), []))
        judged = {"status": worst, "status_time": end}
        return judged if worst == "ok" else judged | {"status_joints": of}


@np.errstate(over="ignore", invalid="ignore")
def doubts_about(trace: Trace) -> list[str]:
    """What makes a run implausible: a wrong unit, a motor taken for a joint, a wrong sign or gear."""
    doubts = []
    step = float(np.median(np.diff(trace.time)))
    if not _STEPS[0] <= step <= _STEPS[1]:
        doubts.append(f"it has a sample every {step:.4g} s: check the unit of the time")
    for name in ("q_encoder", "q_d", "q_calculated"):
        turn = np.rad2deg(np.nanmax(np.abs(trace[name]), initial=0.0)) if name in trace else 0.0
        if turn > _MOST_TURN_DEG:
            doubts.append(f"{name} reaches {turn:.4g} deg, and no joint turns by more than half a turn")
    doubts += _doubts_about_jumps(trace)
    if {"q_d", "e"} <= trace.variables.keys():
        doubts += _doubts_about_error(trace)
    if {"q_calculated", "q_encoder"} <= trace.variables.keys():
        for k, joint in enumerate(trace.joint):
            calculated, encoder = (trace[name][:, k] for name in ("q_calculated", "q_encoder"))
            known = np.isfinite(encoder) & np.isfinite(calculated)
            x, y = (values[known] - values[known][:1] for values in (encoder, calculated))
            extent = float(np.ptp(x, axis=0)) if x.size else 0.0
            apart = float(np.sqrt(np.mean((x - y) ** 2))) / extent if extent else 0.0
            if apart > _FAR_APART:
                doubts.append(
                    f"S q_motor of joint {joint} is {apart:.0%} of its range from the encoder: "
                    "unit, sign, scale or number of a motor"
                )
    return doubts


def _doubts_about_jumps(trace: Trace) -> Iterator[str]:
    """Measured values that leap, as where a logger writes a nought or -99 for what it lost."""
    name = "q_encoder" if "q_encoder" in trace else "e"
    if name in trace:
        for joint, values in zip(trace.joint, trace[name].T, strict=True):
            leaps = np.abs(np.diff(values))
            known = leaps[np.isfinite(leaps)]
            if known.size and known.max() > max(
                _LEAP * _span(values), _LEAPS * np.quantile(known, 0.9), _COUNT
            ):
                at = trace.time[1 + int(np.nanargmax(leaps))]
                yield (
                    f"{name} of joint {joint} leaps by {np.rad2deg(known.max()):.3g} deg at {at:.4g} s: "
                    "lost samples are no numbers, `nan` or an empty cell"
                )


def _doubts_about_error(trace: Trace) -> Iterator[str]:
    """Joints whose angles begin apart, or whose error is no law's that tracks."""
    rest = trace.time <= trace.time[0] + _REST
    for joint, e, q_d in zip(trace.joint, trace["e"].T, trace["q_d"].T, strict=True):
        begin, known, extent = e[rest & np.isfinite(e)], e[np.isfinite(e)], _span(q_d)
        size = float(np.abs(known).mean()) if known.size else 0.0
        apart = float(np.median(begin)) if begin.size else 0.0
        # A record that begins in the midst of a motion begins with an error.
        if abs(apart) > max(0.5 * size, 10.0 * _COUNT, _span(q_d[rest])):
            yield f"the angles of joint {joint} begin {np.rad2deg(apart):.3g} deg apart: `offset` of one"
        elif size > _FAR_BEHIND * extent > 0.0:
            share = f"{size / extent:.0%} of the desired range on average"
            yield f"the error of joint {joint} is {share}: unit or sign of an angle or of the error"


def _span(values: Array) -> float:
    """Range of the numbers among values; infinite without any, since then nothing is known of it."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else np.inf


def _listed(joints: Sequence[int], chosen: ArrayLike) -> str:
    return ", ".join(str(joints[place]) for place in np.flatnonzero(chosen).tolist())
