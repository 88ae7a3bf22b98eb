"""The closed loop in time, by SciPy; the law is machine code of one lane, or a user's own.

The integrator starts afresh at each sample, so it never steps across a jump of the torque.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.integrate import ode

from tendonrepro.arrays import Array
from tendonrepro.errors import TendonreproError
from tendonrepro.simulation.codegen.lanes import bundled
from tendonrepro.simulation.codegen.machine import callable_code, callable_on_array
from tendonrepro.simulation.kernel import single_part
from tendonrepro.simulation.loop import Loop, Solver, measure, recorded, rest_at, sample, start
from tendonrepro.simulation.resolution import PreparedLoop

MOST_STEPS = 5000
"""Steps in one period after which a plant counts as one that cannot be resolved."""

FIRST_STEP = 0.5
"""First step as a share of the longest.

On the shipped arms the tolerances allow one step a period. Joint angles are then within 2e-9 rad of a run at
1e-12, and with two steps within 3e-11.
"""

SetTorque: TypeAlias = Callable[[int], bool]
"""Sets the plant's torque at a sample and records it; gives whether the run goes on."""


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
    trace = np.empty((time.size, loop.recorded_columns))
    law = _law_of_machine if loop.controller.command is None else _law_of_python
    set_torque = law(loop, plant, trace)
    advance = _integrator(loop.solver, plant)
    # SciPy warns on standard error where advance() raises, and NumPy where a run diverges.
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", UserWarning)
        k = 0
        while set_torque(k):
            advance(time[k], time[k + 1])
            k += 1
        return loop.trace(trace[: k + 1])


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
        ready = PreparedLoop(loop, self.rest, np.zeros(0, dtype=np.int64))
        part = single_part(ready, sampled=loop.controller.command is None)
        self.code, self._named = part.code, part.rows.named
        self.rows: Array = bundled(part.filled([0]), part.lanes)[0]
        self.state, self.torque = self.lane("state", 4 * n), self.lane("torque", n)
        self.slope = callable_on_array(part.code["slope"], self.lane("slope", 4 * n))

    def lane(self, name: str, size: int) -> Array:
        """View of the numbers of a name."""
        return self.rows[self._named[name] :, 0][:size]


def _law_of_machine(loop: Loop, plant: MachinePlant, trace: Array) -> SetTorque:
    """The package's own law as machine code."""
    reference, n = loop.fed, loop.plant.preload.size
    noise = loop.unit_noise()(len(trace))
    signals = np.hstack([reference.q_d, reference.dq_d, reference.ddq_d, noise])
    # Desired motion and noise are neighbours.
    given, live, kept = (
        plant.lane("desired", 6 * n),
        plant.lane("live", 1),
        plant.lane("trace", trace.shape[1]),
    )
    run, address = callable_code(plant.code["sample"]), plant.rows.ctypes.data

    def set_torque(k: int) -> bool:
        given[:] = signals[k]
        run(address, k, 0.0)
        trace[k] = kept
        return bool(live[0] > 0.0)

    return set_torque


def _law_of_python(loop: Loop, plant: MachinePlant, trace: Array) -> SetTorque:
    """A user's own law."""
    law, command, motion = loop.controller.law, loop.controller.command, loop.fed
    assert command is not None
    hardware, tau = loop.hardware(plant.rest), loop.torque_before(plant.rest)
    noise = loop.unit_noise()(len(trace))
    measured = measure(plant.rest.state, noise[0], law, hardware)
    memory, pending = start(measured, loop.reference.q_d[0], tau, law), [tau] * loop.actuator.delay

    def set_torque(k: int) -> bool:
        nonlocal memory, pending
        state, desired = plant.state.copy(), (motion.q_d[k], motion.dq_d[k], motion.ddq_d[k])
        now = sample(state, memory, pending, desired, noise[k], law, hardware, command)
        memory, pending, plant.torque[:] = now.memory, now.pending, now.torque
        trace[k] = recorded(state, now)
        return bool(now.bounded) and k + 1 < motion.time.size

    return set_torque
