"""A ``MultibodySystem`` as batches of symbolic elements, for the classical equations of motion, Eqs. (92)-(94).

Output of the assembly: (p_dot of the chart, e, c) with e = M u_dot + h - f - A^T lam and c the constraint rows.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from .assembly import Assembly, Batch
from .layout import Layout, Stabilised
from .symbolic import ROWS, body_element, row_element, spring_element


def equations_of_motion(layout: Layout, level: str, alpha: float, beta: float, *, differentiable: bool) -> Assembly:
    """(p_dot, e, c) over (p, u, lam) and w = u_dot; ``level`` of c as in ``row_element``."""
    batches = [body_batch(layout), spring_batch(layout)]
    for kind in ROWS:
        joints, rows = joint_rows(layout, kind)
        ends = pair_ends(layout, layout.system.joint_i[joints], layout.system.joint_j[joints])
        place = layout.row(rows)
        z, out = [ends.z, layout.multiplier(rows)], [ends.load, np.where(place < 0, -1, layout.lam.start + place)]
        if isinstance(layout, Stabilised):
            z.append(np.where(place < 0, z[1], layout.eta.start + place))
            out += [np.where(place < 0, -1, layout.eta.start + place), ends.p]
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
    parameters = np.concatenate((s.mass[:, None], s.inertia.reshape(-1, 9), gravity), axis=1)
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


def joint_rows(layout: Layout, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """The joints with rows of ``kind`` and the numbers of these rows in phi (m, 3 or 2)."""
    s = layout.system
    joints = np.arange(s.nj) if kind == "point" else np.flatnonzero(s.joint_revolute)
    first = s.row_start[joints] + (0 if kind == "point" else 3)
    return joints, first[:, None] + np.arange(ROWS[kind][1])


def row_parameters(layout: Layout, kind: str) -> np.ndarray:
    """Points (s_i, s_j) or axes (u, n_1, n_2) of the joints of ``joint_rows``."""
    s, (joints, _) = layout.system, joint_rows(layout, kind)
    if kind == "point":
        return np.concatenate((s.joint_s_i[joints], s.joint_s_j[joints]), axis=1)
    return np.concatenate((s.joint_u[joints], s.joint_n[joints].reshape(-1, 6)), axis=1)


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
