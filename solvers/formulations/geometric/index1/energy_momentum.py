"""Energy and momentum kept by a mean-value step: Cayley's map, discrete gradients of rows and springs (compiled).

Simo and Wong 1991, Int. J. Numer. Meth. Eng. 31; discrete gradients: Gonzalez 1996, J. Nonlinear Sci. 6::

    r_1 = r_0 + h v_m,  R_1 = R_0 cay(h Omega_m),  v_m = (v_0 + v_1) / 2,  R_m = (R_0 + R_1) / 2 (no rotation)
    m (v_1 - v_0) = h (m g + sum F),   J (Omega_1 - Omega_0) + h Omega_m x J Omega_m = h R_m^-1 T
    R_m^-1 y = R_0^T y - (h/2) Omega_m x R_0^T y,   phi(q_1) = 0

R_1 s - R_0 s = h R_m (Omega_m x s), so a force F at a joint with T = (R_m s) x F, and nu on an axis row with
T = nu (R_m,i u) x (R_m,j n), do no work: A_m v_m = (phi_1 - phi_0) / h for the rows A_m of those wrenches. A spring
pulls with k (1 - 2 d_free / (d_0 + d_1)) along the mean line, a damper with (2 c / h) (d_1 - d_0) / (d_0 + d_1).

Simplified Newton: S of the first estimate's A_m, P = h F, dv = v_0 + h M^-1 f + M^-1 A_m^T P - v_1,
S dP = -A_m dv - 2 phi / h. The multipliers F are those of the middle, and A v of the ends, free to alternate from step
to step by O(h^2), makes them alternate by O(h). The record has F + (F' - F'') / 2 of the last three at the end of the
step: alternation cancels, a straight line is continued. The matrix of the iteration knows no springs.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from ..arrays import Model
from ..loads import load
from ..vectors import INNER, JIT, blend, copy, cross, dot, minus, plus, put, times, turn
from .fixed_step import FAILED, MOST_ITERATIONS, SETTLED, STUCK, keep_step, largest, settled, times_of
from .kernel import (
    HOT,
    Kernel,
    add_gyroscopic,
    add_rows_back,
    factorise,
    fill_Y,
    solve,
    times_inverse_mass,
    times_rows,
)
from .rkmk import FINISHED, FULL, NOT_FINITE


class Scheme(NamedTuple):
    """``tolerance`` of phi and of the last correction of poses [m; axis rows and angles without unit]."""

    tolerance: float


class Step(NamedTuple):
    """Room for one step."""

    r0: np.ndarray  # (nb, 3)
    R0: np.ndarray  # (nb, 3, 3)
    v0: np.ndarray  # (nb, 6)
    v: np.ndarray  # (nb, 6) at the end
    gain: np.ndarray  # (nb, 6) v_1 - v_0, the estimate of the next step's
    dv: np.ndarray  # (nb, 6)
    F: np.ndarray  # (nrows,) multipliers of the middle
    F1: np.ndarray  # (nrows,) of the middle of the step before
    F2: np.ndarray  # (nrows,) and of the one before that
    lam: np.ndarray  # (nrows,) at the end
    clock: np.ndarray  # (3,)


def empty_step(model: Model) -> Step:
    """Arrays of one step."""
    nb, nrows = len(model.mass), int(model.row[-1])
    return Step(
        r0=np.zeros((nb, 3)), R0=np.zeros((nb, 3, 3)), v0=np.zeros((nb, 6)), v=np.zeros((nb, 6)),
        gain=np.zeros((nb, 6)), dv=np.zeros((nb, 6)), F=np.zeros(nrows), F1=np.zeros(nrows), F2=np.zeros(nrows),
        lam=np.zeros(nrows), clock=np.zeros(3, dtype=np.int64),
    )  # fmt: skip


def start(k: Kernel, step: Step) -> None:
    """The reaction at the start, by index 1, stands for the middles before it."""
    step.F[:], step.F1[:], step.F2[:] = k.lam, k.lam, k.lam


@njit(**HOT)
def _pose(step, h, k):
    """q_1 of the mean velocities in ``k.v``."""
    for b in range(len(k.v)):
        x, y, z = 0.5 * h * k.v[b, 3], 0.5 * h * k.v[b, 4], 0.5 * h * k.v[b, 5]
        f = 2.0 / (1.0 + x * x + y * y + z * z)
        for a in range(3):
            k.r[b, a] = step.r0[b, a] + h * k.v[b, a]
            p, q, s = step.R0[b, a, 0], step.R0[b, a, 1], step.R0[b, a, 2]
            i, j, l = q * z - s * y, s * x - p * z, p * y - q * x  # row of R_0 hat(h Omega_m / 2)
            k.R[b, a, 0] = p + f * (i + j * z - l * y)
            k.R[b, a, 1] = q + f * (j + l * x - i * z)
            k.R[b, a, 2] = s + f * (l + i * y - j * x)


@njit(**HOT)
def _turned(R, b, x0, x1, x2):
    """R_b x; x itself on the ground."""
    if b < 0:
        return x0, x1, x2
    return (
        R[b, 0, 0] * x0 + R[b, 0, 1] * x1 + R[b, 0, 2] * x2,
        R[b, 1, 0] * x0 + R[b, 1, 1] * x1 + R[b, 1, 2] * x2,
        R[b, 2, 0] * x0 + R[b, 2, 1] * x1 + R[b, 2, 2] * x2,
    )


@njit(**HOT)
def _back(step, k, h, b, y0, y1, y2):
    """R_m^-1 y"""
    R, w0, w1, w2 = step.R0, 0.5 * h * k.v[b, 3], 0.5 * h * k.v[b, 4], 0.5 * h * k.v[b, 5]
    z0 = R[b, 0, 0] * y0 + R[b, 1, 0] * y1 + R[b, 2, 0] * y2
    z1 = R[b, 0, 1] * y0 + R[b, 1, 1] * y1 + R[b, 2, 1] * y2
    z2 = R[b, 0, 2] * y0 + R[b, 1, 2] * y1 + R[b, 2, 2] * y2
    return z0 - (w1 * z2 - w2 * z1), z1 - (w2 * z0 - w0 * z2), z2 - (w0 * z1 - w1 * z0)


@njit(**HOT)
def _rows(model, k, step, h):
    """phi at q_1, X and Y of the mean rows."""
    for j in range(len(model.body)):
        i, g, first = model.body[j, 0], model.body[j, 1], model.row[j]
        for a in range(3 if model.pins[j] else 0):
            k.phi[first + a] = 0.0
        for e in range(2 if model.pins[j] else 0):
            sign, b = 1.0 - 2.0 * e, model.body[j, e]
            s0, s1, s2 = model.s[j, e, 0], model.s[j, e, 1], model.s[j, e, 2]
            x0, x1, x2 = _turned(k.R, b, s0, s1, s2)
            if b >= 0:
                y0, y1, y2 = _turned(step.R0, b, s0, s1, s2)
                y0, y1, y2 = 0.5 * sign * (x0 + y0), 0.5 * sign * (x1 + y1), 0.5 * sign * (x2 + y2)
                X = k.X[j, e]
                X[0, 0], X[0, 1], X[0, 2] = _back(step, k, h, b, 0.0, y2, -y1)
                X[1, 0], X[1, 1], X[1, 2] = _back(step, k, h, b, -y2, 0.0, y0)
                X[2, 0], X[2, 1], X[2, 2] = _back(step, k, h, b, y1, -y0, 0.0)
                x0, x1, x2 = x0 + k.r[b, 0], x1 + k.r[b, 1], x2 + k.r[b, 2]
            k.phi[first] += sign * x0
            k.phi[first + 1] += sign * x1
            k.phi[first + 2] += sign * x2
        if model.lines[j]:
            _line_rows(model, k, step, h, j)
        for c in range(model.axes[j]):
            at = 3 * model.pins[j] + c
            u0, u1, u2 = _turned(k.R, i, model.u[j, c, 0], model.u[j, c, 1], model.u[j, c, 2])
            n0, n1, n2 = _turned(k.R, g, model.n[j, c, 0], model.n[j, c, 1], model.n[j, c, 2])
            k.phi[first + at] = u0 * n0 + u1 * n1 + u2 * n2
            p0, p1, p2 = _turned(step.R0, i, model.u[j, c, 0], model.u[j, c, 1], model.u[j, c, 2])
            q0, q1, q2 = _turned(step.R0, g, model.n[j, c, 0], model.n[j, c, 1], model.n[j, c, 2])
            u0, u1, u2 = 0.5 * (u0 + p0), 0.5 * (u1 + p1), 0.5 * (u2 + p2)
            n0, n1, n2 = 0.5 * (n0 + q0), 0.5 * (n1 + q1), 0.5 * (n2 + q2)
            for e in range(2):
                sign, b = 1.0 - 2.0 * e, model.body[j, e]
                if b >= 0:
                    t0, t1, t2 = sign * (u1 * n2 - u2 * n1), sign * (u2 * n0 - u0 * n2), sign * (u0 * n1 - u1 * n0)
                    X = k.X[j, e, at]
                    X[0], X[1], X[2] = _back(step, k, h, b, t0, t1, t2)
        fill_Y(model, k, j)


@njit(**INNER)
def _line_rows(model, k, step, h, j):
    """phi at q_1 and the mean rows: f_m = (f_0 + f_1) / 2 at the arms (R_m s_i), and (R_m s_j) + d_m on j."""
    g = model.body[j, 1]
    x, y = _at(model, step.r0, step.R0, j, 0), _at(model, step.r0, step.R0, j, 1)
    d0 = minus(x, y)
    x, y = _at(model, k.r, k.R, j, 0), _at(model, k.r, k.R, j, 1)
    d1 = minus(x, y)
    for c in range(model.lines[j]):
        row, L, n = model.row[j] + c, model.length[j], model.normal[j, c]
        if L > 0.0:
            f0, f1 = times(1.0 / L, d0), times(1.0 / L, d1)
            k.phi[row] = 0.5 * (dot(d1, d1) / L - L)
        else:
            f0 = _turned(step.R0, g, n[0], n[1], n[2])
            f1 = _turned(k.R, g, n[0], n[1], n[2])
            k.phi[row] = dot(f1, d1)
        f = blend(0.5, f0, 0.5, f1)
        put(f, k.way[j, c])
        for e in range(2):
            b = model.body[j, e]
            if b < 0:
                continue
            s = model.s[j, e]
            p, q = _turned(step.R0, b, s[0], s[1], s[2]), _turned(k.R, b, s[0], s[1], s[2])
            arm = blend(0.5, p, 0.5, q)
            if e == 1:
                arm = plus(arm, blend(0.5, d0, 0.5, d1))
            T = times(1.0 - 2.0 * e, cross(arm, f))
            put(_back(step, k, h, b, T[0], T[1], T[2]), k.X[j, e, c])


@njit(**INNER)
def _at(model, r, R, j, e):
    """Point of an end of a joint in space."""
    b, s = model.body[j, e], model.s[j, e]
    x = _turned(R, b, s[0], s[1], s[2])
    return x if b < 0 else plus(r[b], x)


@njit(**HOT)
def _end(model, r, R, s, e):
    """End ``e`` of spring ``s`` in space."""
    b, p = model.spring_body[s, e], model.p[s, e]
    x0, x1, x2 = _turned(R, b, p[0], p[1], p[2])
    if b < 0:
        return x0, x1, x2
    return r[b, 0] + x0, r[b, 1] + x1, r[b, 2] + x2


@njit(**HOT)
def _forces(model, k, step, h):
    """``k.force``: gravity, discrete gradients of springs, dampers, loads; torques in the sense of R_m^-1 T."""
    for b in range(len(model.mass)):
        for a in range(3):
            k.force[b, a] = model.mass[b] * model.gravity[a]
            k.force[b, 3 + a] = 0.0
    for s in range(len(model.stiffness)):
        a, b = _end(model, step.r0, step.R0, s, 0), _end(model, step.r0, step.R0, s, 1)
        l0, l1, l2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        a, b = _end(model, k.r, k.R, s, 0), _end(model, k.r, k.R, s, 1)
        m0, m1, m2 = a[0] - b[0], a[1] - b[1], a[2] - b[2]
        before, after = math.sqrt(l0 * l0 + l1 * l1 + l2 * l2), math.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
        sum_, gained = before + after, after - before
        pull = model.stiffness[s] * (1.0 - 2.0 * model.free_length[s] / sum_)
        pull += 2.0 * model.damping[s] * gained / (h * sum_)
        for e in range(2):
            body, p = model.spring_body[s, e], model.p[s, e]
            if body < 0:
                continue
            f = -(0.5 - e) * pull
            f0, f1, f2 = f * (l0 + m0), f * (l1 + m1), f * (l2 + m2)
            x0, x1, x2 = _turned(step.R0, body, p[0], p[1], p[2])
            y0, y1, y2 = _turned(k.R, body, p[0], p[1], p[2])
            x0, x1, x2 = 0.5 * (x0 + y0), 0.5 * (x1 + y1), 0.5 * (x2 + y2)
            t = _back(step, k, h, body, x1 * f2 - x2 * f1, x2 * f0 - x0 * f2, x0 * f1 - x1 * f0)
            for c, value in enumerate((f0, f1, f2, t[0], t[1], t[2])):
                k.force[body, c] += value
    for i in range(len(model.load_body)):
        _load(model, k, step, h, i)
    add_gyroscopic(model, k)


@njit(**INNER)
def _load(model, k, step, h, i):
    """A load by the mean of R: the work of a force in space is exact."""
    b, p = model.load_body[i], model.load_p[i]
    F0, T0 = load(model, step.R0[b], k.t[0] - h, i)
    F1, T1 = load(model, k.R[b], k.t[0], i)
    F, T = blend(0.5, F0, 0.5, F1), blend(0.5, T0, 0.5, T1)
    arm = blend(0.5, turn(step.R0[b], p), 0.5, turn(k.R[b], p))
    T = plus(T, cross(arm, F))
    t = _back(step, k, h, b, T[0], T[1], T[2])
    for a in range(3):
        k.force[b, a] += F[a]
        k.force[b, 3 + a] += t[a]


@njit(**HOT)
def _step(model, blocks, k, step, s, t1, h):
    """One step from where ``k`` stands to ``t1``; returns whether the iteration settled."""
    k.t[0] = t1
    copy(k.r, step.r0)
    copy(k.R, step.R0)
    copy(k.v, step.v0)
    for b in range(len(step.v)):
        for a in range(6):
            step.v[b, a] = step.v0[b, a] + step.gain[b, a]
    last = np.inf
    for i in range(MOST_ITERATIONS):
        for b in range(len(step.v)):
            for a in range(6):
                k.v[b, a] = 0.5 * (step.v0[b, a] + step.v[b, a])
        _pose(step, h, k)
        _rows(model, k, step, h)
        if i == 0:
            factorise(model, blocks, k)
            step.clock[2] += 1
        _forces(model, k, step, h)
        times_inverse_mass(model, k.force)
        add_rows_back(model, k, step.F, k.force)
        for b in range(len(step.v)):
            for a in range(6):
                step.dv[b, a] = step.v0[b, a] + h * k.force[b, a] - step.v[b, a]
        for a in range(len(k.rhs)):
            k.rhs[a] = -2.0 / h * k.phi[a]
        times_rows(model, k, step.dv, -1.0, k.rhs)
        solve(blocks, k, k.rhs)
        add_rows_back(model, k, k.rhs, step.dv)
        for a in range(len(k.rhs)):
            step.F[a] += k.rhs[a] / h
        for b in range(len(step.v)):
            for a in range(6):
                step.v[b, a] += step.dv[b, a]
        step.clock[1] += 1
        size = max(largest(k.phi), h * largest(step.dv))
        state = settled(size, last, s.tolerance)
        if state == FAILED:
            return False
        last = size
        if state == SETTLED:
            break
    if last > s.tolerance:
        return False
    for b in range(len(step.v)):
        for a in range(6):
            k.v[b, a] = 0.5 * (step.v0[b, a] + step.v[b, a])
    _pose(step, h, k)
    copy(step.v, k.v)
    for a in range(len(k.rhs)):
        step.lam[a] = step.F[a] + 0.5 * (step.F1[a] - step.F2[a])
        step.F2[a] = step.F1[a]
        step.F1[a] = step.F[a]
    for b in range(len(step.v)):
        for a in range(6):
            step.gain[b, a] = step.v[b, a] - step.v0[b, a]
    return True


@njit(**JIT)
def march(model, blocks, k, step, s, dt, t_end, record):
    """Steps of ``dt``; returns (outcome, steps recorded)."""
    done = 0
    while done < len(record.t):
        t0, t1 = times_of(step.clock, dt, t_end)
        if not t1 > t0:
            return FINISHED, done
        if not _step(model, blocks, k, step, s, t1, t1 - t0):
            return STUCK, done
        if not keep_step(k, step.lam, step.clock, t1, record, done):
            return NOT_FINITE, done
        done += 1
    return FULL, done
