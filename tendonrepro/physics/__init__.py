"""The paper's equations as pure functions of arrays.

Arrays of arm, drive and statics have the joint or tendon axis first, then independent lanes. Signals over
time are (T, n). A law of your own (docs/python.md) builds on the names here.
"""

from tendonrepro.physics.control import (
    Law,
    Memory,
    command,
    error_rate,
    estimator_weights,
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
    "estimator_weights",
    "phi",
    "phi_slope",
    "sig",
    "surface_and_feedback",
    "time_delay_estimate",
]
