"""Whether a run is the paper's own experiment: only then does the print stand beside it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from tendonrepro.arrays import Array
from tendonrepro.config.models.experiment import CompareConfig
from tendonrepro.config.models.manipulator import Manipulator
from tendonrepro.config.models.readings import RUNS
from tendonrepro.config.published import COMPARED, PrintedText, coupling_of, published, table_1
from tendonrepro.physics.kinematics import coupling_inverse
from tendonrepro.results.records import Trace, TraceFile

_ARM, _PAYLOAD = "hardware.arm", "hardware.payload"

OTHER_BASE = (
    "The base has not the paper's arm, gains and payload, so nothing here speaks of the paper, although its "
    "numbers stand beside."
)
"""Conclusion of an ensemble or a search where `base_of_paper` does not hold."""


def of_paper(file: TraceFile, trace: Trace | None = None) -> bool:
    """Whether a run has the paper's arm, joints, gains and payload; without a run, whether it is the arm.

    An arm is known by its name and its coupling; what the paper does not print, such as masses and motions,
    may differ, and so may readings. Of a measurement more joints may have been recorded, and gains are not
    known.

    Parameters
    ----------
    file : TraceFile
    trace : Trace, optional
        A run of it.

    Returns
    -------
    bool
    """
    plant = file.plant
    S_inv = plant.values["S_inv"].value if "S_inv" in plant.values else None
    if not _arm_of_paper(plant.attributes.get("arm"), S_inv):
        return False
    if trace is None or file.source == "measured":
        return True
    held = trace.attributes
    return trace.joint == COMPARED and _driven_as_paper(
        trace.name, held["law"], held["gains"], held["payload_mass"]
    )


def base_of_paper(config: CompareConfig) -> bool:
    """Whether what plants are drawn around has the paper's arm, gains and payload; see `of_paper`."""
    gains = {name: held.si for name, held in config.control.gains if held}
    return is_arm_of_paper(config.manipulator) and all(
        _driven_as_paper(name, run.law, gains, run.payload.si)
        for name, run in config.runs.items()
        if name in RUNS
    )


def is_arm_of_paper(arm: Manipulator) -> bool:
    """Whether an arm has the paper's name and coupling."""
    routing = arm.routing
    S_inv = coupling_inverse(routing.winch_diameter.si, routing.pulley_diameter.si, routing.sign.si)
    return _arm_of_paper(arm.name, S_inv)


def _arm_of_paper(name: object, S_inv: Array | None) -> bool:
    """By name and coupling, as far as they are known."""
    paper = published()
    arm = paper.entries[_ARM]
    assert isinstance(arm, PrintedText)
    if S_inv is not None:
        # A record of the moving joints alone holds the trailing block.
        block = coupling_of(table_1(paper))[1][-len(S_inv) :, -len(S_inv) :]
        if S_inv.shape != block.shape or not np.allclose(S_inv, block, rtol=1e-9, atol=1e-12):
            return False
    return name in {None, arm.text}


def _driven_as_paper(run: str, law: str, gains: Mapping[str, ArrayLike], payload: float) -> bool:
    """By its law's name, its gains, as far as they are printed, and its payload, kg."""
    paper = published()
    same = (
        np.allclose(ours, paper.per_joint(f"gain.{name}", COMPARED), rtol=1e-9)
        for name, ours in gains.items()
        if f"gain.{name}.joint_{COMPARED[0]}" in paper.entries
    )
    loaded = paper.number(_PAYLOAD) if run.endswith("_payload") else 0.0
    return law == run.removesuffix("_payload") and bool(np.isclose(payload, loaded)) and all(same)


def printed_beside(file: TraceFile, trace: Trace, identifier: str) -> list[float]:
    """Printed numbers ``<identifier>.joint_<number>`` of a run's joints; NaN where none stands beside it."""
    if not of_paper(file, trace):
        return [float("nan")] * len(trace.joint)
    return published().per_joint(identifier, trace.joint)
