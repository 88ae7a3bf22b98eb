"""The closed loop in time, by SciPy.

The integrator starts afresh at each sample, so it never steps across a jump of the torque.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.simulation.loop import DesiredMotion, Loop, Solver, recorded_columns, trace_variables

if TYPE_CHECKING:
    from tendonrepro.simulation.single import Arm

__all__ = ["DesiredMotion", "Loop", "Solver", "simulate"]

MOST_STEPS = 5000
"""Steps in one period after which a plant counts as one that cannot be resolved."""

FIRST_STEP = 0.5
"""First step as a share of the longest: most periods begin with a torque step, after which a full one would
be tried in vain."""


def simulate(loop: Loop) -> dict[str, Array]:
    """Run a closed loop from rest to the end of its reference, or until it diverges.

    Returns
    -------
    dict of array
        ``time`` (T,) and variables (T, n), SI. A diverged run ends with the first sample beyond the limit.

    Raises
    ------
    TendonreproError
        If the integrator cannot keep its tolerances.
    """
    # Where nothing is run, whoever builds a loop needs no compiler.
    from tendonrepro.simulation.single import Arm, MachineLaw, PlainLaw

    time, arm = loop.reference.time, Arm(loop)
    trace = np.empty((time.size, recorded_columns(loop)))
    sample = (MachineLaw if loop.controller.command is None else PlainLaw)(loop, arm, trace)
    advance = _integrator(loop.solver, arm)
    # SciPy warns on standard error where advance() raises, and NumPy where a run diverges.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", UserWarning)
        k = 0
        while sample(k):
            advance(time[k], time[k + 1])
            k += 1
        return trace_variables(trace[: k + 1], loop)


def _integrator(solver: Solver, arm: Arm) -> Callable[[float, float], None]:
    from scipy.integrate import ode

    problem = ode(arm.slope).set_integrator(
        solver.method,
        rtol=solver.rtol,
        atol=solver.atol,
        max_step=solver.max_step,
        first_step=FIRST_STEP * solver.max_step,
        nsteps=MOST_STEPS,
    )

    def advance(start: float, end: float) -> None:
        arm.state[:] = reached = problem.set_initial_value(arm.state, start).integrate(end)
        # A state that overflowed is the run's result; its error shows it at the next sample.
        if not problem.successful() and np.isfinite(reached).all():
            other = "solver.method=lsoda with rtol 1e-7 and atol 1e-9" if solver.method != "lsoda" else ""
            hint = f"the plant is too stiff for this method: try {other or 'softer tendons'}"
            message = f"{solver.method} cannot follow the plant beyond t = {start:.3f} s"
            raise TendonreproError(message, hint=hint)

    return advance
