"""From tables and a mapping to runs in SI units on one time base."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.published import coupling_of, published, table_1
from tendonrepro.dataset.mapping import LOOP_STEPS, MappingFile, RunMapping, Use
from tendonrepro.dataset.read import Contents
from tendonrepro.dataset.tables import Columns
from tendonrepro.errors import ConfigError, DataMissingError
from tendonrepro.physics.metrics import STATUSES, mean, status_of
from tendonrepro.results.records import READ_OFF, Trace, median_step

_ANGLES = "q_d", "q_encoder", "q_calculated"
_FAR = 0.1
"""Mean difference of two of these, over the range, beyond which they are in doubt."""
_MOST_TURN_DEG = 190.0
_UNLIKE = 0.5
"""Range of an angle less its integrated rate, over that of the angle, beyond which the rate is in doubt."""
_HELD = float(np.deg2rad(0.03))
"""Range of a desired angle, rad, below which a joint is held: the dither of its encoder is no ringing."""

_GAP = 1.5
"""Steps beyond this many median ones are gaps."""
_EVEN = 0.1
"""Share of the median step by which a step of a recorder may differ."""
_MOST_POINTS = 5000
"""Points of a curve that somebody may have read off a figure."""
_FINEST = 0.02
"""Step of the grid on which curves are put, at most, s."""

_Curves: TypeAlias = dict[Use, tuple[Array, Array]]
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
        told: list[str] = []
        try:
            trace, recorded = _run(contents, name, run, told)
        except ConfigError as error:
            raise ConfigError(error.message, where=mapping.places[name], hint=error.hint) from None
        traces[name] = trace
        notes += [f"{name}: {note}" for note in told]
        doubts += [f"{name}: {doubt}" for doubt in _doubts(trace, recorded)]
    # A column that no table has may be a slip of the pen.
    columns = dict.fromkeys(column for run in mapping.runs.values() for column in run.columns or {})
    known = {name for table in contents.tables for name in table.named(columns)}
    doubts += [f"the mapping: no table has a column {name!r}" for name in columns if name not in known]
    notes += [f"{file}: {line}" for file, lines in contents.left_out.items() for line in lines]
    notes += [f"{file} was not read: {reason}" for file, reason in contents.unread.items()]
    return traces, notes, doubts


def _run(contents: Contents, name: str, run: RunMapping, notes: list[str]) -> tuple[Trace, Array | None]:
    """A run, and the error that its file holds, rad; notes are added to `notes`."""
    series = _series_of(contents, run, notes)
    time, signals = _read_off(series) if run.reading_error_deg else _on_one_clock(series, notes)
    # A long log is in memory once, not twice.
    del series
    joints = tuple(sorted({use.joint for use in signals}))
    variables: dict[str, Array] = {}
    for use in list(signals):
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
    attributes = {
        "law": "measured",
        "gains": {},
        "readings": {},
        "payload_mass": run.payload_mass_kg,
        "reference_period": run.period_s or 0.0,
        **{f"{READ_OFF}{key}": error for key in variables if (error := run.reading_error(key))},
        **_status(time, variables, joints),
    }
    return Trace(name, time, joints, variables, attributes), recorded


def _series_of(contents: Contents, run: RunMapping, notes: list[str]) -> _Curves:
    """Signals of a run, each of the first table that has it."""
    series: _Curves = {}
    columns = run.columns or {}
    for source in run.sources:
        table = _table(contents, source)
        taken = {use.signal for use in series}
        named = table.named(columns).items()
        uses = {column: columns[name] for name, column in named if columns[name].signal not in taken}
        for (column, use), (other, same) in combinations(uses.items(), 2):
            if use.signal == same.signal and use.variable != "time":
                message = f"{column!r} and {other!r} of {table.name} are both {use.variable} {use.joint}"
                raise ConfigError(message, hint="delete the line of one of them")
        told: list[str] = []
        series |= _of_table(table, uses, run, told)
        place = f"{table.name}, " if len(run.sources) > 1 else ""
        notes += [place + note for note in dict.fromkeys(told)]
    if not series:
        raise ConfigError("none of its tables has a column that the mapping knows")
    return series


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


def _of_table(table: Columns, uses: dict[str, Use], run: RunMapping, notes: list[str]) -> _Curves:
    """Signals of one table."""
    series: _Curves = {}
    for clock, together in by_clock(table, uses).items():
        if clock is not None:
            time = uses[clock].in_si(table[clock])
            notes += [f"times are made from step_s, not from {clock!r}"] if run.step_s is not None else []
        elif run.step_s is not None:
            time = np.arange(float(len(table[together[0]])))
        else:
            hint = "give its column of times the line 'NAME: time s', or the run 'step_s: 0.001'"
            raise ConfigError(f"{table.name} has no times", hint=hint)
        for filled, columns in by_rows(table, together):
            rows, kept = _taken(table, filled, time, run, notes)
            for column in columns:
                values = uses[column].in_si(table[column][rows])
                series[uses[column]] = _in_order(kept, values) if run.reading_error_deg else (kept, values)
                if absent := int((~np.isfinite(values)).sum()):
                    notes.append(f"{column}: {absent} of {len(values)} samples missing")
    return series


def _taken(
    table: Columns, filled: NDArray[np.bool_], time: Array, run: RunMapping, notes: list[str]
) -> tuple[NDArray[np.int64], Array]:
    """Those of the `filled` rows that a run takes, and their times, s.

    A ConfigError says that times go back or repeat, or that fewer than two are left.
    """
    chosen = filled.copy()
    for column, wanted in run.where.items():
        if column not in table:
            raise ConfigError(f"{table.name} has no column {column!r}")
        chosen &= table[column] == wanted
    left_out = {"not those of `where`": int(filled.sum() - chosen.sum())}
    known = chosen & np.isfinite(time)
    left_out["without a time"] = int(chosen.sum() - known.sum())
    rows = np.flatnonzero(known)
    if run.part is not None:
        parts = np.split(rows, starts_again(time[rows]))
        if run.part > len(parts):
            message = f"the time of {table.name} starts again {len(parts) - 1} times: no part {run.part}"
            raise ConfigError(message, hint=f"parts are counted from 1 to {len(parts)}")
        left_out[f"not of part {run.part}"] = len(rows) - len(parts[run.part - 1])
        rows = parts[run.part - 1]
    kept = time[rows] if run.step_s is None else run.step_s * np.arange(float(len(rows)))
    inside = (kept >= run.from_s) & (kept <= run.to_s)
    left_out["before from_s or after to_s"] = int((~inside).sum())
    notes += [f"{count} of {filled.sum()} rows left out: {why}" for why, count in left_out.items() if count]
    notes += _checked(kept[inside], table.name, run)
    return rows[inside], kept[inside]


def _checked(time: Array, table: str, run: RunMapping) -> list[str]:
    """A note on gaps; a ConfigError where times go back, repeat, or are fewer than two."""
    if len(time) < 2:
        raise ConfigError(f"{table} has fewer than two samples that the run takes")
    if run.reading_error_deg:
        return []
    steps = np.diff(time)
    if back := len(starts_again(time)):
        message = (
            f"the time of {table} starts again {back} times, first after {time[np.argmax(steps < 0.0)]:.6g} s"
        )
        hint = "runs below each other? 'part: 1' takes the first, `where` those of a column"
        raise ConfigError(message, hint=hint)
    if repeats := int((steps == 0.0).sum()):
        message = f"the time of {table} repeats {repeats} times, first at {time[np.argmin(steps)]:.6g} s"
        hint = f"rounded times? 'step_s: {even_step(time):.6g}' makes them from the numbers of the samples"
        raise ConfigError(message, hint=hint)
    gaps = int((steps > _GAP * np.median(steps)).sum())
    longest = np.argmax(steps)
    told = f"{gaps} gaps in the times, the longest of {steps[longest]:.4g} s at {time[longest]:.6g} s"
    return [told] if gaps else []


def _on_one_clock(series: _Curves, notes: list[str]) -> tuple[Array, dict[Use, Array]]:
    """All on the first signal's times, as far as others go."""
    times = [time for time, _ in series.values()]
    first = times[0]
    time = first[(first >= max(axis[0] for axis in times)) & (first <= min(axis[-1] for axis in times))]
    if len(time) < 2:
        hint = "two clocks? 'time us - OFFSET' moves one of them"
        raise ConfigError("its tables have no time in common", hint=hint)
    if all(np.array_equal(axis, first) for axis in times):
        return first, {use: values for use, (_, values) in series.items()}
    if beyond := len(first) - len(time):
        notes.append(f"{beyond} samples lie where another column has no times, left out")
    notes.append("columns with other times were interpolated to those of the first")
    return time, {use: np.interp(time, *curve) for use, curve in series.items()}


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
    worst = max((status for status, _ in judged.values()), key=STATUSES.index, default="ok")
    ends = {joint: end for joint, (status, end) in judged.items() if status == worst}
    told = {"status": worst, "status_time": min(ends.values(), default=float(time[-1]))}
    return told if worst == "ok" else told | {"status_joints": [*ends]}


def _doubts(trace: Trace, recorded: Array | None) -> Iterator[str]:
    """What makes a run implausible, with the error (T, n), rad, that its file holds, if any."""
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
    if recorded is not None:
        yield from _doubts_about_error(trace, recorded)


def _doubts_about_rate(trace: Trace, rate: str, angle: str) -> Iterator[str]:
    """Joints that move and whose rate, integrated, is not how far they turn."""
    known = np.isfinite(trace[angle])
    moved = np.array(
        [np.ptp(q[there]) if there.any() else 0.0 for q, there in zip(trace[angle].T, known.T, strict=True)]
    )
    known &= np.isfinite(trace[rate])
    # Summed up, the noise of a joint at rest is no motion.
    for k in np.flatnonzero(known.any(axis=0) & (moved > _FAR * moved.max())):
        time, q, dq = trace.time[known[:, k]], trace[angle][known[:, k], k], trace[rate][known[:, k], k]
        turned = np.append(0.0, np.cumsum(0.5 * np.diff(time) * (dq[1:] + dq[:-1])))
        if np.ptp(q - turned) > _UNLIKE * moved[k]:
            yield f"{rate} of joint {trace.joint[k]} is not the slope of {angle}: check its unit"


def _doubts_about_error(trace: Trace, recorded: Array) -> Iterator[str]:
    """Joints whose recorded error (T, n), rad, is not desired less measured angle, which counts."""
    apart = mean(np.abs(recorded - trace["e"])) > _FAR * mean(np.abs(recorded))
    turned = mean(np.abs(recorded + trace["e"])) < _FAR * mean(np.abs(recorded))
    for joint, differs, other_sign in zip(trace.joint, apart, turned, strict=True):
        if differs:
            how = "has the other sign than" if other_sign else "is not"
            yield f"e of joint {joint} {how} q_d less q_encoder, which counts"


def by_clock(table: Columns, uses: Mapping[str, Use]) -> dict[str | None, list[str]]:
    """Columns of signals by the column of their times: the nearest to the left, else the first.

    Of columns of times that stand side by side the first counts.
    """
    columns_of: dict[str | None, list[str]] = {}
    times = [column for column in table if column in uses and uses[column].variable == "time"]
    clock, before = next(iter(times), None), None
    for column in table:
        if column in times:
            clock = clock if before in times else column
        elif column in uses:
            columns_of.setdefault(clock, []).append(column)
        before = column
    return columns_of


def by_rows(table: Columns, columns: Sequence[str]) -> list[tuple[NDArray[np.bool_], list[str]]]:
    """Columns of one clock by the rows that hold them: all of them together, or some where others have gaps.

    A union of logs has a row for each time of each.
    """
    every = np.ones(len(next(iter(table.values()))), dtype=bool)
    groups: list[tuple[NDArray[np.bool_], list[str]]] = []
    for column in columns:
        values = table[column]
        rows = np.isfinite(values) if values.dtype.kind == "f" else every
        beside = next((names for filled, names in groups if not _alternate(filled, rows)), None)
        if beside is None:
            groups.append((rows, [column]))
        else:
            beside.append(column)
    return groups if len(groups) > 1 else [(every, list(columns))]


def _alternate(rows: NDArray[np.bool_], others: NDArray[np.bool_]) -> bool:
    """Whether rows lie among others, but are seldom the same."""
    least = min(rows.sum(), others.sum())
    if not least or 2 * (rows & others).sum() >= least:
        return False
    (first, last), (start, end) = (np.flatnonzero(these)[[0, -1]] for these in (rows, others))
    return bool(2 * (min(last, end) - max(first, start)) > min(last - first, end - start))


def starts_again(time: Array) -> NDArray[np.int64]:
    """Places at which the time goes back, among samples that have one."""
    return np.flatnonzero(np.diff(time[np.isfinite(time)]) < 0.0) + 1


def even_step(time: Array) -> float:
    """Step of samples whose rounded times repeat, s; 0 if they do not."""
    known = time[np.isfinite(time)]
    steps = np.diff(known)
    if len(known) < 3 or (steps < 0.0).any() or (steps > 0.0).all() or not steps.any():
        return 0.0
    numbers = np.arange(len(known))
    slope = float(np.polyfit(numbers, known, 1)[0])
    # The simplest number that keeps every sample within the rounding.
    for digits in range(1, 9):
        step = float(f"{slope:.{digits - 1}e}")
        if abs(step - slope) * len(known) <= steps[steps > 0.0].min():
            return step
    return slope


def is_digitised(time: Array) -> bool:
    """Whether times are as uneven as those of points read off a figure.

    A recorder that loses samples still has most steps alike.
    """
    steps = np.diff(time[np.isfinite(time)])
    if not 2 < len(steps) < _MOST_POINTS:
        return False
    middle = np.median(np.abs(steps))
    return bool((np.abs(steps - middle) > _EVEN * middle).mean() > 0.5)


def _in_order(time: Array, values: Array) -> tuple[Array, Array]:
    """Points of a curve by time; of points at one time the mean."""
    known = np.isfinite(time) & np.isfinite(values)
    places, index = np.unique(time[known], return_inverse=True)
    return places, np.bincount(index, values[known]) / np.bincount(index)


def _read_off(series: _Curves) -> tuple[Array, dict[Use, Array]]:
    """Curves on one even grid, smoothed as cross-validation finds best."""
    from scipy.interpolate import make_smoothing_spline

    if few := [use for use, (time, _) in series.items() if len(time) < 5]:
        raise ConfigError(f"the curve of {few[0]} has fewer than five points")
    times = [time for time, _ in series.values()]
    start, end = max(float(time[0]) for time in times), min(float(time[-1]) for time in times)
    if end <= start:
        raise ConfigError("its curves have no time in common")
    densest = min(median_step(time) for time in times)
    count = max(int(np.ceil((end - start) / min(0.5 * densest, _FINEST))), 1)
    grid = np.linspace(start, end, count + 1)
    # Smoothed to the stated error, a motion would lose its corners to a careful reader.
    return grid, {use: make_smoothing_spline(time, values)(grid) for use, (time, values) in series.items()}
