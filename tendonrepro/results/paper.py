"""Whether a run is the paper's own experiment: only then does the print stand beside it."""

from __future__ import annotations

import numpy as np

from tendonrepro.config.published import COMPARED, PrintedText, coupling_of, published, table_1
from tendonrepro.results.records import Trace, TraceFile

_ARM, _PAYLOAD = "hardware.arm", "hardware.payload"


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
    paper = published()
    arm = paper.entries[_ARM]
    assert isinstance(arm, PrintedText)
    S_inv, plant = coupling_of(table_1(paper))[1], file.plant
    if "S_inv" in plant.values:
        # A record of the moving joints alone holds the trailing block.
        ours = plant.values["S_inv"].value
        block = S_inv[-len(ours) :, -len(ours) :]
        if ours.shape != block.shape or not np.allclose(ours, block, rtol=1e-9, atol=1e-12):
            return False
    if plant.attributes.get("arm", arm.text) != arm.text:
        return False
    if trace is None or file.source == "measured":
        return True
    loaded = paper.number(_PAYLOAD) if trace.name.endswith("_payload") else 0.0
    gains = (
        np.allclose(ours, paper.per_joint(f"gain.{name}", COMPARED), rtol=1e-9)
        for name, ours in trace.attributes["gains"].items()
        if f"gain.{name}.joint_{COMPARED[0]}" in paper.entries
    )
    return trace.joint == COMPARED and np.isclose(trace.attributes["payload_mass"], loaded) and all(gains)


def printed_beside(file: TraceFile, trace: Trace, identifier: str) -> list[float]:
    """Printed numbers ``<identifier>.joint_<number>`` of a run's joints; NaN where none stands beside it."""
    if not of_paper(file, trace):
        return [float("nan")] * len(trace.joint)
    return published().per_joint(identifier, trace.joint)
