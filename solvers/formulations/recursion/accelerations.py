"""Accelerations of a tree with closing rows, and its projection onto them (compiled).

H u_dot = effort + J^T mu, J u_dot = -gamma: first the accelerations without rows, then the response to the rows by the
factor of J H^-1 J^T.
"""

import math
from typing import Any, NamedTuple

from ..compiled.algebra import clear, copy, multiply, take_larger
from ..compiled.entries import compile_inline, run
from .closing_rows import add_response, couple_rows, factor_closing, rate_rows, solve_closing, store_multipliers
from .limbs import ClosingRows, Limbs
from .sweeps import find_spin_momentum, move_to
from .twists import cross


class CoupledTree(NamedTuple):
    """A tree and its present state, the argument of ``couple_tree``."""

    limbs: Limbs
    closing: ClosingRows
    t: Any  # (1,)
    q: Any  # (nq,)
    u: Any  # (nu,)


class AcceleratedTree(NamedTuple):
    """A tree, its present state, and the results of ``accelerate_tree``."""

    limbs: Limbs
    closing: ClosingRows
    t: Any
    q: Any
    u: Any
    q_dot: Any
    u_dot: Any
    least: Any  # (1,) pivot over its value where the order was found
    loads: int  # program of forces


class ProjectedTree(NamedTuple):
    """A tree, its present state, and the results of ``project_tree``."""

    limbs: Limbs
    closing: ClosingRows
    t: Any
    q: Any
    u: Any
    q_dot: Any
    u_dot: Any
    least: Any
    loads: int
    q_after: Any
    u_after: Any
    lam: Any  # (rows,) in the cut joints' order
    gap: Any  # (1,) largest gap of rows that are left out
    q_moved: Any  # (nq,)
    change: Any  # (nu,)


def accelerate_tree(s: Any) -> None:
    """Set ``q_dot``, ``u_dot`` and ``least``, the least relative pivot of closing rows, from t, q and u.

    ``s`` is an ``AcceleratedTree``.
    """
    s.least[0] = _accelerate(s)
    rate_coordinates(s.limbs, s.q, s.u, s.q_dot)


@compile_inline
def _accelerate(s: Any) -> float:
    """Set ``u_dot`` and the multipliers ``mu`` of the rows in use; return their least relative pivot, at most 1."""
    l, c = s.limbs, s.closing
    l.t[0] = s.t[0]
    move_to(l, s.q, s.u)
    run(s.loads)
    run(l.factoring)
    least = 1.0
    if len(c.joint) > 0:
        run(c.evaluate)
        least = factor_closing(l, c)
    set_loads(l)
    clear(l.effort)
    run(l.responding)
    copy(l.found, s.u_dot)
    if len(c.kept) > 0:
        for k in range(len(l.parent)):
            for i in range(6):
                l.response[k, i] += l.bias[k, i]
            add_centripetal(l, k, l.response[k], l.response[k])
        rate_rows(l, c, l.response)
        for k in range(len(c.kept)):
            c.mu[k] = -(c.gamma[c.kept[k]] + c.rates[c.kept[k]])
        solve_closing(c)
        add_response(c, s.u_dot)
    return least


@compile_inline
def set_loads(l: Any) -> None:
    """Set ``load`` of each limb, about P in space, to its applied forces less its momentum's rate at ``bias``.

    ``bias`` are the accelerations (angular, of P) of the limbs.
    """
    for k in range(len(l.parent)):
        body, m, bias, load = l.body[k], l.mass[k], l.bias[k], l.load[k]
        x, y, z = l.c[k, 0], l.c[k, 1], l.c[k, 2]
        a, b, c = _accelerate_centre(l, k, bias)
        f0, f1, f2 = l.force[body, 0] - m * a, l.force[body, 1] - m * b, l.force[body, 2] - m * c
        a, b, c = find_spin_momentum(l, k, bias[0], bias[1], bias[2])
        n0, n1, n2 = multiply(l.R[body], l.force[body, 3], l.force[body, 4], l.force[body, 5])
        m0, m1, m2 = cross(x, y, z, f0, f1, f2)
        load[0], load[1], load[2] = n0 - a + m0, n1 - b + m1, n2 - c + m2
        load[3], load[4], load[5] = f0, f1, f2


@compile_inline
def _accelerate_centre(l: Any, k: int, a: Any) -> Any:
    """Return the acceleration [m/s2, space] of C of limb ``k``; ``a`` is (angular acceleration, acceleration of P)."""
    d0, d1, d2 = _compute_centripetal(l, k)
    e0, e1, e2 = cross(a[0], a[1], a[2], l.c[k, 0], l.c[k, 1], l.c[k, 2])
    return a[3] + d0 + e0, a[4] + d1 + e1, a[5] + d2 + e2


@compile_inline
def add_centripetal(l: Any, k: int, a: Any, out: Any) -> None:
    """Set ``out`` to the accelerations ``a`` of limb ``k`` plus the centripetal acceleration of C about P."""
    d0, d1, d2 = _compute_centripetal(l, k)
    out[0], out[1], out[2] = a[0], a[1], a[2]
    out[3], out[4], out[5] = a[3] + d0, a[4] + d1, a[5] + d2


@compile_inline
def _compute_centripetal(l: Any, k: int) -> Any:
    """Return omega x (omega x c), the centripetal acceleration [m/s2] of C of limb ``k`` about P."""
    w0, w1, w2 = l.motion[k, 0], l.motion[k, 1], l.motion[k, 2]
    x, y, z = cross(w0, w1, w2, l.c[k, 0], l.c[k, 1], l.c[k, 2])
    return cross(w0, w1, w2, x, y, z)


@compile_inline
def rate_coordinates(l: Any, q: Any, u: Any, out: Any) -> None:
    """Set ``out`` to the rates q_dot of the coordinates ``q`` at velocities ``u``."""
    for k in range(len(l.parent)):
        ns, at, first = l.slides[k], l.q_at[k], l.u_at[k]
        count = ns if l.ball[k] else ns + l.turns[k]
        for i in range(count):
            out[at + i] = u[first + i]
        if l.ball[k]:
            rate_quaternion(q, u, out, at + ns, first + ns, 0.5)


@compile_inline
def rate_quaternion(q: Any, u: Any, out: Any, j: int, i: int, factor: float) -> None:
    """Set four entries of ``out``, from index ``j`` on, to ``factor`` times the quaternion product (0, w) x.

    w are the three entries of ``u`` from ``i`` on, x the four of ``q`` from ``j`` on. With factor 1/2 that is the rate
    of the quaternion x at the angular velocity w.
    """
    a, b, c = u[i], u[i + 1], u[i + 2]
    s, x, y, z = q[j], q[j + 1], q[j + 2], q[j + 3]
    d, e, f = cross(a, b, c, x, y, z)
    out[j] = -factor * (a * x + b * y + c * z)
    out[j + 1], out[j + 2], out[j + 3] = factor * (s * a + d), factor * (s * b + e), factor * (s * c + f)


@compile_inline
def normalise_quaternions(l: Any, q: Any) -> None:
    """Normalise the quaternions of ball joints in ``q`` to length 1, in place."""
    for k in range(len(l.parent)):
        if l.ball[k]:
            j = l.q_at[k] + l.slides[k]
            scale = 1.0 / math.sqrt(q[j] * q[j] + q[j + 1] * q[j + 1] + q[j + 2] * q[j + 2] + q[j + 3] * q[j + 3])
            for i in range(4):
                q[j + i] *= scale


def couple_tree(s: Any) -> None:
    """Factorise H, and compute the lower half of S = J H^-1 J^T of the closing rows in use, at t, q and u.

    ``s`` is a ``CoupledTree``.
    """
    l = s.limbs
    l.t[0] = s.t[0]
    move_to(l, s.q, s.u)
    run(l.factoring)
    if len(s.closing.joint) > 0:
        run(s.closing.evaluate)
        couple_rows(l, s.closing)


def project_tree(s: Any) -> None:
    """Compute accelerations at t, q and u, then project q onto phi = 0 and u onto phi_dot = 0 of the loops.

    ``s`` is a ``ProjectedTree``. Set are ``q_after``, ``u_after`` and ``q_dot`` after the projection, ``u_dot`` and
    ``lam`` before it, the ``least`` pivot, and ``gap``, the largest |phi| after the projection of the rows that are
    left out.
    """
    l, c = s.limbs, s.closing
    s.least[0] = _accelerate(s)
    if len(c.joint) > 0:
        store_multipliers(c, s.lam)
    copy(s.q, s.q_after)
    copy(s.u, s.u_after)
    if len(c.kept) > 0:
        for k in range(len(c.kept)):
            c.mu[k] = -c.phi[c.kept[k]]
        solve_closing(c)
        clear(s.change)
        add_response(c, s.change)
        rate_coordinates(l, s.q, s.change, s.q_moved)
        for i in range(len(s.q)):
            s.q_after[i] += s.q_moved[i]
    normalise_quaternions(l, s.q_after)
    if len(c.joint) > 0:
        move_to(l, s.q_after, s.u)
        run(c.evaluate)
        gap = 0.0
        for k in range(len(c.out)):
            gap = take_larger(gap, abs(c.phi[c.out[k]]))
        s.gap[0] = gap
        rate_rows(l, c, l.motion)
        for k in range(len(c.kept)):
            c.mu[k] = -(c.rates[c.kept[k]] + c.slip[c.kept[k]])
        solve_closing(c)
        add_response(c, s.u_after)
    rate_coordinates(l, s.q_after, s.u_after, s.q_dot)
