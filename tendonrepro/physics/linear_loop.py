"""The sampled loop near a posture: linear, exactly discretised, delay lines and hold included.

Friction is left out: near standstill it only adds damping of unknown size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tendonrepro.arrays import Array
from tendonrepro.physics.arm import gravity_torque, mass_matrix
from tendonrepro.physics.control import (
    Law,
    Surface,
    error_rate,
    phi_slope,
    remember,
    start_memory,
    time_delay_estimate,
    unpacked,
)
from tendonrepro.physics.drive import to_joint_matrix
from tendonrepro.physics.dynamics import Plant

Complex = NDArray[np.complex128]

DEADEST = 1e-12
"""Modulus of an eigenvalue up to which its mode dies within a sample."""


def plant_matrices(q: Array, plant: Plant) -> tuple[Array, Array]:
    """Frictionless plant at rest at ``q`` (n,), linear: ``dx/dt = A x + B tau_m``, A (4 n, 4 n), B (4 n, n).

    The state is the deviation of ``q``, ``dq``, ``theta``, ``dtheta``. Clearance and transmission error do
    not enter.
    """
    n, drive = q.size, plant.drive
    I, D_m = to_joint_matrix(drive.inertia, drive.S_inv), to_joint_matrix(drive.friction.viscous, drive.S_inv)
    K_s, D_s = to_joint_matrix(drive.stiffness, drive.S_inv), to_joint_matrix(drive.damping, drive.S_inv)
    M = mass_matrix(q, plant.arm)
    zero, one = np.zeros((n, n)), np.eye(n)
    springs = np.hstack([K_s + gravity_stiffness(q, plant), D_s, -K_s, -D_s])
    tendons = np.hstack([K_s, D_s, -K_s, -(D_s + D_m)])
    links, motors = -np.linalg.solve(M, springs), np.linalg.solve(I, tendons)
    A = np.block([[zero, one, zero, zero], [links], [zero, zero, zero, one], [motors]])
    return A, np.vstack([zero, zero, zero, np.linalg.inv(I)])


def gravity_stiffness(q: Array, plant: Plant) -> Array:
    """Derivative (n, n) of ``G(q)``, N m rad⁻¹, by a complex step: exact to rounding."""
    step = 1e-30
    shifted = q[:, np.newaxis] + 1j * step * np.eye(q.size)
    return np.asarray(gravity_torque(shifted, plant.arm).imag / step)


def hold_discretised(A: Array, B: Array, L: float) -> tuple[Array, Array]:
    """Exact step over L seconds, the input held: ``x(t + L) = Phi x(t) + Gamma tau_m``."""
    # As heavy as all else that a command imports before its runs begin.
    from scipy.linalg import expm

    m, n = B.shape
    block = np.zeros((m + n, m + n))
    block[:m, :m], block[:m, m:] = A, B
    step = expm(L * block)
    return step[:m, :m], step[:m, m:]


def feedback_gains(law: Law) -> tuple[Array, Array]:
    """Gains of ``e`` and ``de`` in ``u`` for small errors, s⁻² and s⁻¹, each (n,)."""
    if law.surface == Surface.PD:
        return law.K_p, law.K_d
    if law.surface == Surface.TSM:
        return law.lam * law.beta, law.lam + law.beta
    slope = np.array([phi_slope(0.0, law, i) for i in range(law.eta.size)])
    return law.lam * law.eta * slope, law.lam + law.rate_gain * slope


def law_matrices(law: Law, delay: int = 0, *, driven: bool = False) -> tuple[Array, Array]:
    """Part of the loop without plant: torque that leaves now (n, m), memory afterwards (m - 4 n, m).

    The loop's state is the plant's (4 n), the law's memory, (6 lag + 3) n, and the torques under way (delay
    n). Where it is `driven`, 3 n columns more are of the desired ``q_d``, ``dq_d`` and ``ddq_d``.
    """
    n = law.M_bar.size
    end = (4 + 6 * law.lag + 3) * n
    m = end + delay * n
    width = m + 3 * n * driven
    z = np.eye(m, width)
    q, still = z[2 * n : 3 * n] if law.motor_side else z[:n], np.zeros((n, width))
    q_d, dq_d, ddq_d = np.eye(width)[m:].reshape(3, n, width) if driven else (still, still, still)
    memory = unpacked(z[4 * n : end], start_memory(np.zeros(n), np.zeros(n), law.lag))
    de, H_hat = error_rate(memory, q, q_d, dq_d, law), time_delay_estimate(memory, q, law)
    fed, on_error, on_rate = (
        (law.M_bar * gain)[:, np.newaxis] for gain in (law.feed_forward, *feedback_gains(law))
    )
    tau = law.to_joint @ (on_rate * de + on_error * (q_d - q) + fed * ddq_d + H_hat)
    queue = np.concatenate([z[end:], tau])
    known = queue[:n] if law.stores_applied else tau
    after = remember(memory, q, q_d, de, law.to_joint @ H_hat, known, law)
    return queue[:n], np.concatenate([*(part.reshape(-1, width) for part in after), queue[n:]])


def open_loop(q: Array, plant: Plant, law: Law, delay: int = 0) -> tuple[Array, Array, Array]:
    """Loop cut before the plant: ``z[k+1] = A z[k] + B v[k]``, ``tau_m[k] = C z[k]``.

    ``v = tau_m`` closes it. The law remembers ``C z`` whatever the plant feels, as with a wrong torque
    constant.
    """
    output, memory = law_matrices(law, delay)
    Phi, Gamma = hold_discretised(*plant_matrices(q, plant), law.L)
    moved, m = len(Phi), output.shape[1]
    A, B = np.zeros((m, m)), np.zeros((m, q.size))
    A[:moved, :moved], A[moved:], B[:moved] = Phi, memory, Gamma
    return A, B, output


def loop_matrix(q: Array, plant: Plant, law: Law, delay: int = 0) -> Array:
    """Matrix (m, m) of the closed loop from one sample to the next, at posture ``q``, rad."""
    A, B, C = open_loop(q, plant, law, delay)
    return A + B @ C


def load_matrix(q: Array, plant: Plant, L: float) -> Array:
    """What loads (n,) on the joints, N m, held over L seconds, do to the plant's state, (4 n, n)."""
    A, _ = plant_matrices(q, plant)
    pull = np.zeros((4 * q.size, q.size))
    pull[q.size : 2 * q.size] = -np.linalg.inv(mass_matrix(q, plant.arm))
    return hold_discretised(A, pull, L)[1]


class SampledLoop(NamedTuple):
    """A closed loop from one sample to the next: ``x[k+1] = A x[k] + B u[k]``, ``y[k] = C x[k] + D u[k]``.

    It is linear about rest at a posture, for small errors, which need not stay small on a motion. Friction of
    the joints, dry friction, encoder steps, limits of the torque and clearance are left out; viscous friction
    of the winches is not. Quantities are deviations from that rest.

    Attributes
    ----------
    A, B, C, D : array
        With n moving joints ``u`` has 4 n inputs: the load on each joint, N m, which pulls it downwards; the
        desired angle, rad, velocity, rad s⁻¹, and acceleration, rad s⁻². ``y`` has 2 n outputs: the error of
        each joint, rad, and the motors' torque in joint coordinates, N m. The state begins with ``q``,
        ``dq``, ``theta`` and ``dtheta``; the controller's memory follows.
    dt : float
        Sampling period, s.

    Examples
    --------
    >>> import tendonrepro as tr
    >>> loop = tr.compare(set={"reference.periods": 1}, controllers=2).loop("controller_2")
    >>> loop.D.shape, loop.dt
    ((4, 8), 0.001)

    ``control.ss(*loop)`` gives it to python-control, and ``scipy.signal.dlti(*loop[:4], dt=loop.dt)`` to
    SciPy.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float

    def __repr__(self) -> str:
        """Sizes alone: the matrices fill pages."""
        (states, inputs), outputs = self.B.shape, len(self.C)
        return f"SampledLoop({states} states, {inputs} inputs, {outputs} outputs, dt={self.dt:g} s)"


def sampled_loop(q: Array, plant: Plant, law: Law, delay: int = 0) -> SampledLoop:
    """Closed loop at posture ``q``, rad, with loads and the desired motion as its inputs."""
    n, A = q.size, loop_matrix(q, plant, law, delay)
    output, memory = law_matrices(law, delay, driven=True)
    m = len(A)
    _, Gamma = hold_discretised(*plant_matrices(q, plant), law.L)
    load = np.zeros((m, n))
    load[: 4 * n] = load_matrix(q, plant, law.L)
    B = np.hstack([load, np.vstack([Gamma @ output[:, m:], memory[:, m:]])])
    # The error is of the angles that the controller has.
    own = slice(2 * n, 3 * n) if law.motor_side else slice(n)
    C, D = np.vstack([-np.eye(m)[own], output[:, :m]]), np.zeros((2 * n, 4 * n))
    D[:n, n : 2 * n], D[n:, n:] = np.eye(n), output[:, m:]
    return SampledLoop(A, B, C, D, law.L)


def spectral_radius(matrices: Array) -> Array:
    """Largest modulus of an eigenvalue of matrices (..., m, m)."""
    return np.asarray(np.abs(np.linalg.eigvals(without_unread(matrices))).max(axis=-1))


def without_unread(matrices: Array) -> Array:
    """Matrices (..., m, m) without states that nothing reads; their eigenvalue is zero."""
    read = (matrices != 0.0).any(axis=tuple(range(matrices.ndim - 1)))
    return matrices if read.all() else without_unread(matrices[..., read, :][..., read])


def decay_rate(postures: Sequence[Array], plant: Plant, law: Law, delay: int = 0) -> float:
    """Slowest decay of the sampled loop over several postures, s⁻¹; negative where it grows."""
    radii = spectral_radius(np.stack([loop_matrix(q, plant, law, delay) for q in postures]))
    return float(-np.log(radii.max()) / law.L)


def modes(matrix: Array, L: float) -> Complex:
    """Eigenvalues as rates, ``log(z) / L``, slowest decay first, without modes that die within a sample.

    Real part: growth, s⁻¹. Imaginary part: angular frequency, rad s⁻¹, from 0 to Nyquist's.
    """
    z = np.linalg.eigvals(without_unread(matrix)).astype(np.complex128)
    z = z[(np.abs(z) > DEADEST) & (z.imag >= 0.0)]
    return np.asarray(np.log(z[np.argsort(-np.abs(z), kind="stable")]) / L)


def slowest(found: Sequence[Complex], above: float) -> tuple[float, float]:
    """Growth, s⁻¹, and frequency, Hz, of the mode that decays least; NaN if no mode is that fast."""
    every = np.concatenate(found)
    hertz = every.imag / (2.0 * np.pi)
    every, hertz = every[hertz >= above], hertz[hertz >= above]
    if not every.size:
        return np.nan, np.nan
    top = every.real.argmax()
    return float(every[top].real), float(hertz[top])


def stroke(q_d: Array) -> Array:
    """Start of a motion, the posture halfway, and its farthest sample, rad, (3, n)."""
    far = q_d[np.abs(q_d - q_d[0]).sum(axis=1).argmax()]
    return np.stack([q_d[0], 0.5 * (q_d[0] + far), far])
