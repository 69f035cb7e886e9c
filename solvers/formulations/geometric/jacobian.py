"""Exact derivative of the step residual (module ``residual``) in dense blocks, one per body, joint end and pair.

The pose of the end follows its velocity: ``dr1 = dt/2 dr_dot1`` and ``dR1 = R1 hat(theta)``, ``theta = T dOmega1``,
``T = dt/2 dexp(dt/2 (Omega0 + Omega1))``. Here inertia and f_bar; joints are in ``jacobian_joints``, springs in
``springs``.

Left out: how C_bar, K_bar, M_bar, the f_bar of line rows and the part in f_bar of springs and loads change within the
step (of order dt^2; it only slows the convergence). For pins under gravity the Jacobian is exact.
"""

from numba import njit

from .directions import ALONG_A, TRANSLATION
from .jacobian_joints import axis_columns, axis_constraints, axis_forces, point_columns, point_constraints, point_forces
from .lines import line_columns, line_slopes
from .loads import add_load_slopes
from .moving import moving_slopes
from .springs import add_jacobian
from .torsion import add_torsion_slopes
from .user_forces import add_user_slopes
from .vectors import INNER, JIT, add, cross, dot, plus, right_differential, times, turn, turn_back


@njit(**JIT)
def assemble(model, step, settings, saddle):
    """Fill ``saddle.blocks``; the diagonal of a joint is (Xi M_bar)^-1.

    Each part loops over all joints itself: a call with these tuples costs more than a joint.
    """
    saddle.blocks[:] = 0.0
    _inertia(model, step, saddle)
    point_forces(model, step, settings, saddle)
    point_columns(model, step, settings, saddle)
    point_constraints(model, step, saddle)
    if settings.couple and settings.use_f_bar and settings.direction != TRANSLATION:
        _f_bar(model, step.end, 0.5 * step.dt, settings.direction, saddle)
    axis_columns(model, step, settings, saddle)
    axis_forces(model, step, settings, saddle)
    axis_constraints(model, step, saddle)
    line_columns(model, step, settings, saddle)
    line_slopes(model, step, settings, saddle)
    moving_slopes(model, step, settings, saddle)
    for j in range(len(model.body)):
        for k in range(model.row[j + 1] - model.row[j]):
            saddle.blocks[saddle.joint[j], k, k] = saddle.softness[model.row[j] + k]
    add_jacobian(model, step.end, 0.5 * step.dt, saddle)
    add_torsion_slopes(model, step.end, 0.5 * step.dt, saddle)
    add_load_slopes(model, step.end, 0.5 * step.dt, saddle)
    add_user_slopes(model, step.end, 0.5 * step.dt, saddle)


@njit(**INNER)
def _inertia(model, step, saddle):
    """T of all bodies, and d(R J Omega) = R (J dOmega - hat(J Omega) theta)."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    for b in range(len(model.mass)):
        J, T, K = model.J[b], saddle.T[b], saddle.blocks[saddle.body[b]]
        right_differential(times(half, plus(start.v[b, 3:], end.v[b, 3:])), half, T)
        P = turn(J, end.v[b, 3:])
        for k in range(3):
            K[k, k] = model.mass[b]
        for c in range(3):
            x = cross(P, (T[0, c], T[1, c], T[2, c]))
            K[3, 3 + c], K[4, 3 + c], K[5, 3 + c] = J[0, c] - x[0], J[1, c] - x[1], J[2, c] - x[2]


@njit(**INNER)
def _f_bar(model, end, half, choice, saddle):
    """-half D1 G1 with G1 = -f_bar = -N / size: size depends on the arms, f_bar' = -f_bar size' / size."""
    for j in range(len(model.body)):
        i, o = model.body[j, 0], model.body[j, 1]
        for k in range(3 if model.pins[j] else 0):
            size, by_i, by_o = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # and its gradients by theta of both ends
            if i >= 0:
                size, by_i = _size(size, model.mass[i], model.J_inv[i], model.s[j, 0], end.R[i, k], choice)
            if o >= 0:
                size, by_o = _size(size, model.mass[o], model.J_inv[o], model.s[j, 1], end.R[o, k], choice)
            for e in range(2):  # force half f_bar' on row k acts on end e (residual has -half D G = +half D f_bar)
                b = model.body[j, e]
                if b < 0:
                    continue
                f = -(1.0 - 2.0 * e) * half * end.f_bar[model.row[j] + k] / size
                x = cross(model.s[j, e], end.R[b, k])
                if i >= 0:
                    pair = saddle.body[b] if e == 0 else saddle.couple[j, e]
                    _add_slope(times(f, turn_back(saddle.T[i], by_i)), x, k, saddle.blocks[pair])
                if o >= 0:
                    pair = saddle.body[b] if e == 1 else saddle.couple[j, e]
                    _add_slope(times(f, turn_back(saddle.T[o], by_o)), x, k, saddle.blocks[pair])


@njit(**INNER)
def _size(size, mass, J_inv, s, r_k, choice):
    """``size`` + this end's part of a . a or a . M^-1 a, and its gradient: a_rot = s x r_k with r_k = R^T e_k."""
    x = cross(s, r_k)
    y = x if choice == ALONG_A else turn(J_inv, x)
    size += 1.0 if choice == ALONG_A else 1.0 / mass
    # d a_rot = s x (r_k x theta): 2 a' . W a = 2 ((y x s) x r_k) . theta
    return size + dot(x, y), times(2.0, cross(cross(y, s), r_k))


@njit(**INNER)
def _add_slope(slope, x, k, K):
    add(1.0, slope, K[k, 3:])
    for q in range(3):
        add(x[q], slope, K[3 + q, 3:])
