"""Bodies, joint rows and springs as CasADi expressions, one of each kind, in any chart; exact derivatives follow.

Physics is written once on poses x = (r, R) and velocities V = (r_dot [space], Omega [body]) with the flow
x_dot = (r_dot, R hat(Omega)), then composed with a chart, V = B(p) u and p_dot = G(p) u (module ``charts``)::

    body     e = B^T (M V_dot + (0, Omega x J Omega) - (m g, 0)),  V_dot = B u_dot + B_dot u
    rows     phi(x_i, x_j),  phi_dot = A V,  phi_ddot = A V_dot + gamma;  load on a body: -B^T A^T lam
    spring   load -B^T f,  f = -(k (l - d0) + c l_dot) d(l_dot)/dV

In 3-1-3 angles e is ``(M q_dot)' + h - f`` of Eqs. (63), (92) with M = blockdiag(m I, T^T J T). Nothing is divided
by a factor that vanishes at a chart's singularity.
"""

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from .charts import Chart


class Pose(NamedTuple):
    """r (3) and R (3, 3) of one body, symbolic."""

    r: ca.SX
    R: ca.SX

    def flat(self) -> ca.SX:
        return ca.vertcat(self.r, ca.vec(self.R))


class Moving(NamedTuple):
    """One body in a chart: coordinates, velocities, and what they mean in space."""

    p: ca.SX
    u: ca.SX
    u_dot: ca.SX
    pose: Pose
    V: ca.SX
    V_dot: ca.SX
    B: ca.SX  # dV/du
    p_dot: ca.SX  # the flow, without ``Chart.restoring``


@dataclass(frozen=True)
class Element:
    """Inputs (columns of z, w, parameters) and outputs of one element, unmapped.

    ``z`` is what the element reads of the unknowns y, ``w`` what it reads of the accelerations u_dot.
    """

    z: ca.SX
    w: ca.SX
    parameters: ca.SX
    outputs: dict[str, ca.SX]


def moving(chart: Chart, end: str) -> Moving:
    """Symbols of one body and its motion in ``chart``."""
    p, u, u_dot = ca.SX.sym(f"p_{end}", chart.size), ca.SX.sym(f"u_{end}", 6), ca.SX.sym(f"w_{end}", 6)
    V, p_dot = chart.body_velocity(p, u), chart.flow(p, u)
    B = ca.jacobian(V, u)
    V_dot = B @ u_dot + ca.jtimes(V, p, p_dot)
    return Moving(p, u, u_dot, Pose(p[:3], chart.rotation(p)), V, V_dot, B, p_dot)


def body_element(chart: Chart) -> Element:
    """Parameters (m, J (9), g (3)); outputs p_dot of the chart and e, the unbalanced load without joints."""
    b = moving(chart, "i")
    parameters = ca.SX.sym("body", 13)
    m, J, g = parameters[0], ca.reshape(parameters[1:10], 3, 3), parameters[10:]
    Omega = b.V[3:]
    force = m * (b.V_dot[:3] - g)
    torque = J @ b.V_dot[3:] + ca.cross(Omega, J @ Omega)
    e = b.B.T @ ca.vertcat(force, torque)
    rate = b.p_dot + chart.restoring(b.p)
    return Element(ca.vertcat(b.p, b.u), b.u_dot, parameters, {"rate": rate, "e": e})


def point_rows(i: Pose, j: Pose, parameters: ca.SX) -> ca.SX:
    """phi = r_i + R_i s_i - r_j - R_j s_j [m]; parameters (s_i, s_j)."""
    return i.r + i.R @ parameters[:3] - j.r - j.R @ parameters[3:6]


def axis_rows(i: Pose, j: Pose, parameters: ca.SX) -> ca.SX:
    """phi = (R_i u) . (R_j n_k), k = 1, 2 [-]; parameters (u, n_1, n_2)."""
    u = i.R @ parameters[:3]
    return ca.vertcat(ca.dot(u, j.R @ parameters[3:6]), ca.dot(u, j.R @ parameters[6:9]))


def lone_axis_row(i: Pose, j: Pose, parameters: ca.SX) -> ca.SX:
    """phi = (R_i u) . (R_j n) [-]; parameters (u, n)."""
    return ca.dot(i.R @ parameters[:3], j.R @ parameters[3:6])


def plane_row(i: Pose, j: Pose, parameters: ca.SX) -> ca.SX:
    """phi = (R_j n) . d [m], d of ``point_rows``; parameters (s_i, s_j, n)."""
    return ca.dot(j.R @ parameters[6:9], point_rows(i, j, parameters))


def distance_row(i: Pose, j: Pose, parameters: ca.SX) -> ca.SX:
    """phi = (d . d - L^2) / (2 L) [m]; parameters (s_i, s_j, L)."""
    d, L = point_rows(i, j, parameters), parameters[6]
    return (ca.dot(d, d) - L * L) / (2 * L)


ROWS = {  # rows, number of rows, number of parameters
    "point": (point_rows, 3, 6), "plane": (plane_row, 1, 9), "distance": (distance_row, 1, 7),
    "axis": (axis_rows, 2, 9), "lone axis": (lone_axis_row, 1, 6),
}  # fmt: skip


class Pair(NamedTuple):
    """Two bodies and a function g(x_i, x_j) of their poses with its two rates along the motion."""

    i: Moving
    j: Moving
    value: ca.SX  # g
    A: ca.SX  # (., 12): g_dot = A (V_i, V_j), coordinate-free
    A_chart: ca.SX  # (., 12): g_dot = A_chart (u_i, u_j)
    rate: ca.SX  # g_dot
    acceleration: ca.SX  # g_ddot at the accelerations of i and j


def joint_pair(kind: str, chart: Chart, parameters: ca.SX) -> Pair:
    """The rows of ``kind`` between two bodies."""
    i, j = moving(chart, "i"), moving(chart, "j")
    rows, _, _ = ROWS[kind]
    x_i, x_j, V = _pose("i"), _pose("j"), ca.SX.sym("V", 12)
    phi = rows(x_i, x_j, parameters)
    return _pair(i, j, x_i, x_j, V, phi, parameters)


def spring_pair(chart: Chart, parameters: ca.SX) -> Pair:
    """The distance l [m] of two points; parameters (p_i, p_j, ...)."""
    i, j = moving(chart, "i"), moving(chart, "j")
    x_i, x_j, V = _pose("i"), _pose("j"), ca.SX.sym("V", 12)
    return _pair(i, j, x_i, x_j, V, ca.norm_2(point_rows(x_i, x_j, parameters)), parameters)


def row_element(kind: str, chart: Chart, level: str, alpha: float, beta: float) -> Element:
    """Parameters as in ``ROWS``; z ends with lam. Outputs load_i, load_j = -A^T lam and c, the constraint row.

    ``level`` "acceleration": c = phi_ddot + 2 alpha phi_dot + beta^2 phi, Eq. (94); "velocity": phi_dot + alpha phi;
    "position": phi, Eq. (93); "both": (phi, phi_dot), and z ends with lam, eta, which adds G A^T eta to p_dot.
    """
    _, n, n_parameters = ROWS[kind]
    parameters, lam = ca.SX.sym(kind, n_parameters), ca.SX.sym("lam", n)
    pair = joint_pair(kind, chart, parameters)
    load = -pair.A_chart.T @ lam
    if level == "both":
        eta = ca.SX.sym("eta", n)
        slip = pair.A_chart.T @ eta  # a velocity
        moved = ca.vertcat(chart.flow(pair.i.p, slip[:6]), chart.flow(pair.j.p, slip[6:]))
        outputs = {"load": load, "c": pair.value, "c_dot": pair.rate, "moved": moved}
        return Element(_unknowns(pair, lam, eta), _accelerations(pair), parameters, outputs)
    c = {
        "position": pair.value,
        "velocity": pair.rate + alpha * pair.value,
        "acceleration": pair.acceleration + 2.0 * alpha * pair.rate + beta**2 * pair.value,
    }[level]
    return Element(_unknowns(pair, lam), _accelerations(pair), parameters, {"load": load, "c": c})


DIRECTIONS = ("a", "mass", "translation")


def strong_row_element(kind: str, chart: Chart, direction: str = "a") -> Element:
    """What Eq. (65) needs of the rows, at u_dot = 0; parameters as in ``ROWS``, then m_i, J_i, m_j, J_j, 1 if j moves.

    Outputs: A in the chart, ``gamma`` = phi_ddot, phi_dot, phi, M_bar, M_bar_dot and c. The last three are taken in the
    coordinate-free velocities V, c with a . c = 1 per Eq. (31) and M_bar = c^T M c per Eq. (30), so that they do not
    depend on the chart. ``direction`` of c: "a" a / (a . a); "mass" M^-1 a / (a . M^-1 a); "translation" (e_k, 0) on
    the first body, for point rows. Matrices are by columns; the ground has no part in a.
    """
    _, n, n_own = ROWS[kind]
    parameters = ca.SX.sym(kind, n_own + 21)
    body = parameters[n_own:]
    pair = joint_pair(kind, chart, parameters[:n_own])
    a = pair.A @ ca.diagcat(ca.SX.eye(6), body[20] * ca.SX.eye(6))
    M = ca.diagcat(*[ca.diagcat(body[k] * ca.SX.eye(3), ca.reshape(body[k + 1 : k + 10], 3, 3)) for k in (0, 10)])
    if direction == "translation":
        c = ca.horzcat(ca.SX.eye(n), ca.SX.zeros(n, 12 - n))
    else:
        c = a if direction == "a" else ca.solve(M, a.T).T
        c = c / ca.repmat(ca.sum2(a * c), 1, 12)
    M_bar = ca.sum2((c @ M) * c)
    p, p_dot = ca.vertcat(pair.i.p, pair.j.p), ca.vertcat(pair.i.p_dot, pair.j.p_dot)
    w = _accelerations(pair)
    outputs = {
        "A": ca.vec(pair.A_chart),
        "gamma": ca.substitute(pair.acceleration, w, ca.SX.zeros(12)),
        "phi_dot": pair.rate,
        "phi": pair.value,
        "M_bar": M_bar,
        "M_bar_dot": ca.jtimes(M_bar, p, p_dot),
        "c": ca.vec(c),
    }
    return Element(_unknowns(pair), w, parameters, outputs)


def spring_element(chart: Chart) -> Element:
    """Parameters (p_i, p_j, k, d0, c); output the load -f on (i, j), f = -(k (l - d0) + c l_dot) dl/dx."""
    parameters = ca.SX.sym("spring", 9)
    pair = spring_pair(chart, parameters)
    k, d0, c = parameters[6], parameters[7], parameters[8]
    load = pair.A_chart.T @ (k * (pair.value - d0) + c * pair.rate)
    return Element(_unknowns(pair), _accelerations(pair), parameters, {"load": load})


def load_element(chart: Chart, *, chosen: bool = True) -> Element:
    """Parameters (p, F, T, 1 if they turn with the body else 0); output -B^T f, or f itself in V if not ``chosen``."""
    b, parameters = moving(chart, "i"), ca.SX.sym("load", 10)
    p, F, T, follows = parameters[:3], parameters[3:6], parameters[6:9], parameters[9]
    R = b.pose.R
    force = ca.if_else(follows, R @ F, F)
    torque = ca.if_else(follows, T, R.T @ T)
    f = ca.vertcat(force, torque + ca.cross(p, R.T @ force))
    return Element(ca.vertcat(b.p, b.u), b.u_dot, parameters, {"load": -b.B.T @ f if chosen else f})


def free_spring_element(chart: Chart) -> Element:
    """The spring's force f (12) in the velocities V and its slopes -df/dV, -df/dx along the flow (12 x 12, by columns).

    Eq. (32) takes C_bar and K_bar from these.
    """
    parameters, V, way = ca.SX.sym("spring", 9), ca.SX.sym("V", 12), ca.SX.sym("way", 12)
    i, j, x_i, x_j = moving(chart, "i"), moving(chart, "j"), _pose("i"), _pose("j")
    x = ca.vertcat(x_i.flat(), x_j.flat())
    length = ca.norm_2(point_rows(x_i, x_j, parameters))
    rate = ca.jtimes(length, x, _pose_rate(x_i, x_j, V))
    k, d0, c = parameters[6], parameters[7], parameters[8]
    f = -ca.gradient(rate, V) * (k * (length - d0) + c * rate)
    damping = -ca.jacobian(f, V)
    stiffness = -ca.jacobian(ca.jtimes(f, x, _pose_rate(x_i, x_j, way)), way)
    free = ca.Function("spring", [x, V, parameters], [f, ca.densify(damping), ca.densify(stiffness)])
    f, damping, stiffness = free(ca.vertcat(i.pose.flat(), j.pose.flat()), ca.vertcat(i.V, j.V), parameters)
    z = ca.vertcat(i.p, i.u, j.p, j.u)
    outputs = {"f": f, "damping": ca.vec(damping), "stiffness": ca.vec(stiffness)}
    return Element(z, ca.vertcat(i.u_dot, j.u_dot), parameters, outputs)


def _pose_rate(x_i: Pose, x_j: Pose, V: ca.SX) -> ca.SX:
    """x_dot = (r_dot, R hat(Omega)) of both bodies."""
    return ca.vertcat(V[:3], ca.vec(x_i.R @ ca.skew(V[3:6])), V[6:9], ca.vec(x_j.R @ ca.skew(V[9:12])))


def _pair(i: Moving, j: Moving, x_i: Pose, x_j: Pose, V: ca.SX, g: ca.SX, parameters: ca.SX) -> Pair:
    x = ca.vertcat(x_i.flat(), x_j.flat())
    x_dot = _pose_rate(x_i, x_j, V)
    rate = ca.jtimes(g, x, x_dot)
    A, gamma = ca.jacobian(rate, V), ca.jtimes(rate, x, x_dot)
    free = ca.Function("pair", [x, V, parameters], [g, A, rate, gamma])
    at = ca.vertcat(i.pose.flat(), j.pose.flat())
    g, A, rate, gamma = free(at, ca.vertcat(i.V, j.V), parameters)
    B = ca.diagcat(i.B, j.B)
    return Pair(i, j, g, ca.densify(A), ca.densify(A @ B), rate, gamma + A @ ca.vertcat(i.V_dot, j.V_dot))


def _pose(end: str) -> Pose:
    return Pose(ca.SX.sym(f"r_{end}", 3), ca.SX.sym(f"R_{end}", 3, 3))


def _unknowns(pair: Pair, *more: ca.SX) -> ca.SX:
    return ca.vertcat(pair.i.p, pair.i.u, pair.j.p, pair.j.u, *more)


def _accelerations(pair: Pair) -> ca.SX:
    return ca.vertcat(pair.i.u_dot, pair.j.u_dot)
