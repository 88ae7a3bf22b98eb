"""SciPy's `dop853` over one sampling period: plain Python, compiled in `compiled`.

SciPy calls Python for each of some thirty evaluations of the plant in a period, and takes some five times as
long for it as this does. The steps here are those of :class:`scipy.integrate.ode` in SciPy
1.17 to the last bit, which a test holds: its method of order eight with its coefficients, and its choice of
steps, but for the notice that a thousand steps in one period mean a stiff plant.
"""

from __future__ import annotations

import ctypes

import numpy as np
from scipy.integrate import DOP853

from tendonrepro.arrays import Array

MOST_STEPS = 5000
"""Steps in one period after which a plant counts as one that cannot be resolved."""

FIRST_STEP = 0.5
"""First step as a share of the longest: most periods begin with a torque step, after which a full one would
be tried in vain."""

STAGES = DOP853.n_stages
# In one piece: of other arrays numba keeps an address, and then no code on disk.
A, B, C, FIFTH = map(np.ascontiguousarray, (DOP853.A, DOP853.B, DOP853.C, DOP853.E5))
# Weights of the solution of third order on the first, ninth and last stage.
THIRD = (0.24409448818897638, 0.7338466882816118, 0.022058823529411765)
# Bounds and safety of a step's change, as SciPy sets them.
SMALLEST, LARGEST, SAFETY = 0.3, 6.0, 0.9
ROUNDING = 2.220446049250313e-16


def derivative(code: int, t: float, state: Array, tau_m: Array, p: Array, result: Array) -> None:
    """Fill the time derivative (4 n,) of a state by the machine code of a plant; compiled, a mere call."""
    pointer = ctypes.POINTER(ctypes.c_double)
    function = ctypes.CFUNCTYPE(None, ctypes.c_double, *[pointer] * 4)(code)
    function(t, *(array.ctypes.data_as(pointer) for array in (state, tau_m, p, result)))


def advance(
    code: int,
    start: float,
    end: float,
    state: Array,
    tau_m: Array,
    p: Array,
    rtol: float,
    atol: float,
    max_step: float,
) -> tuple[Array, bool]:
    """Take a plant through one sampling period.

    Parameters
    ----------
    code : int
        Address of the plant's machine code.
    start, end : float
        Of the period, s.
    state : array (4 n,)
        At its start, rad and rad s⁻¹.
    tau_m : array (n,)
        Torque held, in joint coordinates, N m.
    p : array (P,)
        The plant's numbers.
    rtol, atol : float
        Tolerances on the state.
    max_step : float
        Longest step, s.

    Returns
    -------
    state : array (4 n,)
        At the end, or where it stopped.
    reached : bool
        Whether that is the end.
    """
    t, h, rejected = start, FIRST_STEP * max_step, False
    slopes = np.empty((STAGES, state.size))
    derivative(code, t, state, tau_m, p, slopes[0])
    for _ in range(MOST_STEPS + 1):
        if 0.1 * h <= abs(t) * ROUNDING:
            break
        last = t + 1.01 * h > end
        if last:
            h = end - t
        tried, error = _step(code, t, h, state, tau_m, p, rtol, atol, slopes)
        if error <= 1.0:
            t, state = t + h, tried
            if last:
                return state, True
            derivative(code, t, state, tau_m, p, slopes[0])
            longer = h / max(1.0 / LARGEST, min(1.0 / SMALLEST, error**0.125 / SAFETY))
            h = min(longer, h if rejected else max_step)
            rejected = False
        else:
            h, rejected = h / (1.0 / SMALLEST), True
    return state, False


def _step(
    code: int,
    t: float,
    h: float,
    state: Array,
    tau_m: Array,
    p: Array,
    rtol: float,
    atol: float,
    slopes: Array,
) -> tuple[Array, float]:
    """State after a step that begins with the first of the slopes, and its error by the tolerances."""
    tried = np.empty_like(state)
    for i in range(state.size):
        tried[i] = state[i] + h * A[1, 0] * slopes[0, i]
    derivative(code, t + C[1] * h, tried, tau_m, p, slopes[1])
    for stage in range(2, STAGES):
        for i in range(state.size):
            change = A[stage, 0] * slopes[0, i]
            for before in range(1, stage):
                if A[stage, before] != 0.0:
                    change += A[stage, before] * slopes[before, i]
            tried[i] = state[i] + h * change
        derivative(code, t + C[stage] * h, tried, tau_m, p, slopes[stage])
    fifth = third = 0.0
    for i in range(state.size):
        mean, difference = B[0] * slopes[0, i], FIFTH[0] * slopes[0, i]
        for stage in range(5, STAGES):
            mean += B[stage] * slopes[stage, i]
            difference += FIFTH[stage] * slopes[stage, i]
        tried[i] = state[i] + h * mean
        scale = atol + rtol * max(abs(state[i]), abs(tried[i]))
        fifth += (difference / scale) ** 2
        lower = THIRD[0] * slopes[0, i], THIRD[1] * slopes[8, i], THIRD[2] * slopes[STAGES - 1, i]
        third += ((mean - lower[0] - lower[1] - lower[2]) / scale) ** 2
    both = fifth + 0.01 * third
    return tried, h * fifth * np.sqrt(1.0 / (state.size * (both if both > 0.0 else 1.0)))
