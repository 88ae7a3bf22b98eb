"""Code on lanes does what the functions do that it was made from."""

from __future__ import annotations

import numpy as np
import pytest
from support.oracles import random_plant

from tendonrepro.arrays import Array
from tendonrepro.physics.control import command
from tendonrepro.physics.dynamics import state_derivative
from tendonrepro.simulation.codegen.lanes import LaneRows, aligned, signature, stacked
from tendonrepro.simulation.codegen.machine import LANES, assembled, callable_code
from tendonrepro.simulation.kernel import advance_source, experiment_rows, runge_kutta, single_code
from tendonrepro.simulation.resolution import demand

T = 0.4
"""Time that code is called with, s."""


def filled(rows: LaneRows) -> Array:
    w = aligned(np.zeros((rows.count, LANES)))
    for row, values in rows.constants.items():
        w[row] = values
    return w


def run(source: str, w: Array, *names: str) -> None:
    for address in assembled(source, *names):
        callable_code(address)(w.ctypes.data, 0.0, T)


def test_a_lane_that_meets_a_higher_demand_goes_back_and_takes_more_steps() -> None:
    """From fast motion to a change of direction, beside one that moves on and one that stands still."""
    plant = random_plant(1, 1, frozenset({"coulomb"})).plant
    rows = experiment_rows(1)
    source = advance_source(stacked([plant] * LANES), rows)
    v, S, at = plant.link_friction.smoothing_velocity[0], plant.drive.S[0, 0], rows.named
    winch = 50.0 * S * plant.drive.friction.smoothing_velocity[0]
    state = np.zeros((4, LANES))
    state[1], state[3], state[1, 1], state[:, 2] = 4.5 * v, winch, 60.0 * v, 0.0
    torque, h = np.full((1, LANES), 0.0), 1e-3
    w = filled(rows)
    w[:4], w[4], w[at["live"]] = state, torque, 1.0
    w[at["demand"]] = [0.0, 0.0, 2.0, *[0.0] * (LANES - 3)]
    for level, steps in enumerate((1.0, 2.0, 5.0)):
        w[at["steps"] + level], w[at["length"] + level] = steps, h / steps
    run(source, w, "prepare", "advance")

    def after(lane: int, steps: int) -> tuple[Array, int]:
        x, met = state[:, lane], 0
        for k in range(steps):
            ahead, _ = runge_kutta(
                lambda t, y: state_derivative(t, y, torque[:, lane], plant), k * h / steps, x, h / steps
            )
            met, x = max(met, int(demand(x, ahead, plant))), ahead
        return x, met

    for lane, first in enumerate((1, 1, 5)):
        expected, met = after(lane, first)
        steps = max(first, (1, 2, 5)[met])
        if steps > first:
            expected, met = after(lane, steps)
        assert w[:4, lane] == pytest.approx(expected, rel=1e-11, abs=1e-13)
        assert w[at["demand"], lane] == met


def test_code_is_written_once_for_plants_with_the_same_features() -> None:
    first, second = (stacked([random_plant(2, seed).plant] * 2) for seed in (1, 2))
    assert signature(first) == signature(second)
    (one, rows), (other, others) = (single_code((plant,), command) for plant in (first, second))
    assert one is other
    for plant, kept in ((first, rows), (second, others)):
        assert plant.drive.inertia[0].tolist() in [values.tolist() for values in kept.constants.values()]
    assert signature(stacked([random_plant(2, 1, frozenset()).plant] * 2)) != signature(first)
