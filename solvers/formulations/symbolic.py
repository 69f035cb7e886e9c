"""Bodies, rows of joints and forces as CasADi expressions, one element of each kind, in any chart.

Rows and forces are those of their declarations (``rows.expressions``), on poses x = (r, R) and velocities
V = (r_dot [space], Omega [body]) with the flow x_dot = (r_dot, R hat(Omega)). A chart is substituted, V = B(p) u and
p_dot = G(p) u (module ``charts``)::

    body     e = B^T (M V_dot + (0, Omega x J Omega) - (m g, 0)),  V_dot = B u_dot + B_dot u
    rows     phi(x_i, x_j),  phi_dot = A V,  phi_ddot = A V_dot + gamma;  load on a body: -B^T A^T lam
    forces   load -B^T f

In 3-1-3 angles e is ``(M q_dot)' + h - f`` of Eqs. (63), (92) with M = blockdiag(m I, T^T J T). Nothing is divided
by a factor that vanishes at a chart's singularity, and all derivatives are exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from ...harness.base.code_meter import making_code
from ...harness.mechanics.forces import DECLARED
from .charts import Chart
from .rows.expressions import express_push, express_rows

ELEMENTS = 64  # elements of each kind that are kept for the next run


class SymbolicPose(NamedTuple):
    """The position r (3) and rotation R (3, 3) of one body, as expressions."""

    r: ca.SX
    R: ca.SX

    def flat(self) -> ca.SX:
        """Return r and the entries of R row by row, as one column (12)."""
        return ca.vertcat(self.r, ca.vec(self.R.T))


class MovingBody(NamedTuple):
    """A body in a chart: its coordinates and velocities as symbols, and the motion in space that they describe."""

    p: ca.SX
    u: ca.SX
    u_dot: ca.SX
    pose: SymbolicPose
    V: ca.SX
    V_dot: ca.SX
    B: ca.SX  # dV/du
    p_dot: ca.SX  # the flow, without ``Chart.restoring``


@dataclass(frozen=True, eq=False)
class Element:
    """The inputs (columns z, w, parameters) and outputs of one element; elements compare equal by identity.

    ``z`` are the element's inputs among the unknowns y, ``w`` those among the accelerations u_dot.
    """

    z: ca.SX
    w: ca.SX
    parameters: ca.SX
    outputs: dict[str, ca.SX]


def make_moving_body(chart: Chart, end: str) -> MovingBody:
    """Return a body with new symbols p, u and u_dot, and its motion in ``chart`` expressed by them.

    V = B(p) u is (v in space, Omega in the body's frame); V_dot and p_dot follow from p, u and u_dot. ``end`` is the
    suffix of the symbols' names, "i" or "j".
    """
    p, u, u_dot = ca.SX.sym(f"p_{end}", chart.size), ca.SX.sym(f"u_{end}", 6), ca.SX.sym(f"w_{end}", 6)
    V, p_dot = chart.body_velocity(p, u), chart.flow(p, u)
    B = ca.jacobian(V, u)
    V_dot = B @ u_dot + ca.jtimes(V, p, p_dot)
    return MovingBody(p, u, u_dot, SymbolicPose(p[:3], chart.rotation(p)), V, V_dot, B, p_dot)


@lru_cache(ELEMENTS)
@making_code
def make_body_element(chart: Chart) -> Element:
    """Return the element of a body: parameters m, J (9), g (3); outputs "rate" = p_dot and "e", the unbalanced load."""
    b = make_moving_body(chart, "i")
    parameters = ca.SX.sym("body", 13)
    m, J, g = parameters[0], ca.reshape(parameters[1:10], 3, 3), parameters[10:]
    Omega = b.V[3:]
    force = m * (b.V_dot[:3] - g)
    torque = J @ b.V_dot[3:] + ca.cross(Omega, J @ Omega)
    e = b.B.T @ ca.vertcat(force, torque)
    rate = b.p_dot + chart.restoring(b.p)
    return Element(ca.vertcat(b.p, b.u), b.u_dot, parameters, {"rate": rate, "e": e})


class JointRows(NamedTuple):
    """The rows phi of one kind of joint between two bodies, with their first and second rate along the motion.

    Rows of velocities alone have no phi.
    """

    i: MovingBody
    j: MovingBody
    numbers: ca.SX
    t: ca.SX
    value: ca.SX  # phi
    A: ca.SX  # (., 12): phi_dot = A (V_i, V_j) + phi_t, coordinate-free
    A_chart: ca.SX  # (., 12): phi_dot = A_chart (u_i, u_j) + phi_t
    rate: ca.SX  # phi_dot
    acceleration: ca.SX  # phi_ddot at the accelerations of i and j


def make_joint_rows(kind: str, chart: Chart) -> JointRows:
    """Return the constraint rows of a joint of kind ``kind`` between two bodies, in ``chart``."""
    e, i, j = express_rows(kind), make_moving_body(chart, "i"), make_moving_body(chart, "j")
    free = ca.Function("rows", [e.x, e.V, e.t, e.numbers], [e.phi, e.A, e.phi_dot, e.gamma])
    phi, A, phi_dot, gamma = free(*_stack_motion(i, j), e.t, e.numbers)
    A_chart = ca.densify(A @ ca.diagcat(i.B, j.B))
    return JointRows(i, j, e.numbers, e.t, phi, A, A_chart, phi_dot, gamma + A @ ca.vertcat(i.V_dot, j.V_dot))


@lru_cache(ELEMENTS)
@making_code
def make_row_element(kind: str, chart: Chart, level: str, alpha: float, beta: float) -> Element:
    """Return the element of a joint: inputs z end with lam, then t; outputs are its load on both bodies and c.

    Its parameters are those of ``list_joint_parameters``. Output "load" is -A^T lam (12,), "c" are the constraint rows
    at a ``level``. "acceleration": phi_ddot + 2 alpha phi_dot + beta^2 phi, Eq. (94); "velocity": phi_dot + alpha phi;
    "position": phi, Eq. (93); "both": phi, with phi_dot as output "c_dot"; z then has lam and eta, and output "moved"
    is G A^T eta, a term of p_dot. ``alpha`` and ``beta`` [1/s] are Baumgarte's.
    """
    pair = make_joint_rows(kind, chart)
    n = pair.value.numel()
    lam = ca.SX.sym("lam", n)
    load = -pair.A_chart.T @ lam
    if level == "both":
        eta = ca.SX.sym("eta", n)
        slip = pair.A_chart.T @ eta  # a velocity
        moved = ca.vertcat(chart.flow(pair.i.p, slip[:6]), chart.flow(pair.j.p, slip[6:]))
        outputs = {"load": load, "c": pair.value, "c_dot": pair.rate, "moved": moved}
        return Element(_stack_unknowns(pair, lam, eta), _stack_accelerations(pair), pair.numbers, outputs)
    c = {
        "position": pair.value,
        "velocity": pair.rate + alpha * pair.value,
        "acceleration": pair.acceleration + 2.0 * alpha * pair.rate + beta**2 * pair.value,
    }[level]
    return Element(_stack_unknowns(pair, lam), _stack_accelerations(pair), pair.numbers, {"load": load, "c": c})


@lru_cache(ELEMENTS)
@making_code
def make_jacobian_element(kind: str, chart: Chart) -> Element:
    """Return the element whose output is A of a joint's constraint rows in the chart, column by column."""
    pair = make_joint_rows(kind, chart)
    return Element(_stack_unknowns(pair), _stack_accelerations(pair), pair.numbers, {"A": ca.vec(pair.A_chart)})


DIRECTIONS = ("a", "mass", "translation")


@lru_cache(ELEMENTS)
@making_code
def make_strong_row_element(kind: str, chart: Chart, direction: str = "a") -> Element:
    """Return the element with the terms of Eq. (65) for the rows of a joint, at u_dot = 0.

    Parameters: ``list_joint_parameters``, then m_i, J_i, m_j, J_j, and 1 if j moves, else 0. Outputs: A in the chart,
    ``gamma`` = phi_ddot, phi_dot, phi, M_bar, M_bar_dot and c. The last three are taken in the coordinate-free
    velocities V, with a . c = 1 by Eq. (31) and M_bar = c^T M c by Eq. (30), so that they do not depend on the chart.
    ``direction`` of c: "a" a / (a . a); "mass" M^-1 a / (a . M^-1 a); "translation" (e_k, 0) on the first body, for
    point rows. Matrices are stored column by column; the ground has no part in a.
    """
    pair, body = make_joint_rows(kind, chart), ca.SX.sym("bodies", 21)
    n = pair.value.numel()
    a = pair.A @ ca.diagcat(ca.SX.eye(6), body[20] * ca.SX.eye(6))
    M = ca.diagcat(*[ca.diagcat(body[k] * ca.SX.eye(3), ca.reshape(body[k + 1 : k + 10], 3, 3)) for k in (0, 10)])
    if direction == "translation":
        c = ca.horzcat(ca.SX.eye(n), ca.SX.zeros(n, 12 - n))
    else:
        c = a if direction == "a" else ca.solve(M, a.T).T
        c = c / ca.repmat(ca.sum2(a * c), 1, 12)
    M_bar = ca.sum2((c @ M) * c)
    p, p_dot = ca.vertcat(pair.i.p, pair.j.p), ca.vertcat(pair.i.p_dot, pair.j.p_dot)
    w = _stack_accelerations(pair)
    outputs = {
        "A": ca.vec(pair.A_chart),
        "gamma": ca.substitute(pair.acceleration, w, ca.SX.zeros(12)),
        "phi_dot": pair.rate,
        "phi": pair.value,
        "M_bar": M_bar,
        "M_bar_dot": ca.jtimes(M_bar, p, p_dot) + ca.jacobian(M_bar, pair.t),
        "c": ca.vec(c),
    }
    return Element(_stack_unknowns(pair), w, ca.vertcat(pair.numbers, body), outputs)


@lru_cache(ELEMENTS)
@making_code
def make_force_element(kind: str, chart: Chart, *, in_chart: bool = True) -> Element:
    """Return the element of a force of kind ``kind``, with parameters ``list_force_parameters`` and output "load".

    The load is -B^T f in the chart's velocities if ``in_chart``, else f itself in the velocities V. It acts on bodies i
    and j, or on i alone if the kind acts on one body.
    """
    e, i, j = express_push(kind), make_moving_body(chart, "i"), make_moving_body(chart, "j")
    (f,) = ca.Function("push", [e.x, e.V, e.t, e.numbers], [e.load]).call([*_stack_motion(i, j), e.t, e.numbers])
    if DECLARED[kind].pair:
        return make_load_element((i, j), f, e.numbers, e.t, in_chart=in_chart)
    return make_load_element((i,), f[:6], e.numbers, e.t, in_chart=in_chart)


def make_load_element(
    bodies: Sequence[MovingBody], f: ca.SX, parameters: ca.SX, t: ca.SX, *, in_chart: bool
) -> Element:
    """Return the element of a force ``f``, given by six components in V for each of ``bodies``.

    Its output "load" is -B^T f in the chart's velocities, a term of e, if ``in_chart``; else it is f. Inputs z end with
    ``t``; ``parameters`` are the symbols that ``f`` depends on.
    """
    load = -ca.diagcat(*[b.B for b in bodies]).T @ f if in_chart else f
    z = ca.vertcat(*[part for b in bodies for part in (b.p, b.u)], t)
    return Element(z, ca.vertcat(*[b.u_dot for b in bodies]), parameters, {"load": ca.densify(load)})


@lru_cache(ELEMENTS)
@making_code
def make_spring_derivative_element(chart: Chart) -> Element:
    """Return the element of a spring's derivatives: parameters ``list_force_parameters``; "damping" and "stiffness".

    These outputs are -df/dV and -df/dx, each 12 x 12 and stored column by column, of the load f (12) on both bodies. V
    is (r_dot in space, Omega in the body) of both, not the chart's velocities, and a change dx of pose is a
    displacement along V. C_bar and K_bar of Eq. (32) are made of these.
    """
    e, i, j = express_push("spring"), make_moving_body(chart, "i"), make_moving_body(chart, "j")
    free = ca.Function("spring", [e.x, e.V, e.t, e.numbers], [-e.velocity_slopes, -e.pose_slopes])
    damping, stiffness = free(*_stack_motion(i, j), e.t, e.numbers)
    outputs = {"damping": ca.vec(damping), "stiffness": ca.vec(stiffness)}
    z = ca.vertcat(i.p, i.u, j.p, j.u, e.t)
    return Element(z, ca.vertcat(i.u_dot, j.u_dot), e.numbers, outputs)


def _stack_motion(i: MovingBody, j: MovingBody) -> tuple[ca.SX, ca.SX]:
    """Return the poses x (24) and velocities V (12) of two bodies, in the order of ``rows.expressions``."""
    return ca.vertcat(i.pose.flat(), j.pose.flat()), ca.vertcat(i.V, j.V)


def _stack_unknowns(pair: JointRows, *more: ca.SX) -> ca.SX:
    """Return the inputs z of an element of two bodies: (p, u) of both, then ``more``, then the time."""
    return ca.vertcat(pair.i.p, pair.i.u, pair.j.p, pair.j.u, *more, pair.t)


def _stack_accelerations(pair: JointRows) -> ca.SX:
    """Return the inputs w of an element of two bodies: u_dot of both."""
    return ca.vertcat(pair.i.u_dot, pair.j.u_dot)
