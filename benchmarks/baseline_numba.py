"""One run of Controller 1 as one would write it in an afternoon for speed: a numba loop and classic RK4.

The plant stands here once more, with the textbook matrices of a two-link arm and the drive in joint
coordinates, and shares nothing with the package. It is neither tuned nor slowed down; commits that touch the
package's engine leave it alone, so that the ratio measures the engine.
"""

from __future__ import annotations

import math
from collections import namedtuple

import numpy as np
from numba import njit

Friction = namedtuple("Friction", "viscous coulomb static_ratio stribeck_velocity smoothing_velocity")
Plant = namedtuple(
    "Plant", "k1 k2 k3 w1 w2 start_angle S_inv I_inv K_s D_s winch_friction link_friction torque_limit"
)
Gains = namedtuple("Gains", "M_bar lam b eta Delta alpha")


def plain(value):
    """Tuples of floats for an array; numba counts references to every array that a function takes."""
    return tuple(map(plain, value)) if np.ndim(value) else float(value)


def named(kind, values):
    return kind(**{name: plain(value) for name, value in values.items()})


def plant_of(p):
    """Constants of Eqs. (3) to (5); absolute link angles are measured from hanging."""
    S_inv = p["S_inv"]
    (l1, l2), (m1, m2), (c1, c2), (I1, I2) = p["length"], p["mass"], p["com"], p["inertia"]
    payload = p["payload"]
    constants = {
        # M = [[k1 + k2 + 2 k3 cos d, k2 + k3 cos d], [., k2]] with d the angle between the links.
        "k1": I1 + m1 * c1**2 + (m2 + payload) * l1**2,
        "k2": I2 + m2 * c2**2 + payload * l2**2,
        "k3": l1 * (m2 * c2 + payload * l2),
        "w1": p["gravity"] * (m1 * c1 + (m2 + payload) * l1),
        "w2": p["gravity"] * (m2 * c2 + payload * l2),
        "start_angle": p["start_angle"],
        "S_inv": S_inv,
        "I_inv": np.linalg.inv(S_inv.T @ np.diag(p["winch_inertia"]) @ S_inv),
        "K_s": S_inv.T @ np.diag(p["winch_stiffness"]) @ S_inv,
        "D_s": S_inv.T @ np.diag(p["winch_damping"]) @ S_inv,
        "torque_limit": p["torque_limit"],
    }
    return Plant(
        **{name: plain(value) for name, value in constants.items()},
        winch_friction=named(Friction, p["winch_friction"]),
        link_friction=named(Friction, p["link_friction"]),
    )


@njit
def friction(velocity, law, i):
    """Viscous, Coulomb and Stribeck friction with a smooth sign."""
    stribeck = (law.static_ratio[i] - 1.0) * math.exp(-((velocity / law.stribeck_velocity[i]) ** 2))
    dry = law.coulomb[i] * (1.0 + stribeck) * math.tanh(velocity / law.smoothing_velocity[i])
    return law.viscous[i] * velocity + dry


@njit
def gravity(q1, q2, plant):
    phi1 = plant.start_angle[0] + q1
    phi2 = plant.start_angle[1] + q1 + q2
    distal = plant.w2 * math.sin(phi2)
    return plant.w1 * math.sin(phi1) + distal, distal


@njit
def derivative(state, tau, plant, out):
    q1, q2, dq1, dq2 = state[0], state[1], state[2], state[3]
    theta1, theta2, dtheta1, dtheta2 = state[4], state[5], state[6], state[7]
    K, D, S_inv, I_inv = plant.K_s, plant.D_s, plant.S_inv, plant.I_inv

    x1, x2, v1, v2 = theta1 - q1, theta2 - q2, dtheta1 - dq1, dtheta2 - dq2
    tau_s1 = K[0][0] * x1 + K[0][1] * x2 + D[0][0] * v1 + D[0][1] * v2
    tau_s2 = K[1][0] * x1 + K[1][1] * x2 + D[1][0] * v1 + D[1][1] * v2

    between = plant.start_angle[1] - plant.start_angle[0] + q2
    k3_cos = plant.k3 * math.cos(between)
    M11, M12, M22 = plant.k1 + plant.k2 + 2.0 * k3_cos, plant.k2 + k3_cos, plant.k2
    h = plant.k3 * math.sin(between)
    g1, g2 = gravity(q1, q2, plant)
    r1 = tau_s1 + h * dq2 * (2.0 * dq1 + dq2) - g1 - friction(dq1, plant.link_friction, 0)
    r2 = tau_s2 - h * dq1 * dq1 - g2 - friction(dq2, plant.link_friction, 1)
    det = M11 * M22 - M12 * M12

    f1 = friction(S_inv[0][0] * dtheta1 + S_inv[0][1] * dtheta2, plant.winch_friction, 0)
    f2 = friction(S_inv[1][0] * dtheta1 + S_inv[1][1] * dtheta2, plant.winch_friction, 1)
    p1 = tau[0] - tau_s1 - (S_inv[0][0] * f1 + S_inv[1][0] * f2)
    p2 = tau[1] - tau_s2 - (S_inv[0][1] * f1 + S_inv[1][1] * f2)

    out[0] = dq1
    out[1] = dq2
    out[2] = (M22 * r1 - M12 * r2) / det
    out[3] = (M11 * r2 - M12 * r1) / det
    out[4] = dtheta1
    out[5] = dtheta2
    out[6] = I_inv[0][0] * p1 + I_inv[0][1] * p2
    out[7] = I_inv[1][0] * p1 + I_inv[1][1] * p2


@njit
def rk4_step(state, tau, plant, h, k1, k2, k3, k4, trial):
    """Advance the state in place; the last five, (8,) each, are workspace."""
    derivative(state, tau, plant, k1)
    for i in range(8):
        trial[i] = state[i] + 0.5 * h * k1[i]
    derivative(trial, tau, plant, k2)
    for i in range(8):
        trial[i] = state[i] + 0.5 * h * k2[i]
    derivative(trial, tau, plant, k3)
    for i in range(8):
        trial[i] = state[i] + h * k3[i]
    derivative(trial, tau, plant, k4)
    for i in range(8):
        state[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])


@njit
def rest_state(plant):
    state, K = np.zeros(8), plant.K_s
    g1, g2 = gravity(0.0, 0.0, plant)
    det = K[0][0] * K[1][1] - K[0][1] * K[1][0]
    state[4] = (K[1][1] * g1 - K[0][1] * g2) / det
    state[5] = (K[0][0] * g2 - K[1][0] * g1) / det
    return state


@njit
def phi(e, b, Delta):
    """Function of the sliding surface and its slope, with the odd polynomial inside ``Delta``."""
    size = abs(e)
    if size < Delta:
        gamma1 = (2.0 - b) * Delta ** (b - 1.0)
        gamma2 = (b - 1.0) * Delta ** (b - 2.0)
        return gamma1 * e + gamma2 * size * e, gamma1 + 2.0 * gamma2 * size
    return math.copysign(size**b, e), b * size ** (b - 1.0)


@njit
def controller_1(q, q_past, tau_past, q_d, dq_d, ddq_d, gains, L, tau):
    """Write the torque of Eqs. (11) to (18) to ``tau``; row 0 of the delay lines is the last sample."""
    for i in range(2):
        M_bar, alpha = gains.M_bar[i], gains.alpha[i]
        e = q_d[i] - q[i]
        de = dq_d[i] - (q[i] - q_past[0, i]) / L
        value, slope = phi(e, gains.b[i], gains.Delta[i])
        s = de + gains.eta[i] * value
        u = ddq_d[i] + gains.eta[i] * slope * de + gains.lam[i] * s
        H1 = tau_past[0, i] - M_bar * (q_past[0, i] - 2.0 * q_past[1, i] + q_past[2, i]) / L**2
        H2 = tau_past[1, i] - M_bar * (q_past[1, i] - 2.0 * q_past[2, i] + q_past[3, i]) / L**2
        tau[i] = M_bar * u + (1.0 - alpha) * H1 + alpha * H2


@njit
def saturate(tau, plant):
    """Limit the winches' torques S^T tau."""
    S_inv, (limit1, limit2) = plant.S_inv, plant.torque_limit
    det = S_inv[0][0] * S_inv[1][1] - S_inv[0][1] * S_inv[1][0]
    winch1 = (S_inv[1][1] * tau[0] - S_inv[1][0] * tau[1]) / det
    winch2 = (S_inv[0][0] * tau[1] - S_inv[0][1] * tau[0]) / det
    if abs(winch1) > limit1 or abs(winch2) > limit2:
        winch1 = min(max(winch1, -limit1), limit1)
        winch2 = min(max(winch2, -limit2), limit2)
        tau[0] = S_inv[0][0] * winch1 + S_inv[1][0] * winch2
        tau[1] = S_inv[0][1] * winch1 + S_inv[1][1] * winch2


@njit
def simulate(plant, gains, L, encoder_step, q_d, dq_d, ddq_d, steps):
    samples = len(q_d)
    angles = np.empty((samples, 2))
    state = rest_state(plant)
    k1, k2, k3, k4, trial = np.empty(8), np.empty(8), np.empty(8), np.empty(8), np.empty(8)
    # The delay lines start filled.
    q, q_past = np.zeros(2), np.zeros((4, 2))
    tau, tau_past = np.zeros(2), np.zeros((2, 2))
    tau_past[:, 0], tau_past[:, 1] = gravity(0.0, 0.0, plant)
    for k in range(samples):
        for i in range(2):
            angles[k, i] = q[i] = state[i]
            if encoder_step > 0.0:
                q[i] = encoder_step * math.floor(state[i] / encoder_step + 0.5)
        controller_1(q, q_past, tau_past, q_d[k], dq_d[k], ddq_d[k], gains, L, tau)
        saturate(tau, plant)
        for i in range(2):
            for j in range(3, 0, -1):
                q_past[j, i] = q_past[j - 1, i]
            q_past[0, i] = q[i]
            tau_past[1, i] = tau_past[0, i]
            tau_past[0, i] = tau[i]
        if k + 1 < samples:
            for _ in range(steps):
                rk4_step(state, tau, plant, L / steps, k1, k2, k3, k4, trial)
    return angles


def run(parameters, reference, steps=2):
    """Simulate one run and return the true joint angles (T, 2), rad.

    ``reference`` holds ``q_d``, ``dq_d``, ``ddq_d``, each (T, 2), in SI units, a sampling period apart.
    ``steps`` are RK4 steps per sample. Two are too few for the shipped friction at 1 ms: around rest it
    decays at up to 8600 1/s, and a step of RK4 is stable to a decay of 2.78, so that it takes four.
    """
    motion = (reference[name] for name in ("q_d", "dq_d", "ddq_d"))
    plant, gains = plant_of(parameters), named(Gains, parameters["gains"])
    return simulate(plant, gains, parameters["L"], parameters["encoder_step"], *motion, steps)
