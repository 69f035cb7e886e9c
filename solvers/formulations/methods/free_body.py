"""The free rigid body over a step: exact where two principal inertias are equal, a symmetric splitting elsewhere.

With the body momentum L = J Omega, H = |L|^2 / 2 J_3 + L_1^2 (1/J_1 - 1/J_3) / 2 + L_2^2 (1/J_2 - 1/J_3) / 2, each part
exact: the first turns R by exp(h L / J_3), the i-th by exp(z e_i) with z = h (1/J_i - 1/J_3) L_i and L by its inverse
(McLachlan, Modin, Verdier, Wilkins 2014, SIAM J. Sci. Comput. 36). Each part keeps the spatial momentum R L.
"""

import math
from typing import Any

import numpy as np

from ....harness.mechanics.fixed_order import dot, principal_axes
from ..compiled.algebra import turn_rotation
from ..compiled.bundles import make_bundle
from ..compiled.entries import compile_inline

# Half and twice of both change no bit of a free body and a top by lie_variational, at usual and at long steps.
EQUAL = 1e-14  # share of the inertia below which two principal values count as equal
NEWTON = 30  # corrections of the discrete free body


def find_principal_axes(inertia: np.ndarray) -> Any:
    """Return the bundle of principal axes (columns of Q) and moments J (nb, 3) of bodies, ordered for the splitting.

    ``inertia`` is (nb, 3, 3). The splitting rotates about axes 0 and 1, and J[2] is that of the isotropic part: an
    axisymmetric body needs one rotation, a sphere none. ``turned`` is 1 where Q is not the identity; ``rate`` (nb, 2)
    is 1/J_i - 1/J_3, 0 where they are equal.
    """
    nb = len(inertia)
    Q, J = np.zeros((nb, 3, 3)), np.zeros((nb, 3))
    for b in range(nb):
        diagonal = np.array_equal(inertia[b], np.diag(np.diag(inertia[b])))
        values, axes = (np.diag(inertia[b]).copy(), np.eye(3)) if diagonal else principal_axes(inertia[b])
        gap = [abs(values[(k + 1) % 3] - values[(k + 2) % 3]) for k in range(3)]
        k = int(np.argmin(gap))  # the axis of symmetry, if there is one: it becomes axis 0, the others 1 and 2
        order = [k, (k + 1) % 3, (k + 2) % 3]
        Q[b], J[b] = axes[:, order], values[order]
        if dot(np.cross(Q[b, :, 0], Q[b, :, 1]), Q[b, :, 2]) < 0.0:
            Q[b, :, 0] *= -1.0
    rate = 1.0 / J[:, :2] - 1.0 / J[:, 2:] if nb else np.zeros((0, 2))
    rate[np.abs(rate) * J[:, 2:] < EQUAL] = 0.0
    turned = np.array([0 if np.array_equal(q, np.eye(3)) else 1 for q in Q], dtype=np.int64)
    return make_bundle("Principal", {}, {}, Q=Q.copy(), turned=turned, J=J, rate=rate)


@compile_inline
def _rotate_about_axis(R, b, axis, z, L):
    """Rotate body ``b`` by z [rad] about its axis e (0, 1 or 2): R[b] := R[b] exp(z hat(e)), L := exp(-z hat(e)) L."""
    c, s = math.cos(z), math.sin(z)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    for a in range(3):
        x, y = R[b, a, i], R[b, a, j]
        R[b, a, i], R[b, a, j] = c * x + s * y, c * y - s * x
    x, y = L[i], L[j]
    L[i], L[j] = c * x + s * y, c * y - s * x


@compile_inline
def _change_axes(Q, b, R, L, forward):
    """Change body ``b`` to its principal axes, R := R Q and L := Q^T L in place, or back without ``forward``."""
    x0, x1, x2 = L[0], L[1], L[2]
    for a in range(3):
        if forward:
            L[a] = Q[b, 0, a] * x0 + Q[b, 1, a] * x1 + Q[b, 2, a] * x2
        else:
            L[a] = Q[b, a, 0] * x0 + Q[b, a, 1] * x1 + Q[b, a, 2] * x2
    for a in range(3):
        y0, y1, y2 = R[b, a, 0], R[b, a, 1], R[b, a, 2]
        for c in range(3):
            if forward:
                R[b, a, c] = y0 * Q[b, 0, c] + y1 * Q[b, 1, c] + y2 * Q[b, 2, c]
            else:
                R[b, a, c] = y0 * Q[b, c, 0] + y1 * Q[b, c, 1] + y2 * Q[b, c, 2]


@compile_inline
def turn_freely(p, b, h, R, L):
    """Rotate body ``b`` freely for ``h`` [s]: change ``R[b]`` and its body momentum ``L`` (3,) in place.

    ``p`` is the bundle of ``find_principal_axes``. The splitting is symmetric: half of axis 1, the isotropic part,
    axis 0, half of axis 1.
    """
    if p.turned[b]:
        _change_axes(p.Q, b, R, L, 1)
    if p.rate[b, 1] != 0.0:
        _rotate_about_axis(R, b, 1, 0.5 * h * p.rate[b, 1] * L[1], L)
    turn_rotation(R[b], h * L[0] / p.J[b, 2], h * L[1] / p.J[b, 2], h * L[2] / p.J[b, 2], R[b])
    if p.rate[b, 0] != 0.0:
        _rotate_about_axis(R, b, 0, h * p.rate[b, 0] * L[0], L)
    if p.rate[b, 1] != 0.0:
        _rotate_about_axis(R, b, 1, 0.5 * h * p.rate[b, 1] * L[1], L)
    if p.turned[b]:
        _change_axes(p.Q, b, R, L, 0)


@compile_inline
def turn_discretely(J, h, R, L):
    """Rotate a free body for ``h`` [s] by Moser and Veselov's equations: R := R F, L := F^T L, in place.

    hat(h L) = F J_d - J_d F^T, J_d = tr(J)/2 - J. With F = (1 + hat(f)) (1 - hat(f))^-1 that is g + g x f + (g . f) f =
    2 J f, g = h L (Lee, Leok, McClamroch 2007, Comput. Methods Appl. Mech. Eng. 196), solved by Newton's method. R and
    L become NaN where it does not converge.
    """
    g0, g1, g2 = h * L[0], h * L[1], h * L[2]
    f0 = f1 = f2 = 0.0
    last = math.inf
    for _ in range(NEWTON):
        # residual (q0, q1, q2); its negative Jacobian has the rows (a, b, c), (p, q, r), (u, v, w)
        d = g0 * f0 + g1 * f1 + g2 * f2
        q0 = g0 + g1 * f2 - g2 * f1 + d * f0 - 2.0 * (J[0, 0] * f0 + J[0, 1] * f1 + J[0, 2] * f2)
        q1 = g1 + g2 * f0 - g0 * f2 + d * f1 - 2.0 * (J[1, 0] * f0 + J[1, 1] * f1 + J[1, 2] * f2)
        q2 = g2 + g0 * f1 - g1 * f0 + d * f2 - 2.0 * (J[2, 0] * f0 + J[2, 1] * f1 + J[2, 2] * f2)
        a, b, c = 2.0 * J[0, 0] - d - f0 * g0, 2.0 * J[0, 1] + g2 - f0 * g1, 2.0 * J[0, 2] - g1 - f0 * g2
        p, q, r = 2.0 * J[1, 0] - g2 - f1 * g0, 2.0 * J[1, 1] - d - f1 * g1, 2.0 * J[1, 2] + g0 - f1 * g2
        u, v, w = 2.0 * J[2, 0] + g1 - f2 * g0, 2.0 * J[2, 1] - g0 - f2 * g1, 2.0 * J[2, 2] - d - f2 * g2
        x, y, z = q * w - r * v, r * u - p * w, p * v - q * u
        t = a * x + b * y + c * z
        d0 = (q0 * x + q1 * (c * v - b * w) + q2 * (b * r - c * q)) / t
        d1 = (q0 * y + q1 * (a * w - c * u) + q2 * (c * p - a * r)) / t
        d2 = (q0 * z + q1 * (b * u - a * v) + q2 * (a * q - b * p)) / t
        f0, f1, f2 = f0 + d0, f1 + d1, f2 + d2
        size = abs(d0) + abs(d1) + abs(d2)
        if size < 1e-15 or (size < 1e-12 and size >= last):
            break
        last = size
    else:
        f0 = math.nan
    s = 2.0 / (1.0 + f0 * f0 + f1 * f1 + f2 * f2)
    for a in range(4):  # rows of R by F, then L as a row: F^T L
        x, y, z = (R[a, 0], R[a, 1], R[a, 2]) if a < 3 else (L[0], L[1], L[2])
        i, j, k = y * f2 - z * f1, z * f0 - x * f2, x * f1 - y * f0  # row times hat(f)
        x, y, z = x + s * (i + j * f2 - k * f1), y + s * (j + k * f0 - i * f2), z + s * (k + i * f1 - j * f0)
        if a < 3:
            R[a, 0], R[a, 1], R[a, 2] = x, y, z
        else:
            L[0], L[1], L[2] = x, y, z
