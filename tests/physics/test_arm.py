from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import Links, lagrangian, random_links, slope

from tendonrepro.physics.arm import (
    bias_torque,
    coriolis_matrix,
    gravity_torque,
    joint_angles,
    link_angles,
    mass_matrix,
)

Array = NDArray[np.float64]

many = settings(max_examples=60, deadline=None)
cases = given(st.integers(1, 3), st.integers(0, 2**32 - 1))
# The oracle covers three links; laws that need none are tried on longer chains too.
long_cases = given(st.integers(1, 6), st.integers(0, 2**32 - 1))


def drawn(n: int, seed: int) -> tuple[Links, Array, Array, Array]:
    """Links, posture, velocity and acceleration, over the full circle."""
    rng = np.random.default_rng(seed)
    return random_links(n, rng), *rng.uniform(-np.pi, np.pi, (3, n))


def near(value: Array, expected: Array) -> bool:
    """Equal but for the rounding of sums of a few dozen terms."""
    return bool(np.abs(value - expected).max() <= 2e-14 * (1.0 + np.abs(expected).max()))


class TestAgainstLagrange:
    @many
    @cases
    def test_whole_equation_of_motion(self, n: int, seed: int) -> None:
        links, q, dq, ddq = drawn(n, seed)
        arm = links.arm()
        torque = mass_matrix(q, arm) @ ddq + bias_torque(q, dq, arm)
        assert near(torque, lagrangian(n).torque(q, dq, ddq, links))


class TestLaws:
    @many
    @long_cases
    def test_mass_matrix_symmetric_and_positive_definite(self, n: int, seed: int) -> None:
        links, q, _, _ = drawn(n, seed)
        M = mass_matrix(q, links.arm())
        assert near(M, M.T)
        assert np.linalg.eigvalsh(M).min() > 0.0

    @many
    @long_cases
    def test_C_is_the_christoffel_form(self, n: int, seed: int) -> None:
        links, q, dq, _ = drawn(n, seed)
        arm = links.arm()
        dM = np.stack([slope(lambda at: mass_matrix(at, arm), q, axis) for axis in np.eye(n)], axis=-1)
        symbols = (dM + dM.transpose(0, 2, 1) - dM.transpose(2, 1, 0)) / 2.0
        assert near(coriolis_matrix(q, dq, arm), symbols @ dq)

    @many
    @given(st.integers(2, 6), st.integers(0, 2**32 - 1))
    def test_holding_the_first_joint_leaves_a_shorter_arm(self, n: int, seed: int) -> None:
        links, q, dq, _ = drawn(n, seed)
        q[0] = dq[0] = 0.0
        outer = Links(*(field[1:] for field in links[:5]), links.payload_mass, links.gravity)
        assert near(mass_matrix(q, links.arm())[1:, 1:], mass_matrix(q[1:], outer.arm()))
        assert near(bias_torque(q, dq, links.arm())[1:], bias_torque(q[1:], dq[1:], outer.arm()))


class TestConvention:
    """Absolute angles from hanging, positive clockwise, that is upwards on the left."""

    links = Links(*np.array([[0.3], [0.7], [0.1], [0.01], [0.0]]), payload_mass=0.2, gravity=9.81)

    def test_a_hanging_link_needs_no_torque_and_one_above_it_a_positive_one(self) -> None:
        arm = self.links.arm()
        assert gravity_torque(np.array([0.0]), arm)[0] == 0.0
        # Horizontal: the full weight of link and payload on their levers.
        expected = 9.81 * (0.7 * 0.1 + 0.2 * 0.3)
        assert gravity_torque(np.array([np.pi / 2]), arm)[0] == pytest.approx(expected, rel=1e-15)

    def test_link_angles_add_up_from_the_start_posture(self) -> None:
        q = np.array([0.1, 0.2, -0.5])
        assert link_angles(q, np.array([1.0, 2.0, 3.0])) == pytest.approx([1.1, 2.3, 2.8], rel=1e-15)
        back = joint_angles(link_angles(q, np.array([1.0, 2.0, 3.0])), np.array([1.0, 2.0, 3.0]))
        assert back == pytest.approx(q, rel=1e-14)
