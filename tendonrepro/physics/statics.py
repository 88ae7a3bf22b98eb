"""Tendons at rest: why each has to pull, section 2.2 of the paper, and where it lies in the arm's plane.

A tendon's side at a joint is +1 where its pull turns the joint clockwise, as at its own joint, -1 where
counter-clockwise, 0 where it crosses the axis. The tensioner is tendon 4; its force is given, not solved for.

A tendon lies straight between pulleys and along an arc on each. Directions are from the x axis,
counter-clockwise, rad. From winch to end it passes a circle of positive ``side * radius`` on the right, of
negative on the left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array, times

SLACK = 1e-6
"""Tension below which a tendon does not pull, N: what rounding leaves of none."""

TENSIONER_SIDES = {"negative": 1.0, "distal_only": 0.0, "alternating": -1.0}
"""Side of tendon 4 at a joint, relative to its side at the joint beyond (0: it passes the axis)."""


class Spring(NamedTuple):
    """A spring at the tensioner's base end, in place of its motor.

    Attributes
    ----------
    force
        At ``q = 0``, N.
    rate
        N m⁻¹; zero is the motor's constant force.
    """

    force: float
    rate: float


def sign_of_side(side: Array) -> Array:
    """Signs ``c`` of Eq. (1) from the sides ``side[p, q]`` of tendon q at joint p; the same map leads back.

    A tendon that a joint on its way winds up is on that joint's counter-clockwise side, so ``c`` is minus the
    side. On the diagonal, at its own joint, it is the side.
    """
    own = np.eye(side.shape[0], dtype=bool)
    return np.where(own, side, 0.0 - side)


def tensioner_side(course: str, joints: int) -> Array:
    """Side (N,) of tendon 4 at each of N joints, by a course of `TENSIONER_SIDES`.

    It turns the last joint counter-clockwise; its side at the others is a reading.
    """
    return np.asarray(-(TENSIONER_SIDES[course] ** np.arange(joints - 1, -1, -1.0)))


def tendon_tension(tau_s: Array, S: Array, winch_diameter: Array) -> Array:
    """Tension (n, ...) of each motor's tendon, ``T[n] = (2 / D[n]) (Sᵀ tau_s)[n]``, N, positive in a pull.

    ``tau_s`` (n, ...), N m, is that of Eqs. (3) to (5), or at rest the weight less the tensioner's part.
    ``S`` (n, n), Eq. (2), is of the moving joints. ``winch_diameter`` (n,) is in m.
    """
    tension = times(np.swapaxes(S, 0, 1), tau_s)
    for n in range(tension.shape[0]):
        tension[n] = 2.0 * tension[n] / winch_diameter[n]
    return tension


def tensioner_torque(force: float | Array, side: Array, diameter: Array) -> Array:
    """Joint torque (n, ...) of the tensioner's pull, N m, positive clockwise.

    It passes joints on ``side`` (n,) at ``diameter`` (n,), m.
    """
    return np.multiply.outer(side * diameter / 2.0, force)


def tensioner_stretch(q: Array, side: Array, diameter: Array) -> Array:
    """Rope that joint angles (n, ...), rad, draw from the tensioner's base end, m."""
    return np.asarray(-np.tensordot(side * diameter / 2.0, q, axes=(0, 0)))


def spring_force(stretch: Array, spring: Spring) -> Array:
    """Pull of a spring, N, at a stretch of :func:`tensioner_stretch`, m; a slack rope does not push."""
    return np.maximum(0.0, spring.force + spring.rate * stretch)


def force_window(without: Array, per_newton: Array, margin: float = 0.0) -> tuple[Array, Array]:
    """Least and largest tensioner force (...), N, that keep every tendon at a tension ``margin``, N.

    Neither is negative; least is above largest where no force does it. ``without`` (n, ...) are the tensions
    without tensioner, N, ``per_newton`` (n,) what a newton of it adds.
    """
    least = np.zeros(without.shape[1:])
    largest = np.full(without.shape[1:], np.inf)
    for n in range(without.shape[0]):
        lacking = margin - without[n]
        if per_newton[n] > 0.0:
            least = np.maximum(least, lacking / per_newton[n])
        elif per_newton[n] < 0.0:
            largest = np.minimum(largest, lacking / per_newton[n])
        else:
            least = np.where(lacking > 0.0, np.inf, least)
    return least, largest


def tension_with_losses(
    tau: Array, force: float | Array, side: Array, diameter: Array, passed_on: Array
) -> Array:
    """Tensions (n, ...) at the winches of the motors' tendons with friction of the guide pulleys, N.

    Parameters
    ----------
    tau : array (n, ...)
        Joint torque that all tendons hold, N m: at rest the weight.
    force : float or array (...)
        The tensioner's at its base end, N.
    side, diameter : array (n, n + 1)
        Of tendon q at joint p in ``[p, q]``, m; the tensioner is last.
    passed_on : array (n + 1, ...)
        Share of the tension that a guide pulley passes on: below one where the rope is about to move
        towards its joint, above one where back.
    """
    n = side.shape[0]
    tension = {n: np.asarray(force)}
    # Tendon n ends at joint n, so what holds the last joint is known first.
    for p in range(n - 1, -1, -1):
        torque = side[p] * diameter[p] / 2.0
        rest = tau[p]
        for k in range(p + 1, n + 1):
            rest = rest - torque[k] * passed_on[k] ** p * tension[k]
        tension[p] = rest / (torque[p] * passed_on[p] ** p)
    return np.stack([tension[p] for p in range(n)])


def slack_time(time: Array, tension: Array) -> Array:
    """How long each tendon (n,) of ``tension`` (n, T), N, does not pull, s: it is slack or pushes.

    A sample stands for the time up to the next.
    """
    return np.asarray(np.where(tension[:, :-1] < SLACK, np.diff(time), 0.0).sum(axis=1))


class TendonPath(NamedTuple):
    """A tendon in T postures, over m circles.

    Attributes
    ----------
    centre : array (T, m, 2)
        Of winch, guide pulleys, and the winch or pulley where it ends, m.
    radius : array (m,)
        Signed, m; zero lets the tendon pass the centre.
    direction : array (T, m)
        In which the tendon leaves each circle, or ends.
    wrap : array (T, m)
        Angle along which it lies on each, never negative.
    """

    centre: Array
    radius: Array
    direction: Array
    wrap: Array


def joint_positions(length: Array, angle: Array) -> Array:
    """Joints and tip of a planar chain, (..., n + 1, 2), m from joint 1, x to the right and y upwards.

    ``length`` (n,) is in m, ``angle`` (..., n) absolute, rad from hanging, positive clockwise.
    """
    steps = -length[:, np.newaxis] * np.stack([np.sin(angle), np.cos(angle)], axis=-1)
    return np.concatenate([np.zeros_like(steps[..., :1, :]), np.cumsum(steps, axis=-2)], axis=-2)


def tendon_path(centre: Array, radius: Array, end: Array) -> TendonPath:
    """Lay a tendon over circles; ``centre`` (T, m, 2) and ``radius`` (m,) are as of `TendonPath`.

    Where it would lift off a pulley, it lies around it once more in all postures: by Eq. (1) and Assumption 2
    it never does. ``end`` (T,) is the direction from the last centre to the fixed point, rad.

    Raises
    ------
    ValueError
        If circles overlap, so that no tangent passes on the wanted sides.
    """
    step = np.diff(centre, axis=1)
    apart = np.hypot(step[..., 0], step[..., 1])
    if not (np.abs(np.diff(radius)) < apart).all():
        message = "circles overlap"
        raise ValueError(message)
    straight = np.arctan2(step[..., 1], step[..., 0]) - np.arcsin(np.diff(radius) / apart)
    last = end + np.copysign(np.pi / 2.0, radius[-1])
    direction = np.unwrap(np.column_stack([straight, last]), axis=0)
    turned = np.sign(radius[1:]) * np.diff(direction, axis=1)
    more = np.ceil(-turned.min(axis=0) / (2.0 * np.pi) - 1e-9)
    wrap = np.maximum(turned + 2.0 * np.pi * more, 0.0)
    return TendonPath(centre, radius, direction, np.column_stack([np.zeros(len(wrap)), wrap]))


def path_points(path: TendonPath, place: int, spacing: float = 0.1) -> Array:
    """Points (K, 2) to draw a tendon through in one posture, m.

    ``spacing`` is the largest angle between two points of an arc, rad.
    """
    points = []
    for centre, radius, leaves, wrap in zip(
        path.centre[place], path.radius, path.direction[place], path.wrap[place], strict=True
    ):
        back = np.linspace(wrap, 0.0, 1 + int(np.ceil(wrap / spacing)))
        # Where it touches stands at a right angle to where it goes.
        around = leaves - np.copysign(1.0, radius) * back - np.pi / 2.0
        points.append(centre + radius * np.column_stack([np.cos(around), np.sin(around)]))
    return np.vstack(points)
