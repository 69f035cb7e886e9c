"""A ``MultibodySystem`` as batches of symbolic elements, for the classical equations of motion, Eqs. (92)-(94).

Output of the assembly: (p_dot of the chart, e, c) with e = M u_dot + h - f - A^T lam and c the constraint rows.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from ...harness.mechanics.joints import MovingKind
from .assembly import Assembly, Batch
from .layout import Layout, Stabilised
from .symbolic import MOVING, RATES, ROWS, body_element, load_element, row_element, spring_element, torsion_element
from .traced import user_element


def equations_of_motion(layout: Layout, level: str, alpha: float, beta: float, *, differentiable: bool) -> Assembly:
    """(p_dot, e, c) over (p, u, lam) and w = u_dot; ``level`` of c as in ``row_element``."""
    batches = [body_batch(layout), spring_batch(layout), *load_batches(layout)]
    for kind in kinds_of(layout):
        joints, rows = joint_rows(layout, kind)
        ends = pair_ends(layout, layout.system.joint_i[joints], layout.system.joint_j[joints])
        place = layout.row(rows)
        z, out = [ends.z, layout.multiplier(rows)], [ends.load, np.where(place < 0, -1, layout.lam.start + place)]
        if isinstance(layout, Stabilised):
            z.append(np.where(place < 0, z[1], layout.eta.start + place))
            out += [np.where(place < 0, -1, layout.eta.start + place), ends.p]
        z += time_of(layout, kind, len(joints))
        batches.append(
            Batch(
                row_element(kind, layout.chart, level, alpha, beta),
                row_parameters(layout, kind),
                np.concatenate(z, axis=1),
                ends.w,
                np.concatenate(out, axis=1),
            )
        )
    return Assembly(layout, batches, layout.n, differentiable=differentiable)


def body_batch(layout: Layout) -> Batch:
    """All bodies with gravity: (p_dot, e)."""
    s, everyone = layout.system, np.arange(layout.system.nb)
    gravity = np.broadcast_to(s.gravity, (s.nb, 3))
    parameters = np.concatenate((s.mass[:, None], s.solved_inertia.reshape(-1, 9), gravity), axis=1)
    place = layout.body(everyone)  # (p_dot, e) are numbered as (p, u)
    return Batch(body_element(layout.chart), parameters, place, layout.velocity(everyone), place)


def spring_batch(layout: Layout) -> Batch:
    """All spring-dampers: their loads on e."""
    s = layout.system
    ends = pair_ends(layout, s.spring_i, s.spring_j)
    return Batch(spring_element(layout.chart), spring_parameters(layout), ends.z, ends.w, ends.load)


def spring_parameters(layout: Layout) -> np.ndarray:
    """(p_i, p_j, k, d0, c) of each spring (ns, 9)."""
    s = layout.system
    return np.concatenate((s.spring_p_i, s.spring_p_j, np.stack((s.spring_k, s.spring_d0, s.spring_c), axis=1)), axis=1)


def _torsion_batch(layout: Layout, chosen: bool) -> Batch:
    s = layout.system
    ends = pair_ends(layout, s.torsion_i, s.torsion_j)
    numbers = np.stack((s.torsion_k, s.torsion_rest, s.torsion_c), axis=1)
    parameters = np.concatenate((s.torsion_u, s.torsion_n.reshape(-1, 6), numbers), axis=1)
    out = ends.load if chosen else np.where(ends.w < layout.n_u, ends.w, -1)
    return Batch(torsion_element(layout.chart, chosen=chosen), parameters, ends.z, ends.w, out)


def load_batches(layout: Layout, *, chosen: bool = True) -> list[Batch]:
    """Torsional springs, loads and user forces on e, or in V on (nb, 6) if not ``chosen``."""
    users = [_user_batch(layout, k, chosen) for k in range(len(layout.system.user_i))]
    return [_torsion_batch(layout, chosen), _load_batch(layout, chosen), *users]


def _user_batch(layout: Layout, k: int, chosen: bool) -> Batch:
    s = layout.system
    ends = pair_ends(layout, s.user_i[k : k + 1], s.user_j[k : k + 1])
    out = ends.load if chosen else np.where(ends.w < layout.n_u, ends.w, -1)
    element = user_element(s.user_law[k], layout.chart, chosen=chosen)
    return Batch(element, np.zeros((1, 0)), np.append(ends.z, [[layout.time]], axis=1), ends.w, out)


def _load_batch(layout: Layout, chosen: bool) -> Batch:
    s = layout.system
    parts = (s.load_p, s.load_force, s.load_torque, s.load_follows[:, None].astype(float), s.load_factor)
    w = layout.velocity(s.load_i)
    out = layout.n_p + w if chosen else w
    z = np.concatenate((layout.body(s.load_i), np.full((len(s.load_i), 1), layout.time)), axis=1)
    return Batch(load_element(layout.chart, chosen=chosen), np.concatenate(parts, axis=1), z, w, out)


def kinds_of(layout: Layout) -> list[str]:
    """The kinds of rows that the system has."""
    return [kind for kind in ROWS if len(joint_rows(layout, kind)[0])]


def time_of(layout: Layout, kind: str, m: int) -> list[np.ndarray]:
    """What ``m`` elements of ``kind`` read behind their other z."""
    return [np.full((m, 1), layout.time)] if kind in (*MOVING, *RATES) else []


MOVING_OF = {
    "driven position": MovingKind.DRIVEN_POSITION, "driven angle": MovingKind.DRIVEN_ANGLE,
    "driven distance": MovingKind.DRIVEN_DISTANCE,
    "disc": MovingKind.ROLLING, "knife edge": MovingKind.KNIFE_EDGE, "rolling": MovingKind.ROLLING,
}  # fmt: skip


def joint_rows(layout: Layout, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """The joints with rows of ``kind``, once for each of its elements, and the numbers of these rows in phi (m, .)."""
    s = layout.system
    if kind == "point":
        return s.point_rows()
    if kind in ("plane", "distance"):
        line = s.line_rows()
        own = (line.length > 0.0) == (kind == "distance")
        return line.joint[own], line.row[own][:, None]
    if kind in MOVING_OF:
        moving = s.moving_rows()
        own = np.array([one == MOVING_OF[kind] for one in moving.kind], dtype=bool)
        first, n = (1, 2) if kind == "rolling" else (0, 1)  # a disc's rows: its height, then two of its slip
        return moving.joint[own], moving.row[own][:, None] + first + np.arange(n)
    first = s.row_start[:-1] + s.joint_points + s.joint_lines
    if kind == "axis":  # the two of a common axis
        joints = np.flatnonzero(s.joint_axes >= 2)
        return joints, first[joints][:, None] + np.arange(2)
    joints = np.flatnonzero(s.joint_axes % 2)
    return joints, (first + s.joint_axes - 1)[joints][:, None]


def row_parameters(layout: Layout, kind: str) -> np.ndarray:
    """Of the elements of ``joint_rows``, as ``ROWS`` has them."""
    s, (joints, rows) = layout.system, joint_rows(layout, kind)
    points = np.concatenate((s.joint_s_i[joints], s.joint_s_j[joints]), axis=1)
    if kind == "point":
        return points
    if kind == "axis":
        return np.concatenate((s.joint_u[joints], s.joint_n[joints, :2].reshape(-1, 6)), axis=1)
    if kind == "lone axis":
        axis = s.axis_rows()
        own = np.searchsorted(axis.row, rows[:, 0])
        return np.concatenate((axis.u[own], axis.n[own]), axis=1)
    if kind in MOVING_OF:
        u, n, f, r = s.joint_u[joints], s.joint_n[joints], s.joint_motion[joints], s.joint_length[joints, None]
        parts = {
            "driven position": (points, n[:, 0], f), "driven angle": (u, n[:, 0], n[:, 1], f),
            "driven distance": (points, f),
            "disc": (points, n[:, 0], u, r), "knife edge": (points[:, :3], u, f),
            "rolling": (points[:, :3], n[:, 0], u, r, n[:, 1], n[:, 2]),
        }  # fmt: skip
        return np.concatenate(parts[kind], axis=1)
    line = s.line_rows()
    own = np.searchsorted(line.row, rows[:, 0])
    return np.concatenate((points, line.n[own] if kind == "plane" else line.length[own, None]), axis=1)


class PairEnds(NamedTuple):
    """What two-body parts read of (p, u) and of u_dot, where their loads go and their p: the ground's nowhere."""

    z: Int[np.ndarray, "m n_z"]
    w: Int[np.ndarray, "m 12"]
    load: Int[np.ndarray, "m 12"]
    p: Int[np.ndarray, "m n_p"]


def pair_ends(layout: Layout, i: Int[np.ndarray, " m"], j: Int[np.ndarray, " m"]) -> PairEnds:
    """Indices of parts between bodies ``i`` and ``j``."""
    z = np.concatenate((layout.body(i), layout.body(j)), axis=1)
    w = np.concatenate((layout.velocity(i), layout.velocity(j)), axis=1)
    p = np.concatenate([layout.body(end)[:, : layout.chart.size] for end in (i, j)], axis=1)
    return PairEnds(z, w, np.where(w < layout.n_u, layout.n_p + w, -1), np.where(p < layout.n_p, p, -1))
