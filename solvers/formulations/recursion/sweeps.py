"""Sweeps over the bodies of a tree: their poses, the factor of H, accelerations by it (compiled).

Featherstone (2008), ch. 7: from the leaves on, each body has the articulated inertia I of all bodies behind it:

    D = S^T I S,   I_parent += X^T (I - I S D^-1 S^T I) X,   x = D^-1 (effort - S^T p) - D^-1 S^T I X a_parent

with S the motions along a limb's velocities, and X a_parent the motion that a limb takes from its parent: behind a
ball, only the translation of its P. The cost is linear in the number of bodies.
"""

from typing import Any

from ..compiled.algebra import copy, multiply, multiply_transposed, turn_rotation
from ..compiled.entries import compile_inline, compile_separately, run
from .twists import copy_rotation, cross, dot, put, turn_by_quaternion


@compile_inline
def move_to(s: Any, q: Any, u: Any) -> None:
    """Copy ``q`` and ``u`` to the tree, and set the motion of all its bodies there, by ``place_bodies``."""
    copy(q, s.q)
    copy(u, s.u)
    run(s.placing)


def place_bodies(s: Any) -> None:
    """Set poses and velocities of all bodies at coordinates ``q`` and velocities ``u``, from the ground outward.

    ``axes`` gets the motions along the limbs' velocities, ``bias`` the accelerations for u_dot = 0.
    """
    n, q, u = len(s.parent), s.q, s.u
    for l in range(n):
        p, ns, at, first = s.parent[l], s.slides[l], s.q_at[l], s.u_at[l]
        own, before, axes, way = s.turned[l], s.turned[p], s.axes[l], s.way[l]
        x, y, z = multiply(before, s.arm[l, 0], s.arm[l, 1], s.arm[l, 2])
        a = b = c = 0.0
        for k in range(ns):
            d0, d1, d2 = multiply(before, way[k, 0], way[k, 1], way[k, 2])
            put(axes[k], 0.0, 0.0, 0.0, d0, d1, d2)
            x, y, z = x + q[at + k] * d0, y + q[at + k] * d1, z + q[at + k] * d2
            a, b, c = a + u[first + k] * d0, b + u[first + k] * d1, c + u[first + k] * d2
        w0, w1, w2 = s.motion[p, 0], s.motion[p, 1], s.motion[p, 2]
        t0, t1, t2 = cross(w0, w1, w2, x, y, z)
        v0, v1, v2 = s.motion[p, 3] + t0 + a, s.motion[p, 4] + t1 + b, s.motion[p, 5] + t2 + c
        e0, e1, e2 = cross(s.bias[p, 0], s.bias[p, 1], s.bias[p, 2], x, y, z)
        f0, f1, f2 = cross(w0, w1, w2, t0 + 2.0 * a, t1 + 2.0 * b, t2 + 2.0 * c)
        e0, e1, e2 = s.bias[p, 3] + e0 + f0, s.bias[p, 4] + e1 + f1, s.bias[p, 5] + e2 + f2
        s.L[l, 0], s.L[l, 1], s.L[l, 2] = x, y, z
        s.P[l, 0], s.P[l, 1], s.P[l, 2] = s.P[p, 0] + x, s.P[p, 1] + y, s.P[p, 2] + z
        if s.ball[l]:
            j = at + ns
            x, y, z = multiply_transposed(s.base, q[j + 1], q[j + 2], q[j + 3])
            turn_by_quaternion(q[j], x, y, z, own)
            w0, w1, w2 = multiply_transposed(s.base, u[first + ns], u[first + ns + 1], u[first + ns + 2])
            a = b = c = 0.0
            for k in range(3):
                put(axes[ns + k], way[ns + k, 0], way[ns + k, 1], way[ns + k, 2], 0.0, 0.0, 0.0)
        else:
            a, b, c = s.bias[p, 0], s.bias[p, 1], s.bias[p, 2]
            copy_rotation(before, own)
            for k in range(ns, ns + s.turns[l]):
                x, y, z = way[k, 0], way[k, 1], way[k, 2]
                d0, d1, d2 = multiply(own, x, y, z)
                put(axes[k], d0, d1, d2, 0.0, 0.0, 0.0)
                rate, angle = u[first + k], q[at + k]
                f0, f1, f2 = cross(w0, w1, w2, d0, d1, d2)
                a, b, c = a + rate * f0, b + rate * f1, c + rate * f2
                w0, w1, w2 = w0 + rate * d0, w1 + rate * d1, w2 + rate * d2
                turn_rotation(own, angle * x, angle * y, angle * z, own)
        put(s.motion[l], w0, w1, w2, v0, v1, v2)
        put(s.bias[l], a, b, c, e0, e1, e2)
        x, y, z = multiply(own, s.centre[l, 0], s.centre[l, 1], s.centre[l, 2])
        s.c[l, 0], s.c[l, 1], s.c[l, 2] = x, y, z
        body = s.body[l]
        R = s.R[body]
        for i in range(3):
            s.r[body, i] = s.P[l, i] + s.c[l, i]
            for k in range(3):
                R[i, k] = own[i, 0] * s.frame[l, 0, k] + own[i, 1] * s.frame[l, 1, k] + own[i, 2] * s.frame[l, 2, k]
        set_rate(s, l, s.motion[l], s.v[body])


@compile_inline
def set_rate(s: Any, l: int, motion: Any, out: Any) -> None:
    """Set ``out`` to (velocity of C [space], angular velocity [body]) of limb ``l``, from its ``motion`` about P."""
    w0, w1, w2 = motion[0], motion[1], motion[2]
    x, y, z = cross(w0, w1, w2, s.c[l, 0], s.c[l, 1], s.c[l, 2])
    a, b, c = multiply_transposed(s.R[s.body[l]], w0, w1, w2)
    put(out, motion[3] + x, motion[4] + y, motion[5] + z, a, b, c)


@compile_inline
def find_spin_momentum(s: Any, l: int, w0: float, w1: float, w2: float) -> Any:
    """Return R J R^T w, the angular momentum [space] of limb ``l`` about C at the angular velocity w."""
    R, J = s.R[s.body[l]], s.inertia[l]
    a, b, c = multiply_transposed(R, w0, w1, w2)
    a, b, c = multiply(J, a, b, c)
    return multiply(R, a, b, c)


def factor_inertia(s: Any) -> None:
    """Factorise H: set the articulated inertia ``carried``, ``D`` and ``gain`` of all limbs, from the leaves inward."""
    n = len(s.parent)
    for l in range(n):
        A, m, x, y, z = s.carried[l], s.mass[l], s.c[l, 0], s.c[l, 1], s.c[l, 2]
        square = x * x + y * y + z * z
        for j in range(3):
            e0, e1, e2 = 1.0 * (j == 0), 1.0 * (j == 1), 1.0 * (j == 2)
            a, b, c = find_spin_momentum(s, l, e0, e1, e2)
            along = s.c[l, j]
            A[0, j], A[1, j], A[2, j] = (
                a + m * (square * e0 - x * along),
                b + m * (square * e1 - y * along),
                c + m * (square * e2 - z * along),
            )
            a, b, c = cross(x, y, z, e0, e1, e2)
            A[0, 3 + j], A[1, 3 + j], A[2, 3 + j] = m * a, m * b, m * c
            A[3 + j, 0], A[3 + j, 1], A[3 + j, 2] = m * a, m * b, m * c
            A[3, 3 + j], A[4, 3 + j], A[5, 3 + j] = m * e0, m * e1, m * e2
    for l in range(n - 1, -1, -1):
        count = s.slides[l] + s.turns[l]
        _free_joint(s.carried[l], s.axes[l], s.pull, s.gain[l], s.D[l], count)
        p = s.parent[l]
        if p < n:
            _add_inertia(s.carried[l], s.L[l, 0], s.L[l, 1], s.L[l, 2], s.ball[l], s.carried[p])


@compile_inline
def _free_joint(A: Any, axes: Any, pull: Any, gain: Any, D: Any, count: int) -> None:
    """Replace a limb's articulated inertia A, in place, by the part that its joint transmits: A - pull^T gain.

    Set are pull = S^T A, D = (S^T A S)^-1 and gain = D pull, with the ``count`` motions S along the ``axes``.
    """
    for k in range(count):
        for i in range(6):
            pull[k, i] = dot(A[i], axes[k])
        for j in range(k + 1):
            D[k, j] = D[j, k] = dot(pull[k], axes[j])
    for k in range(count):  # inverted in place (Gauss and Jordan)
        pivot = 1.0 / D[k, k]
        D[k, k] = 1.0
        for j in range(count):
            D[k, j] *= pivot
        for i in range(count):
            if i != k:
                x = D[i, k]
                D[i, k] = 0.0
                for j in range(count):
                    D[i, j] -= x * D[k, j]
    for k in range(count):
        for i in range(6):
            total = 0.0
            for j in range(count):
                total += D[k, j] * pull[j, i]
            gain[k, i] = total
    for k in range(count):
        for i in range(6):
            for j in range(i + 1):
                A[i, j] -= pull[k, i] * gain[k, j]
    for i in range(6):
        for j in range(i):
            A[j, i] = A[i, j]


@compile_inline
def _add_inertia(A: Any, x: float, y: float, z: float, ball: int, out: Any) -> None:
    """Add X^T A X to the parent's inertia ``out``: a limb's inertia A, shifted by (x, y, z) to the parent's P.

    For a ``ball`` only the part by the translation of P is added.
    """
    for j in range(3):
        # rows of M = A_turn_move + hat(L) A_move, then A_turn + L x rows of A_turn_move + hat(L) M^T
        a, b, c = cross(x, y, z, A[3, 3 + j], A[4, 3 + j], A[5, 3 + j])
        if not ball:
            a, b, c = a + A[0, 3 + j], b + A[1, 3 + j], c + A[2, 3 + j]
        out[0, 3 + j] += a
        out[1, 3 + j] += b
        out[2, 3 + j] += c
        out[3 + j, 0] += a
        out[3 + j, 1] += b
        out[3 + j, 2] += c
        for i in range(3):
            out[3 + i, 3 + j] += A[3 + i, 3 + j]
    for j in range(3):
        b0, b1, b2 = (0.0, 0.0, 0.0) if ball else (A[j, 3], A[j, 4], A[j, 5])
        m0, m1, m2 = cross(x, y, z, A[3, 3], A[3, 4], A[3, 5])
        n0, n1, n2 = cross(x, y, z, A[4, 3], A[4, 4], A[4, 5])
        k0, k1, k2 = cross(x, y, z, A[5, 3], A[5, 4], A[5, 5])
        # row j of M: of each column of A_move, component j of L x column
        if j == 0:
            r0, r1, r2 = b0 + m0, b1 + n0, b2 + k0
        elif j == 1:
            r0, r1, r2 = b0 + m1, b1 + n1, b2 + k1
        else:
            r0, r1, r2 = b0 + m2, b1 + n2, b2 + k2
        a, b, c = cross(x, y, z, r0, r1, r2)
        out[0, j] += a
        out[1, j] += b
        out[2, j] += c
        if not ball:
            a, b, c = cross(x, y, z, b0, b1, b2)
            out[j, 0] += A[j, 0] + a
            out[j, 1] += A[j, 1] + b
            out[j, 2] += A[j, 2] + c


def find_response(s: Any) -> None:
    """Set ``found`` to H^-1 (generalised forces of ``load`` + ``effort``), and ``response`` to the motion by it.

    This is an inward sweep over loads, then an outward one over motions; both results are linear in the inputs.
    """
    n = len(s.parent)
    for l in range(n):
        for i in range(6):
            s.back[l, i] = -s.load[l, i]
    for l in range(n - 1, -1, -1):
        own, p, first = s.back[l], s.parent[l], s.u_at[l]
        for k in range(s.slides[l] + s.turns[l]):
            s.left[first + k] = s.effort[first + k] - dot(s.axes[l, k], own)
        for k in range(s.slides[l] + s.turns[l]):
            x = s.left[first + k]
            for i in range(6):
                own[i] += x * s.gain[l, k, i]
        if p < n:
            transmit_load(s, l, own, s.back[p])
    for l in range(n):
        p, first, count, own = s.parent[l], s.u_at[l], s.slides[l] + s.turns[l], s.response[l]
        _transfer_motion(s, l, s.response[p], own)
        for k in range(count):
            x = -dot(s.gain[l, k], own)
            for j in range(count):
                x += s.D[l, k, j] * s.left[first + j]
            s.found[first + k] = x
        _add_axes(s, l, s.found, own)


@compile_separately
def find_motion(s: Any, u: Any) -> None:
    """Set ``response`` to the motion of all bodies at joint velocities, or accelerations, ``u``, without ``bias``."""
    for l in range(len(s.parent)):
        own = s.response[l]
        _transfer_motion(s, l, s.response[s.parent[l]], own)
        _add_axes(s, l, u, own)


@compile_inline
def _transfer_motion(s: Any, l: int, before: Any, out: Any) -> None:
    """Set ``out`` to X a_parent, the motion of limb ``l`` by that of its parent, ``before``, with its own joint fixed.

    Behind a ball it is the translation of P alone.
    """
    x, y, z = cross(before[0], before[1], before[2], s.L[l, 0], s.L[l, 1], s.L[l, 2])
    share = 0.0 if s.ball[l] else 1.0
    put(out, share * before[0], share * before[1], share * before[2], before[3] + x, before[4] + y, before[5] + z)


@compile_inline
def _add_axes(s: Any, l: int, u: Any, out: Any) -> None:
    """Add to ``out`` the motion of limb ``l`` along its own axes at the tree's velocities ``u``."""
    for k in range(s.slides[l] + s.turns[l]):
        x = u[s.u_at[l] + k]
        for i in range(6):
            out[i] += x * s.axes[l, k, i]


@compile_separately
def gather_efforts(s: Any, loads: Any, out: Any) -> None:
    """Set ``out`` (nu,) to the generalised forces of ``loads``, their power at a unit of each velocity.

    This is an inward sweep: ``loads`` are replaced by the sums that the joints carry.
    """
    n = len(s.parent)
    for l in range(n - 1, -1, -1):
        for k in range(s.slides[l] + s.turns[l]):
            out[s.u_at[l] + k] = dot(s.axes[l, k], loads[l])
        if s.parent[l] < n:
            transmit_load(s, l, loads[l], loads[s.parent[l]])


@compile_inline
def transmit_load(s: Any, l: int, load: Any, out: Any) -> None:
    """Add X^T load, the part of a ``load`` of limb ``l`` that its joint transmits, to its parent's load ``out``."""
    x, y, z = cross(s.L[l, 0], s.L[l, 1], s.L[l, 2], load[3], load[4], load[5])
    share = 0.0 if s.ball[l] else 1.0
    put(
        out,
        out[0] + share * load[0] + x,
        out[1] + share * load[1] + y,
        out[2] + share * load[2] + z,
        out[3] + load[3],
        out[4] + load[4],
        out[5] + load[5],
    )
