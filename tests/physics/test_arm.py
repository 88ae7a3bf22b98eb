from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from support.oracles import Links, lagrangian, random_links, slope

from tendonrepro.physics.arm import (
    bias_torque,
    coriolis_matrix,
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
    def test_C_is_the_christoffel_form(self, n: int, seed: int) -> None:
        links, q, dq, _ = drawn(n, seed)
        arm = links.arm()
        dM = np.stack([slope(lambda at: mass_matrix(at, arm), q, axis) for axis in np.eye(n)], axis=-1)
        symbols = (dM + dM.transpose(0, 2, 1) - dM.transpose(2, 1, 0)) / 2.0
        assert near(coriolis_matrix(q, dq, arm), symbols @ dq)
