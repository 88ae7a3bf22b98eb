"""The presets that come with the page and tell the paper's story."""

from __future__ import annotations

from collections.abc import Sequence

from tendonrepro.configuration.load import load_config
from tendonrepro.reporting.live.library import Library
from tendonrepro.reporting.live.preset import preset

RAMPS = {
    "reference.kind": "ramp",
    "reference.amplitude.2": 10.8,
    "reference.amplitude.3": 10.8,
    "reference.rise": 2.07,
    "reference.hold": 1.13,
    "control.readings.reference_acceleration": "absent",
}
"""Straight ramps, whose acceleration no law gets."""

APART = {
    "runs.controller_2.start_offset.2": -0.75,
    "runs.controller_2.start_offset.3": -0.48,
    "runs.controller_3.start_offset.2": -1.33,
    "runs.controller_3.start_offset.3": -1.07,
}
"""Starts, deg, found by hand: with them the plain arm comes near to Table 2."""

VARIANTS: Sequence[dict[str, object]] = (
    {
        "name": "no_acceleration",
        "of": "published",
        "title": "No acceleration",
        "about": "The reference is a straight ramp, and its acceleration is not fed forward. That makes an "
        "error of its own, nearly the same for all controllers, and α hardly shows.",
        "values": RAMPS,
    },
    {
        "name": "apart",
        "of": "published",
        "title": "Runs that start apart",
        "about": "The same ramps. Controllers 2 and 3 start about a degree off their reference, Controller 1 "
        "starts on it. The starts were chosen to come near to Table 2, so agreement proves nothing.",
        "values": {**RAMPS, **APART},
    },
    {
        "name": "weights",
        "of": "published",
        "title": "Changed weights",
        "about": "As published, but the two delayed estimates weigh 1 + α and −α: Eq. (15) with a changed "
        "sign.",
        "values": {"control.readings.weights": "extrapolating"},
    },
    {
        "name": "delta_in_degrees",
        "of": "published",
        "title": "Δ in degrees",
        "about": "As published, but Δ = 0.2 is understood in degrees. The paper gives no unit.",
        "values": {"control.readings.Delta_unit": "deg"},
    },
)
"""Presets that are another one with some values changed."""


def shipped_presets(library: Library) -> list[dict[str, object]]:
    """The presets that tell the paper's story; a variant is another preset with some values changed."""
    published_ = preset(
        load_config("plain", "compare"),
        "published",
        "As published",
        "Equations, gains and encoder as published. The arm is assumed: its values are the middles of "
        "plausible ranges, with more damping of the tendons.",
        library,
    )
    fitted = preset(
        load_config("closest", "compare"),
        "fitted",
        "Fitted arm",
        "An arm and a motion that were fitted to Tables 2 and 3, so agreement proves nothing.",
        library,
    )
    return [published_, *VARIANTS, fitted]
