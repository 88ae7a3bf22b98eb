"""Reference motions with exact derivatives; the paper shows its reference only as a picture.

A shape starts at zero: a joint angle is a displacement from the start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tendonrepro.arrays import Array

Shape = Callable[[Array], tuple[Array, Array, Array]]
"""Time since the period's start, s (T,), to angle, velocity, acceleration of one joint, each (T,)."""

_EDGE = 1e-9
"""Time, s, by which rounding may put a sample before the corner that it stands on."""


@dataclass(frozen=True)
class Motion:
    """A joint's whole reference: a shape for each turn, each turn ``period`` long, s."""

    turns: tuple[Shape, ...]
    period: float

    @property
    def duration(self) -> float:
        """Duration of all turns, s."""
        return self.period * len(self.turns)


def motion(time: Array, joints: Sequence[Motion]) -> tuple[Array, Array, Array]:
    """Desired angles, velocities and accelerations, each (T, n), rad, rad s⁻¹ and rad s⁻².

    ``time`` (T,), s, increases from 0. After its last turn a joint stays where it is.
    """
    columns = [_follow(time, joint) for joint in joints]
    q_d, dq_d, ddq_d = (np.stack(parts, axis=1) for parts in zip(*columns, strict=True))
    return q_d, dq_d, ddq_d


def _follow(time: Array, joint: Motion) -> tuple[Array, Array, Array]:
    # The offset keeps a sample that rounding put just before a turn's end in the turn it begins.
    turn = np.clip(np.floor(time / joint.period + 1e-9).astype(int), 0, len(joint.turns) - 1)
    values = np.zeros((3, time.size))
    edges = np.searchsorted(turn, np.arange(len(joint.turns) + 1))
    for number, shape in enumerate(joint.turns):
        inside = slice(edges[number], edges[number + 1])
        since = np.clip(time[inside] - number * joint.period, 0.0, joint.period)
        values[:, inside] = shape(since)
    over = time > joint.duration
    values[1:, over] = 0.0
    return values[0], values[1], values[2]


def at_rest(time: Array) -> tuple[Array, Array, Array]:
    """A joint that keeps its start angle."""
    return np.zeros_like(time), np.zeros_like(time), np.zeros_like(time)


def raised_cosine(amplitude: float, period: float) -> Shape:
    """``amplitude (1 - cos(2π t/period)) / 2``; rad and s."""
    omega = 2.0 * np.pi / period

    def shape(t: Array) -> tuple[Array, Array, Array]:
        half = 0.5 * amplitude
        phase = omega * t
        return half * (1.0 - np.cos(phase)), half * omega * np.sin(phase), half * omega**2 * np.cos(phase)

    return shape


def minimum_jerk(amplitude: float, rise: float, hold: float) -> Shape:
    """Up, hold, down, hold; each stroke is the quintic with the least mean square jerk.

    Units are rad and s.
    """

    def stroke(t: Array) -> tuple[Array, Array, Array]:
        x = np.clip(t / rise, 0.0, 1.0)
        q = amplitude * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
        dq = amplitude / rise * 30.0 * x**2 * (1.0 - x) ** 2
        ddq = amplitude / rise**2 * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
        return q, dq, ddq

    return _up_and_down(stroke, rise + hold)


def trapezoidal(amplitude: float, velocity: float, acceleration: float, hold: float) -> Shape:
    """Up, hold, down, hold with constant acceleration, velocity and deceleration.

    Units are rad and s. A stroke too short to reach ``velocity`` is a triangle.
    """
    ramp, rise = trapezoid_times(amplitude, velocity, acceleration)
    sense = np.sign(amplitude) * acceleration

    def stroke(t: Array) -> tuple[Array, Array, Array]:
        x = np.clip(t, 0.0, rise)
        up, down = np.minimum(x, ramp), np.maximum(x - (rise - ramp), 0.0)
        q = sense * (0.5 * up**2 + ramp * np.maximum(x - ramp, 0.0) - 0.5 * down**2)
        dq = sense * (up - down)
        moving = (t >= 0.0) & (t < rise)
        ddq = sense * moving * (1.0 * (t < ramp) - (t >= rise - ramp))
        return q, dq, ddq

    return _up_and_down(stroke, rise + hold)


def ramp(amplitude: float, rise: float, hold: float) -> Shape:
    """Up, hold, down, hold along straight lines, without any acceleration.

    Units are rad and s. The velocity steps at each corner, and a sample on a corner has the new velocity.
    The impulses of acceleration that such steps would need are left out.
    """

    def stroke(t: Array) -> tuple[Array, Array, Array]:
        moving = (t >= -_EDGE) & (t < rise - _EDGE)
        q = amplitude * np.clip(t / rise, 0.0, 1.0)
        return q, np.where(moving, amplitude / rise, 0.0), np.zeros_like(t)

    return _up_and_down(stroke, rise + hold)


def trapezoid_times(amplitude: float, velocity: float, acceleration: float) -> tuple[float, float]:
    """Duration of a ramp and of a stroke of :func:`trapezoidal`, s."""
    ramp = min(velocity / acceleration, float(np.sqrt(abs(amplitude) / acceleration)))
    if ramp == 0.0:
        return 0.0, 0.0
    return ramp, ramp + abs(amplitude) / (acceleration * ramp)


def _up_and_down(stroke: Shape, half: float) -> Shape:
    """Stroke from the start, and back again after ``half``."""

    def shape(t: Array) -> tuple[Array, Array, Array]:
        up, down = stroke(t), stroke(t - half)
        return up[0] - down[0], up[1] - down[1], up[2] - down[2]

    return shape


def smooth_sine(amplitude: float, offset: float, period: float, blend: float) -> Shape:
    """``offset + amplitude sin(2π t/period)``, rad, blended in by a minimum-jerk stroke of ``blend`` s.

    Its turn must last the whole run: a second would start from zero.
    """
    omega = 2.0 * np.pi / period
    fade = minimum_jerk(1.0, blend, np.inf)

    def shape(t: Array) -> tuple[Array, Array, Array]:
        w, dw, ddw = fade(t)
        x = offset + amplitude * np.sin(omega * t)
        dx = amplitude * omega * np.cos(omega * t)
        ddx = -amplitude * omega**2 * np.sin(omega * t)
        return w * x, dw * x + w * dx, ddw * x + 2.0 * dw * dx + w * ddx

    return shape


def sampled(time: Array, angle: Array) -> Shape:
    """Quintic spline through samples, at rest and without acceleration at both ends.

    ``time`` (N,), s, increases strictly; ``angle`` (N,) is in rad.
    """
    from scipy.interpolate import make_interp_spline

    still = [(1, 0.0), (2, 0.0)]
    # SciPy documents this form of the end conditions, its type stubs do not know it.
    spline = make_interp_spline(time, angle, k=5, bc_type=(still, still))  # type: ignore[arg-type]
    rate, curvature = spline.derivative(1), spline.derivative(2)

    def shape(t: Array) -> tuple[Array, Array, Array]:
        inside = np.clip(t + time[0], time[0], time[-1])
        return spline(inside), rate(inside), curvature(inside)

    return shape


def late(rates: Array, L: float, lag: float) -> Array:
    """Rates (T, ...) of a reference after a first-order filter at rest, sampled every L s.

    ``lag`` is the filter's time constant, s; 0 changes nothing.
    """
    from scipy.linalg import solve_banded

    if lag == 0.0:
        return rates
    # Every value is the newest rate's share and the rest of the value before: a system of two diagonals.
    newest = -np.expm1(-L / lag)
    band = np.array([np.ones(len(rates)), np.full(len(rates), newest - 1.0)])
    return np.asarray(solve_banded((1, 0), band, newest * rates))


def straight_lines(time: Array, angle: Array) -> Shape:
    """Straight lines between samples, as :func:`ramp`.

    ``time`` (N,), s, increases strictly; ``angle`` (N,) is in rad.
    """
    slopes = np.append(np.diff(angle) / np.diff(time), 0.0)

    def shape(t: Array) -> tuple[Array, Array, Array]:
        since = t + time[0]
        piece = np.searchsorted(time, since + _EDGE, side="right") - 1
        return np.interp(since, time, angle), slopes[np.maximum(piece, 0)], np.zeros_like(t)

    return shape
