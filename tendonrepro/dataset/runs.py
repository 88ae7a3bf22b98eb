"""From tables and a mapping to runs in SI units on one time base."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.published import coupling_of, published, table_1
from tendonrepro.dataset.clocks import by_clock, by_rows, in_order, read_off, rows_of, times_of
from tendonrepro.dataset.mapping import LOOP_STEPS, MappingFile, RunMapping, Use
from tendonrepro.dataset.read import Contents
from tendonrepro.dataset.tables import FEWEST, Column, Columns
from tendonrepro.errors import ConfigError, DataMissingError
from tendonrepro.physics.metrics import mean, status_of
from tendonrepro.results.records import READ_OFF, Trace, median_step

_ANGLES = "q_d", "q_encoder", "q_calculated"
_FAR = 0.1
"""Mean difference of two of these, over the range, beyond which they are in doubt."""
_ALIKE = 0.8
"""Least share of a slope, or of its variance, that a rate has to be."""
_MOST_TURN_DEG = 190.0
_HELD = float(np.deg2rad(0.03))
"""Range of a desired angle, rad, below which a joint is held: the dither of its encoder is no ringing."""
_SEVERITY = ("ok", "ringing", "diverged")


@dataclass
class Assembly:
    """Runs in the making, with `notes` of what was done to numbers, and `doubts`."""

    contents: Contents
    mapping: MappingFile
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
        traces = {}
        for name, run in self.mapping.runs.items():
            try:
                traces[name] = self._run(name, run)
            except ConfigError as error:
                raise ConfigError(error.message, where=self.mapping.places[name], hint=error.hint) from None
        self.doubts += self._absent()
        return traces

    def _absent(self) -> list[str]:
        """Columns of the mapping that no table has, as after a slip of the pen."""
        runs = self.mapping.runs.values()
        asked = dict.fromkeys(column for run in runs for column in run.columns or {})
        found = {name for table in self.contents.tables for name in table.named(asked)}
        return [f"the mapping: no table has a column {column!r}" for column in asked if column not in found]

    def _run(self, name: str, run: RunMapping) -> Trace:
        time, signals = self._signals(name, run)
        joints = tuple(sorted({use.joint for use in signals}))
        variables: dict[str, Array] = {}
        for use in list(signals):
            # A long log is in memory once, not twice.
            values = signals.pop(use)
            block = variables.setdefault(use.variable, np.full((len(time), len(joints)), np.nan))
            block[:, joints.index(use.joint)] = values
        if time[0] != 0.0:
            self.notes.append(f"{name}: time starts at {time[0]:.6g} s in the files, at 0 here")
            time = time - time[0]
        recorded = variables.get("e")
        if len(variables.keys() & {"q_d", "q_encoder", "e"}) > 1:
            _complete(variables, is_read_off=run.reading_error_deg is not None)
        if "q_motor_encoder" in variables and "q_calculated" not in variables and joints[-2:] == (2, 3):
            places = np.array(joints) - 1
            S, _ = coupling_of(table_1(published()))
            variables["q_calculated"] = variables["q_motor_encoder"] @ S[np.ix_(places, places)].T
            said = "q_calculated is S q_motor_encoder, S of the paper's arm; validate takes that of --config"
            self.notes.append(f"{name}: {said}")
        attributes: dict[str, object] = {"law": "measured", "gains": {}, "readings": {}}
        attributes |= {"payload_mass": run.payload_mass_kg, "reference_period": run.period_s or 0.0}
        attributes |= {f"{READ_OFF}{key}": error for key in variables if (error := run.reading_error(key))}
        attributes |= _status(time, variables, joints)
        trace = Trace(name, time, joints, variables, attributes)
        doubts = [*doubts_about(trace), *([] if recorded is None else doubts_about_error(trace, recorded))]
        self.doubts += [f"{name}: {doubt}" for doubt in doubts]
        return trace

    def _signals(self, name: str, run: RunMapping) -> tuple[Array, dict[Use, Array]]:
        """Common times, s, and values of all columns of a run, SI."""
        series: dict[Use, tuple[Array, Array]] = {}
        for name_of_table in run.sources:
            table = self._table(name_of_table)
            taken = {use.signal for use in series}
            uses = {column: use for column, use in _uses(table, run).items() if use.signal not in taken}
            if all(use.variable == "time" for use in uses.values()):
                continue
            _refuse_twins(table, uses)
            of_table, notes = _series_of(table, uses, run)
            series |= of_table
            place = f"{name}: {table.name}, " if len(run.sources) > 1 else f"{name}: "
            self.notes += [place + note for note in dict.fromkeys(notes)]
        if not series:
            raise ConfigError("none of its tables has a column that the mapping knows")
        if run.reading_error_deg:
            return read_off(series)
        return self._common(name, series)

    def _table(self, name: str) -> Columns:
        """Find a table by its name, or the only one that ends with it."""
        tables = self.contents.tables
        exact = [table for table in tables if table.name == name]
        matching = exact or [table for table in tables if table.name.endswith(f"/{name}")]
        if len(matching) == 1:
            return matching[0]
        for file, reason in self.contents.unread.items():
            if f"/{file}".endswith(f"/{name.partition(':')[0]}"):
                raise DataMissingError(f"was not read: {reason}", where=file)
        message = f"{name!r} could be several tables" if matching else f"there is no table {name!r}"
        raise ConfigError(message, hint=f"tables: {', '.join(table.name for table in tables)}")

    def _common(self, name: str, series: dict[Use, tuple[Array, Array]]) -> tuple[Array, dict[Use, Array]]:
        """All on the first table's times, as far as others go."""
        times = [time for time, _ in series.values()]
        first = times[0]
        time = first[(first >= max(axis[0] for axis in times)) & (first <= min(axis[-1] for axis in times))]
        if len(time) < 2:
            hint = "two clocks? 'time us - OFFSET' moves one of them"
            raise ConfigError("its tables have no time in common", hint=hint)
        if beyond := len(first) - len(time):
            self.notes.append(f"{name}: {beyond} samples lie where another column has no times, left out")
        if all(np.array_equal(axis, first) for axis in times):
            return first, {use: values for use, (_, values) in series.items()}
        self.notes.append(f"{name}: columns with other times were interpolated to those of the first")
        return time, {use: np.interp(time, *axis) for use, axis in series.items()}


def _series_of(
    table: Columns, uses: dict[str, Use], run: RunMapping
) -> tuple[dict[Use, tuple[Array, Array]], list[str]]:
    """Times, s, and values of the columns of one table, SI, and notes on what was left out."""
    series: dict[Use, tuple[Array, Array]] = {}
    rows, notes = rows_of(table, run)
    for clock, together in by_clock(table, uses).items():
        for filled, columns in by_rows(table, together):
            taken = rows & filled
            time, of_times = times_of(table, taken, clock, uses, run)
            notes += of_times
            has_time = np.isfinite(time)
            for column in columns:
                use = uses[column]
                values = _taken(use.in_si(_taken(table[column], taken)), has_time)
                curve = time[has_time], values
                series[use] = in_order(*curve) if run.reading_error_deg else curve
                if absent := int((~np.isfinite(values)).sum()):
                    notes.append(f"{column}: {absent} of {len(values)} samples missing")
    return series, notes


def _complete(variables: dict[str, Array], *, is_read_off: bool) -> None:
    """Find the third of desired angle, measured angle and error.

    The difference counts, but where curves were read off figures: those of errors have the finer axes.
    """
    absent = np.full_like(next(iter(variables.values())), np.nan)
    q_d, q, e = (variables.get(key, absent) for key in ("q_d", "q_encoder", "e"))
    # A joint is filled whole or not at all: gaps stay gaps.
    filled = np.where(np.isnan(q_d).all(axis=0), q + e, q_d)
    has_error = ~np.isnan(e).all(axis=0) if is_read_off else np.isnan(q).all(axis=0)
    q = np.where(has_error, filled - e, q)
    variables |= {"q_d": filled, "q_encoder": q, "e": filled - q}


def _status(time: Array, variables: dict[str, Array], joints: tuple[int, ...]) -> dict[str, object]:
    """Worst of the joints, by the limits of the shipped comparison."""
    limits = load_config(None, "compare").config.status
    ringing = limits.ringing_frequency.si, limits.ringing_share.si
    statuses: dict[int, tuple[str, float]] = {}
    for k, joint in enumerate(joints if "e" in variables else ()):
        e = variables["e"][:, k]
        known = np.isfinite(e)
        if known.any() and np.ptp(variables.get("q_d", variables["e"])[known, k]) > _HELD:
            bridged = np.interp(time, time[known], e[known])[:, np.newaxis]
            statuses[joint] = status_of(time, bridged, limits.divergence_limit.si, *ringing)
    worst = max((status for status, _ in statuses.values()), key=_SEVERITY.index, default="ok")
    of = [joint for joint, (status, _) in statuses.items() if status == worst]
    end = min((statuses[joint][1] for joint in of), default=float(time[-1]))
    judged = {"status": worst, "status_time": end}
    return judged if worst == "ok" else judged | {"status_joints": of}


def _refuse_twins(table: Columns, uses: dict[str, Use]) -> None:
    """Refuse two columns of one table that are the same signal."""
    columns: dict[tuple[str, int], str] = {}
    for column, use in uses.items():
        other = columns.setdefault(use.signal, column)
        if use.variable != "time" and other != column:
            message = f"{other!r} and {column!r} of {table.name} are both {use.variable} {use.joint}"
            raise ConfigError(message, hint="delete the line of one of them")


def _uses(table: Columns, run: RunMapping) -> dict[str, Use]:
    """What columns of a table are to a run."""
    columns = run.columns or {}
    return {column: columns[name] for name, column in table.named(columns).items()}


def _taken(values: Column, rows: NDArray[np.bool_]) -> Column:
    """Values of rows, without a copy of a long log where these are all."""
    return values if rows.all() else values[rows]


def doubts_about(trace: Trace) -> Iterator[str]:
    """What makes a run implausible."""
    step = median_step(trace.time)
    if not LOOP_STEPS[0] <= step <= LOOP_STEPS[1]:
        yield f"it has a sample every {step:.4g} s: check the unit of the time"
    angles = {name: values for name, values in trace.variables.items() if name in _ANGLES}
    for name, values in angles.items():
        turn = np.rad2deg(np.nanmax(np.abs(values), initial=0.0))
        if turn > _MOST_TURN_DEG:
            yield f"{name} reaches {turn:.4g} deg, and no joint turns by more than half a turn"
    for first, other in combinations(angles, 2):
        apart = np.abs(angles[first] - angles[other])
        for joint, size, angle in zip(trace.joint, apart.T, angles[other].T, strict=True):
            known = np.isfinite(size)
            if known.any() and size[known].mean() > _FAR * max(np.ptp(angle[known]), 1e-3):
                yield f"{first} and {other} of joint {joint} differ by a tenth of its motion: check both"
    for rate, angle in (("dq", "q_encoder"), ("dq_d", "q_d")):
        if rate in trace and angle in trace:
            yield from _doubts_about_rate(trace, rate, angle)


def _doubts_about_rate(trace: Trace, rate: str, angle: str) -> Iterator[str]:
    """Joints whose rate, integrated, is not how far they turn."""
    moved = np.nanmax(trace[angle], axis=0) - np.nanmin(trace[angle], axis=0)
    for k, joint in enumerate(trace.joint):
        known = np.isfinite(trace[angle][:, k]) & np.isfinite(trace[rate][:, k])
        if known.sum() < FEWEST or not moved[k] > max(_HELD, _FAR * float(np.nanmax(moved))):
            continue
        time, q, dq = trace.time[known], trace[angle][known, k], trace[rate][known, k]
        turned = np.concatenate([[0.0], np.cumsum(np.diff(time) * 0.5 * (dq[1:] + dq[:-1]))])
        size, together = float(q.var()), float(np.mean((q - q.mean()) * (turned - turned.mean())))
        if together**2 < _ALIKE * size * float(turned.var()) or not together:
            yield f"{rate} of joint {joint} is not the slope of {angle}"
        elif not _ALIKE < together / size < 1.0 / _ALIKE:
            times = f"{together / size:.3g} times the slope of {angle}"
            yield f"{rate} of joint {joint} is {times}: check its unit"


def doubts_about_error(trace: Trace, recorded: Array) -> Iterator[str]:
    """Joints whose recorded error (T, n), rad, is not desired less measured angle, which counts."""
    apart = mean(np.abs(recorded - trace["e"])) > _FAR * mean(np.abs(recorded))
    turned = mean(np.abs(recorded + trace["e"])) < _FAR * mean(np.abs(recorded))
    for joint, differs, other_sign in zip(trace.joint, apart, turned, strict=True):
        if differs:
            how = "has the other sign than" if other_sign else "is not"
            yield f"e of joint {joint} {how} q_d less q_encoder, which counts"
