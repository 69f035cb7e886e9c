"""Line rows: the point of i stays in a plane of j, or at a distance from the point of j; a force f along the way.

With d = x_i - x_j: phi = n . d and f = n = R_j n, or phi = (d . d - L^2) / (2 L) and f = d / L. Either way the row's
force acts at x_i on both bodies, so its arms are x_i - r_i and x_i - r_j, and its wrench on an end (f, arm x f).
Their Jacobian is built column by column: such joints are few, and their force turns with the motion.
"""

from numba import njit

from .jacobian_joints import by_nu
from .moving import moving
from .vectors import INNER, add, blend, cross, dot, minus, plus, put, times, turn, turn_back

ZERO = (0.0, 0.0, 0.0)


@njit(**INNER)
def lines(model, motion):
    """Arms, forces and rows of all line rows, and their rates."""
    for j in range(len(model.body)):
        if not model.lines[j]:
            continue
        if model.kind[j]:
            moving(model, motion, j)
            continue
        for e in range(2):
            b, s = model.body[j, e], model.s[j, e]
            x, x_dot = (s[0], s[1], s[2]), ZERO
            if b >= 0:
                arm, arm_dot = turn(motion.R[b], s), turn(motion.R[b], cross(motion.v[b, 3:], s))
                x, x_dot = plus(motion.r[b], arm), plus(motion.v[b], arm_dot)
            if e == 0:
                put(arm, motion.arm[j, 0])
                put(arm_dot, motion.arm_dot[j, 0])
                put(x, motion.gap[j])
                put(x_dot, motion.gap_dot[j])
            else:
                if b >= 0:
                    put(minus(motion.gap[j], motion.r[b]), motion.arm[j, 1])
                    put(minus(motion.gap_dot[j], motion.v[b]), motion.arm_dot[j, 1])
                put(minus(motion.gap[j], x), motion.gap[j])
                put(minus(motion.gap_dot[j], x_dot), motion.gap_dot[j])
        other, d, d_dot = model.body[j, 1], motion.gap[j], motion.gap_dot[j]
        for k in range(model.lines[j]):
            row, L, n = model.row[j] + k, model.length[j], model.normal[j, k]
            if L > 0.0:
                put(times(1.0 / L, d), motion.f[j, k])
                put(times(1.0 / L, d_dot), motion.f_dot[j, k])
                motion.phi[row] = 0.5 * (dot(d, d) / L - L)
                motion.phi_dot[row] = dot(d, d_dot) / L
                continue
            if other < 0:
                put(n, motion.f[j, k])
            else:
                put(turn(motion.R[other], n), motion.f[j, k])
                put(turn(motion.R[other], cross(motion.v[other, 3:], n)), motion.f_dot[j, k])
            motion.phi[row] = dot(motion.f[j, k], d)
            motion.phi_dot[row] = dot(motion.f[j, k], d_dot) + dot(motion.f_dot[j, k], d)


@njit(**INNER)
def _moment(motion, j, k, e):
    """arm x f of row k on end ``e``, and its rate; moving rows have a torque besides, others 0."""
    f, arm = motion.f[j, k], motion.arm[j, e]
    bend = plus(cross(motion.arm_dot[j, e], f), cross(arm, motion.f_dot[j, k]))
    return plus(cross(arm, f), motion.a[j, k]), plus(bend, motion.a_dot[j, k])


@njit(**INNER)
def line_reactions(model, step, settings, R_v):
    """Their part of Eq. (74)."""
    start, end, rows, half = step.start, step.end, step.rows, 0.5 * step.dt
    B = half * settings.b_term
    for j in range(len(model.body)):
        for k in range(model.lines[j]):
            row = model.row[j] + k
            nu1 = rows.nu1[row]
            nu0 = settings.gauge * nu1 + rows.nu_start[row]
            p, q = nu0 - half * rows.G0[row], -nu1 - half * rows.G1[row]
            force = blend(p, start.f[j, k], q, end.f[j, k])
            force = plus(force, blend(B * nu0, start.f_dot[j, k], B * nu1, end.f_dot[j, k]))
            for e in range(2):
                b, sign = model.body[j, e], 1.0 - 2.0 * e
                if b < 0:
                    continue
                m0, m0_dot = _moment(start, j, k, e)
                m1, m1_dot = _moment(end, j, k, e)
                add(sign, force, R_v[b])
                add(sign, plus(blend(p, m0, q, m1), blend(B * nu0, m0_dot, B * nu1, m1_dot)), R_v[b, 3:])


@njit(**INNER)
def line_columns(model, step, settings, saddle):
    """Columns of nu1."""
    start, end, half = step.start, step.end, 0.5 * step.dt
    B, gauge = half * settings.b_term, settings.gauge
    for j in range(len(model.body)):
        for k in range(model.lines[j]):
            dG = half * step.rows.dG[model.row[j] + k]
            x = by_nu(gauge, B, dG, start.f[j, k], start.f_dot[j, k], end.f[j, k], end.f_dot[j, k])
            for e in range(2):
                b, sign = model.body[j, e], 1.0 - 2.0 * e
                if b < 0:
                    continue
                K = saddle.blocks[saddle.column[j, e]]
                m0, m0_dot = _moment(start, j, k, e)
                m1, m1_dot = _moment(end, j, k, e)
                y = turn_back(end.R[b], by_nu(gauge, B, dG, m0, m0_dot, m1, m1_dot))
                K[0, k], K[1, k], K[2, k] = times(sign, x)
                K[3, k], K[4, k], K[5, k] = times(sign, y)


@njit(**INNER)
def line_slopes(model, step, settings, saddle):
    """Columns of both bodies' velocities: forces of the line rows as the motion changes, and the rows themselves."""
    end, rows, half = step.end, step.rows, 0.5 * step.dt
    B = half * settings.b_term
    for j in range(len(model.body)):
        for o in range(2 if model.lines[j] and not model.kind[j] else 0):  # the end that moves
            if model.body[j, o] < 0:
                continue
            for c in range(6):
                dr, dv, theta, W = _column(c, half, saddle.T[model.body[j, o]])
                turned, turned_dot = _varied(end, model.body[j, o], model.s[j, o], theta, W)
                side = 1.0 - 2.0 * o
                dd, dd_dot = times(side, plus(dr, turned)), times(side, plus(dv, turned_dot))
                for k in range(model.lines[j]):
                    row, L = model.row[j] + k, model.length[j]
                    f, f_dot, d, d_dot = end.f[j, k], end.f_dot[j, k], end.gap[j], end.gap_dot[j]
                    df, df_dot = ZERO, ZERO
                    if L > 0.0:
                        df, df_dot = times(1.0 / L, dd), times(1.0 / L, dd_dot)
                    elif o == 1:
                        df, df_dot = _varied(end, model.body[j, 1], model.normal[j, k], theta, W)
                    dphi, dphi_dot = dot(f, dd), dot(f, dd_dot) + dot(df, d_dot)
                    if not L > 0.0:
                        dphi += dot(df, d)
                        dphi_dot += dot(df_dot, d) + dot(f_dot, dd)
                    saddle.blocks[saddle.row[j, o]][k, c] += rows.on_rate[row] * dphi_dot + rows.on_phi[row] * dphi
                    w, z = -rows.nu1[row] - half * rows.G1[row], B * rows.nu1[row]
                    pull = blend(w, df, z, df_dot)
                    for e in range(2):  # the end on which the force acts
                        b, sign = model.body[j, e], 1.0 - 2.0 * e
                        pair = -1 if b < 0 else saddle.body[b] if e == o else saddle.couple[j, e]
                        if pair < 0:
                            continue
                        da, da_dot = ZERO, ZERO  # of the arm x_i - r_e
                        if e == 0 and o == 0:
                            da, da_dot = turned, turned_dot
                        elif e == 1 and o == 0:
                            da, da_dot = dd, dd_dot
                        elif e == 1:
                            da, da_dot = times(-1.0, dr), times(-1.0, dv)
                        arm, arm_dot = end.arm[j, e], end.arm_dot[j, e]
                        moment = times(w, plus(cross(da, f), cross(arm, df)))
                        bend = plus(
                            plus(cross(da_dot, f), cross(arm_dot, df)), plus(cross(da, f_dot), cross(arm, df_dot))
                        )
                        moment = turn_back(end.R[b], plus(moment, times(z, bend)))
                        K = saddle.blocks[pair]
                        for q in range(3):
                            K[q, c] += sign * pull[q]
                            K[3 + q, c] += sign * moment[q]


@njit(**INNER)
def _column(c, half, T):
    """Changes of r and v in space, of the pose and of Omega in the body, by column c of (dr_dot, dOmega)."""
    unit = (1.0 * (c % 3 == 0), 1.0 * (c % 3 == 1), 1.0 * (c % 3 == 2))
    if c < 3:
        return times(half, unit), unit, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), turn(T, unit), unit


@njit(**INNER)
def _varied(end, b, s, theta, W):
    """Change of R s and of its rate as body b turns by theta and faster by W."""
    R = end.R[b]
    return turn(R, cross(theta, s)), turn(R, plus(cross(theta, cross(end.v[b, 3:], s)), cross(W, s)))
