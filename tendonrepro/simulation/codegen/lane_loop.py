"""The time loop over one bundle of experiments: plain Python, compiled in `compiled`."""

from __future__ import annotations

from collections.abc import Callable

from tendonrepro.arrays import Array

LOOK_AGAIN = 64
"""Samples between two looks whether any experiment of a bundle still goes on."""

SampleCode = Callable[[Array, float], None]
StepCode = Callable[[Array, float, float], None]


def follow(  # noqa: PLR0912 (compiled: rows are copied one number at a time)
    v: Array,
    w: Array,
    n: int,
    width: int,
    desired: Array,
    noise: Array,
    L: float,
    steps: int,
    block: int,
    slow: Array,
    trace: Array,
    sample: SampleCode,
    step: StepCode,
) -> None:
    """Run a bundle to the end of its longest reference, or until every experiment has ended.

    ``v`` and ``w`` are the flat arrays of the sample's and the plant's code, parameters prepared; ``width``
    is the number of experiments. ``desired`` (T, 3 n width) holds q_d, dq_d and ddq_d, ``noise``
    (T, 2 n width) the unit noise of encoders and torque, without rows where there is none. ``slow``
    (B, n width) receives the errors summed up over blocks, ``trace`` (T, 9 n width) the recorded rows, if it
    has any.
    """
    state, one = 4 * n * width, n * width
    q_d, noise_q = 9 * one, 12 * one
    ddq_sample, tau_out, sums, live = 14 * one, 15 * one, 16 * one, 17 * one
    h = L / steps
    last = desired.shape[0] - 1
    for k in range(desired.shape[0]):
        for j in range(state):
            v[j] = w[j]
        for j in range(3 * one):
            v[q_d + j] = desired[k, j]
        if noise.shape[0] > 0:
            for j in range(2 * one):
                v[noise_q + j] = noise[k, j]
        sample(v, float(k))
        if trace.shape[0] > 0:
            for j in range(9 * one):
                trace[k, j] = v[j]
        if (k + 1) % block == 0:
            for j in range(one):
                slow[k // block, j] = v[sums + j]
                v[sums + j] = 0.0
        if k % LOOK_AGAIN == 0 and not any_live(v, live, width):
            last = k
            break
        for j in range(one):
            w[state + j] = v[tau_out + j]
        for i in range(steps):
            step(w, k * L + i * h, h)
            if i == 0:
                for j in range(one):
                    v[ddq_sample + j] = w[state + one + j]
    if (last + 1) % block:
        for j in range(one):
            slow[last // block, j] = v[sums + j]


def any_live(v: Array, live: int, width: int) -> bool:
    """Whether an experiment of the bundle still goes on."""
    for lane in range(width):  # noqa: SIM110 (numba knows no generator in a compiled callee)
        if v[live + lane] > 0.0:
            return True
    return False
