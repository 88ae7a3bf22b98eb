"""From tables and a mapping to runs: SI units, one time base, errors derived."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.dataset.mapping import MappingFile, Run, Use
from tendonrepro.dataset.source import Source
from tendonrepro.errors import ConfigError
from tendonrepro.results.records import Trace
from tendonrepro.results.summary import MEASURED

SAME_TIME = 1e-3
"""Largest difference of times that count as equal, as a share of the step."""
_THIRD = {"q_d": "q_encoder + e", "q_encoder": "q_d - e", "e": "q_d - q_encoder"}
_MOST_TURN_DEG = 190.0
_STEPS = 5e-5, 0.1
"""s, beyond which the unit of the times is in doubt."""
_CONTRADICTS = 0.5
"""RMS of recorded error less difference, over that of the difference: more is not believed."""
_FAR_APART = 0.2
"""Of calculated and measured joint angle, over its range: no tendon stretches by so much."""

StatusOf = Callable[[Array, Array], tuple[str, float]]
"""Time and error without gaps to status and its time."""


@dataclass
class Assembly:
    """Runs in the making.

    Attributes
    ----------
    sources : sequence of Source
    mapping : MappingFile
    S : array (3, 3)
        Coupling matrix.
    status_of : callable
    notes, doubts : list of str
        What was done to the numbers on the way, and what looks wrong.
    """

    sources: Sequence[Source]
    mapping: MappingFile
    S: Array
    status_of: StatusOf
    notes: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def runs(self) -> dict[str, Trace]:
        """All runs of the mapping, in its order.

        Raises
        ------
        ConfigError
            Where the mapping does not fit the tables.
        """
        return {name: self._run(name, run) for name, run in self.mapping.runs.items()}

    def used(self) -> list[Source]:
        """Tables that a run is made of."""
        names = {self._source(name, run).name for run in self.mapping.runs.values() for name in run.sources}
        return [source for source in self.sources if source.name in names]

    def _run(self, name: str, run: Run) -> Trace:
        time, found = self._signals(run)
        joints = tuple(sorted({use.joint for use in found}))
        variables: dict[str, Array] = {}
        for use, values in found.items():
            block = variables.setdefault(use.variable, np.full((len(time), len(joints)), np.nan))
            block[:, joints.index(use.joint)] = values
        if time[0] != 0.0:
            self.notes.append(f"{name}: time starts at {time[0]:.6g} s in the files, at 0 here")
            time = time - time[0]
        self._complete(name, variables, joints)
        self._calculate(name, variables, joints)
        attributes = {
            "law": MEASURED,
            "gains": {},
            "readings": {},
            "payload_mass": run.payload_mass,
            "reference_period": run.period or 0.0,
            **self._status(time, variables, joints),
        }
        trace = Trace(name, time, joints, variables, attributes)
        self.doubts += [f"{name}: {doubt}" for doubt in doubts_about(trace)]
        return trace

    def _signals(self, run: Run) -> tuple[Array, dict[Use, Array]]:
        """Common times, s, and values, SI, of all columns of a run."""
        series: dict[Use, tuple[Array, Array]] = {}
        for name in run.sources:
            source = self._source(name, run)
            uses = self._uses(source, run, taken={(use.variable, use.joint) for use in series})
            if not any(use.variable != "time" for use in uses.values()):
                continue
            rows = self._rows(source, run)
            time = self._times(source, uses, run, rows)
            kept = np.isfinite(time)
            kept &= (time >= (-np.inf if run.first is None else run.first)) & (
                time <= (np.inf if run.last is None else run.last)
            )
            self._check_times(time[kept], source, run)
            for column, use in uses.items():
                if use.variable != "time":
                    series[use] = time[kept], _in_si(source.columns[column], use)[rows][kept]
        if not series:
            raise ConfigError("none of its tables has a column that the mapping knows", where=run.place)
        return self._common(series, run)

    def _source(self, name: str, run: Run) -> Source:
        """Find a table by its name, or by the only one that ends with it."""
        exact = [source for source in self.sources if source.name == name]
        ends = [source for source in self.sources if source.name.endswith(f"/{name}")]
        found = exact or ends
        if len(found) != 1:
            message = f"there is no table {name!r}" if not found else f"{name!r} could be several tables"
            held = ", ".join(source.name for source in self.sources) or "none"
            raise ConfigError(message, where=run.place, hint=f"tables: {held}")
        return found[0]

    def _uses(self, source: Source, run: Run, taken: set[tuple[str, int]]) -> dict[str, Use]:
        """Columns of a table that a run takes, but for variables it has already."""
        found = {}
        for name, use in run.columns.items():
            table, _, column = name.rpartition(":") if name not in source.columns else ("", "", name)
            meant = not table or f"/{source.name}".endswith(f"/{table}")
            if meant and column in source.columns and (use.variable, use.joint) not in taken:
                found[column] = use
        return found

    def _rows(self, source: Source, run: Run) -> NDArray[np.bool_]:
        """Rows that meet the conditions of a run."""
        rows = np.ones(len(next(iter(source.columns.values()))), bool)
        for column, wanted in run.where.items():
            if column not in source.columns:
                raise ConfigError(f"{source.name} has no column {column!r}", where=run.place)
            values = source.columns[column]
            rows &= np.isclose(values, wanted) if values.dtype.kind == "f" else values == str(wanted)
        if not rows.any():
            raise ConfigError(f"no row of {source.name} meets {dict(run.where)}", where=run.place)
        return rows

    def _times(self, source: Source, uses: dict[str, Use], run: Run, rows: NDArray[np.bool_]) -> Array:
        for column, use in uses.items():
            if use.variable == "time":
                return _in_si(source.columns[column], use)[rows]
        if run.step is None:
            hint = "give its column of times the line 'NAME: time s', or the run 'step_s: 0.001'"
            raise ConfigError(f"{source.name} has no times", where=run.place, hint=hint)
        return np.asarray(run.step * np.arange(rows.sum()))

    def _check_times(self, time: Array, source: Source, run: Run) -> None:
        if len(time) < 2:
            message = f"{source.name} has fewer than two samples from from_s to to_s"
            raise ConfigError(message, where=run.place)
        late = np.flatnonzero(np.diff(time) <= 0.0)
        if late.size:
            k = int(late[0])
            message = (
                f"the time of {source.name} does not increase: {time[k]:.6g} s, then {time[k + 1]:.6g} s"
            )
            hint = "several runs below each other? `where` takes the rows of one"
            raise ConfigError(message, where=run.place, hint=hint)

    def _common(self, series: dict[Use, tuple[Array, Array]], run: Run) -> tuple[Array, dict[Use, Array]]:
        """All on the times they share, or on even ones if the mapping says so."""
        times = [time for time, _ in series.values()]
        first, step = times[0], self.mapping.resample
        if step is None:
            for time in times[1:]:
                near = len(time) == len(first) and np.abs(time - first).max() <= SAME_TIME * np.median(
                    np.diff(first)
                )
                if not near:
                    message = f"its tables have other times: {len(first)} and {len(time)} samples"
                    hint = "`resample_s: 0.001` at the top of the mapping puts all on common times"
                    raise ConfigError(message, where=run.place, hint=hint)
            return first, {use: values for use, (_, values) in series.items()}
        start, end = max(time[0] for time in times), min(time[-1] for time in times)
        if end - start < 0.5 * max(time[-1] - time[0] for time in times):
            message = f"its tables have only {max(end - start, 0.0):.6g} s in common"
            raise ConfigError(
                message, where=run.place, hint="two clocks? 'time us - OFFSET' moves one of them"
            )
        even = start + step * np.arange(int((end - start) / step + 1e-6) + 1)
        self.notes.append(f"resampled every {step:g} s: {len(even)} samples of up to {max(map(len, times))}")
        return even, {use: np.interp(even, time, values) for use, (time, values) in series.items()}

    def _complete(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        """Of desired angle, measured angle and error find the third; the difference counts."""
        if len(variables.keys() & _THIRD.keys()) < 2:
            return
        absent = np.full_like(next(iter(variables.values())), np.nan)
        q_d, q, e = (variables.get(key, absent).copy() for key in _THIRD)
        for k, joint in enumerate(joints):
            recorded = e[:, k].copy()
            for key, block, third in (("q_d", q_d, q + e), ("q_encoder", q, q_d - e)):
                if np.isnan(block[:, k]).all() and not np.isnan(third[:, k]).all():
                    block[:, k] = third[:, k]
                    self.notes.append(f"{name}: {key} of joint {joint} is {_THIRD[key]}; sign of e: `* -1`")
            e[:, k] = q_d[:, k] - q[:, k]
            self._doubt_error(f"{name}: e of joint {joint}", recorded, e[:, k])
        variables |= {"q_d": q_d, "q_encoder": q, "e": e}

    def _doubt_error(self, what: str, recorded: Array, difference: Array) -> None:
        """Say where a recorded error contradicts the angles."""
        known = np.isfinite(recorded - difference)
        apart = (recorded - difference)[known]
        if known.any() and np.linalg.norm(apart) > _CONTRADICTS * np.linalg.norm(difference[known]):
            off = np.rad2deg(np.abs(apart).max())
            self.doubts.append(f"{what} is up to {off:.3g} deg off q_d - q_encoder: look at unit and sign")

    def _calculate(self, name: str, variables: dict[str, Array], joints: tuple[int, ...]) -> None:
        """Joint angles from motors."""
        if (
            "q_motor_encoder" in variables
            and "q_calculated" not in variables
            and joints in {(1, 2, 3), (2, 3)}
        ):
            index = np.array(joints) - 1
            variables["q_calculated"] = variables["q_motor_encoder"] @ self.S[np.ix_(index, index)].T
            self.notes.append(f"{name}: q_calculated is S q_motor_encoder")

    def _status(self, time: Array, variables: dict[str, Array], joints: tuple[int, ...]) -> dict[str, Any]:
        """Status by the error, with the joints it is of; gaps are bridged, they are not divergence."""
        found: dict[str, tuple[float, list[int]]] = {}
        for k, joint in enumerate(joints if "e" in variables else ()):
            e = variables["e"][:, k]
            known = np.isfinite(e)
            # A joint that is held is in the dither of its encoder, which is no ringing.
            if known.any() and np.ptp(variables.get("q_d", variables["e"])[known, k]) > np.deg2rad(0.03):
                status, end = self.status_of(time, np.interp(time, time[known], e[known])[:, np.newaxis])
                first, of = found.get(status, (end, []))
                found[status] = min(first, end), [*of, joint]
        worst = next((status for status in ("diverged", "ringing") if status in found), "ok")
        end, of = found.get(worst, (float(time[-1]), []))
        judged = {"status": worst, "status_time": end}
        return judged if worst == "ok" else judged | {"status_joints": of}


def _in_si(values: NDArray[Any], use: Use) -> Array:
    if values.dtype.kind != "f":
        raise ConfigError(f"the column of {use} holds words", where="the mapping")
    return np.asarray((use.factor * values + use.offset) * use.to_si, np.float64)


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
    if "e" in trace and "q_d" in trace:
        sizes = zip(trace.joint, trace["e"].T, trace["q_d"].T, strict=True)
        for joint, e, q_d in sizes:
            if np.isfinite(e).any() and np.nanmean(np.abs(e)) > 0.1 * max(
                np.nanmax(q_d) - np.nanmin(q_d), 1e-3
            ):
                doubts.append(f"the error of joint {joint} is a tenth of its motion: check columns and units")
    if {"q_calculated", "q_encoder"} <= trace.variables.keys():
        apart = np.abs(trace["q_calculated"] - trace["q_encoder"])
        for joint, far, q in zip(trace.joint, apart.T, trace["q_encoder"].T, strict=True):
            if np.isfinite(far).any() and np.nanmax(far) > _FAR_APART * max(
                np.nanmax(q) - np.nanmin(q), 1e-3
            ):
                doubts.append(f"the motors do not fit joint {joint}: check sign, gear and unit of the motors")
    return doubts
