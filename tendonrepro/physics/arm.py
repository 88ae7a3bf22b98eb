"""The rigid arm: a planar serial chain under gravity.

``M``, ``C`` and ``G`` of Eq. (4). The paper leaves them open; a planar chain of links with mass, length,
centre of mass and inertia is the plainest arm that fits its description. A link's absolute angle is
measured from hanging, positive clockwise as the paper draws it, that is upwards into the working half-plane.

In absolute angles the chain needs only constants: ``a[i, j]`` couples two links and ``b[i]`` is a link's
moment of weight. All functions take the joint axis first; further axes are independent lanes, so the same
code serves one posture and a whole trace.
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
        Inertia coupling in absolute angles, kg m².
    b : array (n,)
        Moment of weight, N m: the gravity torque of a horizontal link.
    phi_0 : array (n,)
        Absolute link angles at ``q = 0``, rad from hanging.
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
    """Reduce link data to the constants of the chain.

    Parameters
    ----------
    length, com : array (n,)
        Link lengths and distances of the centres of mass from the proximal axis, m.
    mass : array (n,)
        Link masses, kg.
    inertia : array (n,)
        Link inertias about the centre of mass, kg m².
    phi_0 : array (n,)
        Absolute link angles at ``q = 0``, rad.
    payload_mass : float
        Point mass at the tip of the last link, kg.
    gravity : float
        Acceleration of gravity, m s⁻².

    Returns
    -------
    Arm
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
    """Mass beyond the end of each link, kg.

    Parameters
    ----------
    mass : array (n, ...)
        Link masses, kg.
    payload_mass : float
        At the tip, kg.

    Returns
    -------
    array (n, ...)
    """
    outer = np.cumsum(mass[::-1], axis=0)[::-1][1:]
    return np.asarray(payload_mass + np.concatenate([outer, 0.0 * mass[-1:]]))


def weight_moment(length: Array, mass: Array, com: Array, payload_mass: float, gravity: float) -> Array:
    """Gravity torque of each link when it is horizontal, with what it carries, N m: ``b`` of `Arm`.

    Parameters
    ----------
    length, mass, com : array (n, ...)
        As of :func:`make_arm`.
    payload_mass, gravity : float
        kg, m s⁻².

    Returns
    -------
    array (n, ...)
    """
    return gravity * (mass * com + carried_mass(mass, payload_mass) * length)


def link_angles(q: Array, phi_0: Array) -> Array:
    """Absolute link angles, ``phi[i] = phi_0[i] + Σ_{k<=i} q[k]``, rad.

    Parameters
    ----------
    q : array (n, ...)
        Joint angles, rad.
    phi_0 : array (n,)
        Absolute link angles at ``q = 0``, rad.

    Returns
    -------
    array (n, ...)
    """
    phi = np.empty_like(q)
    turned = 0.0 * q[0]
    for i in range(q.shape[0]):
        turned = turned + q[i]
        phi[i] = phi_0[i] + turned
    return phi


def joint_angles(phi: Array, phi_0: Array) -> Array:
    """Joint angles that give absolute link angles, rad: the inverse of :func:`link_angles`.

    Parameters
    ----------
    phi : array (n, ...)
        Absolute link angles, rad.
    phi_0 : array (n,)
        Those at ``q = 0``, rad.

    Returns
    -------
    array (n, ...)
    """
    q = np.empty_like(phi)
    turned = 0.0 * phi[0]
    for i in range(phi.shape[0]):
        q[i] = phi[i] - phi_0[i] - turned
        turned = turned + q[i]
    return q


def mass_matrix(q: Array, arm: Arm) -> Array:
    """Mass matrix ``M(q)`` of Eq. (4), kg m².

    ``M[i, j] = Σ_{k>=i, l>=j} a[k, l] cos(phi_k - phi_l)``: links beyond a joint move with it.

    Parameters
    ----------
    q : array (n, ...)
        Joint angles, rad.
    arm : Arm

    Returns
    -------
    array (n, n, ...)
        Symmetric and positive definite.
    """
    phi = link_angles(q, arm.phi_0)
    n = q.shape[0]
    M = np.empty((n, n, *q.shape[1:]), dtype=q.dtype)
    for i in range(n):
        for j in range(i + 1):
            M[i, j] = M[j, i] = arm.a[i, j] * np.cos(phi[i] - phi[j])
    return _sum_over_outer_links(M)


def coriolis_matrix(q: Array, dq: Array, arm: Arm) -> Array:
    """Coriolis matrix ``C(q, dq)`` of Eq. (4) in Christoffel form, N m s.

    Parameters
    ----------
    q, dq : array (n, ...)
        Joint angles, rad, and velocities, rad s⁻¹.
    arm : Arm

    Returns
    -------
    array (n, n, ...)
        ``dM/dt - 2 C`` is skew-symmetric.
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
    """Gravity torque ``G(q)`` of Eq. (4), N m; positive where the weight turns the joint back.

    Parameters
    ----------
    q : array (n, ...)
        Joint angles, rad.
    arm : Arm

    Returns
    -------
    array (n, ...)
        The gradient of :func:`potential_energy`.
    """
    phi = link_angles(q, arm.phi_0)
    G = np.empty_like(q)
    carried = 0.0 * q[0]
    for i in range(q.shape[0] - 1, -1, -1):
        carried = carried + arm.b[i] * np.sin(phi[i])
        G[i] = carried
    return G


def bias_torque(q: Array, dq: Array, arm: Arm) -> Array:
    """Torque of motion and weight, ``C(q, dq) dq + G(q)``, N m.

    Parameters
    ----------
    q, dq : array (n, ...)
        Joint angles, rad, and velocities, rad s⁻¹.
    arm : Arm

    Returns
    -------
    array (n, ...)
    """
    C = coriolis_matrix(q, dq, arm)
    torque = gravity_torque(q, arm)
    for i in range(q.shape[0]):
        for j in range(q.shape[0]):
            torque[i] += C[i, j] * dq[j]
    return torque


def potential_energy(q: Array, arm: Arm) -> Array:
    """Energy of the weight, J, zero with every link horizontal.

    Parameters
    ----------
    q : array (n, ...)
        Joint angles, rad.
    arm : Arm

    Returns
    -------
    array (...)
    """
    return np.asarray(-np.tensordot(arm.b, np.cos(link_angles(q, arm.phi_0)), axes=(0, 0)))


def kinetic_energy(q: Array, dq: Array, arm: Arm) -> Array:
    """Kinetic energy of the links, ``½ dqᵀ M dq``, J.

    Parameters
    ----------
    q, dq : array (n, ...)
        Joint angles, rad, and velocities, rad s⁻¹.
    arm : Arm

    Returns
    -------
    array (...)
    """
    return np.asarray(0.5 * np.einsum("i...,ij...,j...", dq, mass_matrix(q, arm), dq))


def _sum_over_outer_links(A: Array) -> Array:
    """Replace ``A[i, j]`` by the sum over all ``k >= i, l >= j``: absolute angles to joint angles."""
    n = A.shape[0]
    for i in range(n - 2, -1, -1):
        for j in range(n):
            A[i, j] = A[i, j] + A[i + 1, j]
    for j in range(n - 2, -1, -1):
        for i in range(n):
            A[i, j] = A[i, j] + A[i, j + 1]
    return A
