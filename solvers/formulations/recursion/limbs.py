"""A spanning tree as arrays: its limbs parents first, the joints that close its loops as rows, and room for sweeps.

Directions and points are those of ``Tree``, in space at the start. A motion of a body is (omega, v of P), a load on it
(moment about P, force), P its point in the joint. The last place of arrays by limbs is the ground's.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics.fixed_order import apply, product
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..compiled.entries import Bound
from ..compiled.kernel import Kernel, empty_kernel, finish_kernel
from ..joint_coordinates.tree import Limb, Tree
from .sweeps import factor_inertia, find_response, place_bodies

MOST = 6  # velocities of a limb: of one that floats


class Limbs(NamedTuple):
    """Numbers of a tree, where it is, and the factor of its inertia."""

    body: Any  # (n,) of each limb
    parent: Any  # (n,) limb, n: the ground
    slides: Any  # (n,) numbers of them
    turns: Any  # (n,) the same; 3 of a ball
    ball: Any  # (n,) 1: orientation and angular velocity are in the base frame, nothing of the parent's is passed on
    q_at: Any  # (n,) first coordinate
    u_at: Any  # (n,) first velocity
    way: Any  # (n, 6, 3) directions of slides, then of turns
    arm: Any  # (n, 3) from the parent's P
    centre: Any  # (n, 3) from P to C
    frame: Any  # (n, 3, 3) body to space, at the start
    base: Any  # (3, 3) space to base
    mass: Any  # (n,)
    inertia: Any  # (n, 3, 3) about C, in the body
    t: Any  # (1,)
    r: Any  # (nb, 3) of bodies, as kernels have them
    R: Any  # (nb, 3, 3)
    v: Any  # (nb, 6)
    force: Any  # (nb, 6) applied force in space, torque about C in the body
    rate: Any  # (nb, 6) change of v: what rows are multiplied with
    turned: Any  # (n + 1, 3, 3) rotation since the start
    P: Any  # (n + 1, 3)
    L: Any  # (n, 3) from the parent's P
    c: Any  # (n + 1, 3) from P to C
    motion: Any  # (n + 1, 6)
    bias: Any  # (n + 1, 6) accelerations where those of the joints are 0
    axes: Any  # (n, 6, 6) motions by velocities of the limb
    carried: Any  # (n, 6, 6) inertia at P of the limb and of what hangs on it, its own joint fixed, then free
    gain: Any  # (n, 6, 6) loads that reach the parent by efforts along the axes
    D: Any  # (n, 6, 6) inverse of the inertia along the axes
    pull: Any  # (6, 6) loads by motions along the axes, of one limb
    load: Any  # (n + 1, 6)
    back: Any  # (n + 1, 6) load, and what those behind pass on
    effort: Any  # (nu,)
    left: Any  # (nu,) efforts less what is passed on
    found: Any  # (nu,) accelerations, or velocities
    response: Any  # (n + 1, 6) motion by these
    momentum: Any  # (n + 1, 6)
    q: Any  # (nq,)
    u: Any  # (nu,)
    placing: Any  # programs: ``sweeps.place_bodies``
    factoring: Any  # ``sweeps.factor_inertia``
    responding: Any  # ``sweeps.find_response``


class Closing(NamedTuple):
    """Rows of the joints that close loops, in their kernel's order, and a dense factor of those that hold."""

    limb: Any  # (nb,) of each body
    body: Any  # (nj, 2) ends
    row: Any  # (nj + 1,) first rows
    pins: Any  # (nj,) as in ``Kernel``
    joint: Any  # (nr,) of each row
    X: Any  # (2, nr, 3)
    way: Any  # (nr, 3), not of the bodies: ``Kernel.way``
    phi: Any  # (nr,)
    slip: Any  # (nr,)
    gamma: Any  # (nr,)
    place: Any  # (nr,) in the kernel, of each row as the tree's cut joints have them
    kept: Any  # (m,) rows that hold, in the order of elimination
    out: Any  # the others
    value: Any  # (m,) pivots where this order was found
    Y: Any  # (m, nu) responses to the rows
    S: Any  # (m, m) of rows that hold, then its factor
    mu: Any  # (m,) right-hand side and solution
    rates: Any  # (nr,)
    evaluate: int  # program of X, way, phi, slip, gamma


class Mechanism(NamedTuple):
    """A tree with its closing rows; what evaluates its forces; kernels hold its arrays."""

    limbs: Limbs
    closing: Closing
    forces: Any  # program: less the gyroscopic torque
    applied: Any  # program: without it
    whole: Kernel  # rows of all joints
    cut: Kernel  # of those that close loops


def make_mechanism(system: MultibodySystem, tree: Tree) -> Mechanism:
    """Return the arrays of a tree with all closing rows; none of them holds yet."""
    whole = finish_kernel(system, empty_kernel(system), {"rows", "forces", "applied_forces"})
    cut = empty_kernel(_with_joints(system, tree.cuts))._replace(
        J=whole.J, J_inv=whole.J_inv, t=whole.t, r=whole.r, R=whole.R, v=whole.v
    )
    cut = finish_kernel(_with_joints(system, tree.cuts), cut, {"rows"})
    limbs = _limbs(system, tree, whole)
    place = {limb.body: n for n, limb in enumerate(tree.limbs)}
    nr, none = len(cut.phi), np.zeros(0)
    closing = Closing(
        np.array([place[b] for b in range(system.nb)], dtype=np.int64), cut.body, cut.row, cut.pins,
        np.repeat(np.arange(len(cut.body)), np.diff(cut.row)), cut.X, cut.way, cut.phi, cut.slip, cut.gamma, cut.order,
        np.zeros(0, dtype=np.int64), np.arange(nr), none, np.zeros((0, tree.nu)), np.zeros((0, 0)), none, np.zeros(nr),
        int(cut.rows),
    )  # fmt: skip
    return Mechanism(limbs, closing, whole.forces, whole.applied_forces, whole, cut)


def hold_rows(closing: Closing, rows: Sequence[int], pivots: Any) -> Closing:
    """Return closing rows of which these hold, numbered as the cut joints have them, with room of their own."""
    kept, m = closing.place[list(rows)].astype(np.int64), len(rows)
    out = np.setdiff1d(closing.place, kept).astype(np.int64)
    return closing._replace(
        kept=kept, out=out, value=np.array(pivots, dtype=float), Y=np.zeros((m, closing.Y.shape[1])),
        S=np.zeros((m, m)), mu=np.zeros(m),
    )  # fmt: skip


def _with_joints(system: MultibodySystem, joints: Sequence[int]) -> MultibodySystem:
    own: dict[str, Any] = {name: a[list(joints)] for name, a in vars(system).items()
                           if name.startswith("joint_") and isinstance(a, np.ndarray)}  # fmt: skip
    return replace(system, **own, joint_names=())


def _limbs(system: MultibodySystem, tree: Tree, kernel: Kernel) -> Limbs:
    n, back = len(tree.limbs), tree.base.T
    place = {limb.body: k for k, limb in enumerate(tree.limbs)} | {GROUND: n}
    body = np.array([limb.body for limb in tree.limbs], dtype=np.int64)
    way = np.zeros((n, MOST, 3))
    for k, limb in enumerate(tree.limbs):
        own = _directions(limb)
        way[k, : len(own)] = product(own, tree.base)
    turned = np.zeros((n + 1, 3, 3))
    turned[n] = np.eye(3)

    def count(of: str) -> np.ndarray:
        return np.array([getattr(limb, of) for limb in tree.limbs], dtype=np.int64)

    def point(of: str) -> np.ndarray:
        return apply(back, np.array([getattr(limb, of) for limb in tree.limbs]).reshape(n, 3))

    slides = np.array([len(limb.slides) for limb in tree.limbs], dtype=np.int64)
    shapes = {
        "rate": (system.nb, 6), "P": (n + 1, 3), "L": (n, 3), "c": (n + 1, 3), "pull": (MOST, MOST),
        **dict.fromkeys(("motion", "bias", "load", "back", "response", "momentum"), (n + 1, 6)),
        **dict.fromkeys(("axes", "carried", "gain", "D"), (n, MOST, MOST)),
        **dict.fromkeys(("effort", "left", "found", "u"), (tree.nu,)), "q": (tree.nq,),
    }  # fmt: skip
    return bind_sweeps(Limbs(
        body=body, parent=np.array([place[limb.parent] for limb in tree.limbs], dtype=np.int64), slides=slides,
        turns=np.array([limb.sizes[1] for limb in tree.limbs], dtype=np.int64) - slides, ball=count("ball"),
        q_at=count("q_at"), u_at=count("u_at"), way=way, arm=point("arm"), centre=point("centre"),
        frame=product(back, tree.frames[body]), base=np.array(tree.base), mass=system.mass[body],
        inertia=np.array(system.regular_inertia[body]), t=kernel.t, r=kernel.r, R=kernel.R, v=kernel.v,
        force=kernel.force, turned=turned, placing=0, factoring=0, responding=0,
        **{name: np.zeros(shape) for name, shape in shapes.items()},
    ))  # fmt: skip


def bind_sweeps(limbs: Limbs) -> Limbs:
    """Return limbs with the programs of their sweeps: compiled once, not into each function that takes them."""
    return limbs._replace(
        placing=Bound(place_bodies, limbs), factoring=Bound(factor_inertia, limbs),
        responding=Bound(find_response, limbs),
    )  # fmt: skip


def _directions(limb: Limb) -> np.ndarray:
    """Those of its slides, then of its turns, in the base frame."""
    return np.concatenate((limb.slides, np.eye(3) if limb.ball else limb.turns))
