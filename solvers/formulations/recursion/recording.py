"""The recorded motion and reactions of a tree, and the error of a step of DOP853 (compiled)."""

import math
from typing import Any, NamedTuple

import numpy as np

from ....harness.mechanics.joint_tree import Tree
from ....harness.mechanics.system import MultibodySystem
from ..compiled.algebra import copy, multiply
from ..compiled.entries import run
from .accelerations import add_centripetal, set_loads
from .closing_rows import add_row
from .limbs import ClosedTree, ClosingRows, Limbs
from .sweeps import find_motion, gather_efforts, move_to, set_rate
from .twists import cross

NOTHING = 1e-300  # makes an error of zero 0, not 0/0


class RecordedTree(NamedTuple):
    """A tree, the rows of its joints, and the inputs and results of ``record_tree``."""

    limbs: Limbs
    closing: ClosingRows
    loads: int  # program of forces
    whole: int  # program of all rows
    X: Any  # (2, nr, 3) torques of all rows
    way: Any  # (nr, 3)
    row: Any  # (m,) rows of joints of the tree
    limb: Any  # (m,)
    end: Any  # (m,) end of the joint that the limb is on
    first: Any  # (m,) body i of the joint
    point: Any  # (m, 3) point of the joint in it
    to: Any  # (m,) places in the reaction
    to_cut: Any  # (rows,) places of the rows that close loops
    t: Any
    q: Any
    u: Any
    u_dot: Any
    lam: Any
    r: Any  # (nb, 3) results, in the system's order of bodies
    R: Any
    v: Any
    v_dot: Any
    reaction: Any


def make_record(system: MultibodySystem, tree: Tree, of: ClosedTree, arrays: "tuple[Any, ...]") -> RecordedTree:
    """Return the bundle of ``record_tree``; ``arrays`` are its t, q, u, u_dot, lam, then r, R, v, v_dot, reaction."""
    row, limbs, ends = list[int](), list[int](), list[int]()
    for k, limb in enumerate(tree.limbs):
        if limb.joint >= 0:
            own = range(int(system.row_start[limb.joint]), int(system.row_start[limb.joint + 1]))
            row += own
            limbs += [k] * len(own)
            ends += [0 if limb.child_is_i else 1] * len(own)
    joint = np.array([tree.limbs[k].joint for k in limbs], dtype=np.int64)
    cut = [np.arange(system.row_start[k], system.row_start[k + 1]) for k in tree.cuts]
    to = np.array(row, dtype=np.int64)
    return RecordedTree(
        of.limbs,
        of.closing,
        int(of.forces),
        int(of.whole.rows),
        of.whole.X,
        of.whole.way,
        of.whole.order[to],
        np.array(limbs, dtype=np.int64),
        np.array(ends, dtype=np.int64),
        system.joint_i[joint].astype(np.int64),
        np.ascontiguousarray(system.joint_s_i[joint]),
        to,
        np.concatenate([np.zeros(0, dtype=np.int64), *cut]).astype(np.int64),
        *arrays,
    )


def record_tree(s: Any) -> None:
    """Set r, R, v, v_dot of all bodies and the reactions of all joints, from t, q, u, u_dot and lam.

    ``s`` is a ``RecordedTree``. Reactions of the tree's joints follow from the wrenches that they carry; those of cut
    joints are ``lam``.
    """
    l, c = s.limbs, s.closing
    l.t[0] = s.t[0]
    move_to(l, s.q, s.u)
    run(s.loads)
    run(s.whole)
    if len(c.joint) > 0:
        run(c.evaluate)
    find_motion(l, s.u_dot)
    for k in range(len(l.parent)):
        for i in range(6):
            l.bias[k, i] += l.response[k, i]
    set_loads(l)
    for a in range(len(s.lam)):
        add_row(l, c, c.place[a], s.lam[a])
        s.reaction[s.to_cut[a]] = s.lam[a]
    for k in range(len(l.parent)):
        add_centripetal(l, k, l.bias[k], l.response[k])
        set_rate(l, k, l.response[k], s.v_dot[l.body[k]])
    copy(l.r, s.r)
    copy(l.R, s.R)
    copy(l.v, s.v)
    gather_efforts(l, l.load, l.found)
    for n in range(len(s.row)):
        k, a, e, i = s.limb[n], s.row[n], s.end[n], s.first[n]
        load, body = l.load[k], l.body[k]
        x, y, z = multiply(l.R[i], s.point[n, 0], s.point[n, 1], s.point[n, 2])
        x, y, z = x + l.r[i, 0], y + l.r[i, 1], z + l.r[i, 2]
        side = 1.0 - 2.0 * e
        f0, f1, f2 = side * s.way[a, 0], side * s.way[a, 1], side * s.way[a, 2]
        n0, n1, n2 = multiply(l.R[body], s.X[e, a, 0], s.X[e, a, 1], s.X[e, a, 2])
        m0, m1, m2 = cross(x - l.r[body, 0], y - l.r[body, 1], z - l.r[body, 2], f0, f1, f2)
        p0, p1, p2 = cross(x - l.P[k, 0], y - l.P[k, 1], z - l.P[k, 2], load[3], load[4], load[5])
        s.reaction[s.to[n]] = -(
            f0 * load[3]
            + f1 * load[4]
            + f2 * load[5]
            + (n0 - m0) * (load[0] - p0)
            + (n1 - m1) * (load[1] - p1)
            + (n2 - m2) * (load[2] - p2)
        )


class ErrorParts(NamedTuple):
    """Parts of y with one tolerance each, and the arrays of a step."""

    low: Any  # first index of each part
    high: Any  # index after the last one
    angle: Any  # 0 for a vector by its length, else twice the tolerance of an angle
    given: Any  # (3,) t, h, rtol
    start: Any  # (n,)
    y: Any  # (n,)
    sums: Any  # (2, n)
    error: Any  # (1,)


def measure_error(s: Any) -> None:
    """Set ``error`` to the root mean square of a step's error estimate, relative to its tolerances.

    Both estimates of DOP853 are combined; tolerances are those of ``stages.list_tolerance_blocks``.
    """
    first = second = 0.0
    for k in range(len(s.low)):
        a = b = x = z = 0.0
        for i in range(s.low[k], s.high[k]):
            a += s.start[i] * s.start[i]
            b += s.y[i] * s.y[i]
            x += s.sums[0, i] * s.sums[0, i]
            z += s.sums[1, i] * s.sums[1, i]
        scale = 0.5 * s.angle[k] if s.angle[k] > 0 else 1.0 + math.sqrt(max(a, b))
        weight = 1.0 / (scale * scale)
        first += weight * x
        second += weight * z
    s.error[0] = s.given[1] * first / (s.given[2] * math.sqrt((first + 0.01 * second) * len(s.y) + NOTHING))
