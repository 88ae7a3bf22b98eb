"""The rigid arm: ``M``, ``C`` and ``G`` of Eq. (4) for a planar serial chain under gravity.

A link's absolute angle is measured from hanging, positive clockwise, that is upwards. In absolute angles the
chain needs only constants.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tendonrepro.arrays import Array


class Arm(NamedTuple):
    """Constants of a planar chain of n moving links.

    Attributes
    ----------
    a : array (n, n)
        Inertia coupling of two links in absolute angles, kg m².
    b : array (n,)
        Gravity torque of a horizontal link, N m.
    phi_0 : array (n,)
        Absolute link angles at ``q = 0``, rad.
    """

    a: Array
    b: Array
    phi_0: Array


def make_arm(
    length: Array,
    mass: Array,
    com: Array,
    inertia: Array,
    *,
    phi_0: Array,
    payload_mass: float,
    gravity: float,
) -> Arm:
    """Reduce link data, arrays (n,), to the constants of the chain.

    Parameters
    ----------
    length, com
        Link lengths and centres of mass from the proximal axis, m.
    mass, inertia
        Of links, kg, and about the centre of mass, kg m².
    payload_mass
        Point mass at the tip, kg.
    gravity
        m s⁻².
    """
    n = length.size
    carried = carried_mass(mass, payload_mass)
    moment = mass * com + carried * length
    a = np.diag(inertia + mass * com**2 + carried * length**2)
    for i in range(n):
        for j in range(i + 1, n):
            a[i, j] = a[j, i] = length[i] * moment[j]
    b = weight_moment(length, mass, com, payload_mass, gravity)
    return Arm(a=a, b=b, phi_0=np.array(phi_0, dtype=np.float64))


def carried_mass(mass: Array, payload_mass: float) -> Array:
    """Mass (n, ...) beyond the end of each link, kg, payload included."""
    outer = np.cumsum(mass[::-1], axis=0)[::-1][1:]
    return np.asarray(payload_mass + np.concatenate([outer, 0.0 * mass[-1:]]))


def weight_moment(length: Array, mass: Array, com: Array, payload_mass: float, gravity: float) -> Array:
    """``b`` of `Arm` (n, ...), N m, from the link data of :func:`make_arm`."""
    return gravity * (mass * com + carried_mass(mass, payload_mass) * length)


def link_angles(q: Array, phi_0: Array) -> Array:
    """Absolute link angles (n, ...), ``phi[i] = phi_0[i] + Σ_{k<=i} q[k]``, rad."""
    phi = np.empty_like(q)
    turned = 0.0 * q[0]
    for i in range(q.shape[0]):
        turned = turned + q[i]
        phi[i] = phi_0[i] + turned
    return phi


def joint_angles(phi: Array, phi_0: Array) -> Array:
    """Inverse of :func:`link_angles`: joint angles (n, ...), rad."""
    q = np.empty_like(phi)
    turned = 0.0 * phi[0]
    for i in range(phi.shape[0]):
        q[i] = phi[i] - phi_0[i] - turned
        turned = turned + q[i]
    return q


def mass_matrix(q: Array, arm: Arm) -> Array:
    """Mass matrix ``M(q)`` of Eq. (4), (n, n, ...), kg m².

    ``M[i, j] = Σ_{k>=i, l>=j} a[k, l] cos(phi_k - phi_l)``
    """
    phi = link_angles(q, arm.phi_0)
    n = q.shape[0]
    M = np.empty((n, n, *q.shape[1:]), dtype=q.dtype)
    for i in range(n):
        for j in range(i + 1):
            M[i, j] = M[j, i] = arm.a[i, j] * np.cos(phi[i] - phi[j])
    return _sum_over_outer_links(M)


def coriolis_matrix(q: Array, dq: Array, arm: Arm) -> Array:
    """Coriolis matrix ``C(q, dq)`` of Eq. (4), (n, n, ...), N m s.

    In Christoffel form: ``dM/dt - 2 C`` is skew-symmetric.
    """
    phi = link_angles(q, arm.phi_0)
    dphi = link_angles(dq, 0.0 * arm.phi_0)
    n = q.shape[0]
    C = np.empty((n, n, *q.shape[1:]), dtype=q.dtype)
    for i in range(n):
        for j in range(i + 1):
            coupling = arm.a[i, j] * np.sin(phi[i] - phi[j])
            C[i, j], C[j, i] = coupling * dphi[j], -coupling * dphi[i]
    return _sum_over_outer_links(C)


def gravity_torque(q: Array, arm: Arm) -> Array:
    """Gravity torque ``G(q)`` of Eq. (4), (n, ...), N m; positive where the weight turns the joint back."""
    phi = link_angles(q, arm.phi_0)
    G = np.empty_like(q)
    carried = 0.0 * q[0]
    for i in range(q.shape[0] - 1, -1, -1):
        carried = carried + arm.b[i] * np.sin(phi[i])
        G[i] = carried
    return G


def bias_torque(q: Array, dq: Array, arm: Arm) -> Array:
    """``C(q, dq) dq + G(q)``, (n, ...), N m."""
    C = coriolis_matrix(q, dq, arm)
    torque = gravity_torque(q, arm)
    for i in range(q.shape[0]):
        for j in range(q.shape[0]):
            torque[i] += C[i, j] * dq[j]
    return torque


def _sum_over_outer_links(A: Array) -> Array:
    """Replace ``A[i, j]`` by its sum over ``k >= i, l >= j``."""
    n = A.shape[0]
    for i in range(n - 2, -1, -1):
        for j in range(n):
            A[i, j] = A[i, j] + A[i + 1, j]
    for j in range(n - 2, -1, -1):
        for i in range(n):
            A[i, j] = A[i, j] + A[i, j + 1]
    return A
