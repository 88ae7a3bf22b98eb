"""A measured trace file as a table of one plant; its motion and errors; and claims and numbers judged on it.

The rules are those of "On the measurement" in docs/verdicts.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig, load_config
from tendonrepro.configuration.models.control import FIRST, LOADED
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, METRICS, Published
from tendonrepro.dataset.motion import Reference, derivatives, recover_reference, timing_of
from tendonrepro.dataset.windows import PrintedTables, Timing, try_windows
from tendonrepro.errors import DataMissingError, UsageError, did_you_mean
from tendonrepro.experiments.loops import build_law
from tendonrepro.physics.control import surface_and_feedback
from tendonrepro.physics.metrics import STATUSES, mae, start_level
from tendonrepro.results.records import Trace, TraceFile, median_step
from tendonrepro.results.summary import CONTROLLERS, statistics
from tendonrepro.results.traces import read_traces
from tendonrepro.verdicts.from_print import NUMBERS, PERCENTAGES, ErrorOf, cut, formula_of
from tendonrepro.verdicts.rules import Evidence, Ruling, not_testable, of_model
from tendonrepro.verdicts.statements import Claim, Plants, claim_on, together

_THE_WAY = "make it by tendonrepro data fetch, data inspect --suggest, and data ingest"
RATE_WINDOW = 0.05
"""Time over which the rate of a measured error is taken, s."""

_SIGNALS = dict.fromkeys((*METRICS, "max"), ("e", "deg")) | {
    "s": ("s or e", "deg_per_s"),
    "torque": ("tau_m", "N_m"),
    "H": ("H_hat", "N_m"),
}
"""What a statistic is of and its unit as evidence, by the first word of its name."""


def read_measured(path: Path) -> TraceFile:
    """Read a measured trace file.

    Raises
    ------
    DataMissingError
        If there is none or it cannot be read.
    UsageError
        If it is simulated, or holds no run.
    """
    if not path.exists():
        meant = did_you_mean(path.name, (other.name for other in path.parent.glob("*.h5")))
        raise DataMissingError(f"there is no measured trace file{meant}", where=str(path), hint=_THE_WAY)
    file = read_traces(path)
    if file.source != "measured":
        raise UsageError("holds simulated traces, not measured ones", where=str(path), hint=_THE_WAY)
    if not file.runs:
        raise UsageError("holds no runs", where=str(path), hint="name them under runs of the mapping")
    return file


@dataclass(frozen=True)
class Measurement:
    """A measured file and what follows from it: a table of one plant, the arm that was measured.

    `unrecovered` says why there is no `reference`. `timing` is of every run of the comparison.
    """

    file: TraceFile
    tables: PrintedTables
    reference: Reference | None
    unrecovered: str = ""
    timing: Mapping[str, Timing] = field(default_factory=dict)
    joints: ClassVar[tuple[int, ...]] = COMPARED
    replicate: ClassVar[NDArray[np.int64]] = np.zeros(1, np.int64)
    _kept: dict[str, dict[str, Array]] = field(default_factory=dict, repr=False)

    @cached_property
    def compare(self) -> TraceFile:
        """Its runs of the comparison."""
        return self.file.part("compare")

    def has(self, run: str, reading: str) -> bool:
        """Whether a run was measured; nobody measured it under another reading."""
        return reading == PRINTED and run in self.compare.runs

    def status(self, run: str, reading: str) -> NDArray[np.int8]:
        """Status code of a run, (1,)."""
        return np.array([STATUSES.index(self._trace(run, reading).status)], dtype=np.int8)

    def statistic(self, run: str, reading: str, name: str) -> Array:
        """One statistic, SI, (1, 2): an error over the window that decides, another over the whole run."""
        trace = self._trace(run, reading)
        if name in METRICS:
            sizes = self.tables.deciding.sizes
            values = np.deg2rad([sizes.get(ErrorOf(run, name, joint).id, np.nan) for joint in self.joints])
        else:
            self._check_alike(name)
            values = self._of_the_run(trace).get(name, np.full(len(self.joints), np.nan))
        for joint, value in zip(self.joints, values, strict=True):
            # NaN is smaller than nothing, so it must not come to a comparison.
            if not np.isfinite(value):
                what = f"{_SIGNALS[name.partition('_')[0]][0]} of the run {run}, joint {joint}"
                raise DataMissingError(f"{what}, or its desired motion q_d")
        return values[np.newaxis]

    def _of_the_run(self, trace: Trace) -> Mapping[str, Array]:
        """All statistics over a whole run, each (2,)."""
        if trace.name not in self._kept:
            rates = None
            with suppress(DataMissingError):
                rates = derivatives(trace)
            self._kept[trace.name] = statistics(with_surface(trace), rates)
        return self._kept[trace.name]

    def _trace(self, run: str, reading: str = PRINTED) -> Trace:
        if not self.has(run, reading):
            raise DataMissingError(f"a measured run {run if reading == PRINTED else f'{run}@{reading}'}")
        trace = self.compare.runs[run].of_joints(self.joints)
        if trace.joint != self.joints:
            raise DataMissingError(f"joints 2 and 3 of the run {run}")
        return trace

    def _check_alike(self, name: str) -> None:
        """Refuse to compare what was recorded differently."""
        if name == "torque_step_rms":
            steps = [median_step(self._trace(run).time) for run in CONTROLLERS]
            if max(steps) > 1.01 * min(steps):
                raise DataMissingError("runs sampled alike: steps of the torque cannot be compared otherwise")
        runs = self.compare.runs
        if name.startswith("s_") and len({"s" in runs[run] for run in CONTROLLERS if run in runs}) > 1:
            raise DataMissingError("s of all controllers: recorded and computed ones cannot be compared")


def measurement_of(file: TraceFile, paper: Published | None, joints: Sequence[int] = COMPARED) -> Measurement:
    """Recover the reference of these joints; try every averaging window, where a paper prints errors."""
    reference, unrecovered = None, ""
    try:
        reference = recover_reference(file, joints)
    except DataMissingError as error:
        unrecovered = str(error).replace("\n", "; ")
    timing = timing_of(file, reference)
    tables = try_windows(file.part("compare"), paper, timing) if paper else PrintedTables()
    return Measurement(file, tables, reference, unrecovered, timing)


def with_surface(trace: Trace) -> Trace:
    """The run of joints 2 and 3 with its sliding variable: recorded, else by Eq. (11) from its error.

    A rate from sample to sample shows the encoder's steps. So it is taken over `RATE_WINDOW`, half of which
    is missing at both ends.
    """
    if "s" in trace or "e" not in trace:
        return trace
    config = load_config(None, "compare").config
    assert isinstance(config, CompareConfig)
    law, e = build_law(config, config.runs[trace.name].law), trace["e"]
    rate = _rate(trace.time, e)
    surfaces = [surface_and_feedback(e[:, i], rate[:, i], law, i)[0] for i in range(len(trace.joint))]
    return replace(trace, variables={**trace.variables, "s": np.stack(surfaces, axis=1)})


def _rate(time: Array, e: Array) -> Array:
    """Difference over `RATE_WINDOW`, or two longer steps, (T, n)."""
    step = median_step(time) if len(time) > 1 else RATE_WINDOW
    half = max(0.5 * RATE_WINDOW, step)
    ends = [
        np.stack([np.interp(time + apart, time, column, np.nan, np.nan) for column in e.T], axis=1)
        for apart in (-half, half)
    ]
    return np.asarray((ends[1] - ends[0]) / (2.0 * half))


JUDGED = ("K3", "K5", "C1", "C2", "F1", "F2", "C3", "C4", "C5", "C6", "P1")
"""Claims that a measurement is asked about."""

TINY, AGREES = 0.01, 0.05
"""Largest errors of K3 and K5 as shares of a joint's or motor's range."""
LEAST_RANGE = float(np.deg2rad(1.0))
"""Range below which a joint or motor counts as at rest, rad."""


def judge_measured(measurement: Measurement, paper: Published) -> dict[str, Ruling]:
    """Judge the claims `JUDGED` and all printed errors and percentages, by id."""
    numbers = [name for name, how in paper.judgements.items() if how.rule in (*NUMBERS, "same_as")]
    rulings = {name: _number(measurement, paper, name) for name in numbers}
    for name in JUDGED:
        try:
            rulings[name] = _claim(measurement, paper, name)
        except DataMissingError as error:
            rulings[name] = not_testable(error.message)
    return rulings


def _number(measurement: Measurement, paper: Published, identifier: str) -> Ruling:
    """Judge a percentage by how it would be printed, others by the printed interval."""
    tables, formula = measurement.tables, formula_of(paper, identifier)
    window: Evidence = {"window": tables.window}
    sizes: list[float | Fraction] = []
    for error in formula.errors:
        if error.id not in tables.deciding.sizes:
            return not_testable(f"the measured errors of {error}", **window)
        sizes.append(tables.deciding.sizes[error.id])
    by_digits = identifier.startswith(PERCENTAGES)
    if by_digits:
        # As the paper's own percentages, those of a measurement follow from what its tables would print.
        decimals = [paper.digits(name).decimals for name in formula.names]
        sizes = [Fraction(f"{size:.{places}f}") for size, places in zip(sizes, decimals, strict=True)]
    try:
        ours = formula.value(*sizes)
    except ZeroDivisionError:
        return not_testable(f"an error of {formula.errors[-1]} that is not zero", **window)
    low, high = paper.interval(identifier)
    holds = cut(ours, paper.digits(identifier)) != "neither" if by_digits else low <= ours <= high
    return of_model(holds, float(ours), window)


def _claim(measurement: Measurement, paper: Published, identifier: str) -> Ruling:
    """Judge a claim: it holds where all its statements do, by one of its measures."""
    rule = paper.judgements[identifier].rule
    if identifier in ANGLES:
        return ANGLES[identifier](measurement.file)
    arm, runs = Plants(measurement, PRINTED), measurement.compare.runs
    claim = claim_on(arm, paper, rule)
    measured = [run for run in (*CONTROLLERS, LOADED) if run in runs]
    stopped = {run: runs[run].told_status for run in measured if runs[run].status != "ok"}
    remarks = []
    if rule == "stable":
        for run in CONTROLLERS:
            # A status that was judged without the error of a joint says nothing about it.
            arm[run, "max_error"]
        remarks += [f"{run} is {told}" for run, told in stopped.items()]
    elif not claim.judged[0]:
        run, told = next(iter(stopped.items()))
        raise DataMissingError(f"a run of {run} that is ok; the one measured is {told}")
    if rule == "similar_surfaces" and "s" not in runs[FIRST]:
        remarks.append(
            "s was not recorded: computed from e by Eq. (11) with the printed gains, the rate of e by its "
            f"difference over {1e3 * RATE_WINDOW:g} ms"
        )
    measures = [name for name, parts in claim.measures.items() if together(parts)[0]]
    if measures and len(claim.measures) > 1:
        remarks.append(f"holds by {', '.join(measures)}")
    evidence = _evidence(claim, arm, measurement) | {"remarks": remarks}
    if rule != "payload":
        return of_model(bool(measures), evidence=evidence)
    increases = {
        name: _number(measurement, paper, name).verdict
        for name in paper.judgements
        if name.startswith("increase.")
    }
    holds = bool(measures) and {*increases.values()} == {"reproduced"}
    return of_model(holds, evidence=evidence | {"percentages": increases})


def _evidence(claim: Claim, arm: Plants, measurement: Measurement) -> Evidence:
    """Statements, what they were judged by, and over which window."""
    statements = [{"statement": part.text, "holds": bool(part.holds[0])} for part in claim.statements]
    sizes: dict[str, dict[str, list[float]]] = {}
    for (run, name), (values,) in arm.looked_up.items():
        unit = _SIGNALS[name.partition("_")[0]][1]
        shown = values if unit == "N_m" else np.rad2deg(values)
        sizes.setdefault(str(run), {})[f"{name}_{unit}"] = shown.tolist()
    evidence = {"statements": statements, "statistics": sizes}
    by_tables = any("mae_deg" in shown for shown in sizes.values())
    return evidence | ({"window": measurement.tables.window} if by_tables else {})


def decoupling(file: TraceFile) -> Ruling:
    """K3: joint angles from the motors against the encoders, less their difference at the start."""
    trace = file.part("decouple").runs.get("decouple")
    if trace is None or trace.joint != (1, 2, 3):
        raise DataMissingError("all of joints 1 to 3 in a measured run decouple")
    encoder = trace["q_encoder"]
    calculated = trace.variables.get("q_calculated")
    if calculated is None:
        calculated = trace["q_motor_encoder"] @ file.plant.matrix("S", trace.joint).T
    apart = calculated - encoder
    known = np.isfinite(apart).all(axis=1)
    time, apart = trace.time[known], apart[known]
    reach = np.nanmax(encoder, axis=0) - np.nanmin(encoder, axis=0)
    if not len(apart) or (reach < LEAST_RANGE).any():
        raise DataMissingError("a run decouple in which joints 1 to 3 all move")
    size = mae(apart - start_level(time, apart))
    holds = {
        "joint 3's error is the largest": size[2] > size[:2].max(),
        f"joint 1's error is below {100 * TINY:g} % of its range": size[0] < TINY * reach[0],
        f"every error is below {100 * AGREES:g} % of the joint's range": (size < AGREES * reach).all(),
    }
    sizes = {"mae_deg": np.rad2deg(size).tolist(), "share_of_range": (size / reach).tolist()}
    rows = [{"statement": text, "holds": bool(part)} for text, part in holds.items()]
    return of_model(all(holds.values()), evidence=sizes | {"statements": rows})


def motor_angles(file: TraceFile) -> Ruling:
    """K5: motor angles from measured against desired joint angles."""
    rows = []
    for name in CONTROLLERS:
        trace = file.part("compare").runs.get(name)
        if trace is None or not {"q_d", "q_encoder"} <= trace.variables.keys():
            continue
        trace = trace.of_joints(COMPARED)
        known = np.isfinite(trace["q_d"] + trace["q_encoder"]).all(axis=1)
        if trace.joint != COMPARED or not known.any():
            continue
        S_inv = file.plant.matrix("S_inv", COMPARED)
        desired, angles = (trace[variable][known] @ S_inv.T for variable in ("q_d", "q_encoder"))
        # Motor 3 hardly turns where joints 2 and 3 move alike, so its own range is no measure.
        reach = np.ptp(desired, axis=0).max()
        if reach < LEAST_RANGE:
            continue
        for motor, apart in zip(COMPARED, mae(angles - desired), strict=True):
            text = f"{name}, motor {motor}: MAE is below {100 * AGREES:g} % of the largest range of a motor"
            sizes = {"mae_deg": float(np.rad2deg(apart)), "share_of_range": float(apart / reach)}
            rows.append({"statement": text, "holds": bool(apart < AGREES * reach)} | sizes)
    if not rows:
        raise DataMissingError("q_encoder and q_d of joints 2 and 3 of a controller whose motors move")
    return of_model(all(row["holds"] for row in rows), evidence={"statements": rows})


ANGLES: Mapping[str, Callable[[TraceFile], Ruling]] = {"K3": decoupling, "K5": motor_angles}
"""Claims that compare angles."""
