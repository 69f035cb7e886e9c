"""Spring-dampers as soft rows of a collocation step: stiffness and damping in the matrix of its iteration (compiled).

A row is the rate of a spring's length, A_s = d(length_dot)/dv; its multiplier p = -tension is an unknown of stage i::

    M vdot_i = f_i + A_i^T lam_i + A_s^T p_i,   p_i = -k (length_i - free length) - c length_dot_i

A change dp changes vdot by Z dp, Z = M^-1 A_s^T - M^-1 A^T S^-1 A M^-1 A_s^T. So with G = A_s Z, the tableau a and the
other changes d of vdot Newton's equations are::

    dp_i + sum_j K_ij (A_s d_j + G dp_j) = -p_i - tension_i,   K = h c a + h^2 k a^2,

dense in 3 ns unknowns, the Schur complement of M + h a D + h^2 a^2 K. Its rate does not depend on k and c, for G alone
is frozen over the step, while forces act along the rows of each iterate. Left out: the turning of a spring under
tension (tension / length across it).
"""

from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import clear, copy, largest
from ..compiled.entries import inner, run
from ..compiled.kernel import Made
from ..compiled.means import Entry, make_entry
from ..compiled.soft_rows import make_springs
from ..generated.steps import call_lapack, integer
from .products import add_scaled, set_rates


class Three(NamedTuple):
    """Kernels of the stages."""

    first: Any
    second: Any
    third: Any


@inner
def each(of):
    """The three as they are indexed."""
    return of.first, of.second, of.third


class Springs(NamedTuple):
    """The springs of a system, and room for their part of an iteration."""

    stages: Three  # kernels whose joints are the springs
    law: Any  # (3, ns) stiffness, free length, damping
    a: Any  # (3, 3)
    square: Any  # (3, 3) a a
    p: Any  # (3, ns)
    old: Any  # (3, ns) of the last accepted step
    tension: Any  # (3, ns) of the law
    stretch: Any  # (3, ns) A_s d
    W: Any  # (ns, nrows) change of lam by each p
    G: Any  # (ns, ns) [1/kg]
    matrix: Any  # (3 ns, 3 ns), by ``factorise`` its factors
    right: Any  # (3 ns,) right-hand side, by ``solve`` the solution
    factorise: Entry
    solve: Entry


def make_springs_of(system: MultibodySystem, stages: list[Made], a: np.ndarray) -> Springs:
    """Rows of the springs of ``system`` for the kernels of three stages with the tableau ``a``."""
    made = [make_springs(system, one.kernel) for one in stages]
    rows = Three(*(one.kernel for one, _ in made))
    ns, nr = made[0][1].shape[1], len(stages[0].kernel.lam)
    p, old, tension, stretch = (np.zeros((3, ns)) for _ in range(4))
    matrix, right = np.zeros((3 * ns, 3 * ns)), np.zeros(3 * ns)
    n, lead, one, info, pivots = (
        integer(3 * ns),
        integer(max(1, 3 * ns)),
        integer(1),
        integer(0),
        np.zeros(3 * ns, "i4"),
    )
    factorise = make_entry([call_lapack("dgetrf", n, n, matrix, lead, pivots, info)] if ns else [], None)
    transposed = np.frombuffer(b"T", dtype="i1")  # LAPACK reads by columns
    solve = [call_lapack("dgetrs", transposed, n, one, matrix, lead, pivots, right, lead, info)] if ns else []
    W, G = np.zeros((ns, nr)), np.zeros((ns, ns))
    law, entries = made[0][1], (factorise, make_entry(solve, (stages, made)))
    return Springs(rows, law, a, a @ a, p, old, tension, stretch, W, G, matrix, right, *entries)


@inner
def set_tensions(s, k, r, R, v, i):
    """Rows of the springs at poses and velocities of stage ``i``, and the tensions of their law."""
    copy(r, k.r)
    copy(R, k.R)
    copy(v, k.v)
    run(k.rows)
    copy(v, k.w)
    run(k.slips)
    for a in range(len(k.phi)):
        s.tension[i, a] = s.law[0, a] * (k.phi[a] - s.law[1, a]) - s.law[2, a] * k.x[a]


@inner
def add_pull(k, p, w):
    """w += M^-1 A_s^T p"""
    copy(w, k.w)
    copy(p, k.x)
    run(k.push)
    copy(k.w, w)


@inner
def set_stretch(s, k, w, i):
    """A_s w of stage ``i``."""
    copy(w, k.w)
    set_rates(k)
    copy(k.x, s.stretch[i])


@inner
def respond(s, k, h):
    """W, G and the factors of the matrix with the factor and rows of the second stage, whose kernel is ``k``."""
    own, ns = s.stages.second, len(s.G)
    for t in range(ns):
        clear(own.w)
        clear(own.x)
        own.x[t] = 1.0
        run(own.push)
        copy(own.w, k.w)
        set_rates(k)
        for a in range(len(k.rhs)):
            k.rhs[a] = -k.x[a]
        run(k.solve)
        copy(k.rhs, s.W[t])
        copy(k.rhs, k.x)
        run(k.push)
        copy(k.w, own.w)
        set_rates(own)
        copy(own.x, s.G[t])
    for i in range(3):
        for a in range(ns):
            for j in range(3):
                K = h * (s.law[2, a] * s.a[i, j] + h * s.law[0, a] * s.square[i, j])
                for t in range(ns):
                    s.matrix[i * ns + a, j * ns + t] = K * s.G[t, a]
            s.matrix[i * ns + a, i * ns + a] += 1.0
    run(s.factorise)


@inner
def correct(step, s, h):
    """Correct p, lam and vdot of all stages; returns the largest change of vdot."""
    ns, size = len(s.G), 0.0
    if ns == 0:
        return size
    for i in range(3):
        for a in range(ns):
            x = -s.p[i, a] - s.tension[i, a]
            for j in range(3):
                x -= h * (s.law[2, a] * s.a[i, j] + h * s.law[0, a] * s.square[i, j]) * s.stretch[j, a]
            s.right[i * ns + a] = x
    run(s.solve)
    for i in range(3):
        k, change = each(step.stages)[i], s.right[i * ns : (i + 1) * ns]
        add_scaled(1.0, change, s.p[i])
        clear(k.x)
        for t in range(ns):
            add_scaled(change[t], s.W[t], k.x)
        add_scaled(1.0, k.x, step.lam[i])
        clear(k.w)
        run(k.push)
        add_pull(each(s.stages)[i], change, k.w)
        for b in range(len(k.w)):
            add_scaled(1.0, k.w[b], step.vdot[i, b])
        size = max(size, largest(k.w))
    return size
