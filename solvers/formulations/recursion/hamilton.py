"""Hamilton's equations of a tree by sweeps over its bodies, and rows that close its loops (compiled).

The functions and coordinates are those of ``joint_coordinates.hamilton``. H u = pi by the factor of the sweeps; with a
limb's motion V and the momentum h = (moment about P, momentum) of all bodies that its joint carries, the slope of the
energy along a rotation about s is

    T_theta = <h, [V, s]> = s . (h_turn x omega + h_move x v)

with V before that joint; along a slide w it is w . (h_move x omega). The bodies behind a ball translate with its P and
do not rotate with its parent: their momentum p acts on the parent as the moment v_P x p.
"""

import math
from typing import Any, NamedTuple

from ..compiled.algebra import clear, copy, multiply, multiply_transposed
from ..compiled.entries import compile_inline, compile_separately, run
from .accelerations import normalise_quaternions, rate_coordinates, rate_quaternion
from .closing_rows import add_response, add_row, factor_closing, rate_rows, solve_closing, store_multipliers
from .limbs import ClosingRows, Limbs
from .sweeps import find_spin_momentum, gather_efforts, move_to, set_rate, transmit_load
from .twists import cross


class Phase(NamedTuple):
    """A tree in canonical coordinates, and arrays of its functions."""

    limbs: Limbs
    closing: ClosingRows
    loads: int  # program of forces, gyroscopic torques left out
    soft: Any  # (n,) alpha of balls' lengths, 0: none
    spin: Any  # (n,) rate of a free spin over its momentum, 0: none
    axis: Any  # (n, 3) axis of the spin, in the base frame
    still: Any  # (nu,) zeros
    force: Any  # (nu,) work array
    t: Any
    q: Any
    p: Any
    q_dot: Any
    p_dot: Any
    u: Any
    lam: Any  # (rows,) input
    out: Any  # output: rows, or their force on the coordinates


def find_slopes(s: Any) -> None:
    """Set q_dot and p_dot, from t, q and p of ``s``, to slopes of the Hamiltonian plus forces, without closing rows."""
    l = s.limbs
    l.t[0] = s.t[0]
    move_to(l, s.q, s.still)
    run(l.factoring)
    lower_momenta(l, s.q, s.p, l.effort)
    clear(l.load)
    run(l.responding)
    for k in range(len(l.parent)):
        for i in range(6):
            l.motion[k, i] = l.response[k, i]
        set_rate(l, k, l.motion[k], l.v[l.body[k]])
    find_momenta(l)
    run(s.loads)
    for k in range(len(l.parent)):
        body, load = l.body[k], l.load[k]
        x, y, z = multiply(l.R[body], l.force[body, 3], l.force[body, 4], l.force[body, 5])
        f0, f1, f2 = l.force[body, 0], l.force[body, 1], l.force[body, 2]
        a, b, c = cross(l.c[k, 0], l.c[k, 1], l.c[k, 2], f0, f1, f2)
        load[0], load[1], load[2], load[3], load[4], load[5] = a + x, b + y, c + z, f0, f1, f2
    _gather_slopes(l, s.force)
    rate_coordinates(l, s.q, l.found, s.q_dot)
    lift_momenta(l, s.q, s.force, s.p_dot)
    for k in range(len(l.parent)):
        if l.ball[k]:
            j, i = l.q_at[k] + l.slides[k], l.u_at[k] + l.slides[k]
            add_quaternion_rate(s.p, l.found, s.p_dot, j, i, 0.5)
            along = s.soft[k] * _dot_quaternions(s.q, s.p, j)
            for a in range(4):
                s.q_dot[j + a] += along * s.q[j + a]
                s.p_dot[j + a] -= along * s.p[j + a]


@compile_separately
def find_momenta(l: Any) -> None:
    """Set ``momentum`` of each limb's body, (angular momentum about P, momentum) in space, from its ``motion``."""
    for k in range(len(l.parent)):
        V, m, out = l.motion[k], l.mass[k], l.momentum[k]
        x, y, z = l.c[k, 0], l.c[k, 1], l.c[k, 2]
        a, b, c = cross(V[0], V[1], V[2], x, y, z)
        a, b, c = m * (V[3] + a), m * (V[4] + b), m * (V[5] + c)
        n0, n1, n2 = find_spin_momentum(l, k, V[0], V[1], V[2])
        x, y, z = cross(x, y, z, a, b, c)
        out[0], out[1], out[2], out[3], out[4], out[5] = n0 + x, n1 + y, n2 + z, a, b, c


@compile_inline
def _gather_slopes(l: Any, out: Any) -> None:
    """Set ``out`` (nu,) to the slope of the kinetic energy along each velocity's motion plus the generalised force.

    This is an inward sweep: ``momentum`` and ``load`` of the limbs are replaced by the sums that their joints carry.
    """
    n = len(l.parent)
    for k in range(n - 1, -1, -1):
        p, ns, first, V, h, F = l.parent[k], l.slides[k], l.u_at[k], l.motion[k], l.momentum[k], l.load[k]
        a, b, c = cross(h[3], h[4], h[5], V[3], V[4], V[5])
        w0, w1, w2 = V[0], V[1], V[2]
        for i in range(ns + l.turns[k] - 1, ns - 1, -1):
            s = l.axes[k, i]
            if not l.ball[k]:
                rate = l.found[first + i]
                w0, w1, w2 = w0 - rate * s[0], w1 - rate * s[1], w2 - rate * s[2]
            x, y, z = cross(h[0], h[1], h[2], w0, w1, w2)
            out[first + i] = s[0] * (F[0] + a + x) + s[1] * (F[1] + b + y) + s[2] * (F[2] + c + z)
        x, y, z = cross(h[3], h[4], h[5], l.motion[p, 0], l.motion[p, 1], l.motion[p, 2])
        for i in range(ns):
            s = l.axes[k, i]
            out[first + i] = s[3] * (F[3] + x) + s[4] * (F[4] + y) + s[5] * (F[5] + z)
        if p < n:
            transmit_load(l, k, h, l.momentum[p])
            transmit_load(l, k, F, l.load[p])
            if l.ball[k]:
                for i in range(3):
                    l.load[p, i] -= a * (i == 0) + b * (i == 1) + c * (i == 2)


@compile_inline
def lower_momenta(l: Any, q: Any, p: Any, out: Any) -> None:
    """Set ``out`` (nu,) to the momenta pi, conjugate to velocities, from ``p``, conjugate to the coordinates ``q``.

    Those of a ball joint are in the base frame.
    """
    for k in range(len(l.parent)):
        ns, at, first = l.slides[k], l.q_at[k], l.u_at[k]
        for i in range(ns if l.ball[k] else ns + l.turns[k]):
            out[first + i] = p[at + i]
        if l.ball[k]:
            j, i = at + ns, first + ns
            a, b, c = cross(q[j + 1], q[j + 2], q[j + 3], p[j + 1], p[j + 2], p[j + 3])
            out[i] = 0.5 * (q[j] * p[j + 1] - p[j] * q[j + 1] + a)
            out[i + 1] = 0.5 * (q[j] * p[j + 2] - p[j] * q[j + 2] + b)
            out[i + 2] = 0.5 * (q[j] * p[j + 3] - p[j] * q[j + 3] + c)


@compile_inline
def lift_momenta(l: Any, q: Any, pi: Any, out: Any) -> None:
    """Set ``out`` (nq,) to momenta p, conjugate to ``q``, from ``pi``; a ball joint's are normal to its quaternion."""
    for k in range(len(l.parent)):
        ns, at, first = l.slides[k], l.q_at[k], l.u_at[k]
        for i in range(ns if l.ball[k] else ns + l.turns[k]):
            out[at + i] = pi[first + i]
        if l.ball[k]:
            j = at + ns
            rate_quaternion(q, pi, out, j, first + ns, 2.0 / _dot_quaternions(q, q, j))


@compile_inline
def add_quaternion_rate(q: Any, u: Any, out: Any, j: int, i: int, factor: float) -> None:
    """Add to four entries of ``out``, from index ``j`` on, what ``rate_quaternion`` with these arguments sets."""
    a, b, c, d = out[j], out[j + 1], out[j + 2], out[j + 3]
    rate_quaternion(q, u, out, j, i, factor)
    out[j], out[j + 1], out[j + 2], out[j + 3] = out[j] + a, out[j + 1] + b, out[j + 2] + c, out[j + 3] + d


def enter_phase(s: Any) -> None:
    """Set the momenta ``p`` of the bundle ``s`` from its coordinates q and velocities u."""
    l = s.limbs
    move_to(l, s.q, s.u)
    find_momenta(l)
    gather_efforts(l, l.momentum, l.found)
    lift_momenta(l, s.q, l.found, s.p)


def find_gaps(s: Any) -> None:
    """Set ``out`` to phi of the closing rows, then (|x|^2 - 1)/2 of quaternions with a row |x|^2 = 1, at t and q."""
    l, c = s.limbs, s.closing
    if len(c.joint) > 0:
        l.t[0] = s.t[0]
        move_to(l, s.q, s.still)
        run(c.evaluate)
        for a in range(len(c.joint)):
            s.out[a] = c.phi[c.place[a]]
    at = len(c.joint)
    for k in range(len(l.parent)):
        if s.soft[k] > 0.0:
            j = l.q_at[k] + l.slides[k]
            s.out[at] = 0.5 * (_dot_quaternions(s.q, s.q, j) - 1.0)
            at += 1


def find_row_force(s: Any) -> None:
    """Set ``out`` (nq,) to G^T lam, the generalised forces of all rows on the coordinates, at t and q."""
    l, c = s.limbs, s.closing
    clear(l.found)
    if len(c.joint) > 0:
        l.t[0] = s.t[0]
        move_to(l, s.q, s.still)
        run(c.evaluate)
        clear(l.load)
        for a in range(len(c.joint)):
            add_row(l, c, c.place[a], s.lam[a])
        gather_efforts(l, l.load, l.found)
    lift_momenta(l, s.q, l.found, s.out)
    at = len(c.joint)
    for k in range(len(l.parent)):
        if s.soft[k] > 0.0:
            j = l.q_at[k] + l.slides[k]
            for i in range(4):
                s.out[j + i] += s.lam[at] * s.q[j + i]
            at += 1


def factor_phase(s: Any) -> None:
    """Factorise H, and S of the closing rows, at t and q of the bundle ``s``: the entry for Python."""
    _factor(s)


@compile_inline
def _factor(s: Any) -> None:
    """Place all bodies at t and q, at rest, and factorise H, and S of the closing rows, there."""
    l, c = s.limbs, s.closing
    l.t[0] = s.t[0]
    move_to(l, s.q, s.still)
    run(l.factoring)
    if len(c.joint) > 0:
        run(c.evaluate)
        factor_closing(l, c)


def close_phase(s: Any) -> None:
    """Compute coordinates and velocities from t, q and p, with unit quaternions, phi_dot = 0 and free spins added.

    They are stored in ``q_dot`` and ``u``; ``out`` gets the multipliers of the change of p that makes phi_dot = 0.
    """
    l, c = s.limbs, s.closing
    _factor(s)
    lower_momenta(l, s.q, s.p, l.effort)
    clear(l.load)
    run(l.responding)
    copy(l.found, s.u)
    if len(c.joint) > 0:
        rate_rows(l, c, l.response)
        for k in range(len(c.kept)):
            a = c.kept[k]
            c.mu[k] = -(c.rates[a] + c.slip[a])
        solve_closing(c)
        add_response(c, s.u)
        for k in range(len(c.kept)):
            c.mu[k] = -c.mu[k]
        store_multipliers(c, s.out)
    copy(s.q, s.q_dot)
    normalise_quaternions(l, s.q_dot)
    at = len(c.joint)
    for k in range(len(l.parent)):
        j, i = l.q_at[k] + l.slides[k], l.u_at[k] + l.slides[k]
        if s.soft[k] > 0.0:
            s.out[at] = _dot_quaternions(s.q, s.p, j) / _dot_quaternions(s.q, s.q, j)
            at += 1
        if s.spin[k] > 0.0:
            _add_spin(l, k, s.spin[k], s.t[0], s.axis[k], s.q_dot, j, s.u, i)


@compile_inline
def _add_spin(l: Any, k: int, share: float, t: float, axis: Any, q: Any, j: int, u: Any, i: int) -> None:
    """Add the free spin of limb ``k`` about ``axis`` to its quaternion, ``q`` from index j on, and to ``u`` from i on.

    The rate is ``share`` [1/(kg m2)] times the angular momentum about the axis; the angle is rate times ``t`` [s].
    """
    x, y, z = axis[0], axis[1], axis[2]
    a, b, c = multiply_transposed(l.base, x, y, z)
    a, b, c = multiply(l.turned[k], a, b, c)
    a, b, c = multiply(l.base, a, b, c)
    rate = share * (a * l.effort[i] + b * l.effort[i + 1] + c * l.effort[i + 2])
    u[i], u[i + 1], u[i + 2] = u[i] + rate * a, u[i + 1] + rate * b, u[i + 2] + rate * c
    half = 0.5 * rate * t
    f, n = math.cos(half), math.sin(half)
    x, y, z = n * x, n * y, n * z
    s, a, b, c = q[j], q[j + 1], q[j + 2], q[j + 3]
    d0, d1, d2 = cross(a, b, c, x, y, z)
    q[j] = f * s - (a * x + b * y + c * z)
    q[j + 1], q[j + 2], q[j + 3] = f * a + s * x + d0, f * b + s * y + d1, f * c + s * z + d2


def solve_phase(s: Any) -> None:
    """Set ``out`` to S^-1 lam for the closing rows in use, and to lam / alpha for rows of quaternion lengths."""
    l, c = s.limbs, s.closing
    if len(c.joint) > 0:
        for a in range(len(c.joint)):
            c.rates[c.place[a]] = s.lam[a]
        for k in range(len(c.kept)):
            c.mu[k] = c.rates[c.kept[k]]
        solve_closing(c)
        store_multipliers(c, s.out)
    at = len(c.joint)
    for k in range(len(l.parent)):
        if s.soft[k] > 0.0:
            s.out[at] = s.lam[at] / s.soft[k]
            at += 1


@compile_inline
def _dot_quaternions(q: Any, p: Any, j: int) -> float:
    """Return the scalar product of the four entries of ``q`` and of ``p`` from index ``j`` on."""
    return q[j] * p[j] + q[j + 1] * p[j + 1] + q[j + 2] * p[j + 2] + q[j + 3] * p[j + 3]
