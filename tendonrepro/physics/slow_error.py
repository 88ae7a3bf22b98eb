"""The error that a slowly changing load leaves, as far as the law alone decides it."""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.control import Law, surface_and_feedback

ERROR_SIZES_DEG = (0.05, 0.25, 1.0, 5.0)
"""Sizes of the error at which the ratio of two laws is given."""

TYPICAL_ERROR_DEG = 0.25
"""The one of these that is nearest to the printed mean errors of both joints."""


def estimate_age(law: Law, delay: int = 0) -> Array:
    """Mean age (n,) of the estimate when it acts, in periods, with whole samples of output delay.

    It is 1 + α by Eq. (15), 1 by Eq. (8), 1 − α extrapolating. A filter adds its mean lag. A delay adds only
    where the law remembers the applied torque: a command meets it on both sides of its equation.
    """
    waited = delay * law.stores_applied + (1.0 / law.estimate_filter - 1.0)
    return np.asarray(law.lag * (law.weights[0] + 2.0 * law.weights[1]) + waited)


def stiffness(law: Law, e: float) -> Array:
    """Feedback per error e, rad, at rest: ``λ k`` with the chord ``k`` of the surface, s⁻², (n,)."""
    n = law.M_bar.size
    return np.array([surface_and_feedback(e, 0.0, law, i)[1] / e for i in range(n)])


def error_ratio(law_a: Law, law_b: Law, e: float, delay: int = 0) -> Array:
    """Error of one law over that of another (n,) while the load changes slowly, without any plant.

    ``e = w L Ḣ / (M_bar λ k)``: age ``w``, stiffness ``λ k`` at the size ``e`` of both errors, rad. Both
    laws, in the same torque coordinates, meet the same ``Ḣ``. It holds while both loops are stable and quiet,
    ``H`` changes little within a few ``L``, ``1/k`` and ``1/λ``, no motor saturates and dry friction does not
    hold the arm.
    """
    a, b = (estimate_age(law, delay) * law.L / (law.M_bar * stiffness(law, e)) for law in (law_a, law_b))
    return np.asarray(a / b)
