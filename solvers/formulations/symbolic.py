"""Bodies, joint rows and springs as CasADi expressions, one of each kind, in any chart; exact derivatives follow.

Physics is written once on poses x = (r, R) and velocities V = (r_dot [space], Omega [body]) with the flow
x_dot = (r_dot, R hat(Omega)), then composed with a chart, V = B(p) u and p_dot = G(p) u (module ``charts``)::

    body     e = B^T (M V_dot + (0, Omega x J Omega) - (m g, 0)),  V_dot = B u_dot + B_dot u
    rows     phi(x_i, x_j),  phi_dot = A V,  phi_ddot = A V_dot + gamma;  load on a body: -B^T A^T lam
    spring   load -B^T f,  f = -(k (l - d0) + c l_dot) d(l_dot)/dV

In 3-1-3 angles e is ``(M q_dot)' + h - f`` of Eqs. (63), (92) with M = blockdiag(m I, T^T J T). Nothing is divided
by a factor that vanishes at a chart's singularity.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from .charts import Chart
from .time_function import time_function

ELEMENTS = 64  # kept for the next run, of each kind of element


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


@dataclass(frozen=True, eq=False)
class Element:
    """Inputs (columns of z, w, parameters) and outputs of one element; two are equal if they are one object.

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


@lru_cache(ELEMENTS)
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


def driven_position_row(i: Pose, j: Pose, parameters: ca.SX, t: ca.SX) -> ca.SX:
    """phi = (R_j n) . d - f(t) [m]; parameters (s_i, s_j, n, f)."""
    return plane_row(i, j, parameters) - time_function(parameters[9:], t)


def driven_angle_row(i: Pose, j: Pose, parameters: ca.SX, t: ca.SX) -> ca.SX:
    """phi = (R_i u) . R_j (n_1 cos f(t) + n_2 sin f(t)) [-]; parameters (u, n_1, n_2, f)."""
    f = time_function(parameters[9:], t)
    return ca.dot(i.R @ parameters[:3], j.R @ (parameters[3:6] * ca.cos(f) + parameters[6:9] * ca.sin(f)))


def driven_distance_row(i: Pose, j: Pose, parameters: ca.SX, t: ca.SX) -> ca.SX:
    """phi = |d| - f(t) [m]; parameters (s_i, s_j, f)."""
    return ca.norm_2(point_rows(i, j, parameters)) - time_function(parameters[6:], t)


def disc_row(i: Pose, j: Pose, parameters: ca.SX, t: ca.SX) -> ca.SX:
    """phi = n . d - r sqrt(1 - (n . a)^2) [m]: the lowest point of a disc; parameters (s_i, s_j, n, a, r)."""
    steep = ca.dot(j.R @ parameters[6:9], i.R @ parameters[9:12])
    return plane_row(i, j, parameters) - parameters[12] * ca.sqrt(1 - steep**2)


def knife_rate(i: Pose, j: Pose, V: ca.SX, parameters: ca.SX, t: ca.SX) -> ca.SX:
    """phi_dot = (R_i u) . slip at the point of i, less f(t) [m/s]; parameters (s_i, u, f)."""
    arm = i.R @ parameters[:3]
    return ca.dot(i.R @ parameters[3:6], slip(i, j, V, arm)) - time_function(parameters[6:], t)


def rolling_rates(i: Pose, j: Pose, V: ca.SX, parameters: ca.SX, t: ca.SX) -> ca.SX:
    """phi_dot = (R_j t_k) . slip at the lowest point of a disc, k = 1, 2 [m/s]; parameters (s_i, n, a, r, t_1, t_2)."""
    n, a = j.R @ parameters[3:6], i.R @ parameters[6:9]
    down = n - ca.dot(n, a) * a
    at = slip(i, j, V, i.R @ parameters[:3] - parameters[9] * down / ca.norm_2(down))
    return ca.vertcat(ca.dot(j.R @ parameters[10:13], at), ca.dot(j.R @ parameters[13:16], at))


def slip(i: Pose, j: Pose, V: ca.SX, arm: ca.SX) -> ca.SX:
    """Velocity of the material point of i at ``arm`` from its C, in space, seen from j."""
    of_i = V[:3] + ca.cross(i.R @ V[3:6], arm)
    return of_i - V[6:9] - ca.cross(j.R @ V[9:12], i.r + arm - j.r)


ROWS: dict[str, tuple[Callable[..., ca.SX], int, int]] = {  # rows, their number, number of parameters
    "point": (point_rows, 3, 6), "plane": (plane_row, 1, 9), "distance": (distance_row, 1, 7),
    "axis": (axis_rows, 2, 9), "lone axis": (lone_axis_row, 1, 6),
    "driven position": (driven_position_row, 1, 16), "driven angle": (driven_angle_row, 1, 16),
    "driven distance": (driven_distance_row, 1, 13),
    "disc": (disc_row, 1, 13), "knife edge": (knife_rate, 1, 13), "rolling": (rolling_rates, 2, 16),
}  # fmt: skip
MOVING = ("driven position", "driven angle", "driven distance", "disc")  # take the time
RATES = ("knife edge", "rolling")  # take velocities and time, and are phi_dot: there is no phi


class Pair(NamedTuple):
    """Two bodies and a function g(x_i, x_j) of their poses with its two rates along the motion."""

    i: Moving
    j: Moving
    value: ca.SX  # g
    A: ca.SX  # (., 12): g_dot = A (V_i, V_j), coordinate-free
    A_chart: ca.SX  # (., 12): g_dot = A_chart (u_i, u_j)
    rate: ca.SX  # g_dot
    acceleration: ca.SX  # g_ddot at the accelerations of i and j
    t: ca.SX  # what they read of time: 1 or 0


def joint_pair(kind: str, chart: Chart, parameters: ca.SX) -> Pair:
    """The rows of ``kind`` between two bodies."""
    i, j = moving(chart, "i"), moving(chart, "j")
    rows, n, _ = ROWS[kind]
    x_i, x_j, V, t = _pose("i"), _pose("j"), ca.SX.sym("V", 12), ca.SX.sym("t")
    if kind in RATES:
        return _pair(i, j, x_i, x_j, V, ca.SX.zeros(n), parameters, t, rows(x_i, x_j, V, parameters, t))
    if kind in MOVING:
        return _pair(i, j, x_i, x_j, V, rows(x_i, x_j, parameters, t), parameters, t)
    return _pair(i, j, x_i, x_j, V, rows(x_i, x_j, parameters), parameters)


def spring_pair(chart: Chart, parameters: ca.SX) -> Pair:
    """The distance l [m] of two points; parameters (p_i, p_j, ...)."""
    i, j = moving(chart, "i"), moving(chart, "j")
    x_i, x_j, V = _pose("i"), _pose("j"), ca.SX.sym("V", 12)
    return _pair(i, j, x_i, x_j, V, ca.norm_2(point_rows(x_i, x_j, parameters)), parameters)


def torsion_pair(chart: Chart, parameters: ca.SX) -> Pair:
    """The angle [rad] of u in i from theta_0 beyond e in j, within half a turn; parameters (u, e, b, k, theta_0, c)."""
    i, j = moving(chart, "i"), moving(chart, "j")
    x_i, x_j, V = _pose("i"), _pose("j"), ca.SX.sym("V", 12)
    u, e, b, rest = x_i.R @ parameters[:3], x_j.R @ parameters[3:6], x_j.R @ parameters[6:9], parameters[10]
    p, q = ca.dot(u, e), ca.dot(u, b)
    cosine, sine = ca.cos(rest), ca.sin(rest)
    return _pair(i, j, x_i, x_j, V, ca.atan2(q * cosine - p * sine, p * cosine + q * sine), parameters)


@lru_cache(ELEMENTS)
def row_element(kind: str, chart: Chart, level: str, alpha: float, beta: float) -> Element:
    """Parameters as in ``ROWS``; z ends with lam, then t. Outputs load_i, load_j = -A^T lam and c, the constraint row.

    ``level`` "acceleration": c = phi_ddot + 2 alpha phi_dot + beta^2 phi, Eq. (94); "velocity": phi_dot + alpha phi;
    "position": phi, Eq. (93); "both": (phi, phi_dot), and z has lam, eta, which adds G A^T eta to p_dot.
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


@lru_cache(ELEMENTS)
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
        "M_bar_dot": ca.jtimes(M_bar, p, p_dot) + (ca.jacobian(M_bar, pair.t) if pair.t.numel() else 0),
        "c": ca.vec(c),
    }
    return Element(_unknowns(pair), w, parameters, outputs)


@lru_cache(ELEMENTS)
def spring_element(chart: Chart) -> Element:
    """Parameters (p_i, p_j, k, d0, c); output the load -f on (i, j), f = -(k (l - d0) + c l_dot) dl/dx."""
    parameters = ca.SX.sym("spring", 9)
    pair = spring_pair(chart, parameters)
    k, d0, c = parameters[6], parameters[7], parameters[8]
    load = pair.A_chart.T @ (k * (pair.value - d0) + c * pair.rate)
    return Element(_unknowns(pair), _accelerations(pair), parameters, {"load": load})


@lru_cache(ELEMENTS)
def torsion_element(chart: Chart, *, chosen: bool = True) -> Element:
    """Parameters (u, e, b, k, theta_0, c); output the load on (i, j), or the wrench in V if not ``chosen``."""
    parameters = ca.SX.sym("torsion", 12)
    pair = torsion_pair(chart, parameters)
    pull = parameters[9] * pair.value + parameters[11] * pair.rate
    out = pair.A_chart.T @ pull if chosen else -pair.A.T @ pull
    return Element(_unknowns(pair), _accelerations(pair), parameters, {"load": out})


@lru_cache(ELEMENTS)
def load_element(chart: Chart, *, chosen: bool = True) -> Element:
    """Parameters (p, F, T, 1 if they turn with the body else 0, factor); output -B^T f, or f in V if not ``chosen``."""
    b, parameters, t = moving(chart, "i"), ca.SX.sym("load", 17), ca.SX.sym("t")
    p, F, T, follows = parameters[:3], parameters[3:6], parameters[6:9], parameters[9]
    F, T = (a * time_function(parameters[10:], t) for a in (F, T))
    R = b.pose.R
    force = ca.if_else(follows, R @ F, F)
    torque = ca.if_else(follows, T, R.T @ T)
    f = ca.vertcat(force, torque + ca.cross(p, R.T @ force))
    return Element(ca.vertcat(b.p, b.u, t), b.u_dot, parameters, {"load": -b.B.T @ f if chosen else f})


@lru_cache(ELEMENTS)
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


def _pair(
    i: Moving, j: Moving, x_i: Pose, x_j: Pose, V: ca.SX, g: ca.SX, parameters: ca.SX, t: ca.SX | None = None,
    rate: ca.SX | None = None,
) -> Pair:  # fmt: skip
    """With t, the partial derivatives by it are in both rates; with ``rate``, that of nothing (nonholonomic)."""
    x = ca.vertcat(x_i.flat(), x_j.flat())
    x_dot = _pose_rate(x_i, x_j, V)
    t = ca.SX(0, 1) if t is None else t
    at, at_dot = ca.vertcat(x, t), ca.vertcat(x_dot, ca.SX.ones(t.numel()))
    rate = ca.jtimes(g, at, at_dot) if rate is None else rate
    A, gamma = ca.jacobian(rate, V), ca.jtimes(rate, at, at_dot)
    free = ca.Function("pair", [x, V, parameters, t], [g, A, rate, gamma])
    here = ca.vertcat(i.pose.flat(), j.pose.flat())
    g, A, rate, gamma = free(here, ca.vertcat(i.V, j.V), parameters, t)
    B = ca.diagcat(i.B, j.B)
    return Pair(i, j, g, ca.densify(A), ca.densify(A @ B), rate, gamma + A @ ca.vertcat(i.V_dot, j.V_dot), t)


def _pose(end: str) -> Pose:
    return Pose(ca.SX.sym(f"r_{end}", 3), ca.SX.sym(f"R_{end}", 3, 3))


def _unknowns(pair: Pair, *more: ca.SX) -> ca.SX:
    return ca.vertcat(pair.i.p, pair.i.u, pair.j.p, pair.j.u, *more, pair.t)


def _accelerations(pair: Pair) -> ca.SX:
    return ca.vertcat(pair.i.u_dot, pair.j.u_dot)
