"""One run at its samples: the arm that SciPy integrates, and the law as machine code or as a user wrote it.

The code is that of `kernel`, for bundles of experiments; here the first lane is all that counts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tendonrepro.arrays import Array
from tendonrepro.physics.dynamics import holding_torque, rest_state
from tendonrepro.simulation import sampled
from tendonrepro.simulation.codegen.lanes import bundled
from tendonrepro.simulation.codegen.machine import callable_code
from tendonrepro.simulation.kernel import sample_rows
from tendonrepro.simulation.parts import (
    CompiledPart,
    Rest,
    hardware_of,
    is_noisy,
    memory_of,
    sample_part,
    slope_part,
    unit_noise,
)
from tendonrepro.simulation.stepper import Loop


class Arm:
    """State (4 n,) of a plant and the torque (n,) held on it: views of the rows of its machine code."""

    def __init__(self, loop: Loop) -> None:
        part, n = slope_part(loop.plant), loop.plant.preload.size
        still = np.zeros(n)
        self.rest = Rest(rest_state(still, loop.plant), holding_torque(still, loop.plant))
        self.rows, named = _filled(part), part.rows.named
        self.state = self.rows[: 4 * n, 0]
        self.torque = self.rows[named["torque"] :, 0][:n]
        self.state[:] = self.rest.state
        slope = self.rows[named["slope"] :, 0][: 4 * n]
        # SciPy calls this some thirty times a period; a memory view is filled in half the time of an array.
        run, state, address = callable_code(part.code.run), memoryview(self.state), self.rows.ctypes.data

        def derivative(t: float, x: Array) -> Array:
            state[:] = x
            run(address, t)
            return slope

        self.slope = derivative


def _filled(part: CompiledPart) -> Array:
    """Rows of a part's first column, as the only experiment of a bundle."""
    rows: Array = bundled(part.filled([0]))[0]
    return rows


def sample_code(loop: Loop, arm: Arm, trace: Array) -> Callable[[int], bool]:
    """Package's own law as machine code: from the arm's state to its torque at sample k, and whether it goes on."""
    part = sample_part({0: loop}, {0: arm.rest}, lambda _: 1, statistics=False, record=True)
    rows, named, reference = _filled(part), sample_rows(arm.torque.size).named, loop.reference
    arrays = {
        "plant": arm.rows,
        "desired": np.hstack([reference.q_d, reference.dq_d, reference.ddq_d]),
        "noise": _noise(loop),
        "trace": trace,
    }
    for name, values in arrays.items():
        rows.view(np.int64)[named[name]] = values.ctypes.data
    code, address, live = callable_code(part.code.run), rows.ctypes.data, rows[named["live"], :1]

    def sample(k: int) -> bool:
        code(address, k)
        return bool(live[0] > 0.0)

    # The code reads them by address.
    sample.__dict__["kept"] = arrays
    return sample


def plain_sample(loop: Loop, arm: Arm, trace: Array) -> Callable[[int], bool]:
    """Same for a user's own law, which stays Python."""
    law, reference, noise, command = (
        loop.controller.law,
        loop.reference,
        _noise(loop),
        loop.controller.command,
    )
    hardware, (memory, tau) = hardware_of(loop, arm.rest), memory_of(loop, arm.rest)
    pending = [tau] * loop.actuator.delay
    assert command is not None

    def sample(k: int) -> bool:
        nonlocal memory, pending
        motion = reference.q_d[k], reference.dq_d[k], reference.ddq_d[k]
        found = sampled.sample(arm.state.copy(), memory, pending, motion, noise[k], law, hardware, command)
        memory, pending, arm.torque[:] = found.memory, found.pending, found.torque
        trace[k] = np.concatenate([arm.state, *found.measured, found.tau, found.tau_m, *found.signals])
        return bool(found.bounded) and k + 1 < reference.time.size

    return sample


def _noise(loop: Loop) -> Array:
    samples, n = loop.reference.q_d.shape
    return unit_noise(loop)(samples) if is_noisy(loop) else np.zeros((samples, 3 * n))
