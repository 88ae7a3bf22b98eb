"""The runs of a comparison as linear loops, and those of them that grow."""

from __future__ import annotations

from typing import NamedTuple

from tendonrepro.configuration.load import CompareConfig, LoadedConfig
from tendonrepro.experiments.loops import build_law, build_reference
from tendonrepro.experiments.rig import build_plant
from tendonrepro.physics.control import Law
from tendonrepro.physics.dynamics import Plant
from tendonrepro.physics.linear_loop import loop_matrix, modes, slowest, stroke


class View(NamedTuple):
    """One run as a linear loop."""

    law_name: str
    law: Law
    plant: Plant
    payload: float
    delay: int


def run_views(config: CompareConfig) -> dict[str, View]:
    """Law, plant and delay of every run."""
    delay = int(config.manipulator.actuator.output_delay.si)
    return {
        name: View(
            run.law, build_law(config, run.law), build_plant(config, run.payload.si), run.payload.si, delay
        )
        for name, run in config.runs.items()
    }


def growing(loaded: LoadedConfig) -> dict[str, float]:
    """Runs of a comparison whose linear loop grows somewhere on the motion, and the frequency at which, Hz.

    A run may end before slow growth is seen in its status.
    """
    config = loaded.config
    if not isinstance(config, CompareConfig):
        return {}
    postures = stroke(build_reference(config.reference, config, loaded.folder).q_d)
    found = {}
    for name, view in run_views(config).items():
        matrices = [loop_matrix(q, view.plant, view.law, view.delay) for q in postures]
        growth, hertz = slowest([modes(matrix, view.law.L) for matrix in matrices], 0.0)
        if growth > 0.0:
            found[name] = hertz
    return found
