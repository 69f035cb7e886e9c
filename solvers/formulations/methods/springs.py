"""Spring-dampers as soft rows of a collocation step: stiffness and damping in the matrix of its iteration (compiled).

A row is the rate of a spring's length, A_s = d(length_dot)/dv; its multiplier p = -tension is an unknown of stage i::

    M vdot_i = f_i + A_i^T lam_i + A_s^T p_i,   p_i = -k (length_i - free length) - c length_dot_i

A change dp changes vdot by Z dp, Z = M^-1 A_s^T - M^-1 A^T S^-1 A M^-1 A_s^T. So with G = A_s Z, the tableau a and the
other changes d of vdot Newton's equations are::

    dp_i + sum_j K_ij (A_s d_j + G dp_j) = -p_i - tension_i,   K = h c a + h^2 k a^2,

dense in 3 ns unknowns, the Schur complement of M + h a D + h^2 a^2 K. Its rate does not depend on k and c, for G alone
is frozen over the step, while forces act along the rows of each iterate. Left out: the turning of a spring under
tension (tension / length across it). ``g`` are the kernels of the stages, ``s`` the bundle of the springs, ``k`` their
kernels.
"""

from typing import Any

import numpy as np

from ....harness.base.generated import Program
from ....harness.mechanics.fixed_order import product
from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import clear, copy, find_largest, take_larger
from ..compiled.bundles import make_bundle
from ..compiled.entries import BoundFunction, compile_inline, run
from ..compiled.soft_rows import make_spring_kernels
from .products import add_scaled

ARRAYS = {
    "p": "3 ns",
    "old": "3 ns",  # p of the last accepted step
    "tension": "3 ns",  # tension by the law
    "pull": "3 nb 6",  # M^-1 A_s^T p
    "stretch": "3 ns",  # A_s d
    "W": "ns nr",  # change of lam by each p
    "G": "ns ns",  # [1/kg]
    "change": "ns",  # change of p
}


def make_soft_rows(system: MultibodySystem, nrows: int, a: np.ndarray, keeps: Any) -> Any:
    """Make the bundle of a system's springs as soft rows of three stages, with the tableau ``a``.

    ``nrows`` is the number of the mechanism's constraint rows; ``keeps`` is kept alive. ``matrix`` holds its factors
    after ``_factorise``, ``right`` the solution after ``_solve``.
    """
    stages, made, law = make_spring_kernels(system, 3)
    ns = law.shape[1]
    matrix, right = np.zeros((3 * ns, 3 * ns)), np.zeros(3 * ns)
    return make_bundle(
        "Springs",
        ARRAYS,
        {"nb": system.nb, "ns": ns, "nr": nrows},
        stages=stages,
        law=law,
        a=a,
        square=product(a, a),
        matrix=matrix,
        right=right,
        pivots=np.zeros(3 * ns, dtype=np.int64),
        kept=Program([], (keeps, made)),
    )


@compile_inline
def _factorise(A, pivots):
    """Factorise the dense matrix A in place by rows, with the largest pivot of each column; set ``pivots``.

    The order of operations is fixed, unlike LAPACK's: the same bits on every machine.
    """
    n = len(A)
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[best, k]):
                best = i
        pivots[k] = best
        for j in range(n):
            A[k, j], A[best, j] = A[best, j], A[k, j]
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]


@compile_inline
def _solve(A, pivots, x):
    """Set x := A^-1 x by the factors of ``_factorise``."""
    n = len(A)
    for k in range(n):
        x[k], x[pivots[k]] = x[pivots[k]], x[k]
        for j in range(k):
            x[k] -= A[k, j] * x[j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= A[k, j] * x[j]
        x[k] /= A[k, k]


@compile_inline
def set_rates(g, i):
    """Set ``g.x[i]`` := A w, the rates of the rows of stage ``i`` at the velocities w = ``g.w[i]``, without phi_t."""
    run(g.slips[i])
    for a in range(g.x.shape[1]):
        g.x[i, a] = -g.x[i, a] - g.slip[i, a]


def measure_springs(step):
    """Compute the springs' rows, and their tensions by the law, at the poses and velocities of all stages.

    ``pull`` becomes M^-1 A_s^T p.
    """
    g, s, k = step.stages, step.springs, step.springs.stages
    for i in range(3):
        copy(g.r[i], k.r[i])
        copy(g.R[i], k.R[i])
        copy(g.v[i], k.v[i])
        run(k.rows[i])
        copy(g.v[i], k.w[i])
        run(k.slips[i])
        for a in range(s.law.shape[1]):
            s.tension[i, a] = s.law[0, a] * (k.phi[i, a] - s.law[1, a]) - s.law[2, a] * k.x[i, a]
        clear(k.w[i])
        copy(s.p[i], k.x[i])
        run(k.push[i])
        copy(k.w[i], s.pull[i])


@compile_inline
def _add_pull(k, i, p, w):
    """Add M^-1 A_s^T p to w (nb, 6), with the springs' rows of stage ``i``; ``k`` are the springs' kernels."""
    copy(w, k.w[i])
    copy(p, k.x[i])
    run(k.push[i])
    copy(k.w[i], w)


def prepare_springs(step):
    """Compute the response of lam (W) and of the lengths' rates (G) to each p, and factorise the springs' matrix.

    Factor and rows are those of the second stage.
    """
    g, s, k, h = step.stages, step.springs, step.springs.stages, step.control.h
    ns = len(s.G)
    for t in range(ns):
        clear(g.w[1])
        clear(s.change)
        s.change[t] = 1.0
        _add_pull(k, 1, s.change, g.w[1])
        set_rates(g, 1)
        for a in range(g.x.shape[1]):
            g.rhs[1, a] = -g.x[1, a]
        run(g.solve[1])
        copy(g.rhs[1], s.W[t])
        copy(g.rhs[1], g.x[1])
        run(g.push[1])
        copy(g.w[1], k.w[1])
        set_rates(k, 1)
        copy(k.x[1], s.G[t])
    for i in range(3):
        for a in range(ns):
            for j in range(3):
                K = h * (s.law[2, a] * s.a[i, j] + h * s.law[0, a] * s.square[i, j])
                for t in range(ns):
                    s.matrix[i * ns + a, j * ns + t] = K * s.G[t, a]
            s.matrix[i * ns + a, i * ns + a] += 1.0
    _factorise(s.matrix, s.pivots)


def correct_springs(step):
    """Correct p, lam and vdot of all stages by the springs' equations; ``g.w`` are the other changes d of vdot.

    ``changed`` is raised to the largest change of vdot, where that is larger.
    """
    g, s, k, h = step.stages, step.springs, step.springs.stages, step.control.h
    ns = len(s.G)
    for i in range(3):
        copy(g.w[i], k.w[i])
        set_rates(k, i)
        copy(k.x[i], s.stretch[i])
    for i in range(3):
        for a in range(ns):
            x = -s.p[i, a] - s.tension[i, a]
            for j in range(3):
                x -= h * (s.law[2, a] * s.a[i, j] + h * s.law[0, a] * s.square[i, j]) * s.stretch[j, a]
            s.right[i * ns + a] = x
    _solve(s.matrix, s.pivots, s.right)
    for i in range(3):
        clear(g.x[i])
        for t in range(ns):
            s.change[t] = s.right[i * ns + t]
            add_scaled(s.change[t], s.W[t], g.x[i])
        add_scaled(1.0, s.change, s.p[i])
        add_scaled(1.0, g.x[i], step.lam[i])
        clear(g.w[i])
        run(g.push[i])
        _add_pull(k, i, s.change, g.w[i])
        for b in range(g.w.shape[1]):
            add_scaled(1.0, g.w[i, b], step.vdot[i, b])
        step.scheme.changed = take_larger(step.scheme.changed, find_largest(g.w[i]))


ENTRIES = {
    "measure_springs": measure_springs,
    "prepare_springs": prepare_springs,
    "correct_springs": correct_springs,
}  # entries of a step


def add_entries(step: Any) -> Any:
    """Return the bundle of a step with the entries ``ENTRIES``; in a system without springs they do nothing."""
    some = len(step.springs.G)
    return step._replace(**{name: BoundFunction(f, step) if some else Program([]) for name, f in ENTRIES.items()})
