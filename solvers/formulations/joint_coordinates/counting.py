"""A lower bound on the operations of a mechanism's code, from its matrix at the start, before any code is made.

Entries that happen to be zero at the start make the elimination appear shorter than it is. A product counts as six
operations, below the 8 to 40 found for grids, platforms and linkages.
"""

import numpy as np
from jaxtyping import Float

from ....harness.mechanics.jacobian import constraint_jacobian
from ....harness.mechanics.joint_tree import Tree, build_spanning_tree, remove_rounding
from ....harness.mechanics.state import State
from ....harness.mechanics.system import GROUND, MultibodySystem
from ....harness.mechanics.types import Problem
from .code import MOST_OPERATIONS, refuse_size
from .elimination import Matrix, NoInertia, find_order
from .remembering import remember_last

# operations an entry of H, a ball, a body; a product of the elimination
OF_AN_ENTRY, OF_A_BALL, OF_A_BODY, OF_A_PRODUCT = 3, 150, 30, 6
build_tree = remember_last(build_spanning_tree)
MOST_BODIES = 1000  # above it bodies alone are counted, at ``OF_A_BODY`` each


def refuse_code(problem: Problem) -> str | None:
    """Return why no code can be made for a problem's mechanism, or None as far as this is known beforehand.

    Reasons: user forces, or a lower bound on the operations above ``MOST_OPERATIONS``.
    """
    if len(problem.system.user_i):
        return "writes out declared forces only, no user forces: use rkmk_dop853"
    operations = estimate_least_operations(problem.system, problem.initial)
    return refuse_size(operations) if operations > MOST_OPERATIONS else None


@remember_last
def estimate_least_operations(system: MultibodySystem, start: State) -> int:
    """Return a lower bound on the operations of one evaluation by code made for the mechanism.

    Counted are entries of H and spherical joints, or, for loops without spherical joints, bodies and products of the
    elimination. Above ``MOST_BODIES`` bodies alone are counted.
    """
    if system.nb > MOST_BODIES:
        return OF_A_BODY * system.nb
    tree, depth, total = build_tree(system, start), {GROUND: 0}, 0
    for limb in tree.limbs:
        depth[limb.body] = limb.sizes[1] + (0 if limb.ball else depth[limb.parent])
        total += OF_AN_ENTRY * limb.sizes[1] * depth[limb.body] + OF_A_BALL * limb.ball
    if not tree.cuts or any(limb.ball and limb.parent != GROUND for limb in tree.limbs):
        return total
    try:
        products = find_order(_assemble_matrix(system, tree, start), tree.nu).products
    except NoInertia:
        return total
    return OF_A_BODY * system.nb + OF_A_PRODUCT * products


def _assemble_matrix(system: MultibodySystem, tree: Tree, start: State) -> Matrix:
    """Return K = [[H, J^T], [J, 0]] of the tree and its loop rows, with its values at the start, by columns."""
    T = _compute_unit_velocities(system, tree)
    v, Omega = T[:, :3], T[:, 3:]
    H = np.einsum("b,bix,biy->xy", system.mass, v, v, optimize=True)
    H += np.einsum("bij,bix,bjy->xy", system.regular_inertia, Omega, Omega, optimize=True)
    rows = np.concatenate([np.arange(system.row_start[k], system.row_start[k + 1]) for k in tree.cuts])
    J = np.asarray(constraint_jacobian(system, start)[rows] @ T.reshape(-1, tree.nu))
    H, J = remove_rounding(H), remove_rounding(J)
    K: Matrix = {k: {int(u): float(column[u]) for u in np.flatnonzero(column)} for k, column in enumerate(H)}
    for k, row in enumerate(J, tree.nu):
        K[k] = {int(u): float(row[u]) for u in np.flatnonzero(row)}
        for u, entry in K[k].items():
            K[u][k] = entry
    return K


def _compute_unit_velocities(system: MultibodySystem, tree: Tree) -> Float[np.ndarray, "nb 6 nu"]:
    """Return v of C [space] and Omega [body] of each body for a unit of each velocity of the tree, at the start."""
    T, out = np.zeros((system.nb + 1, 6, tree.nu)), np.zeros((system.nb, 6, tree.nu))
    centre = np.zeros((system.nb + 1, 3))
    for limb in tree.limbs:
        b, p, ns, own = limb.body, limb.parent, len(limb.slides), T[limb.body]
        centre[b] = limb.centre
        own[3:] = 0.0 if limb.ball else T[p, 3:]
        at = limb.u_at + ns
        turns = np.eye(3) if limb.ball else limb.turns
        own[3:, at : at + len(turns)] = turns.T
        own[:3] = T[p, :3] + np.cross(T[p, 3:], limb.arm - centre[p], axisa=0, axisc=0)
        own[:3] += np.cross(own[3:], limb.centre, axisa=0, axisc=0)
        own[:3, limb.u_at : at] += limb.slides.T
        out[b] = np.concatenate((tree.base.T @ own[:3], tree.frames[b].T @ own[3:]))
    return out
