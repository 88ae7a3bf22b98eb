"""The presets that come with the page and tell the paper's story."""

from __future__ import annotations

from collections.abc import Sequence

from tendonrepro.configuration.load import load_config
from tendonrepro.reporting.live.library import Library
from tendonrepro.reporting.live.preset import preset

RAMPS = {
    "reference": {
        "kind": "ramp",
        "amplitude": {"value": [3.4, 8.7], "unit": "deg", "source": "assumed: chosen to come near Table 2"},
        "rise": {"value": 3.6, "unit": "s", "source": "assumed: chosen to come near Table 2"},
        "hold": {"value": 1.4, "unit": "s", "source": "assumed: chosen to come near Table 2"},
        "periods": {"value": 2, "unit": "1", "source": "assumed: as many as as published"},
    },
    "control.readings.reference_acceleration": "absent",
}
"""Straight ramps, whose acceleration no law gets."""

APART = {
    "runs.controller_2.start_offset.2": -1.1,
    "runs.controller_2.start_offset.3": -1.1,
    "runs.controller_3.start_offset.2": -1.8,
    "runs.controller_3.start_offset.3": -1.7,
}
"""Starts, deg, found by a search: with them the typical arm comes near Table 2."""

VARIANTS: Sequence[dict[str, object]] = (
    {
        "name": "apart",
        "of": "ramps",
        "title": "Runs that start apart",
        "about": "The same ramps. Controllers 2 and 3 start one to two degrees below their reference, "
        "Controller 1 starts on it. They were chosen to come near Table 2, so agreement proves nothing.",
        "values": APART,
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
    published = preset(
        load_config(None, "compare"),
        "published",
        "As published",
        "Equations, gains and encoder as published. Arm and motion are assumed: a typical one of plausible "
        "ranges, that of tendonrepro compare. Every run starts on its reference and gets its acceleration.",
        library,
    )
    ramps = preset(
        load_config(None, "compare", overrides=RAMPS),
        "ramps",
        "Straight ramps",
        "The reference is a straight ramp, and its acceleration is not fed forward. The order is as before.",
        library,
    )
    fitted = preset(
        load_config("closest", "compare"),
        "fitted",
        "Fitted arm",
        "An arm and a motion that were fitted to Tables 2 and 3, so agreement proves nothing.",
        library,
    )
    return [published, ramps, *VARIANTS, fitted]
