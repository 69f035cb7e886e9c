"""Evaluate route 1's rows of driven, rolling, knife-edge and rack joints: its moving rows.

A row is a force F at a point x and a torque T on body i, the opposite on j, with their rates:

    phi_dot = F . (v_i(x) - v_j(x)) + T . (omega_i - omega_j) + phi_t

with v_b(x) the velocity of body b's material point at x. One joint at a time; vectors are in space.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

ZERO = np.zeros(3)


class MovingRowRates(NamedTuple):
    """A moving row: its force and torque on body i for a multiplier of 1, and their rates at constant velocities."""

    phi: float
    phi_t: float
    phi_t_rate: float
    F: np.ndarray  # force on body i
    F_rate: np.ndarray
    T: np.ndarray  # torque on body i
    T_rate: np.ndarray
    x: np.ndarray  # [m] where F acts
    x_rate: np.ndarray

    def acceleration(self, i: "Body", j: "Body") -> float:
        """Return phi_ddot of the row if both bodies keep v and omega: the part without accelerations."""
        convective = cross(i.omega, self.x_rate - i.v) - cross(j.omega, self.x_rate - j.v)
        slip = i.velocity(self.x) - j.velocity(self.x)
        turning = self.T_rate @ (i.omega - j.omega)
        return self.F_rate @ slip + self.F @ convective + turning + self.phi_t_rate


class Body(NamedTuple):
    """The position of C, orientation, velocity and angular velocity of a body, in space."""

    r: np.ndarray
    R: np.ndarray
    v: np.ndarray
    omega: np.ndarray

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """Return the velocity [m/s] of the body's material point at ``x`` in space."""
        return self.v + cross(self.omega, x - self.r)


class Joint(NamedTuple):
    """The points [m] and directions of a joint in its bodies' frames, and its function of time f, f_dot, f_ddot."""

    s_i: np.ndarray
    s_j: np.ndarray
    u: np.ndarray
    n: np.ndarray
    length: float
    f: tuple[float, float, float]


def _evaluate_driven_position(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = n . d - f of a driven position, in a list.

    d is the distance vector of the joint's points, n a direction of body j, f the prescribed function of time.
    """
    x, n = i.r + i.R @ p.s_i, j.R @ p.n[0]
    phi = n @ (x - j.r - j.R @ p.s_j) - p.f[0]
    return [MovingRowRates(phi, -p.f[1], -p.f[2], n, cross(j.omega, n), ZERO, ZERO, x, i.velocity(x))]


def _evaluate_driven_distance(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = |d| - f of a driven distance, in a list.

    d is the distance vector of the joint's points, f the prescribed function of time.
    """
    x, y = i.r + i.R @ p.s_i, j.r + j.R @ p.s_j
    d, d_dot = x - y, i.velocity(x) - j.velocity(y)
    distance = np.sqrt(d @ d)
    e = d / distance
    e_dot = (d_dot - (e @ d_dot) * e) / distance
    return [MovingRowRates(distance - p.f[0], -p.f[1], -p.f[2], e, e_dot, ZERO, ZERO, x, i.velocity(x))]


def _evaluate_driven_angle(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = u . n(f) of a driven angle, in a list: a torque u x n(f) without a force.

    u is a direction of body i, n(f) one of body j that turns with the prescribed angle f about the joint's axis.
    """
    f, f_dot, f_ddot = p.f
    u, n_1, n_2 = i.R @ p.u, j.R @ p.n[0], j.R @ p.n[1]
    n, dn = n_1 * np.cos(f) + n_2 * np.sin(f), n_2 * np.cos(f) - n_1 * np.sin(f)
    u_dot = cross(i.omega, u)
    n_dot, dn_dot = cross(j.omega, n) + dn * f_dot, cross(j.omega, dn) - n * f_dot
    phi_t_rate = (u_dot @ dn + u @ dn_dot) * f_dot + u @ dn * f_ddot
    T_rate = cross(u_dot, n) + cross(u, n_dot)
    return [MovingRowRates(u @ n, u @ dn * f_dot, phi_t_rate, ZERO, ZERO, cross(u, n), T_rate, i.r, i.v)]


def _evaluate_knife_edge(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row u . (v_i - v_j) - f = 0 of a knife edge, in a list; it is nonholonomic, so that its phi is 0."""
    x, u = i.r + i.R @ p.s_i, i.R @ p.u
    return [MovingRowRates(0.0, -p.f[0], -p.f[1], u, cross(i.omega, u), ZERO, ZERO, x, i.velocity(x))]


def _evaluate_rolling_disc(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the three rows of a disc that rolls on a plane of body j.

    The first has the height of its lowest point as phi; the others prohibit slip there in two directions, with phi = 0.
    """
    centre, axis, n = i.r + i.R @ p.s_i, i.R @ p.u, j.R @ p.n[0]
    axis_dot, n_dot = cross(i.omega, axis), cross(j.omega, n)
    down = (n @ axis) * axis - n
    down_dot = (n_dot @ axis + n @ axis_dot) * axis + (n @ axis) * axis_dot - n_dot
    steep = np.sqrt(down @ down)
    x = centre + (p.length / steep) * down
    x_dot = i.velocity(centre) + p.length / steep * (down_dot - (down @ down_dot) / steep**2 * down)
    phi = n @ (x - j.r - j.R @ p.s_j)
    directions = [j.R @ direction for direction in p.n]
    return [
        MovingRowRates(phi if k == 0 else 0.0, 0.0, 0.0, direction, cross(j.omega, direction), ZERO, ZERO, x, x_dot)
        for k, direction in enumerate(directions)
    ]


def _evaluate_rack(i: Body, j: Body, p: Joint) -> list[MovingRowRates]:
    """Return the row phi = r theta - e . d of a rack and pinion, in a list: a force along the rack, and a torque.

    r [m] is the radius of the pinion, theta its angle, e the direction of the rack, d from the rack's point to the
    pinion's. phi is taken modulo whole turns. The torque is r if u is normal to the pinion's axis.
    """
    x, u, e, b = i.r + i.R @ p.s_i, i.R @ p.u, -(j.R @ p.n[1]), j.R @ p.n[0]
    axis = cross(e, b)
    ahead = cross(axis, u)
    square = ahead @ ahead
    u_dot, ahead_dot = cross(i.omega, u), cross(cross(j.omega, axis), u) + cross(axis, cross(i.omega, u))
    turn = cross(u, ahead)
    T = p.length / square * turn
    turn_dot = cross(u_dot, ahead) + cross(u, ahead_dot)
    T_rate = p.length / square * (turn_dot - 2.0 * (ahead @ ahead_dot) / square * turn)
    slip = np.arctan2(u @ b, u @ e) - e @ (x - j.r - j.R @ p.s_j) / p.length
    phi = p.length * (np.remainder(slip + np.pi, 2.0 * np.pi) - np.pi)
    return [MovingRowRates(phi, 0.0, 0.0, -e, -cross(j.omega, e), T, T_rate, x, i.velocity(x))]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a x b of two vectors (3,), without NumPy's overhead."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


ROW_FUNCTIONS: dict[str, Callable[[Body, Body, Joint], list[MovingRowRates]]] = {
    "driven position": _evaluate_driven_position,
    "driven angle": _evaluate_driven_angle,
    "driven distance": _evaluate_driven_distance,
    "knife edge": _evaluate_knife_edge,
    "rolling disc": _evaluate_rolling_disc,
    "rack and pinion": _evaluate_rack,
}
