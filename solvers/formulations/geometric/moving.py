"""Moving rows (``mechanics.moving_rows``): drives, knife edges and rolling discs (compiled).

Each pushes both bodies with a force at one point x and a torque, both of which turn and move with the motion::

    phi_dot = force . (v_i(x) - v_j(x)) + torque . (omega_i - omega_j) + phi_t

They are joints of their own here, with ``lines`` rows; Jacobians are differences, column by column: they are few.
"""

import math

from numba import njit

from .vectors import INNER, blend, cross, dot, minus, plus, put, times, turn, turn_back, turned_by

POSITION, ANGLE, KNIFE, ROLLING, DISTANCE = range(1, 6)  # ``Model.kind``; 0: no moving rows
ZERO = (0.0, 0.0, 0.0)
DIFFERENCE = 1e-5  # of central differences: rounding and truncation are 1e-10


@njit(**INNER)
def function(numbers, t):
    """f, f_dot and f_ddot of a function of time."""
    c1, c2, c3, a, w = numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]
    sine, cosine = a * math.sin(w * t + numbers[6]), a * math.cos(w * t + numbers[6])
    return (
        numbers[0] + t * (c1 + t * (c2 + t * c3)) + sine,
        c1 + t * (2.0 * c2 + 3.0 * t * c3) + w * cosine,
        2.0 * c2 + 6.0 * t * c3 - w * w * sine,
    )


@njit(**INNER)
def spin_of(R, v, b):
    """omega of a body in space; 0 on the ground."""
    return turn(R[b], v[b, 3:]) if b >= 0 else ZERO


@njit(**INNER)
def fixed_in(R, b, x):
    """A vector fixed in a body, in space."""
    return turn(R[b], x) if b >= 0 else (x[0], x[1], x[2])


@njit(**INNER)
def velocity_at(r, R, v, b, x):
    """Of the material point of a body at x."""
    return plus(v[b], cross(spin_of(R, v, b), minus(x, r[b]))) if b >= 0 else ZERO


@njit(**INNER)
def along(a, a_dot):
    """Length and direction of a vector, and the rate of the direction."""
    size = math.sqrt(dot(a, a))
    e = times(1.0 / size, a)
    return size, e, times(1.0 / size, minus(a_dot, times(dot(e, a_dot), e)))


@njit(**INNER)
def moving_row(model, r, R, v, t, j, k):
    """(phi, phi_t, its rate), force, torque and point of row k of joint j, each with its rate along v."""
    i, g, kind = model.body[j, 0], model.body[j, 1], model.kind[j]
    omega_i, omega_j = spin_of(R, v, i), spin_of(R, v, g)
    arm = turn(R[i], model.s[j, 0])
    x, x_dot = plus(r[i], arm), plus(v[i], cross(omega_i, arm))
    f, f_dot, f_ddot = function(model.motion[j], t)
    u = turn(R[i], model.u[j, 0])
    u_dot = cross(omega_i, u)
    if kind == KNIFE:
        return (0.0, -f, -f_dot), u, u_dot, ZERO, ZERO, x, x_dot
    n = fixed_in(R, g, model.normal[j, 0])
    if kind == ANGLE:
        m = fixed_in(R, g, model.normal[j, 1])
        a = blend(math.cos(f), n, math.sin(f), m)
        da = blend(-math.sin(f), n, math.cos(f), m)  # by f
        a_dot = plus(cross(omega_j, a), times(f_dot, da))
        phi_tt = f_dot * (dot(u_dot, da) + dot(u, cross(omega_j, da)) - f_dot * dot(u, a)) + f_ddot * dot(u, da)
        return (
            (dot(u, a), f_dot * dot(u, da), phi_tt), ZERO, ZERO, cross(u, a), plus(cross(u_dot, a), cross(u, a_dot)),
            x, x_dot,
        )  # fmt: skip
    n_dot = cross(omega_j, n)
    y = plus(r[g], turn(R[g], model.s[j, 1])) if g >= 0 else (model.s[j, 1, 0], model.s[j, 1, 1], model.s[j, 1, 2])
    if kind == POSITION:
        return (dot(n, minus(x, y)) - f, -f_dot, -f_ddot), n, n_dot, ZERO, ZERO, x, x_dot
    if kind == DISTANCE:
        distance, e, e_dot = along(minus(x, y), minus(x_dot, velocity_at(r, R, v, g, y)))
        return (distance - f, -f_dot, -f_ddot), e, e_dot, ZERO, ZERO, x, x_dot
    steep, steep_dot = dot(n, u), dot(n_dot, u) + dot(n, u_dot)
    down = minus(n, times(steep, u))
    down_dot = minus(n_dot, plus(times(steep_dot, u), times(steep, u_dot)))
    _, e, e_dot = along(down, down_dot)
    x, x_dot = minus(x, times(model.length[j], e)), minus(x_dot, times(model.length[j], e_dot))
    phi = dot(n, minus(x, y)) if k == 0 else 0.0
    if k > 0:
        n = fixed_in(R, g, model.normal[j, k])
        n_dot = cross(omega_j, n)
    return (phi, 0.0, 0.0), n, n_dot, ZERO, ZERO, x, x_dot


@njit(**INNER)
def rate(model, r, R, v, j, phi_t, f, m, x):
    """phi_dot of a row."""
    i, g = model.body[j, 0], model.body[j, 1]
    seen = minus(velocity_at(r, R, v, i, x), velocity_at(r, R, v, g, x))
    return dot(f, seen) + dot(m, minus(spin_of(R, v, i), spin_of(R, v, g))) + phi_t


@njit(**INNER)
def moving(model, motion, j):
    """Rows of joint j at one instant: phi, phi_dot, forces, torques, and the arms of their point."""
    r, R, v, t = motion.r, motion.R, motion.v, motion.t[0]
    for k in range(model.lines[j]):
        (phi, phi_t, _), f, f_dot, m, m_dot, x, x_dot = moving_row(model, r, R, v, t, j, k)
        put(f, motion.f[j, k])
        put(f_dot, motion.f_dot[j, k])
        put(m, motion.a[j, k])
        put(m_dot, motion.a_dot[j, k])
        motion.phi[model.row[j] + k] = phi
        motion.phi_dot[model.row[j] + k] = rate(model, r, R, v, j, phi_t, f, m, x)
        for e in range(2):
            b = model.body[j, e]
            if b >= 0:
                put(minus(x, r[b]), motion.arm[j, e])
                put(minus(x_dot, v[b]), motion.arm_dot[j, e])


@njit(**INNER)
def gamma(model, r, R, v, j, phi_tt, f, f_dot, m_dot, x, x_dot):
    """phi_ddot of a row without accelerations; the point moves over the bodies."""
    i, g = model.body[j, 0], model.body[j, 1]
    omega_i, omega_j = spin_of(R, v, i), spin_of(R, v, g)
    bend = cross(omega_i, minus(x_dot, v[i]))
    if g >= 0:
        bend = minus(bend, cross(omega_j, minus(x_dot, v[g])))
    seen = minus(velocity_at(r, R, v, i, x), velocity_at(r, R, v, g, x))
    return dot(f_dot, seen) + dot(f, bend) + dot(m_dot, minus(omega_i, omega_j)) + phi_tt


@njit(**INNER)
def moving_slopes(model, step, settings, saddle):
    """Columns of both bodies' velocities by central differences: rows, and what they push with."""
    end, half = step.end, 0.5 * step.dt
    r, R, v = end.r, end.R, end.v
    for j in range(len(model.body)):
        for o in range(2 if model.kind[j] else 0):  # the end that moves
            b = model.body[j, o]
            if b < 0:
                continue
            T = saddle.T[b]
            p = (r[b, 0], r[b, 1], r[b, 2])
            Q0, Q1, Q2 = row_of(R, b, 0), row_of(R, b, 1), row_of(R, b, 2)
            for c in range(6):
                before = v[b, c]
                for side in (1.0, -1.0):
                    h = side * DIFFERENCE
                    v[b, c] = before + h
                    if c < 3:
                        r[b, c] = p[c] + half * h
                    else:
                        turned_by(R[b], (h * T[0, c - 3], h * T[1, c - 3], h * T[2, c - 3]), R[b])
                    _add(model, step, settings, saddle, (Q0, Q1, Q2), j, o, c, 0.5 / h)
                    put(p, r[b])
                    put(Q0, R[b, 0])
                    put(Q1, R[b, 1])
                    put(Q2, R[b, 2])
                v[b, c] = before


@njit(**INNER)
def row_of(R, b, k):
    """Row k of R_b as a tuple."""
    return R[b, k, 0], R[b, k, 1], R[b, k, 2]


@njit(**INNER)
def _add(model, step, settings, saddle, Q, j, o, c, weight):
    """``weight`` times rows and pushes of joint j at the end as it stands, in column c of its end ``o``.

    ``Q`` is that end's own R by rows: equations stay in the frames of the step's end.
    """
    end, rows, half = step.end, step.rows, 0.5 * step.dt
    r, R, v = end.r, end.R, end.v
    for k in range(model.lines[j]):
        row = model.row[j] + k
        (phi, phi_t, _), f, f_dot, m, m_dot, x, x_dot = moving_row(model, r, R, v, end.t[0], j, k)
        phi_dot = rate(model, r, R, v, j, phi_t, f, m, x)
        saddle.blocks[saddle.row[j, o]][k, c] += weight * (rows.on_rate[row] * phi_dot + rows.on_phi[row] * phi)
        w, z = -rows.nu1[row] - half * rows.G1[row], half * settings.b_term * rows.nu1[row]
        pull = blend(w, f, z, f_dot)
        for e in range(2):  # the end that is pushed
            b = model.body[j, e]
            pair = -1 if b < 0 else saddle.body[b] if e == o else saddle.couple[j, e]
            if pair < 0:
                continue
            arm, arm_dot = minus(x, r[b]), minus(x_dot, v[b])
            moment = plus(cross(arm, f), m)
            bend = plus(plus(cross(arm_dot, f), cross(arm, f_dot)), m_dot)
            y = blend(w, moment, z, bend)
            if e == o:
                y = (
                    Q[0][0] * y[0] + Q[1][0] * y[1] + Q[2][0] * y[2],
                    Q[0][1] * y[0] + Q[1][1] * y[1] + Q[2][1] * y[2],
                    Q[0][2] * y[0] + Q[1][2] * y[1] + Q[2][2] * y[2],
                )
            else:
                y = turn_back(R[b], y)
            K, sign = saddle.blocks[pair], weight * (1.0 - 2.0 * e)
            for q in range(3):
                K[q, c] += sign * pull[q]
                K[3 + q, c] += sign * y[q]
