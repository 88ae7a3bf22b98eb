from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import (
    FEATURES,
    PAPER,
    Subject,
    accelerations_by_matrices,
    elongation,
    friction_by_formula,
    joint_matrices,
    random_links,
    random_plant,
    random_state,
    slope,
    total_energy,
    turned,
    winch_angles,
)

from tendonrepro.arrays import solve_positive_definite
from tendonrepro.physics.arm import coriolis_matrix, mass_matrix
from tendonrepro.physics.drive import to_winch_torque
from tendonrepro.physics.dynamics import (
    both_ways,
    frictionless,
    holding_torque,
    load_at_rest,
    rest_state,
    state_derivative,
)

Array = NDArray[np.float64]

PASSIVE = FEATURES - {"step", "sine"}

each_size = pytest.mark.parametrize("n", [1, 2, 3])
each = pytest.mark.parametrize(("n", "seed"), [(1, 0), (2, 1), (2, 2), (3, 3), (3, 4)])
# The oracle covers three links; what needs none is tried on longer chains too.
long_cases = given(st.integers(1, 6), st.integers(0, 2**32 - 1))


def drawn(n: int, seed: int, features: frozenset[str]) -> tuple[Subject, Array, Array]:
    """Plant, state and motor torque."""
    rng = np.random.default_rng([n, seed, 2])
    return random_plant(n, seed, features), random_state(n, rng), rng.uniform(-5.0, 5.0, n)


def dissipation(state: Array, tau_m: Array, subject: Subject) -> float:
    """Power lost in bearings, tendons, pulleys and reducers, W."""
    q, dq, theta, dtheta = np.split(state, 4)
    drive, routing = subject.plant.drive, subject.routing
    motor, motor_rate, radius = winch_angles(theta, routing), winch_angles(dtheta, routing), routing.winch / 2
    winch_rate = motor_rate * (1.0 + drive.wobble * drive.wobble_rate * np.cos(drive.wobble_rate * motor))
    stretch = elongation(q, turned(motor, drive), routing) / radius
    stretch_rate = elongation(dq, winch_rate, routing) / radius
    pulled = np.sign(stretch) * np.maximum(np.abs(stretch) - drive.slack, 0.0)
    tendon = drive.stiffness * pulled + drive.damping * stretch_rate
    to_motor = np.linalg.inv(np.column_stack([winch_angles(axis, routing) for axis in np.eye(q.size)])).T
    transmitted = drive.pulley_loss * np.abs(tendon) + drive.reducer_loss * np.abs(to_motor @ tau_m)
    at_motor = friction_by_formula(motor_rate, drive.friction)
    at_motor += transmitted * np.tanh(motor_rate / drive.friction.smoothing_velocity)
    links = friction_by_formula(dq, subject.plant.link_friction)
    return float(links @ dq + at_motor @ motor_rate + (drive.damping * stretch_rate**2).sum())


@settings(max_examples=60)
@long_cases
def test_C_is_the_christoffel_form(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm, (q, dq) = random_links(n, rng).arm(), rng.uniform(-np.pi, np.pi, (2, n))
    dM = np.stack([slope(lambda at: mass_matrix(at, arm), q, axis) for axis in np.eye(n)], axis=-1)
    symbols = (dM + dM.transpose(0, 2, 1) - dM.transpose(2, 1, 0)) / 2.0 @ dq
    # Sums of a few dozen terms.
    near = 2e-14 * (1.0 + np.abs(symbols).max())
    np.testing.assert_allclose(coriolis_matrix(q, dq, arm), symbols, rtol=0.0, atol=near)


@long_cases
def test_solution_leaves_only_rounding(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    factor, b = rng.uniform(-1.0, 1.0, (n, n)), rng.uniform(-1.0, 1.0, n)
    A = factor @ factor.T + 0.1 * np.eye(n)
    x = solve_positive_definite(A, b)
    # Backward stability of Cholesky: the residual is of the size of A x rounded, n + 1 times over.
    bound = 4 * (n + 1) * np.finfo(float).eps * np.linalg.norm(A) * np.linalg.norm(x)
    assert np.linalg.norm(A @ x - b) <= bound


class TestPaperEquations:
    @each
    @pytest.mark.parametrize("t", [0.2, 0.5, 0.9])
    def test_derivative_solves_equations_3_to_5(self, n: int, seed: int, t: float) -> None:
        """The step of the disturbance is at 0.5 s."""
        subject, state, tau_m = drawn(n, seed, PAPER)
        _, dq, _, dtheta = np.split(state, 4)
        ddq, ddtheta = accelerations_by_matrices(t, state, tau_m, subject)
        got = np.split(state_derivative(t, state, tau_m, subject.plant), 4)
        assert (got[0] == dq).all()
        assert (got[2] == dtheta).all()
        # Two ways to solve: the condition of M and of S_inv, up to some thousands, multiplies the rounding.
        assert got[1] == pytest.approx(ddq, abs=1e-11 * np.abs(ddq).max())
        assert got[3] == pytest.approx(ddtheta, abs=1e-11 * np.abs(ddtheta).max())


class TestEnergy:
    @each
    def test_power_balance_at_any_state(self, n: int, seed: int) -> None:
        """Everything switched on but the disturbance, which drives from inside."""
        subject, state, tau_m = drawn(n, seed, PASSIVE)
        derivative = state_derivative(0.0, state, tau_m, subject.plant)
        gained = slope(lambda at: total_energy(at, subject), state, derivative)
        expected = tau_m @ state[3 * n :] - dissipation(state, tau_m, subject)
        # Terms of some hundred watts cancel to some tens.
        assert gained == pytest.approx(expected, rel=1e-11, abs=1e-10)

    @each_size
    @pytest.mark.parametrize(
        "features", [PASSIVE - {"clearance", "wobble"}, frozenset()], ids=["all", "none"]
    )
    def test_frictionless_keeps_only_D_m_and_D_s(self, n: int, features: frozenset[str]) -> None:
        subject, state, tau_m = drawn(n, 1, features)
        bare = subject._replace(plant=frictionless(subject.plant))
        derivative = state_derivative(0.0, state, tau_m, bare.plant)
        gained = slope(lambda at: total_energy(at, bare), state, derivative)
        _, dq, _, dtheta = np.split(state, 4)
        matrix = joint_matrices(subject)
        lost = dtheta @ matrix.D_m @ dtheta + (dtheta - dq) @ matrix.D_s @ (dtheta - dq)
        assert gained == pytest.approx(tau_m @ dtheta - lost, rel=1e-11, abs=1e-10)


class TestRest:
    @each
    @pytest.mark.parametrize("features", [PAPER - {"step", "sine"}, PASSIVE], ids=["paper", "all"])
    def test_nothing_moves_under_the_holding_torque(
        self, n: int, seed: int, features: frozenset[str]
    ) -> None:
        subject, state, _ = drawn(n, seed, features)
        at = state[:n]
        rest = rest_state(at, subject.plant)
        assert (rest[:n] == at).all()
        derivative = state_derivative(0.0, rest, holding_torque(at, subject.plant), subject.plant)
        # Torques of some N m, rounded, over inertias of a few g m2.
        assert derivative == pytest.approx(np.zeros(4 * n), abs=1e-10)

    @each
    def test_a_tendon_that_would_have_to_push_holds_nothing(self, n: int, seed: int) -> None:
        subject, state, _ = drawn(n, seed, PAPER)
        plant = subject.plant
        pulling = to_winch_torque(holding_torque(state[:n], plant), plant.drive)
        drive = plant.drive._replace(one_way=np.ones(n))
        held = to_winch_torque(holding_torque(state[:n], plant._replace(drive=drive)), drive)
        assert held == pytest.approx(np.maximum(pulling, 0.0), rel=1e-12, abs=1e-12)
        assert (both_ways(plant._replace(drive=drive)).drive.one_way == 0.0).all()


@each_size
@pytest.mark.parametrize("features", [frozenset(), FEATURES], ids=["bare", "all"])
def test_many_states_at_once_equal_each_alone_bit_for_bit(n: int, features: frozenset[str]) -> None:
    plant = random_plant(n, 1, features).plant
    rng = np.random.default_rng(n)
    t, state, tau_m = rng.uniform(0.0, 1.0, 37), random_state(n, rng, (37,)), rng.uniform(-5.0, 5.0, (n, 37))
    together = state_derivative(t, state, tau_m, plant)
    alone = [state_derivative(float(t[k]), state[:, k], tau_m[:, k], plant) for k in range(37)]
    assert (together == np.stack(alone, axis=-1)).all()
    held = [load_at_rest(state[:n, k], plant) for k in range(37)]
    assert (load_at_rest(state[:n], plant) == np.stack(held, axis=-1)).all()
