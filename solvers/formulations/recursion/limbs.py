"""A spanning tree as arrays: its limbs, parents first, the rows of joints that close its loops, and arrays for sweeps.

Directions and points are those of ``Tree``, in space at the start. A motion of a body is (omega, v of P), a load on it
(moment about P, force), with P its point in the joint. Arrays of n + 1 limbs have the ground as the last one.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics.fixed_order import apply, product
from ....harness.mechanics.joint_tree import Limb, Tree
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..compiled.entries import BoundFunction
from ..compiled.kernel import Kernel, allocate_kernel, finish_kernel
from .sweeps import factor_inertia, find_response, place_bodies

MOST = 6  # velocities of a limb at most, for one that floats


class Limbs(NamedTuple):
    """The constants of a tree, its present state, and the factor of its inertia."""

    body: Any  # (n,) body of each limb
    parent: Any  # (n,) limb, n: the ground
    slides: Any  # (n,) number of slides
    turns: Any  # (n,) number of turns; 3 for a ball
    ball: Any  # (n,) 1: orientation and angular velocity are in the base frame, independent of those of the parent
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
    r: Any  # (nb, 3) of bodies, in the kernels' form
    R: Any  # (nb, 3, 3)
    v: Any  # (nb, 6)
    force: Any  # (nb, 6) applied force in space, torque about C in the body
    rate: Any  # (nb, 6) change of v, which rows are multiplied by
    turned: Any  # (n + 1, 3, 3) rotation since the start
    P: Any  # (n + 1, 3)
    L: Any  # (n, 3) from the parent's P
    c: Any  # (n + 1, 3) from P to C
    motion: Any  # (n + 1, 6)
    bias: Any  # (n + 1, 6) accelerations while those of the joints are 0
    axes: Any  # (n, 6, 6) motions by velocities of the limb
    carried: Any  # (n, 6, 6) inertia at P of the limb and all behind it, with its own joint fixed, then free
    gain: Any  # (n, 6, 6) loads that reach the parent by efforts along the axes
    D: Any  # (n, 6, 6) inverse of the inertia along the axes
    pull: Any  # (6, 6) loads by motions along the axes, of one limb
    load: Any  # (n + 1, 6)
    back: Any  # (n + 1, 6) load, and the loads that limbs behind pass on
    effort: Any  # (nu,)
    left: Any  # (nu,) efforts less the parts passed on
    found: Any  # (nu,) accelerations, or velocities
    response: Any  # (n + 1, 6) motion by these
    momentum: Any  # (n + 1, 6)
    q: Any  # (nq,)
    u: Any  # (nu,)
    placing: Any  # programs: ``sweeps.place_bodies``
    factoring: Any  # ``sweeps.factor_inertia``
    responding: Any  # ``sweeps.find_response``


class ClosingRows(NamedTuple):
    """Rows of the joints that close loops, in their kernel's order, and a dense factor of those in use."""

    limb: Any  # (nb,) limb of each body
    body: Any  # (nj, 2) ends
    row: Any  # (nj + 1,) first rows
    pins: Any  # (nj,) as in ``Kernel``
    joint: Any  # (nr,) joint of each row
    X: Any  # (2, nr, 3)
    way: Any  # (nr, 3), not of the bodies: ``Kernel.way``
    phi: Any  # (nr,)
    slip: Any  # (nr,)
    gamma: Any  # (nr,)
    place: Any  # (nr,) place in the kernel of each row in the cut joints' order
    kept: Any  # (m,) rows in use, in the order of elimination
    out: Any  # the rows left out
    value: Any  # (m,) pivots where this order was found
    Y: Any  # (m, nu) responses to the rows
    S: Any  # (m, m) S of rows in use, then its factor
    mu: Any  # (m,) right-hand side and solution
    rates: Any  # (nr,)
    evaluate: int  # program of X, way, phi, slip, gamma


class ClosedTree(NamedTuple):
    """A tree with its closing rows, the programs of its forces, and the kernels whose arrays it shares."""

    limbs: Limbs
    closing: ClosingRows
    forces: Any  # program of forces less the gyroscopic torque
    applied: Any  # program of applied forces alone
    whole: Kernel  # rows of all joints
    cut: Kernel  # rows of the joints that close loops


def make_mechanism(system: MultibodySystem, tree: Tree) -> ClosedTree:
    """Allocate and return the arrays and kernels of a tree with all its closing rows, of which none is in use yet.

    See ``select_rows``. Both kernels share the poses and velocities of the bodies.
    """
    whole = finish_kernel(system, allocate_kernel(system), {"rows", "forces", "applied_forces"})
    cut = allocate_kernel(_restrict_joints(system, tree.cuts))._replace(
        J=whole.J, J_inv=whole.J_inv, t=whole.t, r=whole.r, R=whole.R, v=whole.v
    )
    cut = finish_kernel(_restrict_joints(system, tree.cuts), cut, {"rows"})
    limbs = _make_limbs(system, tree, whole)
    place = {limb.body: n for n, limb in enumerate(tree.limbs)}
    nr, none = len(cut.phi), np.zeros(0)
    closing = ClosingRows(
        np.array([place[b] for b in range(system.nb)], dtype=np.int64),
        cut.body,
        cut.row,
        cut.pins,
        np.repeat(np.arange(len(cut.body)), np.diff(cut.row)),
        cut.X,
        cut.way,
        cut.phi,
        cut.slip,
        cut.gamma,
        cut.order,
        np.zeros(0, dtype=np.int64),
        np.arange(nr),
        none,
        np.zeros((0, tree.nu)),
        np.zeros((0, 0)),
        none,
        np.zeros(nr),
        int(cut.rows),
    )
    return ClosedTree(limbs, closing, whole.forces, whole.applied_forces, whole, cut)


def select_rows(closing: ClosingRows, rows: Sequence[int], pivots: Any) -> ClosingRows:
    """Return a copy of ``closing`` with these ``rows`` in use, in this order, and new arrays for their factor.

    Rows are numbered in the cut joints' order; ``pivots`` are those at the position where the order was found. All
    other arrays are shared.
    """
    kept, m = closing.place[list(rows)].astype(np.int64), len(rows)
    out = np.setdiff1d(closing.place, kept).astype(np.int64)
    return closing._replace(
        kept=kept,
        out=out,
        value=np.array(pivots, dtype=float),
        Y=np.zeros((m, closing.Y.shape[1])),
        S=np.zeros((m, m)),
        mu=np.zeros(m),
    )


def _restrict_joints(system: MultibodySystem, joints: Sequence[int]) -> MultibodySystem:
    """Return a copy of the system with the joints of these indices only, without names."""
    own: dict[str, Any] = {
        name: a[list(joints)]
        for name, a in vars(system).items()
        if name.startswith("joint_") and isinstance(a, np.ndarray)
    }
    return replace(system, **own, joint_names=())


def _make_limbs(system: MultibodySystem, tree: Tree, kernel: Kernel) -> Limbs:
    """Return the arrays of a tree, and bind its sweeps; arrays of bodies are those of the system's ``kernel``."""
    n, back = len(tree.limbs), tree.base.T
    place = {limb.body: k for k, limb in enumerate(tree.limbs)} | {GROUND: n}
    body = np.array([limb.body for limb in tree.limbs], dtype=np.int64)
    way = np.zeros((n, MOST, 3))
    for k, limb in enumerate(tree.limbs):
        own = _list_directions(limb)
        way[k, : len(own)] = product(own, tree.base)
    turned = np.zeros((n + 1, 3, 3))
    turned[n] = np.eye(3)

    def collect_integers(name: str) -> np.ndarray:
        """Return the integer attribute ``name`` of each limb."""
        return np.array([getattr(limb, name) for limb in tree.limbs], dtype=np.int64)

    def collect_vectors(name: str) -> np.ndarray:
        """Return the vector attribute ``name`` of each limb, transformed from the base frame to space."""
        return apply(back, np.array([getattr(limb, name) for limb in tree.limbs]).reshape(n, 3))

    slides = np.array([len(limb.slides) for limb in tree.limbs], dtype=np.int64)
    shapes = {
        "rate": (system.nb, 6),
        "P": (n + 1, 3),
        "L": (n, 3),
        "c": (n + 1, 3),
        "pull": (MOST, MOST),
        **dict.fromkeys(("motion", "bias", "load", "back", "response", "momentum"), (n + 1, 6)),
        **dict.fromkeys(("axes", "carried", "gain", "D"), (n, MOST, MOST)),
        **dict.fromkeys(("effort", "left", "found", "u"), (tree.nu,)),
        "q": (tree.nq,),
    }
    return bind_sweeps(
        Limbs(
            body=body,
            parent=np.array([place[limb.parent] for limb in tree.limbs], dtype=np.int64),
            slides=slides,
            turns=np.array([limb.sizes[1] for limb in tree.limbs], dtype=np.int64) - slides,
            ball=collect_integers("ball"),
            q_at=collect_integers("q_at"),
            u_at=collect_integers("u_at"),
            way=way,
            arm=collect_vectors("arm"),
            centre=collect_vectors("centre"),
            frame=product(back, tree.frames[body]),
            base=np.array(tree.base),
            mass=system.mass[body],
            inertia=np.array(system.regular_inertia[body]),
            t=kernel.t,
            r=kernel.r,
            R=kernel.R,
            v=kernel.v,
            force=kernel.force,
            turned=turned,
            placing=0,
            factoring=0,
            responding=0,
            **{name: np.zeros(shape) for name, shape in shapes.items()},
        )
    )


def bind_sweeps(limbs: Limbs) -> Limbs:
    """Return ``limbs`` with the programs of its sweeps, which are compiled once and not inlined in each caller."""
    return limbs._replace(
        placing=BoundFunction(place_bodies, limbs),
        factoring=BoundFunction(factor_inertia, limbs),
        responding=BoundFunction(find_response, limbs),
    )


def _list_directions(limb: Limb) -> np.ndarray:
    """Return the directions of a limb's slides, then of its turns, in the base frame."""
    return np.concatenate((limb.slides, np.eye(3) if limb.ball else limb.turns))
