"""Where a tendon lies in the arm's plane: straight between pulleys, along an arc on each.

Directions are from the x axis, counter-clockwise, rad. From winch to end a tendon passes a circle of positive
``side * radius`` (`tendonrepro.physics.statics`) on the right, of negative on the left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array


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
