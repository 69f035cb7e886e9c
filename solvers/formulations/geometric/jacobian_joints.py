"""Derivative of the joints' part of the step residual: forces of the rows on the bodies, and the rows themselves.

``theta`` is how the end's pose turns, ``dOmega`` how its rate changes (module ``jacobian``). A point row's block uses
hat identities in the body frame, with ``f = R1^T F1`` and ``beta = -s + dt/2 Omega1 x s``::

    R1^T d(b1 x F1) = hat(f) hat(beta) theta + dt/2 hat(f) hat(s) dOmega
"""

import numpy as np
from numba import njit

from .residual import axis_torque
from .small import INNER, add_hat_hat, add_product, back3, cross3, turn3


@njit(**INNER)
def point_forces(model, m0, m1, rows, dt, settings, index, blocks, T):
    """Moments of nu1 and G1 as the body turns, and the columns of nu1."""
    theta = np.zeros((3, 3))
    spin = np.zeros((3, 3))
    for j in range(len(model.end)):
        for e in range(2):
            if model.end[j, e] < 0:
                continue
            half = 0.5 * dt
            B = half * settings.b_term
            b, row, sign, g = model.end[j, e], model.row[j], 1.0 - 2.0 * e, settings.gauge
            R = m1.R
            s0, s1, s2 = model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2]
            f0, f1, f2 = back3(R, b, rows.nu1[row], rows.nu1[row + 1], rows.nu1[row + 2])
            g0, g1, g2 = back3(R, b, half * rows.G1[row], half * rows.G1[row + 1], half * rows.G1[row + 2])
            w0, w1, w2 = cross3(m1.v[b, 3], m1.v[b, 4], m1.v[b, 5], s0, s1, s2)
            theta[:, :] = 0.0
            spin[:, :] = 0.0
            add_hat_hat(sign, f0, f1, f2, B * w0 - s0, B * w1 - s1, B * w2 - s2, theta)
            add_hat_hat(-sign, g0, g1, g2, s0, s1, s2, theta)
            add_hat_hat(sign * B, f0, f1, f2, s0, s1, s2, spin)
            add_product(theta, T, b, spin, 1.0, blocks, index.body[b])
            # columns: translation sign (g - 1 - half dG), moment R^T ((b1 + g b0 - half dG arm1) x e_k)
            C = index.column[j, e]
            for k in range(3):
                slope = half * rows.dG[row + k]
                blocks[C, k, k] = sign * (g - 1.0 - slope)
                x0 = (
                    g * (m0.arm[j, e, 0] + B * m0.arm_dot[j, e, 0])
                    - (1.0 + slope) * m1.arm[j, e, 0]
                    + B * m1.arm_dot[j, e, 0]
                )
                x1 = (
                    g * (m0.arm[j, e, 1] + B * m0.arm_dot[j, e, 1])
                    - (1.0 + slope) * m1.arm[j, e, 1]
                    + B * m1.arm_dot[j, e, 1]
                )
                x2 = (
                    g * (m0.arm[j, e, 2] + B * m0.arm_dot[j, e, 2])
                    - (1.0 + slope) * m1.arm[j, e, 2]
                    + B * m1.arm_dot[j, e, 2]
                )
                x0, x1, x2 = back3(R, b, x0, x1, x2)
                x0, x1, x2 = cross3(x0, x1, x2, R[b, k, 0], R[b, k, 1], R[b, k, 2])
                blocks[C, 3, k], blocks[C, 4, k], blocks[C, 5, k] = sign * x0, sign * x1, sign * x2


@njit(**INNER)
def point_constraints(model, m1, rows, dt, index, blocks, T):
    """Rows: d phi_dot = dr_dot - R (hat(Omega x s) theta + hat(s) dOmega), d phi = half dr_dot - R hat(s) theta."""
    for j in range(len(model.end)):
        for e in range(2):
            if model.end[j, e] < 0:
                continue
            half = 0.5 * dt
            b, row, sign = model.end[j, e], model.row[j], 1.0 - 2.0 * e
            s0, s1, s2 = model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2]
            w0, w1, w2 = cross3(m1.v[b, 3], m1.v[b, 4], m1.v[b, 5], s0, s1, s2)
            C = index.row[j, e]
            for k in range(3):
                w, p = rows.weight[0, row + k], rows.weight[1, row + k]
                blocks[C, k, k] = sign * (w + half * p)
                # row k of R hat(x) is (r_k x x)^T with r_k = R^T e_k
                r0, r1, r2 = m1.R[b, k, 0], m1.R[b, k, 1], m1.R[b, k, 2]
                a0, a1, a2 = cross3(r0, r1, r2, s0, s1, s2)
                d0, d1, d2 = cross3(r0, r1, r2, w0, w1, w2)
                d0, d1, d2 = w * d0 + p * a0, w * d1 + p * a1, w * d2 + p * a2
                for c in range(3):
                    turned = d0 * T[b, 0, c] + d1 * T[b, 1, c] + d2 * T[b, 2, c]
                    blocks[C, k, 3 + c] = -sign * turned
                blocks[C, k, 3] -= sign * w * a0
                blocks[C, k, 4] -= sign * w * a1
                blocks[C, k, 5] -= sign * w * a2


@njit(**INNER)
def axis_columns(model, m0, m1, rows, dt, settings, index, blocks):
    """Columns of nu1 of axis row k: torque gauge (a0 + B a0_dot) - a1 + B a1_dot - half dG a1 on i, minus on j."""
    for j in range(len(model.end)):
        for k in range(2):
            if not model.hinged[j]:
                continue
            half = 0.5 * dt
            B = half * settings.b_term
            g, w = settings.gauge, 1.0 + half * rows.dG[model.row[j] + 3 + k]
            a0, a1, a2, d0, d1, d2 = axis_torque(m0.u, m0.u_dot, m0.n, m0.n_dot, j, k)
            b0, b1, b2, e0, e1, e2 = axis_torque(m1.u, m1.u_dot, m1.n, m1.n_dot, j, k)
            x0 = g * (a0 + B * d0) - w * b0 + B * e0
            x1 = g * (a1 + B * d1) - w * b1 + B * e1
            x2 = g * (a2 + B * d2) - w * b2 + B * e2
            for e in range(2):
                b = model.end[j, e]
                if b >= 0:
                    y0, y1, y2 = back3(m1.R, b, x0, x1, x2)
                    C, sign = index.column[j, e], 1.0 - 2.0 * e
                    blocks[C, 3, 3 + k], blocks[C, 4, 3 + k], blocks[C, 5, 3 + k] = sign * y0, sign * y1, sign * y2


@njit(**INNER)
def axis_forces(model, m1, rows, dt, settings, index, blocks, T):
    """Torque t = w u x n_k + r (u_dot x n_k + u x n_dot_k) as the body of end ``e`` turns, seen in that body's frame.

    There u (of i) and n_k (of j) are fixed vectors p: with y, y_dot the other one,
    ``R^T dt = +-[hat(w y + r y_dot) hat(p) theta + r hat(y) (hat(Omega x p) theta + hat(p) dOmega)]``.
    """
    theta = np.zeros((3, 3))
    spin = np.zeros((3, 3))
    other_theta = np.zeros((3, 3))
    other_spin = np.zeros((3, 3))
    for j in range(len(model.end)):
        for k in range(2 if model.hinged[j] else 0):
            for e in range(2):
                if model.end[j, e] < 0:
                    continue
                half = 0.5 * dt
                row = model.row[j] + 3 + k
                w = -rows.nu1[row] - half * rows.G1[row]
                r = half * settings.b_term * rows.nu1[row]
                b = model.end[j, e]
                if e == 0:
                    p0, p1, p2 = model.u[j, 0], model.u[j, 1], model.u[j, 2]
                    y0, y1, y2 = back3(m1.R, b, m1.n[j, k, 0], m1.n[j, k, 1], m1.n[j, k, 2])
                    z0, z1, z2 = back3(m1.R, b, m1.n_dot[j, k, 0], m1.n_dot[j, k, 1], m1.n_dot[j, k, 2])
                else:  # u x n = -(n x u)
                    p0, p1, p2 = model.n[j, k, 0], model.n[j, k, 1], model.n[j, k, 2]
                    y0, y1, y2 = back3(m1.R, b, m1.u[j, 0], m1.u[j, 1], m1.u[j, 2])
                    z0, z1, z2 = back3(m1.R, b, m1.u_dot[j, 0], m1.u_dot[j, 1], m1.u_dot[j, 2])
                    w, r = -w, -r
                q0, q1, q2 = cross3(m1.v[b, 3], m1.v[b, 4], m1.v[b, 5], p0, p1, p2)
                theta[:, :] = 0.0
                spin[:, :] = 0.0
                add_hat_hat(1.0, w * y0 + r * z0, w * y1 + r * z1, w * y2 + r * z2, p0, p1, p2, theta)
                add_hat_hat(r, y0, y1, y2, q0, q1, q2, theta)
                add_hat_hat(r, y0, y1, y2, p0, p1, p2, spin)
                sign = 1.0 - 2.0 * e
                add_product(theta, T, b, spin, sign, blocks, index.body[b])
                pair = index.couple[j, 1 - e]
                if pair >= 0:  # the same torque, opposite, on the other body: turned into its frame
                    other = model.end[j, 1 - e]
                    for c in range(3):
                        x0, x1, x2 = turn3(m1.R, b, theta[0, c], theta[1, c], theta[2, c])
                        x0, x1, x2 = back3(m1.R, other, x0, x1, x2)
                        other_theta[0, c], other_theta[1, c], other_theta[2, c] = x0, x1, x2
                        x0, x1, x2 = turn3(m1.R, b, spin[0, c], spin[1, c], spin[2, c])
                        x0, x1, x2 = back3(m1.R, other, x0, x1, x2)
                        other_spin[0, c], other_spin[1, c], other_spin[2, c] = x0, x1, x2
                    add_product(other_theta, T, b, other_spin, -sign, blocks, pair)


@njit(**INNER)
def axis_constraints(model, m1, rows, index, blocks, T):
    """(R (theta x p)) . y = theta . (p x R^T y) for p = u_i, Omega x u_i and y = n, n_dot; likewise on j."""
    for j in range(len(model.end)):
        for k in range(2 if model.hinged[j] else 0):
            for e in range(2):
                if model.end[j, e] < 0:
                    continue
                b, row = model.end[j, e], model.row[j] + 3 + k
                if e == 0:
                    p0, p1, p2 = model.u[j, 0], model.u[j, 1], model.u[j, 2]
                    y0, y1, y2 = back3(m1.R, b, m1.n[j, k, 0], m1.n[j, k, 1], m1.n[j, k, 2])
                    z0, z1, z2 = back3(m1.R, b, m1.n_dot[j, k, 0], m1.n_dot[j, k, 1], m1.n_dot[j, k, 2])
                else:
                    p0, p1, p2 = model.n[j, k, 0], model.n[j, k, 1], model.n[j, k, 2]
                    y0, y1, y2 = back3(m1.R, b, m1.u[j, 0], m1.u[j, 1], m1.u[j, 2])
                    z0, z1, z2 = back3(m1.R, b, m1.u_dot[j, 0], m1.u_dot[j, 1], m1.u_dot[j, 2])
                q0, q1, q2 = cross3(m1.v[b, 3], m1.v[b, 4], m1.v[b, 5], p0, p1, p2)
                a0, a1, a2 = cross3(p0, p1, p2, y0, y1, y2)  # on dOmega, and of phi on theta
                c0, c1, c2 = cross3(p0, p1, p2, z0, z1, z2)
                d0, d1, d2 = cross3(q0, q1, q2, y0, y1, y2)
                w, f = rows.weight[0, row], rows.weight[1, row]
                d0, d1, d2 = w * (c0 + d0) + f * a0, w * (c1 + d1) + f * a1, w * (c2 + d2) + f * a2
                C = index.row[j, e]
                for c in range(3):
                    blocks[C, 3 + k, 3 + c] = d0 * T[b, 0, c] + d1 * T[b, 1, c] + d2 * T[b, 2, c]
                blocks[C, 3 + k, 3] += w * a0
                blocks[C, 3 + k, 4] += w * a1
                blocks[C, 3 + k, 5] += w * a2
