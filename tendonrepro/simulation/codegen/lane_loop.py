"""The time loop over bundles of experiments: plain Python, compiled in `compiled`."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array

LOOK_AGAIN = 64
"""Samples between two looks whether any experiment of a bundle still goes on."""

Whole = NDArray[np.int64]


def call(code: int, rows: Array, k: float) -> None:
    """Run machine code on the rows of a bundle; compiled, this is a call and nothing more."""
    ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_double)(code)(rows.ctypes.data, k)


def sweep(
    v: Array,
    code: Whole,
    lanes: Whole,
    w: Array,
    step: Whole,
    counts: Whole,
    desired: Array,
    noise: Array,
    first: int,
    L: float,
    block: int,
    slow: Array,
    trace: Array,
) -> None:
    """Take experiments through one slice of time, or until all have ended.

    Parameters
    ----------
    v : array (B, rows, lanes)
        Bundles of controllers with their statistics.
    code : array (B,)
        Address of each bundle's code.
    lanes : array (B, 5, lanes)
        Which experiment a lane holds, its motion, its noise, and its bundle and lane in `w`; -1 for none.
    w : array (C, rows, lanes)
        Bundles of plants.
    step : array (C,)
        Address of the code of each.
    counts : array (C, levels, lanes)
        Integration steps per sample at each level of `tendonrepro.simulation.resolution.demand`.
    desired : array (motions, T, 3 n)
        q_d, dq_d and ddq_d from sample `first` on.
    noise : array (noises, T, 2 n)
        Unit noise of encoders and torque.
    first : int
        Sample that the slice begins with.
    L : float
        Sampling period, s.
    block : int
        Samples of a block.
    slow : array (blocks, n, experiments)
        Errors summed up over blocks are added here.
    trace : array (samples, 9 n, experiments)
        Receives the recorded rows, if it has any samples.
    """
    n = desired.shape[2] // 3
    start, left = np.empty((4 * n, w.shape[2])), np.empty(w.shape[2])
    for now in range(desired.shape[1]):
        k = first + now
        for b in range(v.shape[0]):
            measure(v, w, b, lanes, desired, noise, now, n)
            call(code[b], v[b], float(k))
            act(v, w, b, lanes, slow, k // block, n)
            if trace.shape[0] > 0:
                record(v, b, lanes, trace, k)
        if now % LOOK_AGAIN == 0 and not any_live(w, n):
            break
        for b in range(w.shape[0]):
            advance(w, b, counts, k * L, L, start, left, step[b])


def measure(v: Array, w: Array, b: int, lanes: Whole, desired: Array, noise: Array, now: int, n: int) -> None:
    """Give controllers the state and acceleration of their plants, the desired motion and the noise."""
    for lane in range(v.shape[2]):
        motion, source, bundle, seat = (
            lanes[b, 1, lane],
            lanes[b, 2, lane],
            lanes[b, 3, lane],
            lanes[b, 4, lane],
        )
        for j in range(4 * n):
            v[b, j, lane] = w[bundle, j, seat]
        for j in range(n):
            v[b, 14 * n + j, lane] = w[bundle, 6 * n + 4 + j, seat]
        for j in range(3 * n):
            v[b, 9 * n + j, lane] = desired[motion, now, j]
        if source >= 0:
            for j in range(2 * n):
                v[b, 12 * n + j, lane] = noise[source, now, j]


def act(v: Array, w: Array, b: int, lanes: Whole, slow: Array, block: int, n: int) -> None:
    """Give plants their torque, end those of experiments that ended, and add the errors to their block."""
    for lane in range(v.shape[2]):
        member, bundle, seat = lanes[b, 0, lane], lanes[b, 3, lane], lanes[b, 4, lane]
        if member >= 0:
            w[bundle, 6 * n + 3, seat] = v[b, 17 * n, lane]
            for j in range(n):
                w[bundle, 4 * n + j, seat] = v[b, 15 * n + j, lane]
                slow[block, j, member] += v[b, 16 * n + j, lane]


def record(v: Array, b: int, lanes: Whole, trace: Array, k: int) -> None:
    """Keep the recorded rows of this sample."""
    for lane in range(v.shape[2]):
        if lanes[b, 0, lane] >= 0:
            for j in range(trace.shape[1]):
                trace[k, j, lanes[b, 0, lane]] = v[b, j, lane]


def advance(  # noqa: PLR0912 (compiled: lanes are gone through one number at a time)
    w: Array, b: int, counts: Whole, time: float, L: float, start: Array, left: Array, step: int
) -> None:
    """Take the plants of a bundle to the next sample, each in the steps it needs by itself.

    A lane that meets a higher demand than its steps are for goes back and takes more. A lane with nothing to
    do has steps of no length, which leave it as it is.
    """
    n, width = start.shape[0] // 4, left.size
    t, h, demand, live = 6 * n, 6 * n + 1, 6 * n + 2, 6 * n + 3
    for j in range(4 * n):
        for lane in range(width):
            start[j, lane] = w[b, j, lane]
    most = 0.0
    for lane in range(width):
        left[lane] = counts[b, int(w[b, demand, lane]), lane] if w[b, live, lane] > 0.0 else 0.0
        most = max(most, left[lane])
    while most > 0.0:
        for lane in range(width):
            w[b, t, lane] = time
            w[b, h, lane] = L / max(left[lane], 1.0) if left[lane] > 0.0 else 0.0
            w[b, demand, lane] = 0.0 if left[lane] > 0.0 else w[b, demand, lane]
        for i in range(int(most)):
            call(step, w[b], 0.0)
            for lane in range(width):
                w[b, t, lane] = time + (i + 1) * w[b, h, lane]
                w[b, h, lane] = w[b, h, lane] if i + 1 < left[lane] else 0.0
            if i == 0:
                for j in range(n):
                    for lane in range(width):
                        if left[lane] > 0.0:
                            w[b, 6 * n + 4 + j, lane] = w[b, 5 * n + j, lane]
        most = 0.0
        for lane in range(width):
            more = counts[b, int(w[b, demand, lane]), lane]
            if 0.0 < left[lane] < more:
                left[lane] = more
                for j in range(4 * n):
                    w[b, j, lane] = start[j, lane]
            else:
                left[lane] = 0.0
            most = max(most, left[lane])


def any_live(w: Array, n: int) -> bool:
    """Whether an experiment still goes on."""
    return bool((w[:, 6 * n + 3] > 0.0).any())


PARTS = measure, act, record, advance, any_live
"""Functions that :func:`sweep` calls, each after those it calls itself."""
