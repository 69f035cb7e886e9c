"""Derivative of the joints' part of the step residual: forces of the rows on the bodies, and the rows themselves.

``theta`` is how the end's pose turns, ``dOmega`` how its rate changes (module ``jacobian``). A point row's block uses
hat identities in the body frame, with ``F = R1^T nu1`` and ``beta = -s + dt/2 Omega1 x s``::

    R1^T d(b1 x nu1) = hat(F) hat(beta) theta + dt/2 hat(F) hat(s) dOmega
"""

from numba import njit

from .vectors import INNER, add, blend, cross, hat_hat, minus, plus, rows_plus, seen_from, times, turn_back


@njit(**INNER)
def point_forces(model, step, settings, saddle):
    """Moments of nu1 and G1 as the body turns."""
    end, rows, half = step.end, step.rows, 0.5 * step.dt
    B = half * settings.b_term
    for j in range(len(model.body)):
        row = model.row[j]
        for e in range(2 if model.pins[j] else 0):
            b, sign, s = model.body[j, e], 1.0 - 2.0 * e, model.s[j, e]
            if b < 0:
                continue
            F, G1 = turn_back(end.R[b], rows.nu1[row:]), turn_back(end.R[b], times(half, rows.G1[row:]))
            beta = minus(times(B, cross(end.v[b, 3:], s)), s)
            by_theta = rows_plus(hat_hat(sign, F, beta), hat_hat(-sign, G1, s))
            _add_turning(1.0, by_theta, hat_hat(sign * B, F, s), saddle.T[b], saddle.blocks[saddle.body[b]])


@njit(**INNER)
def _add_turning(sign, by_theta, by_Omega, T, K):
    """Rotational part of a block += sign (by_theta T + by_Omega)."""
    add(sign, plus(turn_back(T, by_theta[0]), by_Omega[0]), K[3, 3:])
    add(sign, plus(turn_back(T, by_theta[1]), by_Omega[1]), K[4, 3:])
    add(sign, plus(turn_back(T, by_theta[2]), by_Omega[2]), K[5, 3:])


@njit(**INNER)
def point_columns(model, step, settings, saddle):
    """Columns of nu1: translation sign (gauge - 1 - half dG), moment R1^T (b x e_k), b as in ``by_nu``."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    B, gauge = half * settings.b_term, settings.gauge
    for j in range(len(model.body)):
        for e in range(2 if model.pins[j] else 0):
            b, sign = model.body[j, e], 1.0 - 2.0 * e
            if b < 0:
                continue
            R, K = end.R[b], saddle.blocks[saddle.column[j, e]]
            for k in range(3):
                dG = half * step.rows.dG[model.row[j] + k]
                K[k, k] = sign * (gauge - 1.0 - dG)
                x = by_nu(gauge, B, dG, start.arm[j, e], start.arm_dot[j, e], end.arm[j, e], end.arm_dot[j, e])
                K[3, k], K[4, k], K[5, k] = times(sign, cross(turn_back(R, x), R[k]))


@njit(**INNER)
def axis_columns(model, step, settings, saddle):
    """Columns of nu1 of axis row k: its torque on i, minus that on j."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    B, gauge = half * settings.b_term, settings.gauge
    for j in range(len(model.body)):
        for k in range(model.axes[j]):
            dG = half * step.rows.dG[model.row[j] + 3 * model.pins[j] + k]
            x = by_nu(gauge, B, dG, start.a[j, k], start.a_dot[j, k], end.a[j, k], end.a_dot[j, k])
            for e in range(2):
                b, sign = model.body[j, e], 1.0 - 2.0 * e
                if b >= 0:
                    K = saddle.blocks[saddle.column[j, e]]
                    at = 3 * model.pins[j] + k
                    K[3, at], K[4, at], K[5, at] = times(sign, turn_back(end.R[b], x))


@njit(**INNER)
def by_nu(gauge, B, dG, b0, b0_dot, b1, b1_dot):
    """Derivative by nu1: gauge (b0 + B b0_dot) - (1 + dG) b1 + B b1_dot, b the arm or the unit torque of a row."""
    return plus(blend(gauge, plus(b0, times(B, b0_dot)), -(1.0 + dG), b1), times(B, b1_dot))


@njit(**INNER)
def point_constraints(model, step, saddle):
    """Rows: d phi_dot = dr_dot - R (hat(Omega x s) theta + hat(s) dOmega), d phi = half dr_dot - R hat(s) theta."""
    end, rows, half = step.end, step.rows, 0.5 * step.dt
    for j in range(len(model.body)):
        for e in range(2 if model.pins[j] else 0):
            b, sign, s = model.body[j, e], 1.0 - 2.0 * e, model.s[j, e]
            if b < 0:
                continue
            K, s_dot = saddle.blocks[saddle.row[j, e]], cross(end.v[b, 3:], s)
            for k in range(3):
                on_rate, on_phi = rows.on_rate[model.row[j] + k], rows.on_phi[model.row[j] + k]
                K[k, k] = sign * (on_rate + half * on_phi)
                # row k of R hat(x) is (r_k x x)^T with r_k = R^T e_k
                x, x_dot = cross(end.R[b, k], s), cross(end.R[b, k], s_dot)
                _put_row(-sign, on_rate, on_phi, x, x_dot, saddle.T[b], K[k, 3:])


@njit(**INNER)
def _put_row(sign, on_rate, on_phi, x, x_dot, T, out):
    """A row's derivative by Omega1: sign [(on_rate x_dot + on_phi x)^T T + on_rate x^T]."""
    by_theta = turn_back(T, blend(on_rate, x_dot, on_phi, x))
    for q in range(3):
        out[q] = sign * by_theta[q] + sign * on_rate * x[q]


@njit(**INNER)
def _both_vectors(model, end, j, k, e):
    """Axis row k is p . y with p (u or n_k) fixed in the body of end ``e``: p, y and y_dot in its frame."""
    R = end.R[model.body[j, e]]
    if e == 0:
        u = model.u[j, k]
        return (u[0], u[1], u[2]), turn_back(R, end.n[j, k]), turn_back(R, end.n_dot[j, k])
    n = model.n[j, k]
    return (n[0], n[1], n[2]), turn_back(R, end.u[j, k]), turn_back(R, end.u_dot[j, k])


@njit(**INNER)
def axis_forces(model, step, settings, saddle):
    """Torque t = w u x n_k + z (u_dot x n_k + u x n_dot_k) as the body of end ``e`` turns, seen in that body's frame.

    With p, y of ``_both_vectors`` and + on i, - on j:
    ``R^T dt = +-[hat(w y + z y_dot) hat(p) theta + z hat(y) (hat(Omega x p) theta + hat(p) dOmega)]``.
    """
    end, rows, half = step.end, step.rows, 0.5 * step.dt
    for j in range(len(model.body)):
        for k in range(model.axes[j]):
            row = model.row[j] + 3 * model.pins[j] + k
            for e in range(2):
                b, other, sign = model.body[j, e], model.body[j, 1 - e], 1.0 - 2.0 * e
                if b < 0:
                    continue
                w = sign * (-rows.nu1[row] - half * rows.G1[row])  # u x n = -(n x u)
                z = sign * (half * settings.b_term * rows.nu1[row])
                p, y, y_dot = _both_vectors(model, end, j, k, e)
                p_dot = cross(end.v[b, 3:], p)
                by_theta = rows_plus(hat_hat(1.0, blend(w, y, z, y_dot), p), hat_hat(z, y, p_dot))
                by_Omega = hat_hat(z, y, p)
                _add_turning(sign, by_theta, by_Omega, saddle.T[b], saddle.blocks[saddle.body[b]])
                pair = saddle.couple[j, 1 - e]
                if pair >= 0:  # the same torque, opposite, on the other body: turned into its frame
                    by_theta = seen_from(end.R[other], end.R[b], by_theta)
                    by_Omega = seen_from(end.R[other], end.R[b], by_Omega)
                    _add_turning(-sign, by_theta, by_Omega, saddle.T[b], saddle.blocks[pair])


@njit(**INNER)
def axis_constraints(model, step, saddle):
    """Rows: d(p . y) = (R (theta x p)) . y = theta . (p x R^T y), likewise for the rates of p and y."""
    end, rows = step.end, step.rows
    for j in range(len(model.body)):
        for k in range(model.axes[j]):
            row = model.row[j] + 3 * model.pins[j] + k
            for e in range(2):
                b = model.body[j, e]
                if b < 0:
                    continue
                p, y, y_dot = _both_vectors(model, end, j, k, e)
                x_dot = plus(cross(p, y_dot), cross(cross(end.v[b, 3:], p), y))
                K = saddle.blocks[saddle.row[j, e]]
                _put_row(
                    1.0,
                    rows.on_rate[row],
                    rows.on_phi[row],
                    cross(p, y),
                    x_dot,
                    saddle.T[b],
                    K[3 * model.pins[j] + k, 3:],
                )
