"""Index 1 at one state: products with A and M^-1, accelerations and multipliers, projections (compiled).

S lam = -gamma - A M^-1 f,   v_dot = M^-1 (f + A^T lam),   gamma = A_dot v + (phi_t)_dot

``k`` is a ``Kernel``, whose arrays have the names of the arguments here.
"""

from .algebra import clear, copy, turn_rotation
from .entries import compile_inline, run


@compile_inline
def multiply_by_inverse_mass(mass, J_inv, w):
    """Set w := M^-1 w for the loads w (nb, 6) of all bodies: forces over ``mass``, torques times ``J_inv``."""
    for b in range(len(mass)):
        t0, t1, t2 = w[b, 3], w[b, 4], w[b, 5]
        for a in range(3):
            w[b, a] /= mass[b]
            w[b, 3 + a] = J_inv[b, a, 0] * t0 + J_inv[b, a, 1] * t1 + J_inv[b, a, 2] * t2


@compile_inline
def add_rates(body, row, pins, X, way, w, sign, x):
    """Add sign A w to x (nrows,): A w are the rates of the constraint rows at the velocities w (nb, 6).

    Joint j has the rows ``row[j]`` to ``row[j + 1]`` between the bodies ``body[j]``; -1 is the ground.
    """
    for j in range(len(body)):
        first, last = row[j], row[j + 1]
        for e in range(2):
            b = body[j, e]
            if b < 0:
                continue
            side = 1.0 - 2.0 * e
            for a in range(first, last):
                y = X[e, a, 0] * w[b, 3] + X[e, a, 1] * w[b, 4] + X[e, a, 2] * w[b, 5]
                if pins[j]:
                    if a < first + 3:
                        y += side * w[b, a - first]
                else:
                    y += side * (way[a, 0] * w[b, 0] + way[a, 1] * w[b, 1] + way[a, 2] * w[b, 2])
                x[a] += sign * y


@compile_inline
def add_loads(body, row, pins, mass, way, Y, x, w):
    """Add M^-1 A^T x to w (nb, 6), the change of velocities by the multipliers x (nrows,).

    The rows of A are given by their forces ``way`` and by Y = X J^-1, their torques over inertia. Joint j has the rows
    ``row[j]`` to ``row[j + 1]`` between the bodies ``body[j]``; -1 is the ground.
    """
    for j in range(len(body)):
        first, last = row[j], row[j + 1]
        for e in range(2):
            b = body[j, e]
            if b < 0:
                continue
            share = (1.0 - 2.0 * e) / mass[b]
            for a in range(first, last):
                y = x[a]
                if pins[j]:
                    if a < first + 3:
                        w[b, a - first] += share * y
                else:
                    for q in range(3):
                        w[b, q] += share * y * way[a, q]
                w[b, 3] += Y[e, a, 0] * y
                w[b, 4] += Y[e, a, 1] * y
                w[b, 5] += Y[e, a, 2] * y


def react(k):
    """Compute accelerations ``k.v_dot`` and multipliers ``k.lam`` of index 1 with the present rows and factor of S."""
    run(k.forces)
    copy(k.force, k.v_dot)
    multiply_by_inverse_mass(k.mass, k.J_inv, k.v_dot)
    for a in range(len(k.rhs)):
        k.rhs[a] = -k.gamma[a]
    add_rates(k.body, k.row, k.pins, k.X, k.way, k.v_dot, -1.0, k.rhs)
    run(k.solve)
    copy(k.rhs, k.lam)
    add_loads(k.body, k.row, k.pins, k.mass, k.way, k.Y, k.lam, k.v_dot)


def close_joints(k):
    """Move the poses towards phi = 0 along M^-1 A^T: to first order the least change in the norm of M.

    Rows and the factor of S are those in the kernel. The remaining phi is of second order if the factor belongs to
    nearby poses.
    """
    for a in range(len(k.rhs)):
        k.rhs[a] = -k.phi[a]
    run(k.solve)
    clear(k.change)
    add_loads(k.body, k.row, k.pins, k.mass, k.way, k.Y, k.rhs, k.change)
    for b in range(len(k.mass)):
        for a in range(3):
            k.r[b, a] += k.change[b, a]
        turn_rotation(k.R[b], k.change[b, 3], k.change[b, 4], k.change[b, 5], k.R[b])


def project_rates(k):
    """Project the velocities ``k.v`` onto A v + phi_t = 0 along M^-1 A^T; set ``k.rhs`` to the impulses of the rows.

    Rows and the factor of S are those in the kernel.
    """
    for a in range(len(k.rhs)):
        k.rhs[a] = -k.slip[a]
    add_rates(k.body, k.row, k.pins, k.X, k.way, k.v, -1.0, k.rhs)
    run(k.solve)
    add_loads(k.body, k.row, k.pins, k.mass, k.way, k.Y, k.rhs, k.v)


def divide(k):
    """Set ``k.w`` := M^-1 w, which converts momenta to velocities."""
    multiply_by_inverse_mass(k.mass, k.J_inv, k.w)


def push(k):
    """Add M^-1 A^T x to ``k.w`` (nb, 6): the change of velocities by impulses ``k.x`` (nrows,) of the present rows."""
    add_loads(k.body, k.row, k.pins, k.mass, k.way, k.Y, k.x, k.w)


def push_kept(k):
    """Add M^-1 A^T x to ``k.w``, the change of velocities by ``k.x`` on the rows that ``keep_rows`` has copied."""
    add_loads(k.body, k.row, k.pins, k.mass, k.way0, k.Y0, k.x, k.w)


def keep_rows(k):
    """Copy the present constraint rows, ``k.Y`` and ``k.way``, for ``push_kept``."""
    copy(k.Y, k.Y0)
    copy(k.way, k.way0)


def slips(k):
    """Set ``k.x`` := -(A w + phi_t), minus the rates of the constraint rows at the velocities ``k.w``."""
    for a in range(len(k.x)):
        k.x[a] = -k.slip[a]
    add_rates(k.body, k.row, k.pins, k.X, k.way, k.w, -1.0, k.x)
