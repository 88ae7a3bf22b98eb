"""The closed loop in time, by SciPy; the law is machine code of one lane, or a user's own.

The integrator starts afresh at each sample, so it never steps across a jump of the torque.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
from scipy.integrate import ode

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.simulation.codegen.lanes import bundled
from tendonrepro.simulation.codegen.machine import callable_code, callable_on_array
from tendonrepro.simulation.loop import (
    Loop,
    Solver,
    hardware_of,
    is_noisy,
    measure,
    recorded_columns,
    rest_at,
    sample,
    start,
    torque_before,
    trace_variables,
    unit_noise,
)
from tendonrepro.simulation.parts import single_part

MOST_STEPS = 5000
"""Steps in one period after which a plant counts as one that cannot be resolved."""

FIRST_STEP = 0.5
"""First step as a share of the longest.

On the shipped arms the tolerances allow one step a period. Joint angles are then within 2e-9 rad of a run at
1e-12, and with two steps within 3e-11.
"""


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
    time, plant = loop.reference.time, MachinePlant(loop)
    trace = np.empty((time.size, recorded_columns(loop)))
    set_torque = (MachineLaw if loop.controller.command is None else PlainLaw)(loop, plant, trace)
    advance = _integrator(loop.solver, plant)
    # SciPy warns on standard error where advance() raises, and NumPy where a run diverges.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", UserWarning)
        k = 0
        while set_torque(k):
            advance(time[k], time[k + 1])
            k += 1
        return trace_variables(trace[: k + 1], loop)


def _integrator(solver: Solver, plant: MachinePlant) -> Callable[[float, float], None]:
    problem = ode(plant.slope).set_integrator(
        solver.method,
        rtol=solver.rtol,
        atol=solver.atol,
        max_step=solver.max_step,
        first_step=FIRST_STEP * solver.max_step,
        nsteps=MOST_STEPS,
    )

    def advance(start: float, end: float) -> None:
        plant.state[:] = reached = problem.set_initial_value(plant.state, start).integrate(end)
        # A state that overflowed is the run's result; its error shows it at the next sample.
        if not problem.successful() and np.isfinite(reached).all():
            other = "solver.method=lsoda with rtol 1e-7 and atol 1e-9" if solver.method != "lsoda" else ""
            hint = f"the plant is too stiff for this method: try {other or 'softer tendons'}"
            message = f"{solver.method} cannot follow the plant beyond t = {start:.3f} s"
            raise TendonreproError(message, hint=hint)

    return advance


class MachinePlant:
    """State (4 n,) and torque (n,) of a run: views of the rows of its machine code."""

    def __init__(self, loop: Loop) -> None:
        n = loop.plant.preload.size
        self.rest = rest_at(loop.start_angles, loop.plant)
        part = single_part(loop, self.rest, sampled=loop.controller.command is None)
        self.code, self._named = part.code, part.rows.named
        self.rows: Array = bundled(part.filled([0]), part.lanes)[0]
        self.state, self.torque = self.lane("state", 4 * n), self.lane("torque", n)
        self.state[:] = self.rest.state
        self.slope = callable_on_array(part.code["slope"], self.rows, np.empty(4 * n))

    def lane(self, name: str, size: int) -> Array:
        """View of the numbers of a name."""
        return self.rows[self._named[name] :, 0][:size]


class MachineLaw:
    """Package's own law as machine code."""

    def __init__(self, loop: Loop, plant: MachinePlant, trace: Array) -> None:
        reference, n = loop.fed, loop.plant.preload.size
        self._signals = np.hstack([reference.q_d, reference.dq_d, reference.ddq_d, _noise(loop)])
        # Desired motion and noise are neighbours.
        self._given, self._live = plant.lane("desired", 6 * n), plant.lane("live", 1)
        self._trace, self._kept = trace, plant.lane("trace", trace.shape[1])
        self._run, self._address = callable_code(plant.code["sample"]), plant.rows.ctypes.data

    def __call__(self, k: int) -> bool:
        """Set the plant's torque at sample k; whether the run goes on."""
        self._given[:] = self._signals[k]
        self._run(self._address, k, 0.0)
        self._trace[k] = self._kept
        return bool(self._live[0] > 0.0)


class PlainLaw:
    """A user's own law, in Python."""

    def __init__(self, loop: Loop, plant: MachinePlant, trace: Array) -> None:
        self._loop, self._plant, self._trace = loop, plant, trace
        self._hardware, self._noise = hardware_of(loop, plant.rest), _noise(loop)
        tau, law = torque_before(loop, plant.rest), loop.controller.law
        measured = measure(plant.rest.state, self._noise[0], law, self._hardware)
        self._fed, first = loop.fed, loop.reference.q_d[0]
        self._memory, self._pending = start(measured, first, tau, law), [tau] * loop.actuator.delay

    def __call__(self, k: int) -> bool:
        """Set the plant's torque at sample k; whether the run goes on."""
        reference, controller, state = self._fed, self._loop.controller, self._plant.state.copy()
        assert controller.command is not None
        now = sample(
            state,
            self._memory,
            self._pending,
            (reference.q_d[k], reference.dq_d[k], reference.ddq_d[k]),
            self._noise[k],
            controller.law,
            self._hardware,
            controller.command,
        )
        self._memory, self._pending, self._plant.torque[:] = now.memory, now.pending, now.torque
        self._trace[k] = np.concatenate([state, *now.measured, now.tau, now.tau_m, *now.signals])
        return bool(now.bounded) and k + 1 < reference.time.size


def _noise(loop: Loop) -> Array:
    samples, n = loop.reference.q_d.shape
    return unit_noise(loop)(samples) if is_noisy(loop) else np.zeros((samples, 3 * n))
