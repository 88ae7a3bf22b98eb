"""Find the typical plant again and print its sections of a comparison: ``python docs/typical_arm.py``.

It is, of the stable samples as published, the one whose errors are nearest to the medians. Nothing of the paper's results
enters, and no damping is chosen for stability. ``configs/compare.yaml`` and ``configs/lumidouce_ii.yaml`` have its numbers.
It runs 4,096 experiments, some minutes of one processor.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from math import floor, log10
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.published import METRICS
from tendonrepro.configuration.quantity import to_si
from tendonrepro.configuration.strict_yaml import Tree, dump
from tendonrepro.errors import TendonreproError
from tendonrepro.experiments.loops import build_loops
from tendonrepro.monte_carlo.ensemble import load_study
from tendonrepro.monte_carlo.plan import EnsembleStudy, evaluated
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation.batch import simulate_batch

DRAWS = 1024
"""Samples of the preliminary run."""

SECTIONS = ("manipulator", "posture", "reference", "disturbance")
"""What a sample sets of a comparison as published."""

class Preliminary(NamedTuple):
    """Samples (N, P), logarithms of their sixteen errors (N, 16), and which are stable in all runs, (N,)."""

    values: Array
    logs: Array
    stable: NDArray[np.bool_]

    def distances(self, logs: Array) -> Array:
        """Root mean square distance of errors (..., 16) from the medians of the stable samples."""
        return np.asarray(np.sqrt(np.mean((logs - np.median(self.logs[self.stable], axis=0)) ** 2, axis=-1)))

    def typical(self) -> Array:
        """The stable sample (P,) nearest to the medians."""
        place = np.argmin(np.where(self.stable, self.distances(self.logs), np.inf))
        return np.asarray(self.values[place])


def published_study() -> EnsembleStudy:
    """The shipped ranges, with the equations as published alone."""
    return load_study(None, (), None, "printed")


def preliminary(study: EnsembleStudy) -> Preliminary:
    """Run the plants of a study under its first reading."""
    records = np.concatenate([evaluated(study, piece)[1] for piece in study.pieces(DRAWS)])
    places = [study.lookup[run, study.readings[0].name] for run in RUNS]
    sizes = np.stack([records[metric][:, places] for metric in METRICS], axis=2).astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(sizes.reshape(len(sizes), -1))
    stable = (records["status"][:, places] == STATUSES.index("ok")).all(axis=1)
    return Preliminary(records["draws"], logs, stable)


def rounded(study: EnsembleStudy, values: Array) -> Array:
    """A sample (P,) of two significant digits in the unit that each range is written in."""
    rows = dict(study.loaded.config.box)
    scales = [to_si(1.0, getattr(rows[name], "unit", "1")) for name in study.population.names]
    return np.array([_two_digits(value / scale) * scale for value, scale in zip(values, scales, strict=True)])


def _two_digits(value: float) -> float:
    return round(value, 1 - floor(log10(abs(value)))) if value else 0.0


def typical_sections(study: EnsembleStudy, sample: Preliminary) -> Tree:
    """Sections of a comparison with the typical plant and motion, rounded and checked again.

    Raises
    ------
    TendonreproError
        If it is not stable any more.
    """
    values = rounded(study, sample.typical())
    config = study.population.configured(values)
    named = dict(build_loops(config, study.loaded.base.folder))
    if (simulate_batch([named[run] for run in RUNS]).status != STATUSES.index("ok")).any():
        message = "rounded to two digits the typical plant is no longer stable"
        raise TendonreproError(message)
    sections, published = (
        part.model_dump(mode="json", exclude_none=True) for part in (config, study.loaded.compare)
    )
    arm, shipped = sections["manipulator"], published["manipulator"]
    arm["encoders"], arm["actuator"]["output_delay"] = shipped["encoders"], shipped["actuator"]["output_delay"]
    return {name: sections[name] for name in SECTIONS}


if __name__ == "__main__":
    printed = published_study()
    sys.stdout.write(dump(typical_sections(printed, preliminary(printed))))
