"""Coupling between winches and joints: Eqs. (1) and (2).

A tendon passes the joints before its own over guide pulleys, so their motion winds it.
"""

from __future__ import annotations

import numpy as np

from tendonrepro.arrays import Array


def coupling_inverse(winch_diameter: Array, pulley_diameter: Array, sign: Array) -> Array:
    """Map ``S_inv`` (n, n) from joint to winch angles, ``q_motor = S_inv q``, lower triangular.

    Eq. (2): the diagonal is ``c[n,n] D[n,n] / D[n]``, below it stands ``-c[i,n] D[i,n] / D[n]``. Of the
    matrices only ``p <= q`` is read.

    Parameters
    ----------
    winch_diameter : array (n,)
        ``D[n]``, m.
    pulley_diameter : array (n, n)
        ``D[p, q]``, m: pulley at joint p that guides tendon q, on the diagonal the joint winch.
    sign : array (n, n)
        ``c[p, q]``: +1 if joint p, turning clockwise, makes tendon q drive joint q clockwise too.

    Examples
    --------
    Table 1, with the signs of section 3.3:

    >>> D = np.array([37.0, 37.0, 37.0])
    >>> D_pq = np.array([[77.0, 35.0, 35.0], [0.0, 77.0, 35.0], [0.0, 0.0, 37.0]])
    >>> c = np.array([[1.0, 1.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    >>> coupling_matrix(coupling_inverse(D, D_pq, c)).round(4)
    array([[ 0.4805,  0.    ,  0.    ],
           [ 0.2184,  0.4805,  0.    ],
           [-0.2479,  0.4545,  1.    ]])
    """
    ratio = (sign * pulley_diameter).T / winch_diameter[:, np.newaxis]
    return np.diag(np.diag(ratio)) - np.tril(ratio, k=-1)


def coupling_matrix(S_inv: Array) -> Array:
    """Map ``S`` (n, n) from winch to joint angles, ``q = S q_motor``, by forward substitution."""
    S = np.zeros_like(S_inv)
    for row in range(S_inv.shape[0]):
        S[row, row] = 1.0 / S_inv[row, row]
        S[row, :row] = -S[row, row] * (S_inv[row, :row] @ S[:row, :row])
    return S


def to_joint_matrix(winch_values: Array, S_inv: Array) -> Array:
    """Refer values of the winches (n,) to the joints: ``S_invᵀ diag(w) S_inv``, symmetric (n, n), same unit.

    So inertia, damping and stiffness become ``I``, ``D_m``, ``D_s``, ``K_s`` at the same energy.
    """
    return S_inv.T @ np.diag(winch_values) @ S_inv
