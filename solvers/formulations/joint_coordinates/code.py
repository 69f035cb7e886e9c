"""Machine code of a mechanism in joint coordinates, kept on disk under its numbers: kept code needs no CasADi.

    accelerate(t, y) -> y_dot, least
    measure(given, start, y, sums) -> error; given are t, h, rtol
    step(given, start, first slope) -> y, error, least: the stages of small mechanisms in one
    finish(t, y) -> y, y_dot, lam, guard: y projected onto its loops, accelerations at what came in
    record(t, y, y_dot, lam) -> r, R, v, v_dot of all bodies, reactions of all joints, as the system has them

``least`` is the least pivot over its value at the start; ``guard`` has it and the largest phi of rows left out.
"""

import contextlib
import hashlib
from collections.abc import Collection
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ....harness.code_meter import making_code
from ....harness.mechanics import fixed_order
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..generated import Code
from ..generated.code import print_functions
from ..rows.kept_code import texts_of_makers
from .tree import Tree

if TYPE_CHECKING:
    import casadi as ca

    from ..generated import Straight
    from .elimination import Matrix, Order
    from .loops import Row
    from .motion import Motion

MOST_OPERATIONS = 30_000
AGAIN = 0.03  # of its size at the start: a pivot of an order found later
ROUNDING = 1e-9  # of entries of rows, whose largest are 1 where a joint holds anything
SMALL = 700  # operations of ``accelerate`` up to which the stages of a step are written out


MOST_LOADED = 8  # codes that a process keeps: the last ones
_LOADED: dict[str, Code] = {}


class LostRank(ValueError):
    """No order of elimination has safe pivots."""


class JointCode(NamedTuple):
    """The code of a mechanism; rows of its loops that hold, and how many there are."""

    code: Code
    kept: int
    rows: int
    operations: int  # of ``accelerate``

    @property
    def is_small(self) -> bool:
        """Return whether there is a ``step``."""
        return self.operations <= SMALL


@making_code
def make_code(system: MultibodySystem, tree: Tree, at: np.ndarray | None = None) -> JointCode:
    """Made, or loaded; ValueError where none can be made. Its order of elimination is found at y, or at the start."""
    key = f"{texts_of_makers()}\0{_own_text()}\0{_digest(system, tree, at)}"
    code = _LOADED.pop(key, None) or Code(lambda: _print(system, tree, at), key)
    _LOADED[key] = code
    if len(_LOADED) > MOST_LOADED:
        del _LOADED[next(iter(_LOADED))]
    about = np.zeros(3)
    code.function("about", 1)(about.ctypes.data)
    kept, rows, operations = (int(x) for x in about)
    if operations == 0:
        raise LostRank("no order of elimination has safe pivots")
    if operations < 0:
        raise ValueError("needs inertia for each velocity of a joint; a point mass on a ball has none: use rkmk_dop853")
    if operations > MOST_OPERATIONS:
        raise ValueError(too_large(operations))
    if kept < rows and not system.is_holonomic:
        raise ValueError("leaves out rows that depend on others, and not every row has a phi to watch: use rkmk_dop853")
    return JointCode(code, kept, rows, operations)


def too_large(operations: int) -> str:
    """The refusal of a mechanism of that size."""
    return (
        f"writes code for the mechanism, up to {MOST_OPERATIONS} operations an evaluation (needs {operations} or "
        "more): use rkmk_dop853"
    )


def _print(system: MultibodySystem, tree: Tree, at: np.ndarray | None) -> str:
    """IR of the functions, and of ``about``: rows kept, all rows, operations; alone, where they are too large."""
    import casadi as ca

    from ..generated.functions import Straight, record_function
    from .elimination import NoInertia
    from .stages import write_step

    def about(kept: int, rows: int, operations: int) -> "dict[str, Any]":
        return {"about": Straight([], [ca.vertcat(kept, rows, operations)])}

    try:
        functions, kept, rows = _functions(system, tree, at)
    except NoInertia:
        return print_functions(about(0, 0, -1))
    except LostRank:
        return print_functions(about(0, 0, 0))
    operations = len(record_function(functions["accelerate"]).tape.operations)
    if operations <= SMALL:
        functions["step"] = write_step(functions["accelerate"], functions["measure"])
    if operations > MOST_OPERATIONS:
        functions = {}
    return print_functions({**functions, **about(kept, rows, operations)})


class Equations(NamedTuple):
    """K at a motion, its first row of the cut joints, these, and the order of elimination."""

    motion: "Motion"
    K: "Matrix"
    first: int
    rows: "list[Row]"
    order: "Order"


def choose_order(
    system: MultibodySystem, tree: Tree, t: "ca.SX", y: "ca.SX", at: np.ndarray | None = None
) -> Equations:
    """Make code with balls opened or not, by the shorter elimination; LostRank where none is safe at y."""
    balls = [limb.body for limb in tree.limbs if limb.ball and limb.parent != GROUND]
    found = []
    for way in ([], balls)[: 1 + bool(balls)]:
        with contextlib.suppress(LostRank):
            found.append(_equations(system, tree, t, y, way, at))
    if not found:
        raise LostRank
    return min(found, key=lambda equations: equations.order.products)


def _equations(
    system: MultibodySystem, tree: Tree, t: "ca.SX", y: "ca.SX", opened: list[int], at: np.ndarray | None = None
) -> Equations:
    """LostRank where a pivot at y is not safe beside the size of its row at the start, or as many rows do not hold."""
    from . import loops
    from .elimination import sizes
    from .motion import Motion

    motion = Motion(system, tree, t, y, opened=opened)
    held, rows, K = loops.list_ball_rows(motion), loops.rows(motion), motion.inertia()
    n = len(K)
    for k, row in enumerate([*held, *rows], n):
        K[k] = {}
        for u, entry in row.J.items():
            K[k][u] = K[u][k] = entry
    numbers = _drop_rounding(_evaluate(K, t, y, tree.start), n)
    order = order_rows(numbers, tree.nu, len(held))
    if at is not None:
        size, kept = sizes(numbers, n), len(order.rows)
        order = order_rows(_drop_rounding(_evaluate(K, t, y, at), n), tree.nu, len(held))
        largest = max(size[n:], default=0.0)
        pairs = [(abs(pivot), size[k] or largest) for k, pivot in zip(order.rows, order.pivots, strict=True) if k >= n]
        if len(order.rows) != kept or any(pivot < AGAIN * of for pivot, of in pairs):
            raise LostRank
    return Equations(motion, K, n + len(held), rows, order)


def order_rows(numbers: "Matrix", nu: int, held: int) -> "Order":
    """The order at numbers, with rows that close loops behind all others unless that takes more products.

    Each of the ``held`` rows of opened balls, which follow ``nu`` velocities and as many freed ones, is behind the velocity it alone takes
    away: before, its pivot is of the parent's turns alone and vanishes in some orientations. Behind it no pivot does.
    """
    from .elimination import find_order

    n, first = nu + held, nu + 2 * held
    behind: dict[int, Collection[int]] = {k: (k - held,) for k in range(n, first)}
    last = find_order(numbers, n, {**behind, **dict.fromkeys(range(first, len(numbers)), range(first))}, first)
    if first == len(numbers):
        return last
    mixed = find_order(numbers, n, behind)
    return mixed if mixed.products < last.products else last


def _functions(
    system: MultibodySystem, tree: Tree, at: np.ndarray | None = None
) -> "tuple[dict[str, Straight], int, int]":
    import casadi as ca

    from ..generated import Straight
    from . import loops
    from .elimination import Factor
    from .motion import Motion
    from .stages import write_measure

    nq, nu = tree.nq, tree.nu
    t, y = ca.SX.sym("t"), ca.SX.sym("y", nq + nu)
    found = choose_order(system, tree, t, y, at)
    motion, rows, first = found.motion, found.rows, found.first
    factor = Factor(found.K, found.order.rows)
    x = factor.solve(
        {k: -e for k, e in enumerate(_parts(motion.efforts(motion.compute_carried_loads(motion.applied_forces()))))}
        | {k: -row.acceleration for k, row in enumerate(rows, first)}
    )
    u_dot = _column([x[k] for k in range(nu)])
    lam = _column([-x.get(k, ca.SX(0)) for k in range(first, first + len(rows))])
    step = factor.solve({k: -row.phi for k, row in enumerate(rows, first)})
    q = _normalise(tree, motion.q + motion.q_dot(_column([step[k] for k in range(nu)])) if rows else motion.q)
    moved = Motion(system, tree, t, ca.vertcat(q, y[nq:]))
    after = loops.rows(moved)
    step = factor.solve({k: -row.rate for k, row in enumerate(after, first)})
    u = y[nq:] + _column([step[k] for k in range(nu)])
    ratio, gap = ca.SX(1), ca.SX(0)
    for pivot, value in zip(factor.pivots, found.order.pivots, strict=True):
        ratio = ca.fmin(ratio, (1.0 / value) * pivot)
    for k, row in enumerate(after, first):
        if k not in factor.inverse:
            gap = ca.fmax(gap, ca.fabs(row.phi))
    y_dot = ca.vertcat(moved.q_dot(u), u_dot)
    functions = {
        "accelerate": Straight([t, y], [ca.vertcat(motion.q_dot(motion.u), u_dot), ratio]),
        "measure": write_measure(tree),
        "finish": Straight([t, y], [ca.vertcat(q, u), y_dot, lam, ca.vertcat(ratio, gap)]),
        "record": _record(system, tree, len(rows)),
    }
    return functions, sum(k >= first for k in factor.order), len(rows)


def _record(system: MultibodySystem, tree: Tree, rows: int) -> "Straight":
    import casadi as ca

    from ..generated import Straight
    from . import loops
    from .motion import Motion, Wrench

    t, y, y_dot = ca.SX.sym("t"), ca.SX.sym("y", tree.nq + tree.nu), ca.SX.sym("y_dot", tree.nq + tree.nu)
    lam = ca.SX.sym("lam", rows)
    motion = Motion(system, tree, t, y, y_dot[tree.nq :])
    loads, held = motion.applied_forces(), loops.row_loads(motion, lam)
    carried = motion.compute_carried_loads({b: Wrench(x.f + held[b].f, x.n + held[b].n) for b, x in loads.items()})
    first = system.row_start
    reaction: list[Any] = [ca.SX(0)] * system.nrows
    back = ca.SX(ca.DM(tree.base.T))
    parts = {limb.joint: loops.reaction(motion, limb, carried[limb.body]) for limb in tree.limbs if limb.joint >= 0}
    at = np.concatenate(([0], np.cumsum(system.joint_rows[list(tree.cuts)]))).astype(int)
    parts |= {k: lam[int(at[n]) : int(at[n + 1])] for n, k in enumerate(tree.cuts)}
    for k, own in parts.items():
        points = int(system.joint_points[k])
        own = ca.vertcat(back @ own[:points], own[points:]) if points else own
        reaction[first[k] : first[k + 1]] = _parts(own)
    r, R, v, v_dot = [], [], [], []
    for b in range(system.nb):
        F, c, omega = ca.SX(ca.DM(tree.frames[b])), motion.centre[b], motion.omega[b]
        R_b = motion.R[b] @ F
        r.append(back @ (motion.P[b] + c))
        R.append(ca.vec((back @ R_b).T))
        v += [back @ (motion.v[b] + ca.cross(omega, c)), R_b.T @ omega]
        v_dot += [back @ (motion.a[b] + motion.W[b] @ c), R_b.T @ motion.alpha[b]]
    return Straight([t, y, y_dot, lam], [ca.densify(_column(x)) for x in (r, R, v, v_dot, reaction)])


def _evaluate(K: dict[int, dict[int, Any]], t: "ca.SX", y: "ca.SX", start: np.ndarray) -> dict[int, dict[int, float]]:
    import casadi as ca

    places = [(k, row) for k, column in K.items() for row in column]
    values = ca.Function("K", [t, y], [_column([K[k][row] for k, row in places])])(0.0, start)
    out: dict[int, dict[int, float]] = {k: {} for k in K}
    for (k, row), value in zip(places, np.asarray(values, dtype=float).ravel().tolist(), strict=True):
        out[k][row] = value
    return out


def _drop_rounding(K: dict[int, dict[int, float]], nu: int) -> dict[int, dict[int, float]]:
    """Without the entries of rows that have nothing but rounding: of a joint of the tree that is declared twice."""
    from .elimination import sizes

    size = sizes(K, nu)
    nothing = (ROUNDING / max(size[:nu], default=1.0)) * ROUNDING
    for k in range(nu, len(K)):
        if size[k] < nothing:
            for u in K[k]:
                del K[u][k]
            K[k] = {}
    return K


def _normalise(tree: Tree, q: "ca.SX") -> "ca.SX":
    import casadi as ca

    out = ca.SX(q)
    for limb in tree.limbs:
        if limb.ball:
            own = slice(limb.q_at + len(limb.slides), limb.q_at + limb.sizes[0])
            out[own] = q[own] / ca.sqrt(ca.dot(q[own], q[own]))
    return out


def _parts(x: "ca.SX") -> list[Any]:
    return [x[k] for k in range(x.numel())]


def _column(x: list[Any]) -> "ca.SX":
    import casadi as ca

    return ca.densify(ca.vertcat(*x)) if len(x) else ca.SX(0, 1)


def _digest(system: MultibodySystem, tree: Tree, at: np.ndarray | None = None) -> str:
    """Digest of all numbers of a system, of its tree, and of where the order of elimination is found."""
    digest = hashlib.sha256(repr([limb[:4] for limb in tree.limbs]).encode())
    arrays = {field.name: getattr(system, field.name) for field in fields(system)}
    arrays |= {f"limb {k} {n}": a for k, limb in enumerate(tree.limbs) for n, a in limb._asdict().items()}
    arrays |= {"base": tree.base, "frames": tree.frames, "start": tree.start, "at": at}
    for name, a in arrays.items():
        if isinstance(a, np.ndarray) and a.dtype != object:
            digest.update(f"{name} {a.shape} {a.dtype}".encode() + a.tobytes())
    return digest.hexdigest()


@cache
def _own_text() -> str:
    names = ("code", "elimination", "loops", "motion", "stages", "tree")
    paths = [*(Path(__file__).with_name(f"{name}.py") for name in names), Path(fixed_order.__file__)]
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()
