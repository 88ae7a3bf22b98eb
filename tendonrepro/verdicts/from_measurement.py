"""Claims and numbers judged by "On the measurement" in docs/verdicts.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import FIRST, LOADED
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import COMPARED, Published
from tendonrepro.errors import DataMissingError
from tendonrepro.physics.metrics import mae, start_level
from tendonrepro.results.records import Trace, TraceFile
from tendonrepro.results.summary import CONTROLLERS
from tendonrepro.verdicts.formulas import NUMBERS, PERCENTAGES, cut, formula_of
from tendonrepro.verdicts.measurement import RATE_WINDOW, Measurement, signal_of
from tendonrepro.verdicts.plants import Plants
from tendonrepro.verdicts.rules import Evidence, Ruling, not_testable, of_model
from tendonrepro.verdicts.statements import Claim, claim_on, larger_with_load, together

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
    if rule == "payload":
        return _payload(measurement, paper)
    arm, runs = Plants(measurement, PRINTED), measurement.compare.runs
    claim = claim_on(arm, paper, rule)
    remarks = []
    if rule == "stable":
        for run in CONTROLLERS:
            # A status that was judged without the error of a joint says nothing about it.
            arm.statistic(run, "max_error")
        remarks += [f"{run} is {runs[run].told_status}" for run in CONTROLLERS if runs[run].status != "ok"]
    else:
        _check_ok(claim, runs, (*CONTROLLERS, LOADED))
    if rule == "similar_surfaces" and "s" not in runs[FIRST]:
        remarks.append(
            "s was not recorded: computed from e by Eq. (11) with the printed gains, the rate of e by its "
            f"difference over {1e3 * RATE_WINDOW:g} ms"
        )
    measures = [name for name, parts in claim.measures.items() if together(parts)[0]]
    if measures and len(claim.measures) > 1:
        remarks.append(f"holds by {', '.join(measures)}")
    return of_model(bool(measures), evidence=_evidence(claim, arm, measurement, remarks))


def _payload(measurement: Measurement, paper: Published) -> Ruling:
    """P1: it needs Controller 1 and the loaded run alone, and its percentages besides."""
    arm = Plants(measurement, PRINTED)
    claim = Claim(larger_with_load(arm), arm.ok(FIRST, LOADED), None)
    _check_ok(claim, measurement.compare.runs, (FIRST, LOADED))
    increases = {
        name: _number(measurement, paper, name).verdict
        for name in paper.judgements
        if name.startswith("increase.")
    }
    holds = together(claim.statements)[0] and {*increases.values()} == {"reproduced"}
    return of_model(holds, evidence=_evidence(claim, arm, measurement, []) | {"percentages": increases})


def _check_ok(claim: Claim, runs: Mapping[str, Trace], needed: Sequence[str]) -> None:
    """Refuse to judge where a run that was measured diverged or rings."""
    if not claim.judged[0]:
        lost = next(run for run in needed if run in runs and runs[run].status != "ok")
        raise DataMissingError(f"a run of {lost} that is ok; the one measured is {runs[lost].told_status}")


def _evidence(claim: Claim, arm: Plants, measurement: Measurement, remarks: list[str]) -> Evidence:
    """Statements, what they were judged by, and over which window."""
    statements = [{"statement": part.text, "holds": bool(part.holds[0])} for part in claim.statements]
    statistics: dict[str, dict[str, list[float]]] = {}
    for (run, name), (sizes,) in arm.looked_up.items():
        _, unit = signal_of(name)
        shown = sizes if unit == "N_m" else np.rad2deg(sizes)
        statistics.setdefault(str(run), {})[f"{name}_{unit}"] = shown.tolist()
    evidence = {"statements": statements, "statistics": statistics, "remarks": remarks}
    by_tables = any("mae_deg" in sizes for sizes in statistics.values())
    return evidence | ({"window": measurement.tables.window} if by_tables else {})


def decoupling(file: TraceFile) -> Ruling:
    """K3: joint angles from the motors against the encoders."""
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
    ways = {"start_offset_removed": apart - start_level(time, apart), "as_recorded": apart}
    rows = {name: _agreement(mae(difference), reach) for name, difference in ways.items()}
    decided, other = (all(row["holds"] for row in rows[name]["statements"]) for name in ways)
    remarks = [] if decided == other else ["with the start offset left in, the verdict is the other one"]
    return of_model(decided, evidence=rows | {"remarks": remarks})


def _agreement(size: Array, reach: Array) -> Evidence:
    statements = {
        "joint 3's error is the largest": size[2] > size[:2].max(),
        f"joint 1's error is below {100 * TINY:g} % of its range": size[0] < TINY * reach[0],
        f"every error is below {100 * AGREES:g} % of the joint's range": (size < AGREES * reach).all(),
    }
    return {
        "mae_deg": np.rad2deg(size).tolist(),
        "share_of_range": (size / reach).tolist(),
        "statements": [{"statement": text, "holds": bool(holds)} for text, holds in statements.items()],
    }


def motor_angles(file: TraceFile) -> Ruling:
    """K5: motor angles from measured against desired joint angles."""
    rows = []
    for name in CONTROLLERS:
        trace = file.part("compare").runs.get(name)
        if trace is None or not {"q_d", "q_encoder"} <= trace.variables.keys():
            continue
        # An encoder at rest may have been recorded without a desired angle.
        there = np.isfinite(trace["q_d"] + trace["q_encoder"]).any(axis=0)
        trace = trace.of_joints(np.compress(there, trace.joint).tolist())
        if not {*COMPARED} <= {*trace.joint}:
            continue
        S_inv = file.plant.matrix("S_inv", trace.joint)
        known = np.isfinite(trace["q_d"] + trace["q_encoder"]).all(axis=1)
        desired, angles = (trace[variable][known] @ S_inv.T for variable in ("q_d", "q_encoder"))
        # Motor 3 hardly turns where joints 2 and 3 move alike, so its own range is no measure.
        reach = np.ptp(desired, axis=0).max() if known.any() else 0.0
        if reach < LEAST_RANGE:
            continue
        for motor, apart in zip(trace.joint, mae(angles - desired), strict=True):
            text = f"{name}, motor {motor}: MAE is below {100 * AGREES:g} % of the largest range of a motor"
            sizes = {"mae_deg": float(np.rad2deg(apart)), "share_of_range": float(apart / reach)}
            rows.append({"statement": text, "holds": bool(apart < AGREES * reach)} | sizes)
    if not rows:
        raise DataMissingError("q_encoder and q_d of joints 2 and 3 of a controller whose motors move")
    return of_model(all(row["holds"] for row in rows), evidence={"statements": rows})


ANGLES: Mapping[str, Callable[[TraceFile], Ruling]] = {"K3": decoupling, "K5": motor_angles}
"""Claims that compare angles."""
