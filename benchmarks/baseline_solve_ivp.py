"""One run of Controller 1 as one would write it in an afternoon: NumPy, lists, and ``solve_ivp`` per sample.

The plant stands here a second time, with the textbook matrices of a two-link arm and the drive in joint
coordinates, and shares nothing with the package. It is neither tuned nor slowed down; commits that touch the
package's engine leave it alone, so that the ratio measures the engine.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.integrate import solve_ivp


def friction(velocity, law):
    """Viscous, Coulomb and Stribeck friction with a smooth sign."""
    stribeck = (law["static_ratio"] - 1.0) * np.exp(-((velocity / law["stribeck_velocity"]) ** 2))
    return law["viscous"] * velocity + law["coulomb"] * (1.0 + stribeck) * np.tanh(
        velocity / law["smoothing_velocity"]
    )


class FlexibleArm:
    """Two flexible joints, Eqs. (3) to (5); absolute link angles are measured from hanging."""

    def __init__(self, p):
        self.p = p
        self.S_inv = p["S_inv"]
        self.I_inv = np.linalg.inv(self.S_inv.T @ np.diag(p["winch_inertia"]) @ self.S_inv)
        self.K_s = self.S_inv.T @ np.diag(p["winch_stiffness"]) @ self.S_inv
        self.D_s = self.S_inv.T @ np.diag(p["winch_damping"]) @ self.S_inv
        (l1, l2), (m1, m2), (c1, c2), (I1, I2) = p["length"], p["mass"], p["com"], p["inertia"]
        payload = p["payload"]
        # M = [[k1 + k2 + 2 k3 cos d, k2 + k3 cos d], [., k2]] with d the angle between the links.
        self.k1 = I1 + m1 * c1**2 + (m2 + payload) * l1**2
        self.k2 = I2 + m2 * c2**2 + payload * l2**2
        self.k3 = l1 * (m2 * c2 + payload * l2)
        self.w1 = p["gravity"] * (m1 * c1 + (m2 + payload) * l1)
        self.w2 = p["gravity"] * (m2 * c2 + payload * l2)

    def mass_matrix(self, q):
        k3_cos = self.k3 * np.cos(self.angle_between(q))
        return np.array([[self.k1 + self.k2 + 2.0 * k3_cos, self.k2 + k3_cos], [self.k2 + k3_cos, self.k2]])

    def coriolis_matrix(self, q, dq):
        h = self.k3 * np.sin(self.angle_between(q))
        return np.array([[-h * dq[1], -h * (dq[0] + dq[1])], [h * dq[0], 0.0]])

    def gravity(self, q):
        phi1, phi2 = self.p["start_angle"] + np.cumsum(q)
        distal = self.w2 * np.sin(phi2)
        return np.array([self.w1 * np.sin(phi1) + distal, distal])

    def angle_between(self, q):
        return self.p["start_angle"][1] - self.p["start_angle"][0] + q[1]

    def derivative(self, _t, state, tau_m):
        q, dq, theta, dtheta = state.reshape(4, 2)
        tau_s = self.K_s @ (theta - q) + self.D_s @ (dtheta - dq)
        load = self.coriolis_matrix(q, dq) @ dq + self.gravity(q) + friction(dq, self.p["link_friction"])
        ddq = np.linalg.solve(self.mass_matrix(q), tau_s - load)
        winch_friction = self.S_inv.T @ friction(self.S_inv @ dtheta, self.p["winch_friction"])
        ddtheta = self.I_inv @ (tau_m - tau_s - winch_friction)
        return np.concatenate([dq, ddq, dtheta, ddtheta])

    def rest_state(self):
        q = np.zeros(2)
        theta = q + np.linalg.solve(self.K_s, self.gravity(q))
        return np.concatenate([q, np.zeros(2), theta, np.zeros(2)])

    def saturated(self, tau):
        limit = self.p["torque_limit"]
        winch = np.linalg.solve(self.S_inv.T, tau)
        return tau if np.all(np.abs(winch) <= limit) else self.S_inv.T @ np.clip(winch, -limit, limit)


class Controller1:
    """Eqs. (11) to (18) with the odd polynomial inside ``Delta``; the delay lines start filled."""

    def __init__(self, gains, L, q, tau):
        self.L = L
        self.M_bar, self.lam, self.eta = gains["M_bar"], gains["lam"], gains["eta"]
        self.b, self.Delta, self.alpha = gains["b"], gains["Delta"], gains["alpha"]
        self.gamma1 = (2.0 - self.b) * self.Delta ** (self.b - 1.0)
        self.gamma2 = (self.b - 1.0) * self.Delta ** (self.b - 2.0)
        self.q = deque([q] * 4, maxlen=4)
        self.tau = deque([tau] * 2, maxlen=2)

    def torque(self, q, q_d, dq_d, ddq_d):
        e = q_d - q
        de = dq_d - (q - self.q[0]) / self.L
        phi, slope = self.phi(e)
        s = de + self.eta * phi
        u = ddq_d + self.eta * slope * de + self.lam * s
        H_hat = (1.0 - self.alpha) * self.delayed_H(0) + self.alpha * self.delayed_H(1)
        return self.M_bar * u + H_hat

    def phi(self, e):
        size = np.abs(e)
        if np.all(size < self.Delta):
            return self.gamma1 * e + self.gamma2 * size * e, self.gamma1 + 2.0 * self.gamma2 * size
        inside = size < self.Delta
        power = np.where(inside, self.Delta, size)
        value = np.where(inside, self.gamma1 * e + self.gamma2 * size * e, power**self.b * np.sign(e))
        slope = np.where(inside, self.gamma1 + 2.0 * self.gamma2 * size, self.b * power ** (self.b - 1.0))
        return value, slope

    def delayed_H(self, k):
        ddq = (self.q[k] - 2.0 * self.q[k + 1] + self.q[k + 2]) / self.L**2
        return self.tau[k] - self.M_bar * ddq

    def remember(self, q, tau):
        self.q.appendleft(q)
        self.tau.appendleft(tau)


def run(parameters, reference, rtol, method="RK45"):
    """Simulate one run and return the true joint angles (T, 2), rad.

    ``reference`` holds ``time`` (T,) and ``q_d``, ``dq_d``, ``ddq_d``, each (T, 2), in SI units; ``atol`` is
    a hundredth of ``rtol``.
    """
    arm = FlexibleArm(parameters)
    state = arm.rest_state()
    controller = Controller1(parameters["gains"], parameters["L"], state[:2].copy(), arm.gravity(state[:2]))
    step, time = parameters["encoder_step"], reference["time"]
    angles = np.empty((len(time), 2))
    for k in range(len(time)):
        angles[k] = state[:2]
        measured = step * np.floor(angles[k] / step + 0.5) if step else angles[k]
        tau = controller.torque(measured, reference["q_d"][k], reference["dq_d"][k], reference["ddq_d"][k])
        tau = arm.saturated(tau)
        controller.remember(measured, tau)
        if k + 1 < len(time):
            span = (time[k], time[k + 1])
            solution = solve_ivp(
                arm.derivative, span, state, method=method, args=(tau,), rtol=rtol, atol=rtol / 100.0
            )
            state = solution.y[:, -1]
    return angles
