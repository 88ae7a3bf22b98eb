"""A recovered motion written for the simulator to run: as a trajectory file and in a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tendonrepro.config.fields.model import is_multiple
from tendonrepro.config.fields.strict_yaml import Node
from tendonrepro.dataset.motion.fit import judged, limit
from tendonrepro.dataset.motion.knots import Knots
from tendonrepro.dataset.motion.recover import Reference
from tendonrepro.dataset.motion.reference_turns import Turns
from tendonrepro.dataset.motion.shapes import OUT_AND_BACK, UNITS, cycle_of

FILE = "reference.csv"


def csv_text(knots: Knots, joint: Sequence[int]) -> str:
    """Trajectory file: ``time_s`` and ``q<joint>_deg``."""
    rows = np.column_stack([knots.time, np.rad2deg(knots.angle)])
    lines = [",".join(f"{number:.9g}" for number in row) for row in rows + 0.0]
    return "\n".join([",".join(["time_s", *(f"q{number}_deg" for number in joint)]), *lines]) + "\n"


def runnable(reference: Reference, sampling_period: float) -> Reference:
    """Recovered motion as a configuration can hold it.

    Parameters
    ----------
    reference : Reference
    sampling_period : float
        Of the configuration, s.

    Returns
    -------
    Reference
        With a shape that lasts a whole number of sampling periods; where a shape's residual does not allow
        that, without one, so as samples.
    """
    shape = reference.shape
    if shape is None:
        return reference
    cycle, cycles = cycle_of(shape.kind, shape.values), _cycles(reference)
    if is_multiple(cycles * cycle, sampling_period):
        return reference
    later = sampling_period * round(cycles * cycle / sampling_period) / cycles - cycle
    longer = {"hold": 0.5 * later} if "hold" in shape.values else {"period": later}
    values = shape.values | {name: shape.values[name] + more for name, more in longer.items()}
    fit = judged(reference.record, shape.kind, _turns(reference), values)
    if fit.largest > limit(reference.record):
        return replace(reference, fitted=())
    period = reference.period * (1.0 + later / cycle)
    return replace(reference, fitted=(fit, *reference.fitted), period=period)


def _turns(reference: Reference) -> Turns | None:
    """Turns that a named motion of the joints has; a sine has none."""
    shape = reference.shape
    return reference.turns if shape and shape.kind in OUT_AND_BACK else None


def _cycles(reference: Reference) -> int:
    """How often a named motion goes out and back, or a sine repeats."""
    turns = _turns(reference)
    if turns:
        return len(turns.joints)
    left = float(reference.record.time[-1]) - reference.delay
    return max(int(np.ceil(left / reference.period - 0.02)), 1)


def reference_tree(reference: Reference, measured: str) -> dict[str, Node]:
    """Section ``reference`` of a configuration that runs the recovered motion.

    Parameters
    ----------
    reference : Reference
    measured : str
        Name of the measured file, for the source of each value.
    """
    shape, turns = reference.shape, _turns(reference)
    if shape is None:
        return {"kind": "sampled", "file": FILE}
    source = f"identified: {measured}"
    tree: dict[str, Node] = {"kind": shape.kind}
    for name, value in shape.parameters().items():
        tree[name] = {"value": value, "unit": UNITS[name], "source": source}
    periods = _cycles(reference)
    if turns:
        pattern, periods = turns.pattern()
        if len(pattern) > 1:
            tree["turns"] = [[reference.record.joint[i] for i in turn] for turn in pattern]
    tree["periods"] = {"value": periods, "unit": "1", "source": source}
    return tree


def config_tree(tree: Mapping[str, Node], reference: Reference, measured: str) -> dict[str, Node]:
    """Whole configuration of a comparison on the recovered motion.

    Parameters
    ----------
    tree : Mapping
        Of a complete configuration.
    reference : Reference
    measured : str
        Name of the measured file.
    """
    title = f"{tree['title']}, on the reference measured in {measured}"
    return dict(tree) | {"title": title, "reference": reference_tree(reference, measured)}
