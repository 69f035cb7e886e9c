"""Evaluate route 2's rows of driven, rolling, knife-edge and rack joints: its moving rows.

They are functions of positions and directors, without angular velocity or cross product.

A point of a body is a sum p . X of X = (r, d_1, d_2, d_3) with constant weights p = (1, s), a direction one with p =
(0, u). For the ground X = (0, e_1, e_2, e_3). Arrays are stacked along time.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Row(NamedTuple):
    """A moving row: phi, its Jacobian J by X of both bodies, and the required values of J X_dot and J X_ddot."""

    phi: np.ndarray | float  # (nt,)
    J_i: np.ndarray  # (nt, 4, 3)
    J_j: np.ndarray  # likewise, of body j
    speed: np.ndarray  # (nt,) J X_dot = speed
    gamma: np.ndarray  # (nt,) J X_ddot = gamma makes phi_ddot = 0


class Joint(NamedTuple):
    """The weights (4,) of a joint's points and directions, and its function of time with two derivatives (nt,)."""

    s_i: np.ndarray
    s_j: np.ndarray
    u: np.ndarray
    n: np.ndarray  # (3, 4)
    length: float
    f: tuple[np.ndarray, np.ndarray, np.ndarray]


Body = tuple[np.ndarray, np.ndarray]  # X and X_dot (nt, 4, 3)


def _evaluate_driven_position(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row phi = n . d - f of a driven position, in a list.

    d is the distance vector of the joint's points, n a direction of body j, f the prescribed function of time.
    """
    (X, X_dot), (Y, Y_dot) = i, j
    d, n = p.s_i @ X - p.s_j @ Y, p.n[0] @ Y
    gamma = p.f[2] - 2.0 * dot(p.s_i @ X_dot - p.s_j @ Y_dot, p.n[0] @ Y_dot)
    return [Row(dot(d, n) - p.f[0], outer(p.s_i, n), outer(p.n[0], d) - outer(p.s_j, n), p.f[1], gamma)]


def _evaluate_driven_distance(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row phi = (d . d - f^2) / 2 of a driven distance, in a list.

    d is the distance vector of the joint's points, f the prescribed function of time.
    """
    f, f_dot, f_ddot = p.f
    d, d_dot = p.s_i @ i[0] - p.s_j @ j[0], p.s_i @ i[1] - p.s_j @ j[1]
    gamma = f_dot**2 + f * f_ddot - dot(d_dot, d_dot)
    return [Row(0.5 * (dot(d, d) - f * f), outer(p.s_i, d), -outer(p.s_j, d), f * f_dot, gamma)]


def _evaluate_driven_angle(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row phi = u . n(f) of a driven angle, in a list.

    u is a direction of body i, n(f) one of body j that turns with the prescribed angle f about the joint's axis.
    """
    f, f_dot, f_ddot = p.f
    u, u_dot = p.u @ i[0], p.u @ i[1]
    ahead = np.cos(f)[:, None] * p.n[0] + np.sin(f)[:, None] * p.n[1]
    dahead = np.cos(f)[:, None] * p.n[1] - np.sin(f)[:, None] * p.n[0]
    n, dn = combine_directors(ahead, j[0]), combine_directors(dahead, j[0])
    n_dot = combine_directors(ahead, j[1]) + f_dot[:, None] * dn
    rest = 2.0 * f_dot[:, None] * combine_directors(dahead, j[1]) + f_ddot[:, None] * dn - (f_dot**2)[:, None] * n
    gamma = -2.0 * dot(u_dot, n_dot) - dot(u, rest)
    return [Row(dot(u, n), outer(p.u, n), ahead[:, :, None] * u[:, None], -f_dot * dot(u, dn), gamma)]


def _evaluate_knife_edge(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row u . (v_i - v_j) = f of a knife edge, in a list; it is nonholonomic, so that its phi is 0."""
    return [_evaluate_slip(i, j, p.u @ i[0], p.u @ i[1], p.s_i @ i[0], p.s_i @ i[1], p.f[:2])]


def _evaluate_rolling_disc(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the three rows of a disc of radius L that rolls on a plane of body j with normal n.

    The first is its height n . d - L g = 0; the others prohibit slip in two directions at its lowest point,
    c - L (n - w axis) / g, with the centre c, g^2 = 1 - w^2 and w = n . axis.
    """
    (X, X_dot), (Y, Y_dot), L = i, j, p.length
    c, c_dot, a, a_dot = p.s_i @ X, p.s_i @ X_dot, p.u @ X, p.u @ X_dot
    d, d_dot = c - p.s_j @ Y, c_dot - p.s_j @ Y_dot
    n, n_dot = p.n[0] @ Y, p.n[0] @ Y_dot
    w, w_dot = dot(n, a), dot(n_dot, a) + dot(n, a_dot)
    g = np.sqrt(1.0 - w * w)
    tip = (L * w / g)[:, None]  # -L dg/dw
    J_i = outer(p.s_i, n) + outer(p.u, tip * n)
    J_j = outer(p.n[0], d + tip * a) - outer(p.s_j, n)
    gamma = -2.0 * dot(n_dot, d_dot) - L / g**3 * w_dot**2 - 2.0 * tip[:, 0] * dot(n_dot, a_dot)
    height = Row(dot(n, d) - L * g, J_i, J_j, np.zeros(len(X)), gamma)
    down = (w[:, None] * a - n) / g[:, None]
    down_dot = (w_dot[:, None] * a + w[:, None] * a_dot - n_dot + (w * w_dot / g)[:, None] * down) / g[:, None]
    x, x_dot = c + L * down, c_dot + L * down_dot
    still = (np.zeros(len(X)), np.zeros(len(X)))
    return [height, *(_evaluate_slip(i, j, direction @ Y, direction @ Y_dot, x, x_dot, still) for direction in p.n[1:])]


def _evaluate_rack(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row r (Q cos x - P sin x) = 0 of a rack and pinion, in a list; it holds at any number of turns.

    r [m] is the radius of the pinion, r x the travel along the rack; P, Q are the components along and across the rack
    of the pinion's vector u.
    """
    (X, X_dot), (Y, Y_dot), r = i, j, p.length
    along_, across = -p.n[1], p.n[0]
    u, u_dot, e, e_dot, b, b_dot = p.u @ X, p.u @ X_dot, along_ @ Y, along_ @ Y_dot, across @ Y, across @ Y_dot
    d, d_dot = p.s_i @ X - p.s_j @ Y, p.s_i @ X_dot - p.s_j @ Y_dot
    x, x_dot = dot(e, d) / r, (dot(e_dot, d) + dot(e, d_dot)) / r
    c, s = np.cos(x), np.sin(x)
    P, Q = dot(u, e), dot(u, b)
    P_dot, Q_dot = dot(u_dot, e) + dot(u, e_dot), dot(u_dot, b) + dot(u, b_dot)
    direction = c[:, None] * b - s[:, None] * e
    lever = P * c + Q * s
    J_i = outer(p.u, r * direction) - outer(p.s_i, lever[:, None] * e)
    J_j = r * (outer(across, c[:, None] * u) - outer(along_, s[:, None] * u))
    J_j += outer(p.s_j, lever[:, None] * e) - outer(along_, lever[:, None] * d)
    rest = c * 2.0 * dot(u_dot, b_dot) - s * 2.0 * dot(u_dot, e_dot) - 2.0 * (s * Q_dot + c * P_dot) * x_dot
    rest = r * (rest - (Q * c - P * s) * x_dot**2) - lever * 2.0 * dot(e_dot, d_dot)
    return [Row(r * (Q * c - P * s), J_i, J_j, np.zeros(len(X)), -rest)]


def _evaluate_slip(
    i: Body, j: Body, t: np.ndarray, t_dot: np.ndarray, x: np.ndarray, x_dot: np.ndarray, f: tuple[np.ndarray, ...]
) -> Row:
    """Return the velocity row t . (v_i - v_j) = f[0] at the point ``x`` [m] along the direction ``t``, both in space.

    ``t_dot``, ``x_dot`` and f[1] are the rates of t, x and f[0]. A body's material point at x has the weights
    (1, d_a . (x - r)).
    """
    J: list[np.ndarray] = []
    slip, convective = np.zeros_like(x), np.zeros_like(x)
    for (X, X_dot), sign in ((i, 1.0), (j, -1.0)):
        place, rate = x - X[:, 0], x_dot - X_dot[:, 0]
        weights = np.einsum("tac,tc->ta", X[:, 1:], place)
        weights_dot = np.einsum("tac,tc->ta", X_dot[:, 1:], place) + np.einsum("tac,tc->ta", X[:, 1:], rate)
        slip += sign * (X_dot[:, 0] + np.einsum("ta,tac->tc", weights, X_dot[:, 1:]))
        convective += sign * np.einsum("ta,tac->tc", weights_dot, X_dot[:, 1:])
        J.append(sign * np.insert(weights, 0, 1.0, axis=1)[:, :, None] * t[:, None])
    return Row(0.0, J[0], J[1], f[0], f[1] - dot(t_dot, slip) - dot(t, convective))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a . b along the last axis."""
    out: np.ndarray = np.sum(a * b, axis=-1)
    return out


def outer(p: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the derivative (nt, 4, 3) by X of ``direction`` . (p . X), for constant weights p (4,)."""
    return p[:, None] * direction[:, None]


def combine_directors(p: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return p . X (nt, 3), a point or direction in space, for weights p (nt, 4) that change with time."""
    return np.einsum("ta,tac->tc", p, X)


ROWS: dict[str, Callable[[Body, Body, Joint], list[Row]]] = {
    "driven position": _evaluate_driven_position,
    "driven angle": _evaluate_driven_angle,
    "driven distance": _evaluate_driven_distance,
    "knife edge": _evaluate_knife_edge,
    "rolling disc": _evaluate_rolling_disc,
    "rack and pinion": _evaluate_rack,
}
