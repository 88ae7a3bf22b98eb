"""One sampled control law, of which Controllers 1 to 3 and plain TDC are parameter sets.

Every law is ``tau_m = M_bar u + H_hat`` (Eq. 17). Laws differ in the surface that makes ``u`` (Eqs. 9, 11,
18) and in the weights of the time-delay estimate ``H_hat`` (Eqs. 8, 15).
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple, TypeVar

import numpy as np

from tendonrepro.arrays import Array, choose, pick, times

ANGLES_BACK, TORQUES_BACK = 3, 2
"""How many delay times back Eqs. (15) and (16) reach; their second difference is the first of a delay ago."""

DEGREES_PER_RADIAN = 180.0 / np.pi

TYPICAL_ERROR_DEG = 0.25
"""Size of the error at which the ratio of two laws is given: near the printed mean errors of both joints."""


class Surface(IntEnum):
    """Which error combination the law drives to zero."""

    NTSM = 0
    """Nonsingular terminal sliding mode, Eqs. (11) and (12)."""
    TSM = 1
    """``s = de + beta e``, Controller 3."""
    PD = 2
    """Plain time-delay control, Eq. (9)."""


class Law(NamedTuple):
    """Gains and readings of one law; arrays are (n,), an entry per moving joint.

    Defaults are as published, but for the odd polynomial and the ``eta`` kept in Controller 2. What is
    a whole number or a truth chooses by `choose` or `pick`, not by a branch, so that experiments side by side
    may differ in it; of surfaces only in NTSM and TSM.

    Attributes
    ----------
    surface : int
        A :class:`Surface`.
    L
        Sampling period, s.
    lag
        Delay time in sampling periods; 1 as the paper suggests.
    M_bar
        kg m².
    lam, eta, b, Delta, beta
        Gains of Eqs. (11) to (14); ``Delta`` is in rad times ``angle_scale``.
    K_d, K_p
        Gains of Eq. (9), s⁻¹ and s⁻², of ``Surface.PD`` only.
    weights : array (2, n)
        Of the estimates from ``t - L`` and ``t - 2L``, Eq. (15).
    newest
        Newest sample in the difference labelled ``t - L``: 1 as Eq. (16) prints it, 0 centred.
    phi_is_odd
        Polynomial ``gamma_1 e + gamma_2 |e| e``; False is the print's ``gamma_1 e + gamma_2 e²``.
    power_inside
        Power branch of ``phi`` inside ``Delta`` too.
    power_floor
        Error, in the unit of ``Delta``, below which the power branch's slope stops growing.
    angle_scale
        Units of ``phi``'s argument per radian: 1, or 180/π where gains mean degrees.
    rate_gain
        Factor of ``dphi`` in ``u``: ``eta``, or 1 where Controller 2's print drops it.
    rate_filter, ddq_filter, estimate_filter
        Low-pass filters of ``de``, Eq. (16) and ``H_hat``: weight of the newest value, 1 for none.
    error_differenced
        ``de`` is the error's difference, not ``dq_d`` less the encoder's.
    to_joint, from_joint : array (n, n)
        Between the law's torque coordinates and joint coordinates.
    stores_applied
        It remembers the torque that the drive put out, not the commanded one.
    feed_forward
        Share of the desired acceleration that the law gets: 1, or 0 where none is fed forward.
    motor_side
        Angles are ``S q_motor`` of motor encoders, not of joint encoders.
    """

    L: float
    M_bar: Array
    lam: Array
    eta: Array
    b: Array
    Delta: Array
    beta: Array
    K_d: Array
    K_p: Array
    weights: Array
    rate_gain: Array
    to_joint: Array
    from_joint: Array
    power_floor: float
    surface: int = Surface.NTSM
    lag: int = 1
    newest: int = 1
    phi_is_odd: bool = True
    power_inside: bool = False
    angle_scale: float = 1.0
    rate_filter: float = 1.0
    ddq_filter: float = 1.0
    estimate_filter: float = 1.0
    error_differenced: bool = False
    stores_applied: bool = False
    motor_side: bool = False
    feed_forward: float = 1.0


Kind = TypeVar("Kind", bound="Memory | ServoMemory")


class Memory(NamedTuple):
    """What the law remembers between two samples, the newest first.

    Attributes
    ----------
    q : array (3 lag, n)
        Encoder values back to ``t - 3L``, rad.
    tau : array (2 lag, n)
        Torques back to ``t - 2L``, N m in joint coordinates: commanded and limited, or applied
        (`Law.stores_applied`).
    de, q_d : array (n,)
        Rate of the error, rad s⁻¹, and desired angles, rad, one sample ago.
    ddq : array (lag, n)
        Accelerations of Eq. (16), rad s⁻².
    H_hat : array (n,)
        Last estimate, N m in joint coordinates.
    """

    q: Array
    tau: Array
    de: Array
    q_d: Array
    ddq: Array
    H_hat: Array


def start_memory(q: Array, tau: Array, lag: int = 1, q_d: Array | None = None) -> Memory:
    """Start-up rule for ``t < 4L``: every delay line holds one value.

    They are the encoder values, rad, and holding torque, N m, of an arm at rest, which stands beside the
    reference where that begins at another ``q_d``. The reading ``cold`` gives zero torque.
    """
    still = np.zeros_like(q)
    return Memory(
        q=np.stack([q] * (ANGLES_BACK * lag)),
        tau=np.stack([tau] * (TORQUES_BACK * lag)),
        de=still,
        q_d=q if q_d is None else q_d,
        ddq=np.stack([still] * lag),
        H_hat=tau,
    )


def unpacked(values: Array, example: Kind) -> Kind:
    """Memory shaped as an example, from all its numbers in order, (numbers, ...)."""
    parts = np.split(values, np.cumsum([part.size for part in example])[:-1])
    shaped = (part.reshape(like.shape + part.shape[1:]) for part, like in zip(parts, example, strict=True))
    return type(example)(*shaped)


def remember(memory: Memory, q: Array, q_d: Array, de: Array, H_hat: Array, tau: Array, law: Law) -> Memory:
    """Shift the delay lines by one period; arguments are this sample's, as in `Memory`."""
    return Memory(
        q=_shifted(memory.q, q),
        tau=_shifted(memory.tau, tau),
        de=de,
        q_d=q_d,
        ddq=_shifted(memory.ddq, delayed_acceleration(memory, q, law)),
        H_hat=H_hat,
    )


def _shifted(line: Array, newest: Array) -> Array:
    return np.concatenate((newest[np.newaxis], line[:-1]))


def command(
    memory: Memory, q: Array, q_d: Array, dq_d: Array, ddq_d: Array, law: Law
) -> tuple[Array, Array, Array, Array]:
    """One sample of the law, Eqs. (8) to (18); all arrays are (n,).

    Parameters
    ----------
    q
        Encoder values now, rad.
    q_d, dq_d, ddq_d
        Desired motion now, rad, rad s⁻¹, rad s⁻².

    Returns
    -------
    tau, H_hat
        Commanded torque and estimate of the lumped dynamics, N m in joint coordinates.
    s
        Sliding variable, rad s⁻¹.
    de
        Rate of the error, rad s⁻¹, for :func:`remember`.
    """
    de = error_rate(memory, q, q_d, dq_d, law)
    H_hat = time_delay_estimate(memory, q, law)
    tau = np.empty_like(q)
    s = np.empty_like(q)
    for i in range(q.shape[0]):
        s[i], u = surface_and_feedback(q_d[i] - q[i], de[i], law, i)
        tau[i] = law.M_bar[i] * (ddq_d[i] + u) + H_hat[i]
    return times(law.to_joint, tau), times(law.to_joint, H_hat), s, de


def error_rate(memory: Memory, q: Array, q_d: Array, dq_d: Array, law: Law) -> Array:
    """Rate ``de`` (n,) of the tracking error, rad s⁻¹, filtered as the law says.

    The encoder's part is a backward difference; the paper names none.
    """
    de = np.empty_like(q)
    for i in range(q.shape[0]):
        desired = choose(law.error_differenced, (q_d[i] - memory.q_d[i]) / law.L, dq_d[i])
        newest = desired - (q[i] - memory.q[0, i]) / law.L
        de[i] = (1.0 - law.rate_filter) * memory.de[i] + law.rate_filter * newest
    return de


def time_delay_estimate(memory: Memory, q: Array, law: Law) -> Array:
    """``H_hat`` (n,) by Eqs. (15) and (16), or (8), N m in the law's torque coordinates."""
    newest = delayed_acceleration(memory, q, law)
    H_hat = np.zeros_like(q)
    for back in range(2):
        torque = times(law.from_joint, pick(memory.tau, (back + 1) * law.lag - 1))
        ddq = pick(memory.ddq, law.lag - 1) if back else newest
        for i in range(q.shape[0]):
            H_hat[i] += law.weights[back, i] * (torque[i] - law.M_bar[i] * ddq[i])
    before = times(law.from_joint, memory.H_hat)
    for i in range(q.shape[0]):
        H_hat[i] = (1.0 - law.estimate_filter) * before[i] + law.estimate_filter * H_hat[i]
    return H_hat


def delayed_acceleration(memory: Memory, q: Array, law: Law) -> Array:
    """``ddq(t - L)`` of Eq. (16), (n,), rad s⁻², filtered as the law says.

    ``ddq(t - 2L)`` is what this was one delay time ago. Only the centred reading uses ``q``.
    """
    L, lag = law.lag * law.L, law.lag
    one, two, three = (pick(memory.q, back * lag - 1) for back in (1, 2, 3))
    ddq = choose(law.newest, one - 2.0 * two + three, q - 2.0 * one + two) / (L * L)
    filtered: Array = (1.0 - law.ddq_filter) * memory.ddq[0] + law.ddq_filter * ddq
    return filtered


def surface_and_feedback(e: Any, de: Any, law: Law, i: int) -> tuple[Any, Any]:
    """Sliding variable ``s``, rad s⁻¹, and feedback ``u - ddq_d``, rad s⁻², of joint i, from 0.

    NTSM: Eqs. (11) and (18). TSM: Controller 3. PD: Eq. (9), whose ``s`` is its feedback over ``K_d``.
    """
    if isinstance(law.surface, int):
        return (_ntsm, _tsm, _pd)[law.surface](e, de, law, i)
    both = zip(_tsm(e, de, law, i), _ntsm(e, de, law, i), strict=True)
    s, feedback = (choose(law.surface > 0.0, *pair) for pair in both)
    return s, feedback


def _ntsm(e: Any, de: Any, law: Law, i: int) -> tuple[Any, Any]:
    s = de + law.eta[i] * phi(e, law, i)
    return s, law.rate_gain[i] * phi_slope(e, law, i) * de + law.lam[i] * s


def _tsm(e: Any, de: Any, law: Law, i: int) -> tuple[Any, Any]:
    s = de + law.beta[i] * e
    return s, law.beta[i] * de + law.lam[i] * s


def _pd(e: Any, de: Any, law: Law, i: int) -> tuple[Any, Any]:
    feedback = law.K_d[i] * de + law.K_p[i] * e
    return feedback / law.K_d[i], feedback


def phi(e: Any, law: Law, i: int) -> Any:
    """``phi(e)`` of Eq. (12) for joint i, rad^b; ``eta`` carries the unit that makes it a velocity.

    The print takes the power branch inside ``Delta`` only while ``de + eta sig(e)^b`` is exactly zero, which
    measured numbers never are.
    """
    x = e * law.angle_scale
    outer = sig(x, law.b[i])
    gamma_1, gamma_2 = polynomial(law.b[i], law.Delta[i])
    inner = gamma_1 * x + gamma_2 * (x * choose(law.phi_is_odd, abs(x), x))
    return _of_branch(x, outer, inner, law, i) / law.angle_scale


def phi_slope(e: Any, law: Law, i: int) -> Any:
    """Slope of :func:`phi`, so that ``dphi/dt = phi_slope de``; the paper never prints it.

    The power branch's slope is unbounded at zero; below ``power_floor`` it is held.
    """
    x = e * law.angle_scale
    outer = law.b[i] * np.maximum(abs(x), law.power_floor) ** (law.b[i] - 1.0)
    gamma_1, gamma_2 = polynomial(law.b[i], law.Delta[i])
    inner = gamma_1 + 2.0 * gamma_2 * choose(law.phi_is_odd, abs(x), x)
    return _of_branch(x, outer, inner, law, i)


def _of_branch(x: Any, outer: Any, inner: Any, law: Law, i: int) -> Any:
    """Power or polynomial of Eq. (12), or their slopes, whichever acts."""
    printed = choose(abs(x) >= law.Delta[i], outer, inner)
    return choose(law.power_inside, outer, printed)


def sig(x: Any, b: Any) -> Any:
    """``|x|^b sign(x)``."""
    size = abs(x) ** b
    return choose(x >= 0.0, size, -size)


def polynomial(b: Any, Delta: Any) -> tuple[Any, Any]:
    """Coefficients ``gamma_1``, ``gamma_2`` of Eq. (13): value and slope of ``sig(e)^b`` at ``Delta``."""
    return (2.0 - b) * Delta ** (b - 1.0), (b - 1.0) * Delta ** (b - 2.0)


def estimator_weights(alpha: Array, reading: str = "interpolating") -> Array:
    """Weights (2, n) of Eq. (15) from alpha (n,): ``(1 - alpha, alpha)`` as printed.

    The reading ``extrapolating`` is ``(1 + alpha, -alpha)``, ``swapped`` is ``(alpha, 1 - alpha)``. But for
    ``swapped``, zero is Eq. (8).
    """
    older = {"interpolating": alpha, "extrapolating": -alpha, "swapped": 1.0 - alpha}[reading]
    return np.stack([1.0 - older, older])


class Servo(NamedTuple):
    """Gains of one position loop per winch, for the decoupling experiment.

    A stiff loop is assumed; the paper names none. Claim K3 does not depend on it: calculated joint angles
    start from motor angles reached.

    Attributes
    ----------
    stiffness, damping : array (n,)
        At the winch, N m rad⁻¹ and N m s rad⁻¹.
    L : float
        Sampling period, s.
    """

    stiffness: Array
    damping: Array
    S_inv: Array
    L: float


class ServoMemory(NamedTuple):
    """Motor encoder values one sample ago, rad, and the torque that held the arm at the start, N m, (n,)."""

    q_motor: Array
    tau: Array


def servo_torque(q_motor: Array, q_motor_before: Array, q_d: Array, dq_d: Array, servo: Servo) -> Array:
    """Torque (n,) beyond the one that held the arm at the start, N m in joint coordinates.

    Motor encoder values (n,) are in rad at the winch. ``q_d`` and ``dq_d`` (n,) are of joints, rad and rad
    s⁻¹.
    """
    rate = (q_motor - q_motor_before) / servo.L
    error, de = times(servo.S_inv, q_d) - q_motor, times(servo.S_inv, dq_d) - rate
    return times(servo.S_inv.T, servo.stiffness * error + servo.damping * de)


def estimate_age(law: Law, delay: int = 0) -> Array:
    """Mean age (n,) of the estimate when it acts, in periods, with whole samples of output delay.

    It is 1 + α by Eq. (15), 1 by Eq. (8), 1 − α extrapolating. A filter adds its mean lag. A delay adds only
    where the law remembers the applied torque: a command meets it on both sides of its equation.
    """
    waited = delay * law.stores_applied + (1.0 / law.estimate_filter - 1.0)
    return np.asarray(law.lag * (law.weights[0] + 2.0 * law.weights[1]) + waited)


def stiffness(law: Law, e: float) -> Array:
    """Feedback per error e, rad, at rest: ``λ k`` with the chord ``k`` of the surface, s⁻², (n,)."""
    n = law.M_bar.size
    return np.array([surface_and_feedback(e, 0.0, law, i)[1] / e for i in range(n)])


def error_ratio(law_a: Law, law_b: Law, e: float, delay: int = 0) -> Array:
    """Error of one law over that of another (n,) while the load changes slowly, without any plant.

    ``e = w L Ḣ / (M_bar λ k)``: age ``w``, stiffness ``λ k`` at the size ``e`` of both errors, rad. Both
    laws, in the same torque coordinates, meet the same ``Ḣ``. It holds while both loops are stable and quiet,
    ``H`` changes little within a few ``L``, ``1/k`` and ``1/λ``, no motor saturates and dry friction does not
    hold the arm.
    """
    a, b = (estimate_age(law, delay) * law.L / (law.M_bar * stiffness(law, e)) for law in (law_a, law_b))
    return np.asarray(a / b)
