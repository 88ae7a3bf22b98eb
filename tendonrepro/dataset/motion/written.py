"""A recovered motion written for the simulator to run: as a trajectory file and in a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tendonrepro.config.fields.model import is_multiple
from tendonrepro.config.fields.strict_yaml import Node
from tendonrepro.dataset.motion.fit import UNITS, judged, limit
from tendonrepro.dataset.motion.knots import Knots
from tendonrepro.dataset.motion.recover import Reference
from tendonrepro.dataset.motion.shapes import cycle_of

FILE = "reference.csv"


def csv_text(knots: Knots, joint: Sequence[int]) -> str:
    """Trajectory file: ``time_s`` and ``q<joint>_deg``, s and degrees, for joints of these numbers."""
    rows = np.column_stack([knots.time, np.rad2deg(knots.angle)])
    lines = [",".join(f"{number:.9g}" for number in row) for row in rows + 0.0]
    return "\n".join([",".join(["time_s", *(f"q{number}_deg" for number in joint)]), *lines]) + "\n"


def runnable(reference: Reference, sampling_period: float) -> Reference:
    """Recovered motion as a configuration with a sampling period, s, can hold it.

    A shape lasts a whole number of sampling periods; where its residual does not allow that there is none, so
    the motion is written as samples.
    """
    shape = reference.shape
    if shape is None:
        return reference
    cycle, cycles = cycle_of(shape.values), _cycles(reference)
    if is_multiple(cycles * cycle, sampling_period):
        return reference
    later = sampling_period * round(cycles * cycle / sampling_period) / cycles - cycle
    longer = {"hold": 0.5 * later} if "hold" in shape.values else {"period": later}
    values = shape.values | {name: shape.values[name] + more for name, more in longer.items()}
    fit = judged(reference.record, shape.kind, reference.turns, values)
    if fit.largest > limit(reference.record):
        return replace(reference, fitted=(), turns=None)
    period = cycle_of(values) * round(reference.period / cycle)
    return replace(reference, fitted=(fit, *reference.fitted[1:]), period=period)


def _cycles(reference: Reference) -> int:
    """How often a named motion goes out and back, or a sine repeats."""
    if reference.turns:
        return len(reference.turns.joints)
    left = float(reference.record.time[-1]) - reference.delay
    return max(int(np.ceil(left / reference.period - 0.02)), 1)


def config_tree(tree: Mapping[str, Node], reference: Reference, measured: str) -> dict[str, Node]:
    """Whole configuration of a comparison, `tree`, on the recovered motion.

    `measured` is the name of the measured file, for the title and the source of each value.
    """
    title = f"{tree['title']}, on the reference measured in {measured}"
    shape, source = reference.shape, f"identified: {measured}"
    if shape is None:
        return dict(tree) | {"title": title, "reference": {"kind": "sampled", "file": FILE}}
    motion: dict[str, Node] = {"kind": shape.kind}
    for name, value in shape.parameters().items():
        motion[name] = {"value": value, "unit": UNITS[name], "source": source}
    periods = _cycles(reference)
    if reference.turns:
        pattern, periods = reference.turns.pattern()
        if len(pattern) > 1:
            motion["turns"] = [[reference.record.joint[i] for i in turn] for turn in pattern]
    motion["periods"] = {"value": periods, "unit": "1", "source": source}
    return dict(tree) | {"title": title, "reference": motion}
