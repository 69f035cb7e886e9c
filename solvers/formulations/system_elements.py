"""A ``MultibodySystem`` as batches of symbolic elements, for the classical equations of motion, Eqs. (92)-(94).

The output of the assembly is (p_dot of the chart, e, c) with e = M u_dot + h - f - A^T lam and c the constraint rows.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...harness.mechanics.forces import DECLARED
from ...harness.mechanics.joints import KINDS
from .assembly import Assembly, Batch
from .layout import Layout, StabilisedLayout
from .rows.expressions import list_force_parameters, list_joint_parameters
from .sparse_pattern import FixedPattern
from .symbolic import make_body_element, make_force_element, make_row_element
from .tracing import make_user_element


class PairEnds(NamedTuple):
    """Indices of the inputs (p, u), u_dot and time of two-body elements, and of their outputs, -1 on the ground."""

    z: Int[np.ndarray, "m n_z"]
    w: Int[np.ndarray, "m 12"]
    load: Int[np.ndarray, "m 12"]  # places on e
    free: Int[np.ndarray, "m 12"]  # places in V
    p: Int[np.ndarray, "m n_p"]
    t: Int[np.ndarray, "m 1"]


class KindRows(NamedTuple):
    """All joints of one kind: their bodies, the indices of their rows of phi, their parameters and their inputs."""

    kind: str
    i: Int[np.ndarray, " m"]
    j: Int[np.ndarray, " m"]
    rows: Int[np.ndarray, "m n"]
    numbers: Float[np.ndarray, "m n_numbers"]
    ends: PairEnds


def assemble_equations(layout: Layout, level: str, alpha: float, beta: float, *, differentiable: bool) -> Assembly:
    """Return the assembly of (p_dot, e, c) over (p, u, lam) and w = u_dot; ``level`` as in ``make_row_element``.

    e = M u_dot + h - f - A^T lam, and c are the kept constraint rows with Baumgarte's ``alpha``, ``beta`` [1/s].
    """
    batches = [make_body_batch(layout), *make_force_batches(layout)]
    for of in iterate_joint_kinds(layout):
        ends, place = of.ends, layout.index_rows(of.rows)
        z, out = (
            [ends.z, layout.index_multipliers(of.rows)],
            [ends.load, np.where(place < 0, -1, layout.lam.start + place)],
        )
        if isinstance(layout, StabilisedLayout):
            z.append(np.where(place < 0, z[1], layout.eta.start + place))
            out += [np.where(place < 0, -1, layout.eta.start + place), ends.p]
        element = make_row_element(of.kind, layout.chart, level, alpha, beta)
        batches.append(
            Batch(element, of.numbers, np.concatenate((*z, ends.t), axis=1), ends.w, np.concatenate(out, axis=1))
        )
    return Assembly(layout, batches, layout.n, differentiable=differentiable)


def make_body_batch(layout: Layout) -> Batch:
    """Return the batch of all bodies, with gravity; its outputs are p_dot and e."""
    s, everyone = layout.system, np.arange(layout.system.nb)
    gravity = np.broadcast_to(s.gravity, (s.nb, 3))
    parameters = np.concatenate((s.mass[:, None], s.regular_inertia.reshape(-1, 9), gravity), axis=1)
    place = layout.index_bodies(everyone)  # (p_dot, e) are numbered as (p, u)
    return Batch(make_body_element(layout.chart), parameters, place, layout.index_velocities(everyone), place)


def make_force_batches(layout: Layout, *, in_chart: bool = True) -> list[Batch]:
    """Return the batches of all forces, one for each kind and one for each user force.

    If ``in_chart``, loads are added to e in the chart's velocities; else they are f in V, in an output of size 6 nb.
    """
    s, batches = layout.system, []
    for kind, declared in DECLARED.items():
        i = getattr(s, f"{kind}_i")
        ends = index_pair_ends(layout, i, getattr(s, f"{kind}_j") if declared.pair else i)
        size = 2 if declared.pair else 1
        z = np.concatenate((ends.z[:, : size * (layout.chart.size + 6)], ends.t), axis=1)
        out = (ends.load if in_chart else ends.free)[:, : 6 * size]
        element = make_force_element(kind, layout.chart, in_chart=in_chart)
        batches.append(Batch(element, list_force_parameters(s, kind), z, ends.w[:, : 6 * size], out))
    for k, law in enumerate(s.user_law):
        ends = index_pair_ends(layout, s.user_i[k : k + 1], s.user_j[k : k + 1])
        z, out = np.concatenate((ends.z, ends.t), axis=1), ends.load if in_chart else ends.free
        batches.append(Batch(make_user_element(law, layout.chart, in_chart=in_chart), np.zeros((1, 0)), z, ends.w, out))
    return batches


def iterate_joint_kinds(layout: Layout) -> Iterator[KindRows]:
    """Yield the joints of each kind that occurs: bodies, row indices, parameters and input indices, together."""
    s = layout.system
    for number, kind in enumerate(KINDS):
        joints = np.flatnonzero(s.joint_sort == number)
        if len(joints):
            first, n = s.row_start[joints], s.row_start[joints[0] + 1] - s.row_start[joints[0]]
            i, j = s.joint_i[joints], s.joint_j[joints]
            rows = first[:, None] + np.arange(n)
            yield KindRows(kind, i, j, rows, list_joint_parameters(s, joints), index_pair_ends(layout, i, j))


def find_jacobian_pattern(layout: Layout) -> tuple[FixedPattern, Int[np.ndarray, " entries"]]:
    """Return the sparsity pattern of A (k, n_u) of the kept rows, and the index of the nonzero of each joint's entry.

    Entries are those of all joints, in the order of ``iterate_joint_kinds`` and column by column. The index is -1 for
    dropped rows and for columns of the ground.
    """
    row, column = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for of in iterate_joint_kinds(layout):
        w, kept = of.ends.w, layout.index_rows(of.rows)
        rows = np.broadcast_to(kept[:, None, :], (*w.shape, kept.shape[1]))
        row.append(rows.ravel())
        column.append(np.broadcast_to(w[:, :, None], rows.shape).ravel())
    rows, columns = np.concatenate(row), np.concatenate(column)
    used = (rows >= 0) & (columns < layout.n_u)
    pattern, place = FixedPattern(rows[used], columns[used], (layout.k, layout.n_u)), np.full(len(used), -1)
    place[used] = pattern.place
    return pattern, place


def index_pair_ends(layout: Layout, i: Int[np.ndarray, " m"], j: Int[np.ndarray, " m"]) -> PairEnds:
    """Return the indices of the inputs and outputs of elements between bodies ``i`` and ``j``, one row each."""
    z = np.concatenate((layout.index_bodies(i), layout.index_bodies(j)), axis=1)
    w = np.concatenate((layout.index_velocities(i), layout.index_velocities(j)), axis=1)
    p = np.concatenate([layout.index_bodies(end)[:, : layout.chart.size] for end in (i, j)], axis=1)
    free = np.where(w < layout.n_u, w, -1)
    load = np.where(free < 0, -1, layout.n_p + w)
    return PairEnds(z, w, load, free, np.where(p < layout.n_p, p, -1), np.full((len(i), 1), layout.time))
