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
    cosine: Float[np.ndarray, "nt m"]  # cos(theta - f) of driven angles, 1 of the others

    def rate(self, system: MultibodySystem, s: States) -> Float[np.ndarray, "nt m"]:
        """Return phi_dot of the moving rows at the velocities of ``s``, by the module's first equation."""
        r, v = (append_ground(a, np.zeros(3)) for a in (s.r, s.v))
        omega = append_ground(apply_matrices(s.R, s.Omega), np.zeros(3))
        slip, spin = np.zeros((2, *self.force.shape))  # v_i - v_j at the point, omega_i - omega_j
        for ends, sign in ((system.joint_i, 1.0), (system.joint_j, -1.0)):
            b = ends[self.joint]
            slip += sign * (v[:, b] + so3.cross(omega[:, b], self.point - r[:, b]))
            spin += sign * omega[:, b]
        return np.sum(self.force * slip + self.torque * spin, axis=-1) + self.phi_t


def evaluate_moving_rows(system: MultibodySystem, s: States) -> MovingRowTerms:
    """Evaluate phi, phi_t, forces, torques and points of all moving rows at the times and poses of ``s``."""
    rows = system.moving_rows()
    joint = np.repeat(rows.joint, system.joint_moving[rows.joint])
    nt, m = len(s.r), len(joint)
    phi, phi_t, vectors, cosine = np.zeros((nt, m)), np.zeros((nt, m)), np.zeros((3, nt, m, 3)), np.ones((nt, m))
    if m:
        row = np.concatenate([k + np.arange(n) for k, n in zip(rows.row, system.joint_moving[rows.joint], strict=True)])
        x_i, x_j = find_points(system, s, rows.joint)
        u = turn_vectors(s, system.joint_i[rows.joint], system.joint_u[rows.joint])
        n = [turn_vectors(s, system.joint_j[rows.joint], system.joint_n[rows.joint, k]) for k in range(3)]
        f, f_dot, _ = (a.T for a in evaluate_functions(system.joint_motion[rows.joint], s.times))
        at = 0
        for k, kind in enumerate(rows.kind):
            v = _JointVectors(x_i[:, k], x_j[:, k], u[:, k], *(a[:, k] for a in n))
            if kind == MovingKind.DRIVEN_ANGLE:
                cosine[:, at] = -_dot(v.u, _rotate_normal(v, f[k])[1])
            for terms in ROWS_OF[kind](v, f[k], f_dot[k], float(system.joint_length[rows.joint[k]])):
                phi[:, at], phi_t[:, at], vectors[0, :, at], vectors[1, :, at], vectors[2, :, at] = terms
                at += 1
    else:
        row = np.zeros(0, dtype=np.int64)
    return MovingRowTerms(joint, row, phi, phi_t, vectors[0], vectors[1], vectors[2], cosine)


SAMPLES, MOST_SAMPLES = 200, 1e6  # samples of a function of time: in a period of its sine, and in all


def check_lengths(system: MultibodySystem, t_end: float) -> None:
    """Raise ValueError unless driven distances stay above 0 m up to ``t_end`` [s]: at 0, d has no direction.

    Each f(t) is sampled; where its sine has too many periods for that, the cubic less the amplitude must stay above 0.
    """
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


class _JointVectors(NamedTuple):
    """The points [m] and unit vectors of a joint in space at each time, (nt, 3) each."""

    x_i: np.ndarray
    x_j: np.ndarray
    u: np.ndarray  # fixed in body i
    n_1: np.ndarray  # fixed in body j, as the next two
    n_2: np.ndarray
    n_3: np.ndarray


class _RowTerms(NamedTuple):
    """The terms of one moving row at each time, as in ``MovingRowTerms``; a lone 0 stands for zeros."""

    phi: np.ndarray | float
    phi_t: np.ndarray | float
    force: np.ndarray | float
    torque: np.ndarray | float
    point: np.ndarray


def _evaluate_driven_position(v: _JointVectors, f: np.ndarray, f_dot: np.ndarray, length: float) -> list[_RowTerms]:
    """Return the row of a driven position, n_1 . d - f(t); ``f`` and ``f_dot`` are values at each time."""
    return [_RowTerms(_dot(v.n_1, v.x_i - v.x_j) - f, -f_dot, v.n_1, 0.0, v.x_i)]


def _evaluate_driven_distance(v: _JointVectors, f: np.ndarray, f_dot: np.ndarray, length: float) -> list[_RowTerms]:
    """Return the row of a driven distance, |d| - f(t); ``f`` and ``f_dot`` are values at each time."""
    distance = np.linalg.norm(v.x_i - v.x_j, axis=-1)
    return [_RowTerms(distance - f, -f_dot, (v.x_i - v.x_j) / distance[:, None], 0.0, v.x_i)]


def _evaluate_driven_angle(v: _JointVectors, f: np.ndarray, f_dot: np.ndarray, length: float) -> list[_RowTerms]:
    """Return the row of a driven angle, u . n(f) = sin(theta - f); ``f`` and ``f_dot`` are values at each time."""
    n, dn = _rotate_normal(v, f)
    return [_RowTerms(_dot(v.u, n), _dot(v.u, dn) * f_dot, 0.0, so3.cross(v.u, n), v.x_i)]


def _rotate_normal(v: _JointVectors, f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return n(f) = n_1 cos f + n_2 sin f of a driven angle, to which u must be normal, and dn/df, in space."""
    cosine, sine = np.cos(f)[:, None], np.sin(f)[:, None]
    return v.n_1 * cosine + v.n_2 * sine, v.n_2 * cosine - v.n_1 * sine


def _evaluate_knife_edge(v: _JointVectors, f: np.ndarray, f_dot: np.ndarray, length: float) -> list[_RowTerms]:
    """Return the row of a knife edge, which has no phi; ``f`` [m/s] is the prescribed velocity across the blade."""
    return [_RowTerms(0.0, -f, v.u, 0.0, v.x_i)]


def _evaluate_rolling_disc(v: _JointVectors, f: np.ndarray, f_dot: np.ndarray, length: float) -> list[_RowTerms]:
    """Return the rows of a rolling disc of radius ``length``: height of its lowest point, slip along two tangents."""
    normal, axis = v.n_1, v.u
    down = normal - _dot(normal, axis)[:, None] * axis
    x = v.x_i - length * down / np.linalg.norm(down, axis=-1, keepdims=True)
    height = _RowTerms(_dot(normal, x - v.x_j), 0.0, normal, 0.0, x)
    return [height, _RowTerms(0.0, 0.0, v.n_2, 0.0, x), _RowTerms(0.0, 0.0, v.n_3, 0.0, x)]


def _evaluate_rack_and_pinion(v: _JointVectors, f: np.ndarray, f_dot: np.ndarray, length: float) -> list[_RowTerms]:
    """Return the row r theta - e . d of a rack and a pinion of radius r = ``length``, kept within half a turn of 0."""
    e, axis = -v.n_2, so3.cross(v.n_1, v.n_2)
    ahead = so3.cross(axis, v.u)  # direction in which u turns
    x = _dot(e, v.x_i - v.x_j)
    slip = np.arctan2(_dot(axis, so3.cross(e, v.u)), _dot(e, v.u)) - x / length
    phi = length * (np.remainder(slip + np.pi, 2.0 * np.pi) - np.pi)
    return [_RowTerms(phi, 0.0, -e, length * so3.cross(v.u, ahead) / _dot(ahead, ahead)[:, None], v.x_i)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return a . b for vectors in the last axis."""
    out: np.ndarray = np.sum(a * b, axis=-1)
    return out


ROWS_OF: dict[Kind, Callable[..., list[_RowTerms]]] = {
    MovingKind.DRIVEN_POSITION: _evaluate_driven_position,
    MovingKind.DRIVEN_ANGLE: _evaluate_driven_angle,
    MovingKind.DRIVEN_DISTANCE: _evaluate_driven_distance,
    MovingKind.KNIFE_EDGE: _evaluate_knife_edge,
    MovingKind.ROLLING: _evaluate_rolling_disc,
    "rack and pinion": _evaluate_rack_and_pinion,
}
