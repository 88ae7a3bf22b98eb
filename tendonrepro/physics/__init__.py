"""The paper's equations as pure functions: no files, no clock, no state.

Arrays of arm, drive and statics have the joint or tendon axis first; further axes are independent lanes.
Signals over time are (T, n).

What a law of your own builds on (docs/python.md) can be imported from here.
"""

from tendonrepro.physics.control import (
    Law,
    Memory,
    command,
    error_rate,
    phi,
    phi_slope,
    sig,
    surface_and_feedback,
    time_delay_estimate,
)

__all__ = [
    "Law",
    "Memory",
    "command",
    "error_rate",
    "phi",
    "phi_slope",
    "sig",
    "surface_and_feedback",
    "time_delay_estimate",
]
