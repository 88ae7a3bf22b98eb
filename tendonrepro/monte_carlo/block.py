"""One block of an ensemble: from its place in the plan to a finished shard."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.load import CompareConfig
from tendonrepro.configuration.models.readings import under
from tendonrepro.configuration.strict_model import Model
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import build_law, build_loops, build_reference, reference_lag, run_status
from tendonrepro.experiments.rig import build_actuator, build_encoder
from tendonrepro.monte_carlo.box import configured, scrambled_sobol
from tendonrepro.monte_carlo.data import Arrays, Block, shard_image
from tendonrepro.monte_carlo.plan import Study
from tendonrepro.physics.instruments import Encoder
from tendonrepro.physics.metrics import STATUSES, mae, rmse
from tendonrepro.simulation.batch import Batch, simulate_batch
from tendonrepro.simulation.loop import DesiredMotion, Loop, TimeDelayController
from tendonrepro.simulation.stepper import simulate

Simulate: TypeAlias = Callable[[Sequence[Loop], Any], Batch]
"""Signature of `tendonrepro.simulation.batch.simulate_batch`."""

DRAWS_AT_ONCE = 32
"""Draws simulated together; more fill the lanes better; each has motions of some 3 MB."""

_MOTION = {"motion", "sampling_period"}
"""Axes of readings that the desired motion depends on."""

_Settings: TypeAlias = tuple[tuple[str, str], ...]

IDEAL = Encoder(resolution=0.0, noise=0.0)


def make_block(study: Study, block: Block, simulate: Simulate = simulate_batch) -> tuple[Block, bytes]:
    """Compute a block as it is stored."""
    return block, shard_image(compute_block(study, block, simulate))


def compute_block(study: Study, block: Block, simulate: Simulate = simulate_batch) -> Arrays:
    """Simulate every case of every draw of a block."""
    box = study.boxes[block.population]
    values = box.values(scrambled_sobol(box, study.seed, block.replicate, block.first, block.count))
    batches = [
        simulate([loop for row in group for loop in loops_of(study, block, row)], study.loaded.compare.status)
        for group in np.split(values, range(DRAWS_AT_ONCE, len(values), DRAWS_AT_ONCE))
    ]

    def by_case(parts: list[Any], kind: type) -> Any:
        """Batches go draw by draw; a reader asks case by case."""
        # What overflows single precision is of a diverged run, and infinite for every purpose.
        with np.errstate(over="ignore"):
            joined: NDArray[Any] = np.concatenate(parts).astype(kind)
        return joined.reshape(-1, len(study.cases), *joined.shape[1:]).swapaxes(0, 1)

    return {
        "draws": values,
        "status": by_case([batch.status for batch in batches], np.int8),
        "check": np.array(json.dumps(spot_check(study, block, values, simulate))),
    } | {
        name: by_case([batch.statistics[name] for batch in batches], np.float32)
        for name in batches[0].statistics
    }


def loops_of(study: Study, block: Block, row: Array) -> Iterator[Loop]:
    """Yield the loops of one draw (P,) by case; what readings leave alone is shared."""
    box, folder = study.boxes[block.population], study.loaded.base.folder
    draw = box.named(row)
    try:
        config = configured(study.loaded.base, box, row)
        printed = dict(build_loops(config, folder))
        motions: dict[tuple[tuple[str, str], ...], DesiredMotion] = {
            (): next(iter(printed.values())).reference
        }
        others: dict[tuple[tuple[str, str], ...], Mapping[str, Loop]] = {}
        for run, case in study.cases:
            changed = under(case, config, draw)
            moving = tuple(setting for setting in case.settings if setting[0] in _MOTION)
            if moving not in motions:
                motions[moving] = build_reference(changed.reference, changed, folder)
            if _same_plant(changed, config, run):
                yield replace(_refitted(printed[run], changed, run), reference=motions[moving])
                continue
            if case.settings not in others:
                others[case.settings] = dict(build_loops(changed, folder, motions[moving]))
            yield others[case.settings][run]
    except TendonreproError as error:
        message = f"a draw of {block} cannot be run: {error.message}"
        raise TendonreproError(message, where=error.where, hint=json.dumps(draw)) from error


def _differing(changed: Model, before: Model) -> set[str]:
    """Sections of a model that are not the same objects."""
    return {name for name in type(before).model_fields if getattr(changed, name) is not getattr(before, name)}


def _same_plant(changed: CompareConfig, before: CompareConfig, run: str) -> bool:
    """Whether a run has the plant and sampling period that it had."""
    parts = _differing(changed.manipulator, before.manipulator)
    same = _differing(changed, before) <= {"control", "manipulator", "reference", "runs"}
    friction = changed.runs[run].friction_scale is before.runs[run].friction_scale
    return same and friction and parts <= {"actuator", "encoders"}


def _refitted(loop: Loop, changed: CompareConfig, run: str) -> Loop:
    """Build only law, instruments and start of a loop anew."""
    encoders, offset = changed.manipulator.encoders, changed.runs[run].start_offset
    return replace(
        loop,
        controller=TimeDelayController(build_law(changed, changed.runs[run].law)),
        cold=changed.control.readings.start == "cold",
        reference_lag=reference_lag(changed),
        start_offset=offset.si if offset else None,
        joint_encoder=build_encoder(encoders.joint),
        motor_encoder=build_encoder(encoders.motor),
        actuator=build_actuator(changed),
    )


def spot_check(
    study: Study, block: Block, values: Array, simulate_together: Simulate = simulate_batch
) -> dict[str, float | int | str | None]:
    """Rerun one experiment of one block in `Study.check_every` with the SciPy stepper and an ideal encoder.

    A hash chooses; other blocks give an empty answer. ``difference`` is the largest relative one of MAE and
    RMSE: 0 if both runs diverged or were not resolved, None where the steppers disagree on the status.
    """
    digest = hashlib.sha256(f"{study.identity} {block}".encode()).digest()
    chosen, place, at = (int.from_bytes(digest[k : k + 8], "big") for k in (0, 8, 16))
    if study.check_every == 0 or chosen % study.check_every:
        return {}
    place, at = place % len(study.cases), at % len(values)
    run, case = study.cases[place]
    loop = replace([*loops_of(study, block, values[at])][place], joint_encoder=IDEAL)
    difference = _difference(loop, simulate_together([loop], study.loaded.compare.status), study)
    return {"run": run, "reading": case.name, "draw": at, "difference": difference}


def _difference(loop: Loop, batch: Batch, study: Study) -> float | None:
    """The ``difference`` of :func:`spot_check`."""
    status = STATUSES[int(batch.status[0])]
    if status == "unresolved":
        return 0.0
    try:
        variables = simulate(loop)
    except TendonreproError:
        return None
    if status != run_status(loop, variables, study.loaded.compare)[0]:
        return None
    if status == "diverged":
        return 0.0
    sizes = np.array([mae(variables["e"]), rmse(variables["e"])])
    found = np.array([batch.statistics[name][0] for name in ("mae", "rmse")])
    return float(np.abs(found / sizes - 1.0).max())
