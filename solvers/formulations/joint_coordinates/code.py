"""Machine code of a mechanism in joint coordinates, kept on disk by a key of its numbers: kept code needs no CasADi.

K = [[H, J^T], [J, 0]] has its entries in one array, its factor L another, and b has the loads of velocities and rows:

    entries(t, y) -> K, b, q_dot          factor(K) -> L, least                solve(L, b) -> u_dot, lam
    gaps(t, y) -> b                       move(t, y, step) -> q, b, phi        conclude(y, q, step) -> y, q_dot
    accelerate(t, y) -> y_dot, least: all of the first line in one
    step(given, start, first slope) -> y, error, least: the stages of small mechanisms in one
    measure(given, start, y, sums) -> error; given are t, h, rtol
    record(t, y, y_dot, lam) -> r, R, v, v_dot of all bodies, reactions of all joints, in the order of the system

The order of elimination is found at the start. Where others are needed, they are lists (module ``pivots``), and no code
is made anew. ``least`` is the least pivot relative to its value where the order was found. ``gaps``, ``move`` and
``conclude`` project y onto its loops, with the factor at the unprojected y.
"""

import hashlib
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ....harness.base import tableaux
from ....harness.base.code_meter import making_code
from ....harness.base.generated import Code
from ....harness.base.generated.code import print_functions
from ....harness.mechanics import fixed_order, joint_tree
from ....harness.mechanics.joint_tree import Tree
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..rows.kept_code import digest_makers
from .elimination import EliminationOrder, Factor, Matrix, NoInertia
from .pivots import Pattern, order_rows
from .remembering import remember_last

if TYPE_CHECKING:
    import casadi as ca

    from ....harness.base.generated import GeneratedFunction
    from .loops import LoopRow
    from .motion import TreeMotion

MOST_OPERATIONS = 30_000  # larger code exceeds the processor's caches and does not pay (docs/decisions/kernels.md)
ACCELERATION = "entries", "factor", "solve"
SHARED = *ACCELERATION, "gaps", "move", "conclude", "record"
SMALL = 700  # operations of ``accelerate`` up to which the stages of a step are written out


MOST_LOADED = 8  # codes that a process keeps loaded: the last ones
_LOADED: "dict[str, JointCode]" = {}


class CodeTooLarge(ValueError):
    """Raised where code of a mechanism would need more than ``MOST_OPERATIONS``."""


class JointCode(NamedTuple):
    """The code of a mechanism, the pattern of K, the order of its elimination, and sizes."""

    code: Code
    pattern: Pattern
    order: EliminationOrder
    rows: int  # rows of its loops
    operations: int  # operations of accelerations
    entries: int  # entries of L
    whole: bool  # whether ``accelerate`` is one function

    @property
    def rows_in_use(self) -> int:
        """Number of loop rows in use: those in the elimination, without rows that depend on others."""
        return sum(k >= self.pattern.first for k in self.order.rows)

    @property
    def words(self) -> str:
        """Note for the trajectory, which says that code evaluates the mechanism."""
        return f"code of {self.operations} operations an evaluation"

    @property
    def is_small(self) -> bool:
        """Flag of a mechanism so small that its code may have ``step``, all stages of a step in one function."""
        return self.operations <= SMALL


@making_code
def make_code(system: MultibodySystem, tree: Tree, *, whole: bool = True) -> JointCode:
    """Return the code of a mechanism, loaded from disk or made and stored, with its order of elimination.

    If ``whole``, it has ``accelerate`` as one function, else ``solve_rows``. The last ``MOST_LOADED`` codes stay
    loaded. Raises ``CodeTooLarge``, a ValueError, above ``MOST_OPERATIONS``, and ValueError where a velocity has no
    inertia, or where rows without phi depend on others.
    """
    equations = digest_mechanism(system, tree)
    key = f"{equations}\0{whole}"
    made = _LOADED.pop(key, None) or _read_tables(
        Code(lambda: _generate_ir(system, tree, equations, whole), key), whole
    )
    _LOADED[key] = made
    if len(_LOADED) > MOST_LOADED:
        del _LOADED[next(iter(_LOADED))]
    if made.operations < 0:
        raise ValueError("needs inertia for each velocity of a joint; a point mass on a ball has none: use rkmk_dop853")
    if made.operations > MOST_OPERATIONS:
        raise CodeTooLarge(refuse_size(made.operations))
    if made.rows_in_use < made.rows and not system.is_holonomic:
        raise ValueError("leaves out rows that depend on others, and not every row has a phi to watch: use rkmk_dop853")
    return made


def digest_mechanism(system: MultibodySystem, tree: Tree) -> str:
    """Return the key of a mechanism's code on disk: digests of the generator's source and of system and tree."""
    return f"{digest_makers()}\0{_digest_generator()}\0{_digest(system, tree)}"


ABOUT = "operations", "rows", "entries", "pairs", "variable", "ordered", "nu", "held"


def _read_tables(code: Code, whole: bool) -> JointCode:
    """Return ``code`` with its sizes and tables, as its functions ``about`` and ``pattern`` state them."""
    numbers = np.zeros(len(ABOUT))
    code.function("about", 1)(numbers.ctypes.data)
    about = dict(zip(ABOUT, numbers.astype(int).tolist(), strict=True))
    pairs, constants = np.zeros((about["pairs"], 2)), np.zeros(about["pairs"] - about["variable"])
    rows, pivots = np.zeros((2, about["ordered"]))
    code.function("pattern", 4)(*(a.ctypes.data for a in (pairs, constants, rows, pivots)))
    pattern = Pattern(pairs.astype(np.int64), constants, about["nu"], about["held"], about["rows"])
    order = EliminationOrder(rows.astype(int).tolist(), pivots.tolist(), 0)
    return JointCode(code, pattern, order, about["rows"], about["operations"], about["entries"], whole)


def refuse_size(operations: int) -> str:
    """Return the refusal of a mechanism whose code needs at least ``operations`` per evaluation, which is too many."""
    return (
        f"writes code for the mechanism, up to {MOST_OPERATIONS} operations an evaluation (needs {operations} or "
        "more): use rkmk_dop853"
    )


def _generate_ir(system: MultibodySystem, tree: Tree, key: str, whole: bool) -> str:
    """Return the LLVM IR of the mechanism's functions, and of ``about`` and ``pattern``, which state sizes and tables.

    Where the functions are too large it contains the latter alone; where inertia is missing the number of operations
    is -1. With ``whole`` there are ``accelerate`` and ``measure``, and for small mechanisms ``step``.
    """
    import casadi as ca

    from ....harness.base.generated.functions import GeneratedFunction, record_function
    from .stages import write_step

    def write_tables(operations: int, parts: "MechanismFunctions | None" = None) -> "dict[str, GeneratedFunction]":
        """Return the functions ``about`` and ``pattern``; without ``parts`` all sizes are 0 and all tables empty."""
        about = (operations, *parts.sizes) if parts else (operations, *(0 for _ in ABOUT[1:]))
        tables = parts.tables if parts else [ca.SX(0, 1)] * 4
        return {"about": GeneratedFunction([], [ca.vertcat(*about)]), "pattern": GeneratedFunction([], tables)}

    try:
        parts = MechanismFunctions(system, tree, find_equations(system, tree, key))
    except NoInertia:
        return print_functions(write_tables(-1))
    functions = {name: parts.functions[name] for name in (*SHARED, "measure" if whole else "solve_rows")}
    if whole:
        functions["accelerate"] = parts.accelerate()
    evaluated = ("accelerate",) if whole else ACCELERATION
    operations = sum(len(record_function(functions[name]).tape.operations) for name in evaluated)
    if whole and operations <= SMALL:
        functions["step"] = write_step(functions["accelerate"], functions["measure"])
    if operations > MOST_OPERATIONS:
        functions = {}
    return print_functions({**functions, **write_tables(operations, parts)})


class JointEquations(NamedTuple):
    """K at a motion (t, y), the number of its first loop row, the loop rows, and the order of elimination."""

    t: "ca.SX"
    y: "ca.SX"
    motion: "TreeMotion"
    K: "Matrix"
    first: int
    rows: "list[LoopRow]"
    order: "EliminationOrder"

    @property
    def held(self) -> int:
        """Number of rows that hold opened balls on their parents."""
        return 3 * len(self.motion.opened)


_FOUND: dict[str, JointEquations] = {}  # the last equations found


def find_equations(system: MultibodySystem, tree: Tree, key: str) -> JointEquations:
    """Return the equations of ``choose_equations``; the last ones are kept, and returned again for the same ``key``."""
    import casadi as ca

    if key not in _FOUND:
        _FOUND.clear()
        _FOUND[key] = choose_equations(system, tree, ca.SX.sym("t"), ca.SX.sym("y", tree.nq + tree.nu))
    return _FOUND[key]


def choose_equations(system: MultibodySystem, tree: Tree, t: "ca.SX", y: "ca.SX") -> JointEquations:
    """Return the equations of a tree with all or none of its ball joints opened, whichever need fewer products."""
    balls = [limb.body for limb in tree.limbs if limb.ball and limb.parent != GROUND]
    found = [write_equations(system, tree, t, y, opened) for opened in ([], balls)[: 1 + bool(balls)]]
    return min(found, key=lambda equations: equations.order.products)


def write_equations(system: MultibodySystem, tree: Tree, t: "ca.SX", y: "ca.SX", opened: list[int]) -> JointEquations:
    """Return K of a tree as expressions in ``t`` and ``y``, its loop rows, and its order of elimination at the start.

    The ball joints of the bodies ``opened`` are opened: three more velocities and three rows for each.
    """
    from . import loops
    from .motion import TreeMotion

    motion = TreeMotion(system, tree, t, y, opened=opened)
    held, rows, K = loops.list_ball_rows(motion), loops.list_loop_rows(motion), motion.assemble_inertia()
    n = len(K)
    for k, row in enumerate([*held, *rows], n):
        K[k] = {}
        for u, entry in row.J.items():
            K[k][u] = K[u][k] = entry
    order = order_rows(_evaluate_matrix(K, t, y, tree.start), tree.nu, len(held))
    return JointEquations(t, y, motion, K, n + len(held), rows, order)


def list_entries(found: JointEquations) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return the places of the entries of K that depend on the motion, and those of constant entries.

    A place is (column, row) with column <= row: each symmetric pair is listed once.
    """
    pairs = [(k, row) for k, column in found.K.items() for row in column if k <= row]
    constant = {(k, row) for k, row in pairs if found.K[k][row].is_constant()}
    return [pair for pair in pairs if pair not in constant], [pair for pair in pairs if pair in constant]


class MechanismFunctions:
    """The functions of a mechanism as expressions, from which its accelerations and its projection are composed."""

    def __init__(self, system: MultibodySystem, tree: Tree, found: JointEquations) -> None:
        """Write the functions of the equations ``found`` as expressions; constant entries of K and L stay constants."""
        import casadi as ca

        from ....harness.base.generated import GeneratedFunction
        from .motion import coordinate_rates
        from .stages import write_measure

        self._found = found
        t, y, motion, rows, first = found.t, found.y, found.motion, found.rows, found.first
        nq, nu, nr = tree.nq, tree.nu, len(rows)
        u, lam_at = y[nq:], range(first, first + nr)
        variable, constant = list_entries(found)
        given = ca.SX.sym("K", len(variable))
        K: Matrix = {k: {} for k in found.K}
        for (k, row), entry in [
            *zip(variable, _split_column(given), strict=True),
            *((p, found.K[p[0]][p[1]]) for p in constant),
        ]:
            K[k][row] = K[row][k] = entry
        factor = self.factor = Factor(K, found.order.rows)
        L = factor.name_entries()
        b = ca.SX.sym("b", nu + nr)
        x = factor.solve(
            {**dict(enumerate(_split_column(b[:nu]))), **dict(zip(lam_at, _split_column(b[nu:]), strict=True))}
        )
        of_rows = factor.solve(dict(zip(lam_at, _split_column(b[nu:]), strict=True)))
        lam_of_rows = _join_column([-of_rows.get(k, ca.SX(0)) for k in lam_at])
        ratio = ca.SX(1)
        for pivot, value in zip(factor.pivots, found.order.pivots, strict=True):
            ratio = ca.fmin(ratio, (1.0 / value) * pivot)
        efforts = motion.compute_generalised_forces(motion.compute_carried_loads(motion.compute_applied_forces()))
        loads = ca.vertcat(-efforts, *(-row.acceleration for row in rows))
        self.functions = {
            "entries": GeneratedFunction(
                [t, y], [_join_column([found.K[k][row] for k, row in variable]), ca.densify(loads), motion.q_dot(u)]
            ),
            "factor": GeneratedFunction([given], [_join_column(factor.entries), ratio]),
            "solve": GeneratedFunction(
                [L, b], [_join_column([x[k] for k in range(nu)]), _join_column([-x.get(k, ca.SX(0)) for k in lam_at])]
            ),
            "solve_rows": GeneratedFunction([L, b[nu:]], [lam_of_rows]),
            "measure": write_measure(tree),
            "record": _write_record(system, tree, nr),
        }
        step, q = ca.SX.sym("step", nu), ca.SX.sym("q", nq)
        moved = _normalise_quaternions(tree, motion.q + motion.q_dot(step) if rows else motion.q)
        gaps_and_rates = [_join_column([row.phi for row in rows]), _join_column([row.rate for row in rows])]
        phi, rates = ca.Function("rows", [t, y], gaps_and_rates)(t, ca.vertcat(moved, u))
        still = [ca.SX(0)] * nu
        self.functions |= {
            "gaps": GeneratedFunction([t, y], [_join_column([*still, *(-row.phi for row in rows)])]),
            "move": GeneratedFunction(
                [t, y, step], [moved, _join_column([*still, *_split_column(-rates)]), ca.densify(phi)]
            ),
            "conclude": GeneratedFunction([y, q, step], [ca.vertcat(q, u + step), coordinate_rates(tree, q, u + step)]),
        }
        places = [place for pair in (*variable, *constant) for place in pair]
        constants = [float(found.K[k][row]) for k, row in constant]
        tables = places, constants, found.order.rows, found.order.pivots
        self.tables = [ca.SX(ca.DM([float(x) for x in table])) for table in tables]
        self.sizes = (
            nr,
            len(factor.entries),
            len(variable) + len(constant),
            len(variable),
            len(found.order.rows),
            nu,
            found.held,
        )

    def accelerate(self) -> "GeneratedFunction":
        """Return the function (t, y) -> y_dot, least pivot, composed of ``entries``, ``factor`` and ``solve``."""
        import casadi as ca

        from ....harness.base.generated import GeneratedFunction

        t, y = self._found.t, self._found.y
        entries, factor, solve = (self._make_casadi_function(name) for name in ACCELERATION)
        K, b, q_dot = entries(t, y)
        L, ratio = factor(K)
        return GeneratedFunction([t, y], [ca.vertcat(q_dot, solve(L, b)[0]), ratio])

    def finish(self) -> "GeneratedFunction":
        """Return the function (t, y) -> y projected onto the loops, y_dot, lam."""
        import casadi as ca

        from ....harness.base.generated import GeneratedFunction

        t, y = self._found.t, self._found.y
        entries, factor, solve, gaps, move, conclude = (
            self._make_casadi_function(name) for name in (*ACCELERATION, "gaps", "move", "conclude")
        )
        K, b, _ = entries(t, y)
        L, _ = factor(K)
        u_dot, lam = solve(L, b)
        q, slips, _ = move(t, y, solve(L, gaps(t, y))[0])
        after, q_dot = conclude(y, q, solve(L, slips)[0])
        return GeneratedFunction([t, y], [after, ca.vertcat(q_dot, u_dot), lam])

    def _make_casadi_function(self, name: str) -> "ca.Function":
        """Return the function ``name`` of ``functions`` as a CasADi function, which can be called with expressions."""
        import casadi as ca

        function = self.functions[name]
        return ca.Function(name, list(function.inputs), [ca.densify(x) for x in function.outputs])


def _write_record(system: MultibodySystem, tree: Tree, rows: int) -> "GeneratedFunction":
    """Return the function ``record``: (t, y, y_dot, lam) -> r, R, v, v_dot of all bodies, reactions of all joints.

    ``rows`` is the number of loop rows, the length of lam. Results are in the system's frames and order.
    """
    import casadi as ca

    from ....harness.base.generated import GeneratedFunction
    from . import loops
    from .motion import TreeMotion, Wrench

    t, y, y_dot = ca.SX.sym("t"), ca.SX.sym("y", tree.nq + tree.nu), ca.SX.sym("y_dot", tree.nq + tree.nu)
    lam = ca.SX.sym("lam", rows)
    motion = TreeMotion(system, tree, t, y, y_dot[tree.nq :])
    loads, held = motion.compute_applied_forces(), loops.compute_row_loads(motion, lam)
    carried = motion.compute_carried_loads({b: Wrench(x.f + held[b].f, x.n + held[b].n) for b, x in loads.items()})
    first = system.row_start
    reaction: list[Any] = [ca.SX(0)] * system.nrows
    back = ca.SX(ca.DM(tree.base.T))
    parts = {
        limb.joint: loops.compute_reaction(motion, limb, carried[limb.body]) for limb in tree.limbs if limb.joint >= 0
    }
    at = np.concatenate(([0], np.cumsum(system.joint_rows[list(tree.cuts)]))).astype(int)
    parts |= {k: lam[int(at[n]) : int(at[n + 1])] for n, k in enumerate(tree.cuts)}
    for k, own in parts.items():
        points = int(system.joint_points[k])
        own = ca.vertcat(back @ own[:points], own[points:]) if points else own
        reaction[first[k] : first[k + 1]] = _split_column(own)
    r, R, v, v_dot = [], [], [], []
    for b in range(system.nb):
        F, c, omega = ca.SX(ca.DM(tree.frames[b])), motion.centre[b], motion.omega[b]
        R_b = motion.R[b] @ F
        r.append(back @ (motion.P[b] + c))
        R.append(ca.vec((back @ R_b).T))
        v += [back @ (motion.v[b] + ca.cross(omega, c)), R_b.T @ omega]
        v_dot += [back @ (motion.a[b] + motion.W[b] @ c), R_b.T @ motion.alpha[b]]
    return GeneratedFunction([t, y, y_dot, lam], [ca.densify(_join_column(x)) for x in (r, R, v, v_dot, reaction)])


def _evaluate_matrix(
    K: dict[int, dict[int, Any]], t: "ca.SX", y: "ca.SX", start: np.ndarray
) -> dict[int, dict[int, float]]:
    """Return the values of K, by columns, at t = 0 and the coordinates and velocities ``start``."""
    import casadi as ca

    places = [(k, row) for k, column in K.items() for row in column]
    values = ca.Function("K", [t, y], [_join_column([K[k][row] for k, row in places])])(0.0, start)
    out: dict[int, dict[int, float]] = {k: {} for k in K}
    for (k, row), value in zip(places, np.asarray(values, dtype=float).ravel().tolist(), strict=True):
        out[k][row] = value
    return out


def _normalise_quaternions(tree: Tree, q: "ca.SX") -> "ca.SX":
    """Return the coordinates ``q`` with the quaternions of balls divided by their lengths."""
    import casadi as ca

    out = ca.SX(q)
    for limb in tree.limbs:
        if limb.ball:
            own = slice(limb.q_at + len(limb.slides), limb.q_at + limb.sizes[0])
            out[own] = q[own] / ca.sqrt(ca.dot(q[own], q[own]))
    return out


def _split_column(x: "ca.SX") -> list[Any]:
    """Return the entries of a CasADi column as a list."""
    return [x[k] for k in range(x.numel())]


def _join_column(x: list[Any]) -> "ca.SX":
    """Return the expressions ``x`` as a dense CasADi column, of size 0 if there are none."""
    import casadi as ca

    return ca.densify(ca.vertcat(*x)) if len(x) else ca.SX(0, 1)


@remember_last
def _digest(system: MultibodySystem, tree: Tree) -> str:
    """Return a digest of all numbers of a system and of its tree."""
    digest = hashlib.sha256(repr([limb[:4] for limb in tree.limbs]).encode())
    arrays = {field.name: getattr(system, field.name) for field in fields(system)}
    arrays |= {f"limb {k} {n}": a for k, limb in enumerate(tree.limbs) for n, a in limb._asdict().items()}
    arrays |= {"base": tree.base, "frames": tree.frames, "start": tree.start}
    for name, a in arrays.items():
        if isinstance(a, np.ndarray) and a.dtype != object:
            digest.update(f"{name} {a.shape} {a.dtype}".encode() + a.tobytes())
    return digest.hexdigest()


@cache
def _digest_generator() -> str:
    """Return a digest of the modules that generate the code, so that code of another version is made again."""
    names = ("code", "elimination", "loops", "motion", "pivots", "stages")
    paths = [Path(__file__).with_name(f"{name}.py") for name in names]
    paths += [Path(joint_tree.__file__), Path(fixed_order.__file__), Path(tableaux.__file__)]
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()
