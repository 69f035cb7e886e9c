"""Evaluate route 2's moving rows as functions of positions and directors, without angular velocity or cross product.

A point of a body is a sum p . X of X = (r, d_1, d_2, d_3) with constant weights p = (1, s), a direction one with p =
(0, u). For the ground X = (0, e_1, e_2, e_3). Arrays are stacked along time.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np


class Row(NamedTuple):
    """A moving row: phi, its Jacobian J by the X of both bodies, and the required values of J X_dot and J X_ddot."""

    phi: np.ndarray | float  # (nt,)
    J_i: np.ndarray  # (nt, 4, 3)
    J_j: np.ndarray  # likewise, of body j
    speed: np.ndarray  # (nt,) J X_dot = speed
    bend: np.ndarray  # (nt,) J X_ddot = bend


class Joint(NamedTuple):
    """The weights (4,) of a joint's points and directions, and its function of time with two derivatives (nt,)."""

    s_i: np.ndarray
    s_j: np.ndarray
    u: np.ndarray
    n: np.ndarray  # (3, 4)
    length: float
    f: tuple[np.ndarray, np.ndarray, np.ndarray]


Body = tuple[np.ndarray, np.ndarray]  # X and X_dot (nt, 4, 3)


def _driven_position(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row phi = n . d - f of a driven position, as a list of one; d is the gap of the joint's points."""
    (X, X_dot), (Y, Y_dot) = i, j
    d, n = p.s_i @ X - p.s_j @ Y, p.n[0] @ Y
    bend = p.f[2] - 2.0 * dot(p.s_i @ X_dot - p.s_j @ Y_dot, p.n[0] @ Y_dot)
    return [Row(dot(d, n) - p.f[0], outer(p.s_i, n), outer(p.n[0], d) - outer(p.s_j, n), p.f[1], bend)]


def _driven_distance(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row phi = (d . d - f^2) / 2 of a driven distance, as a list of one."""
    f, f_dot, f_ddot = p.f
    d, d_dot = p.s_i @ i[0] - p.s_j @ j[0], p.s_i @ i[1] - p.s_j @ j[1]
    bend = f_dot**2 + f * f_ddot - dot(d_dot, d_dot)
    return [Row(0.5 * (dot(d, d) - f * f), outer(p.s_i, d), -outer(p.s_j, d), f * f_dot, bend)]


def _driven_angle(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row phi = u . n(f) of a driven angle, as a list of one; the weights of n depend on time by f."""
    f, f_dot, f_ddot = p.f
    u, u_dot = p.u @ i[0], p.u @ i[1]
    ahead = np.cos(f)[:, None] * p.n[0] + np.sin(f)[:, None] * p.n[1]
    dahead = np.cos(f)[:, None] * p.n[1] - np.sin(f)[:, None] * p.n[0]
    n, dn = combine_directors(ahead, j[0]), combine_directors(dahead, j[0])
    n_dot = combine_directors(ahead, j[1]) + f_dot[:, None] * dn
    rest = 2.0 * f_dot[:, None] * combine_directors(dahead, j[1]) + f_ddot[:, None] * dn - (f_dot**2)[:, None] * n
    bend = -2.0 * dot(u_dot, n_dot) - dot(u, rest)
    return [Row(dot(u, n), outer(p.u, n), ahead[:, :, None] * u[:, None], -f_dot * dot(u, dn), bend)]


def _knife_edge(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row u . (v_i - v_j) = f of a knife edge, which has no phi, as a list of one."""
    return [_slip(i, j, p.u @ i[0], p.u @ i[1], p.s_i @ i[0], p.s_i @ i[1], p.f[:2])]


def _rolling(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the three rows of a rolling disc of radius L: its height n . d - L g, and no slip at the lowest point.

    That point is c - L (n - w axis) / g, with g^2 = 1 - w^2 and w = n . axis; it may not slip in two directions.
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
    bend = -2.0 * dot(n_dot, d_dot) - L / g**3 * w_dot**2 - 2.0 * tip[:, 0] * dot(n_dot, a_dot)
    height = Row(dot(n, d) - L * g, J_i, J_j, np.zeros(len(X)), bend)
    down = (w[:, None] * a - n) / g[:, None]
    down_dot = (w_dot[:, None] * a + w[:, None] * a_dot - n_dot + (w * w_dot / g)[:, None] * down) / g[:, None]
    x, x_dot = c + L * down, c_dot + L * down_dot
    still = (np.zeros(len(X)), np.zeros(len(X)))
    return [height, *(_slip(i, j, way @ Y, way @ Y_dot, x, x_dot, still) for way in p.n[1:])]


def _rack(i: Body, j: Body, p: Joint) -> list[Row]:
    """Return the row r (Q cos x - P sin x) = 0 of a rack and pinion, as a list of one; it contains no angle.

    r [m] is the radius of the pinion, r x the travel along the rack; P, Q are the components along and across the rack
    of the pinion's vector u. Of ``p``, the joint: points s_i, s_j, vectors u and n in coefficients of directors.
    """
    (X, X_dot), (Y, Y_dot), r = i, j, p.length
    along_, across = -p.n[1], p.n[0]
    u, u_dot, e, e_dot, b, b_dot = p.u @ X, p.u @ X_dot, along_ @ Y, along_ @ Y_dot, across @ Y, across @ Y_dot
    d, d_dot = p.s_i @ X - p.s_j @ Y, p.s_i @ X_dot - p.s_j @ Y_dot
    x, x_dot = dot(e, d) / r, (dot(e_dot, d) + dot(e, d_dot)) / r
    c, s = np.cos(x), np.sin(x)
    P, Q = dot(u, e), dot(u, b)
    P_dot, Q_dot = dot(u_dot, e) + dot(u, e_dot), dot(u_dot, b) + dot(u, b_dot)
    way = c[:, None] * b - s[:, None] * e
    reach = P * c + Q * s
    J_i = outer(p.u, r * way) - outer(p.s_i, reach[:, None] * e)
    J_j = r * (outer(across, c[:, None] * u) - outer(along_, s[:, None] * u))
    J_j += outer(p.s_j, reach[:, None] * e) - outer(along_, reach[:, None] * d)
    rest = c * 2.0 * dot(u_dot, b_dot) - s * 2.0 * dot(u_dot, e_dot) - 2.0 * (s * Q_dot + c * P_dot) * x_dot
    rest = r * (rest - (Q * c - P * s) * x_dot**2) - reach * 2.0 * dot(e_dot, d_dot)
    return [Row(r * (Q * c - P * s), J_i, J_j, np.zeros(len(X)), -rest)]


def _slip(
    i: Body, j: Body, t: np.ndarray, t_dot: np.ndarray, x: np.ndarray, x_dot: np.ndarray, f: tuple[np.ndarray, ...]
) -> Row:
    """Return the row t . (v_i - v_j) = f[0] at the point x for a direction t; f[1] is the rate of f[0].

    ``t_dot`` and ``x_dot`` are the rates of t and x. The body's material point at x has the weights (1, d_a . (x - r)).
    """
    J: list[np.ndarray] = []
    seen, bend = np.zeros_like(x), np.zeros_like(x)
    for (X, X_dot), sign in ((i, 1.0), (j, -1.0)):
        place, rate = x - X[:, 0], x_dot - X_dot[:, 0]
        weights = np.einsum("tac,tc->ta", X[:, 1:], place)
        weights_dot = np.einsum("tac,tc->ta", X_dot[:, 1:], place) + np.einsum("tac,tc->ta", X[:, 1:], rate)
        seen += sign * (X_dot[:, 0] + np.einsum("ta,tac->tc", weights, X_dot[:, 1:]))
        bend += sign * np.einsum("ta,tac->tc", weights_dot, X_dot[:, 1:])
        J.append(sign * np.insert(weights, 0, 1.0, axis=1)[:, :, None] * t[:, None])
    return Row(0.0, J[0], J[1], f[0], f[1] - dot(t_dot, seen) - dot(t, bend))


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a . b along the last axis."""
    out: np.ndarray = np.sum(a * b, axis=-1)
    return out


def outer(p: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the derivative (nt, 4, 3) of ``way`` . (p . X) by X, for constant weights p (4,)."""
    return p[:, None] * way[:, None]


def combine_directors(p: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return p . X (nt, 3) for weights p (nt, 4) that change with time."""
    return np.einsum("ta,tac->tc", p, X)


ROWS: dict[str, Callable[[Body, Body, Joint], list[Row]]] = {
    "driven position": _driven_position,
    "driven angle": _driven_angle,
    "driven distance": _driven_distance,
    "knife edge": _knife_edge,
    "rolling disc": _rolling,
    "rack and pinion": _rack,
}
