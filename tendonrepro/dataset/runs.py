"""From tables and a mapping to runs in SI units on one time base."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import TypeAlias

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.published import coupling_of, published, table_1
from tendonrepro.dataset.clocks import by_clock, by_rows, in_order, read_off, rows_of, times_of
from tendonrepro.dataset.mapping import LOOP_STEPS, MappingFile, RunMapping, Use
from tendonrepro.dataset.read import Contents
from tendonrepro.dataset.tables import Columns
from tendonrepro.errors import ConfigError, DataMissingError
from tendonrepro.physics.metrics import mean, status_of
from tendonrepro.results.records import READ_OFF, Trace, median_step

_ANGLES = "q_d", "q_encoder", "q_calculated"
_FAR = 0.1
"""Mean difference of two of these, over the range, beyond which they are in doubt."""
_MOST_TURN_DEG = 190.0
_HELD = float(np.deg2rad(0.03))
"""Range of a desired angle, rad, below which a joint is held: the dither of its encoder is no ringing."""
_SEVERITY = ("ok", "ringing", "diverged")

Series: TypeAlias = dict[Use, tuple[Array, Array]]
"""Times, s, and values, SI, of each signal."""


def runs_of(contents: Contents, mapping: MappingFile) -> tuple[dict[str, Trace], list[str], list[str]]:
    """All runs of a mapping, notes on what was done to numbers or left out, and doubts.

    Raises
    ------
    ConfigError
        Where the mapping does not fit the tables.
    DataMissingError
        If a file of it was not read.
    """
    traces: dict[str, Trace] = {}
    notes: list[str] = []
    doubts: list[str] = []
    for name, run in mapping.runs.items():
        try:
            traces[name], told, asked = _run(contents, name, run)
        except ConfigError as error:
            raise ConfigError(error.message, where=mapping.places[name], hint=error.hint) from None
        notes += [f"{name}: {note}" for note in told]
        doubts += [f"{name}: {doubt}" for doubt in asked]
    # A column that no table has may be a slip of the pen.
    columns = dict.fromkeys(column for run in mapping.runs.values() for column in run.columns or {})
    known = {name for table in contents.tables for name in table.named(columns)}
    doubts += [f"the mapping: no table has a column {name!r}" for name in columns if name not in known]
    notes += [f"{file}: {line}" for file, lines in contents.left_out.items() for line in lines]
    notes += [f"{file} was not read: {reason}" for file, reason in contents.unread.items()]
    return traces, notes, doubts


def _run(contents: Contents, name: str, run: RunMapping) -> tuple[Trace, list[str], list[str]]:
    series, notes = _series_of(contents, run)
    if run.reading_error_deg:
        time, signals = read_off(series)
    else:
        time, signals, told = _on_one_clock(series)
        notes += told
    joints = tuple(sorted({use.joint for use in signals}))
    variables: dict[str, Array] = {}
    for use in list(signals):
        # A long log is in memory once, not twice.
        values = signals.pop(use)
        block = variables.setdefault(use.variable, np.full((len(time), len(joints)), np.nan))
        block[:, joints.index(use.joint)] = values
    if time[0] != 0.0:
        notes.append(f"time starts at {time[0]:.6g} s in the files, at 0 here")
        time = time - time[0]
    recorded = variables.get("e")
    if len(variables.keys() & {"q_d", "q_encoder", "e"}) > 1:
        _complete(variables, is_read_off=run.reading_error_deg is not None)
    if "q_motor_encoder" in variables and "q_calculated" not in variables and joints[-2:] == (2, 3):
        places = np.array(joints) - 1
        S, _ = coupling_of(table_1(published()))
        variables["q_calculated"] = variables["q_motor_encoder"] @ S[np.ix_(places, places)].T
        notes.append(
            "q_calculated is S q_motor_encoder, S of the paper's arm; validate takes that of --config"
        )
    attributes: dict[str, object] = {"law": "measured", "gains": {}, "readings": {}}
    attributes |= {"payload_mass": run.payload_mass_kg, "reference_period": run.period_s or 0.0}
    attributes |= {f"{READ_OFF}{key}": error for key in variables if (error := run.reading_error(key))}
    attributes |= _status(time, variables, joints)
    trace = Trace(name, time, joints, variables, attributes)
    return (
        trace,
        notes,
        [*_doubts(trace), *([] if recorded is None else _doubts_about_error(trace, recorded))],
    )


def _series_of(contents: Contents, run: RunMapping) -> tuple[Series, list[str]]:
    """Signals of a run, each of the first table that has it, and notes on what was left out."""
    series: Series = {}
    notes: list[str] = []
    for source in run.sources:
        table = _table(contents, source)
        columns = run.columns or {}
        taken = {use.signal for use in series}
        uses = {column: columns[name] for name, column in table.named(columns).items()}
        uses = {column: use for column, use in uses.items() if use.signal not in taken}
        if all(use.variable == "time" for use in uses.values()):
            continue
        for (column, use), (other, same) in combinations(uses.items(), 2):
            if use.signal == same.signal and use.variable != "time":
                message = f"{column!r} and {other!r} of {table.name} are both {use.variable} {use.joint}"
                raise ConfigError(message, hint="delete the line of one of them")
        of_table, told = _of_table(table, uses, run)
        series |= of_table
        place = f"{table.name}, " if len(run.sources) > 1 else ""
        notes += [place + note for note in dict.fromkeys(told)]
    if not series:
        raise ConfigError("none of its tables has a column that the mapping knows")
    return series, notes


def _table(contents: Contents, name: str) -> Columns:
    """Find a table by its name, or the only one that ends with it."""
    exact = [table for table in contents.tables if table.name == name]
    matching = exact or [table for table in contents.tables if table.name.endswith(f"/{name}")]
    if len(matching) == 1:
        return matching[0]
    for file, reason in contents.unread.items():
        if f"/{file}".endswith(f"/{name.partition(':')[0]}"):
            raise DataMissingError(f"was not read: {reason}", where=file)
    message = f"{name!r} could be several tables" if matching else f"there is no table {name!r}"
    raise ConfigError(message, hint=f"tables: {', '.join(table.name for table in contents.tables)}")


def _of_table(table: Columns, uses: dict[str, Use], run: RunMapping) -> tuple[Series, list[str]]:
    """Signals of one table, and notes on what was left out."""
    series: Series = {}
    notes: list[str] = []
    rows = rows_of(table, run)
    for clock, together in by_clock(table, uses).items():
        for filled, columns in by_rows(table, together):
            time, of_times = times_of(table, rows & filled, clock, uses, run)
            notes += of_times
            kept = rows & filled
            kept[kept] = np.isfinite(time)
            if absent := int(filled.sum() - kept.sum()):
                why = "no time, or not those of where, part, from_s and to_s"
                notes.append(f"{absent} of {int(filled.sum())} rows left out: {why}")
            for column in columns:
                values = uses[column].in_si(table[column][kept])
                curve = time[np.isfinite(time)], values
                series[uses[column]] = in_order(*curve) if run.reading_error_deg else curve
                if absent := int((~np.isfinite(values)).sum()):
                    notes.append(f"{column}: {absent} of {len(values)} samples missing")
    return series, notes


def _on_one_clock(series: Series) -> tuple[Array, dict[Use, Array], list[str]]:
    """All on the first signal's times, as far as others go."""
    times = [time for time, _ in series.values()]
    first = times[0]
    time = first[(first >= max(axis[0] for axis in times)) & (first <= min(axis[-1] for axis in times))]
    if len(time) < 2:
        hint = "two clocks? 'time us - OFFSET' moves one of them"
        raise ConfigError("its tables have no time in common", hint=hint)
    if all(np.array_equal(axis, first) for axis in times):
        return first, {use: values for use, (_, values) in series.items()}, []
    notes = ["columns with other times were interpolated to those of the first"]
    if beyond := len(first) - len(time):
        notes.insert(0, f"{beyond} samples lie where another column has no times, left out")
    return time, {use: np.interp(time, *curve) for use, curve in series.items()}, notes


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
    judged: dict[int, tuple[str, float]] = {}
    for k, joint in enumerate(joints if "e" in variables else ()):
        e = variables["e"][:, k]
        known = np.isfinite(e)
        if known.any() and np.ptp(variables.get("q_d", variables["e"])[known, k]) > _HELD:
            bridged = np.interp(time, time[known], e[known])[:, np.newaxis]
            judged[joint] = status_of(time, bridged, limits.divergence_limit.si, *ringing)
    worst = max((status for status, _ in judged.values()), key=_SEVERITY.index, default="ok")
    ends = {joint: end for joint, (status, end) in judged.items() if status == worst}
    told = {"status": worst, "status_time": min(ends.values(), default=float(time[-1]))}
    return told if worst == "ok" else told | {"status_joints": [*ends]}


def _doubts(trace: Trace) -> Iterator[str]:
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


def _doubts_about_error(trace: Trace, recorded: Array) -> Iterator[str]:
    """Joints whose recorded error (T, n), rad, is not desired less measured angle, which counts."""
    apart = mean(np.abs(recorded - trace["e"])) > _FAR * mean(np.abs(recorded))
    turned = mean(np.abs(recorded + trace["e"])) < _FAR * mean(np.abs(recorded))
    for joint, differs, other_sign in zip(trace.joint, apart, turned, strict=True):
        if differs:
            how = "has the other sign than" if other_sign else "is not"
            yield f"e of joint {joint} {how} q_d less q_encoder, which counts"
