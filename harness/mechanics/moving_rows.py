"""Evaluate moving rows: drives, which are functions f of time, and rows that restrict velocities alone (nonholonomic).

Every such row acts on both bodies by a force at one point and a torque, of opposite signs, so that::

    phi_dot = A v + phi_t = force . (v_i(x) - v_j(x)) + torque . (omega_i - omega_j) + phi_t

with v_b(x) the velocity of the material point of body b at x. In d = x_i - x_j, n = axis_j, directions in space::

    driven position   phi = n . d - f                force n at x_i           phi_t = -f_dot
    driven angle      phi = u . n(f) = sin(theta - f), theta from across_j to u = across_i about the axis;
                                                     0 half a turn away, too, where cos(theta - f) = -u . dn/df = -1
                                                     torque u x n(f)          phi_t = u . dn/df f_dot
                      n(f) = n_1 cos f + n_2 sin f, n_1 = axis x across_j, n_2 = axis x n_1
    driven distance   phi = |d| - f                  force d/|d| at x_i       phi_t = -f_dot
    knife edge        phi_dot = 0 alone              force axis_i at x_i      phi_t = -f
    rolling disc      phi = n . (x_c - x_j), x_c the disc's lowest point      force n at x_c
                      phi_dot = 0 alone, twice       tangents at x_c
    rack and pinion   phi = r theta - e . d, theta from e = across_j to u = across_i about the axis, the two together
                      within half a turn             force -e at x_i, torque r (u x (axis x u)) / |axis x u|^2

The reactions of these rows do work, since A v = -phi_t: their power -reaction . phi_t enters the energy balance.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from . import so3
from .ends import append_ground, apply_matrices, find_points, turn_vectors
from .joints import KINDS, Kind, MovingKind
from .naming import name_joint
from .state import States
from .system import MultibodySystem
from .time_functions import evaluate_functions


class MovingRowTerms(NamedTuple):
    """The terms of all moving rows in the order of phi; vectors in space."""

    joint: Int[np.ndarray, " m"]  # number of the joint
    row: Int[np.ndarray, " m"]  # its number in phi
    phi: Float[np.ndarray, "nt m"]
    phi_t: Float[np.ndarray, "nt m"]  # rate of phi at rest, by the function of time
    force: Float[np.ndarray, "nt m 3"]  # on body i for a reaction of 1; the opposite on j
    torque: Float[np.ndarray, "nt m 3"]  # likewise
    point: Float[np.ndarray, "nt m 3"]  # [m] where the force acts
    along: Float[np.ndarray, "nt m"]  # cos(theta - f) of driven angles, 1 of the others

    def rate(self, system: MultibodySystem, s: States) -> Float[np.ndarray, "nt m"]:
        """Return phi_dot of the moving rows (nt, m) at the velocities of ``s``."""
        r, v = (append_ground(a, np.zeros(3)) for a in (s.r, s.v))
        omega = append_ground(apply_matrices(s.R, s.Omega), np.zeros(3))
        seen, spin = np.zeros((2, *self.force.shape))
        for ends, sign in ((system.joint_i, 1.0), (system.joint_j, -1.0)):
            b = ends[self.joint]
            seen += sign * (v[:, b] + so3.cross(omega[:, b], self.point - r[:, b]))
            spin += sign * omega[:, b]
        return np.sum(self.force * seen + self.torque * spin, axis=-1) + self.phi_t


def evaluate_moving_rows(system: MultibodySystem, s: States) -> MovingRowTerms:
    """Evaluate phi, phi_t, force and torque of all moving rows at the times and poses of ``s``."""
    rows = system.moving_rows()
    joint = np.repeat(rows.joint, system.joint_moving[rows.joint])
    nt, m = len(s.r), len(joint)
    phi, phi_t, vectors, along = np.zeros((nt, m)), np.zeros((nt, m)), np.zeros((3, nt, m, 3)), np.ones((nt, m))
    if m:
        row = np.concatenate([k + np.arange(n) for k, n in zip(rows.row, system.joint_moving[rows.joint], strict=True)])
        x_i, x_j = find_points(system, s, rows.joint)
        u = turn_vectors(s, system.joint_i[rows.joint], system.joint_u[rows.joint])
        n = [turn_vectors(s, system.joint_j[rows.joint], system.joint_n[rows.joint, k]) for k in range(3)]
        f, f_dot, _ = (a.T for a in evaluate_functions(system.joint_motion[rows.joint], s.times))
        at = 0
        for k, kind in enumerate(rows.kind):
            here = [x_i[:, k], x_j[:, k], u[:, k], *(a[:, k] for a in n)]
            if kind == MovingKind.DRIVEN_ANGLE:
                along[:, at] = -_dot(here[2], _rotate_normal(here, f[k])[1])
            for made in ROWS_OF[kind](here, f[k], f_dot[k], float(system.joint_length[rows.joint[k]])):
                phi[:, at], phi_t[:, at], vectors[0, :, at], vectors[1, :, at], vectors[2, :, at] = made
                at += 1
    else:
        row = np.zeros(0, dtype=np.int64)
    return MovingRowTerms(joint, row, phi, phi_t, vectors[0], vectors[1], vectors[2], along)


SAMPLES, MOST_SAMPLES = 200, 1e6  # samples of a function of time: in a period of its sine, and in all


def check_lengths(system: MultibodySystem, t_end: float) -> None:
    """Raise ValueError unless driven distances stay above 0 up to ``t_end`` [s]: else d loses its direction."""
    for k in np.flatnonzero(system.joint_sort == KINDS.index(MovingKind.DRIVEN_DISTANCE)):
        numbers, swing = system.joint_motion[k].copy(), 0.0
        count = SAMPLES * abs(numbers[5]) * t_end / (2.0 * math.pi)
        if count > MOST_SAMPLES:  # so many periods that the sine is at its minimum wherever the cubic is
            swing, numbers[4], count = abs(numbers[4]), 0.0, 0.0
        t = np.linspace(0.0, t_end, 1000 + int(count))
        length, _, bend = (a[:, 0] for a in evaluate_functions(numbers[None], t))
        length = length - swing
        # bound on how much lower it may be between two samples
        low = ~(length > t[1] ** 2 / 8.0 * np.max(np.abs(bend)))
        if np.any(low):
            first = int(np.argmax(low))
            raise ValueError(
                f"the driven distance of {name_joint(system, int(k))} must be above 0 m up to t_end = {t_end:g} s "
                f"(got {length[first]:.3g} m at {t[first]:.3g} s)"
            )


Rows = list[tuple]  # (phi, phi_t, force, torque, point) of each row of a joint


def _driven_position(here: list[np.ndarray], f: np.ndarray, f_dot: np.ndarray, length: float) -> Rows:
    """Return the row of a driven position, from ``here``: (x_i, x_j, u, n_1, n_2, n_3) in space.

    Here and below f, f_dot are the values of the joint's function of time, ``length`` its radius [m] if it has one.
    """
    x_i, x_j, _, n, _, _ = here
    return [(_dot(n, x_i - x_j) - f, -f_dot, n, 0.0, x_i)]


def _driven_distance(here: list[np.ndarray], f: np.ndarray, f_dot: np.ndarray, length: float) -> Rows:
    """Return the row of a driven distance, |d| - f."""
    x_i, x_j = here[:2]
    distance = np.linalg.norm(x_i - x_j, axis=-1)
    return [(distance - f, -f_dot, (x_i - x_j) / distance[:, None], 0.0, x_i)]


def _driven_angle(here: list[np.ndarray], f: np.ndarray, f_dot: np.ndarray, length: float) -> Rows:
    """Return the row of a driven angle, u . n(f)."""
    x_i, _, u = here[:3]
    n, dn = _rotate_normal(here, f)
    return [(_dot(u, n), _dot(u, dn) * f_dot, 0.0, so3.cross(u, n), x_i)]


def _rotate_normal(here: list[np.ndarray], f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return n(f) of a driven angle, the direction to which u is normal, and dn/df, in space."""
    n_1, n_2, cosine, sine = here[3], here[4], np.cos(f)[:, None], np.sin(f)[:, None]
    return n_1 * cosine + n_2 * sine, n_2 * cosine - n_1 * sine


def _knife_edge(here: list[np.ndarray], f: np.ndarray, f_dot: np.ndarray, length: float) -> Rows:
    """Return the row of a knife edge, which has no phi."""
    return [(0.0, -f, here[2], 0.0, here[0])]


def _rolling(here: list[np.ndarray], f: np.ndarray, f_dot: np.ndarray, length: float) -> Rows:
    """Return the three rows of a rolling disc of radius ``length``: height and slip of its lowest point."""
    centre, x_j, axis, n, t_1, t_2 = here
    down = n - _dot(n, axis)[:, None] * axis
    x = centre - length * down / np.linalg.norm(down, axis=-1, keepdims=True)
    return [(_dot(n, x - x_j), 0.0, n, 0.0, x), (0.0, 0.0, t_1, 0.0, x), (0.0, 0.0, t_2, 0.0, x)]


def _rack(here: list[np.ndarray], f: np.ndarray, f_dot: np.ndarray, length: float) -> Rows:
    """Return the row of a rack and a pinion of radius ``length``, r theta - e . d within half a turn."""
    x_i, x_j, u, n_1, n_2 = here[:5]
    e, axis = -n_2, so3.cross(n_1, n_2)
    ahead = so3.cross(axis, u)  # direction in which u turns
    x = _dot(e, x_i - x_j)
    slip = np.arctan2(_dot(axis, so3.cross(e, u)), _dot(e, u)) - x / length
    phi = length * (np.remainder(slip + np.pi, 2.0 * np.pi) - np.pi)
    return [(phi, 0.0, -e, length * so3.cross(u, ahead) / _dot(ahead, ahead)[:, None], x_i)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    out: np.ndarray = np.sum(a * b, axis=-1)
    return out


ROWS_OF: dict[Kind, Callable[..., Rows]] = {
    MovingKind.DRIVEN_POSITION: _driven_position,
    MovingKind.DRIVEN_ANGLE: _driven_angle,
    MovingKind.DRIVEN_DISTANCE: _driven_distance,
    MovingKind.KNIFE_EDGE: _knife_edge,
    MovingKind.ROLLING: _rolling,
    "rack and pinion": _rack,
}
