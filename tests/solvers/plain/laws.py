"""Laws of what compiled steps call: the kernel's entries, rotations, free bodies and the block LU, by plain NumPy.

A law costs milliseconds where a run costs a second, and its message is nearer to the fault. Kernels are compared with
``plain.mechanics``, free bodies with ``plain.rattle``, rotations with ``so3``, linear algebra with NumPy.
"""

import math
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from mbsbench import Joint, RigidBody, State, assemble, so3
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.joints import KINDS, JointKind
from mbsbench.harness.mechanics.system import MultibodySystem
from mbsbench.solvers.formulations.compiled import algebra, block_lu
from mbsbench.solvers.formulations.compiled.entries import BoundFunction
from mbsbench.solvers.formulations.compiled.kernel import list_parts, make_kernel, set_state
from mbsbench.solvers.formulations.compiled.saddle_pattern import analyse_saddle
from mbsbench.solvers.formulations.methods import free_body, radau, radau_error
from mbsbench.solvers.plain import radau_ggl, rattle
from mbsbench.solvers.plain.mechanics import Mechanism, move, solve

from ..arbitrary_joints import all_joints, moving_rows, one_joint
from ..arbitrary_systems import consistent, linkage, with_user_forces

ROUNDED = 1e-15  # of single operations
LEFT = 1e-12  # of the size of a quantity: what rounding leaves of solutions with S
ENTRIES = ("rows", "factorise", "solve", "accelerate", "close_joints", "project_rates")
ENTRIES += ("divide", "push", "push_kept", "keep_rows", "slips")
SHIFT = 0.3


class Law(NamedTuple):
    """Quantities that compiled functions compute, and the same by plain NumPy."""

    name: str
    solve: Callable[[], dict[str, np.ndarray]]
    plain: dict[str, np.ndarray]
    left: float  # of a quantity's size

    def compare(self, found: dict[str, np.ndarray]) -> None:
        """Raise AssertionError where a quantity differs, with its place and both numbers."""
        for quantity, plain in self.plain.items():
            shapes = found[quantity].shape, plain.shape
            assert shapes[0] == shapes[1], f"{self.name}: {quantity} {shapes[0]}, by the plain method {shapes[1]}"
            gap = np.abs(found[quantity] - plain)
            if not np.all(gap <= self.left * max(1.0, float(np.max(np.abs(plain), initial=0.0)))):  # NaN is wrong
                at = np.unravel_index(np.argmax(np.where(np.isfinite(gap), gap, np.inf)), gap.shape)
                place = list(map(int, at)) if at else ""
                one, two = float(found[quantity][at]), float(plain[at])
                raise AssertionError(f"{self.name}: {quantity}{place} is {one!r}, by the plain method {two!r}")

    def describe_change(self, before: dict[str, np.ndarray], after: dict[str, np.ndarray]) -> str:
        """Return by how much quantities differ that both meet the law, in words; empty for the same bits."""
        gap = max(float(np.max(np.abs(after[name] - x), initial=0.0)) for name, x in before.items())
        return f"quantities differ by {gap:.1e}" if gap else ""


def make_laws(rooms: Collection[str]) -> list[Law]:
    """Make all laws of some rooms: ``kernel``, ``rotations``, ``saddle``, or of solvers."""
    found = []
    if "kernel" in rooms:
        found += [_of_kernel(name, system, seed) for name, (system, seed) in list_mechanisms().items()]
    if "rotations" in rooms:
        found.append(_of_rotations())
    found += [_of_free_body(solver) for solver in ("rattle", "lie_variational") if solver in rooms]
    if "radau_ggl" in rooms:
        found.append(_of_radau())
    if "saddle" in rooms:
        found.append(_of_saddle())
    return found


def list_mechanisms() -> dict[str, tuple[MultibodySystem, int]]:
    """Return mechanisms with seeds of their states: hinges, pins, rows of any other kind, moving and redundant ones."""
    flat = [Joint(b, (-0.4, 0, 0), b - 1, (0.4, 0, 0), (0, 0, 1), (0, 0, 1)) for b in range(2)]
    return {
        "spherical": (with_user_forces(), 3),
        "revolute": (linkage(springs=True), 2),
        "revolute along an axis of space": (assemble([RigidBody(1.0, np.diag([0.1, 0.2, 0.3]))] * 2, flat), 2),
        "all joints": (all_joints(), 2),
        "moving rows": (moving_rows(None), 4),
        "revolute, twice": (one_joint(JointKind.REVOLUTE, ground=False, times=2)[0], 2),
        "planar loop": (make_problem("random_linkage", {"linkage": "planar"}).system, 0),
    }


def _of_kernel(name: str, system: MultibodySystem, seed: int) -> Law:
    """The kernel's entries at a state of a mechanism."""
    m, loop = Mechanism(system), name == "planar loop"
    s = make_problem("random_linkage", {"linkage": "planar"}).initial if loop else consistent(system, seed, 0.4)
    random = np.random.default_rng(seed)
    w, x = random.standard_normal((system.nb, 6)), random.standard_normal(m.nr)
    y = m.rows(s.t, s.r, s.R, np.hstack((s.v, s.Omega))).A @ w.ravel()  # of a motion, redundant rows or not
    away = 0.0 if loop else 1e-2  # copies of a joint agree off phi = 0, too; the rows of a loop do not
    change = away * random.standard_normal((system.nb, 6))
    other = State(*move(s.r, s.R, change), s.v, s.Omega, s.t)

    def solve_by_kernel() -> dict[str, np.ndarray]:
        return _run_kernel(system, (s, other), w, x, y)

    left = 1e-9 if loop else LEFT  # its rows are as nearly dependent as its pose is closed
    return Law(f"kernel, {name}", solve_by_kernel, _evaluate_mechanism(m, (s, other), w, x, y), left)


def _run_kernel(system: Any, states: Any, w: np.ndarray, x: np.ndarray, y: np.ndarray) -> dict[str, np.ndarray]:
    k, found = make_kernel(system, ENTRIES), dict[str, Any]()

    def begin(state: State) -> None:
        set_state(k, state)
        k.rows.run()
        k.factorise.run()

    def call(entry: str, of: np.ndarray | None = None) -> None:
        k.w[:] = w
        k.x[k.order] = k.rhs[k.order] = x if of is None else of
        getattr(k, entry).run()

    begin(states[0])
    found["rank"] = np.array(float(k.state["rank"]))
    call("slips")
    found["rate of row"] = -k.x[k.order]
    call("push")
    found["pushed velocity of body"] = k.w.copy()
    call("divide")
    found["divided velocity of body"] = k.w.copy()
    call("keep_rows")
    call("solve", y)
    found["solution with S, as a velocity of body"] = _push(k, k.rhs)
    k.accelerate.run()
    found["acceleration of body"], found["load as a velocity of body"] = k.v_dot.copy(), _push(k, k.lam)
    begin(states[1])
    joint = [list_parts(system)[1][part].joint for part in k.blocks.joint]
    Q = np.array([k.turn[col] for col in np.argsort(joint, kind="stable") if np.any(k.turn[col])]).reshape(-1, 3, 3)
    found["products of directions of hinge"] = Q @ np.swapaxes(Q, 1, 2)
    found["axis of hinge, times itself,"] = np.einsum("ni,nj->nij", Q[:, 2], Q[:, 2])
    found["least component of hinge"] = np.array([one[0, np.argmin(np.abs(one[2]))] for one in Q])
    call("push_kept")
    found["velocity of body, pushed by rows kept"] = k.w.copy()
    k.v[:] = w
    k.rows.run()
    k.project_rates.run()
    found["projected velocity of body"], found["impulse as a velocity of body"] = k.v.copy(), _push(k, k.rhs)
    k.close_joints.run()
    found["closed position of body"], found["closed pose of body"] = k.r.copy(), k.R.copy()
    k.state["shift"] = SHIFT
    begin(states[0])
    call("solve")
    found["multiplier of shifted row"] = k.rhs[k.order]
    return found


def _push(k: Any, x: np.ndarray) -> np.ndarray:
    """M^-1 A^T x, which tells what multipliers are where redundant rows share them by a rule."""
    k.w[:], k.x[:] = 0.0, x
    k.push.run()
    return k.w.copy()


def _evaluate_mechanism(m: Mechanism, states: Any, w: np.ndarray, x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    """The same by the plain mechanism."""
    s, other = states
    v = np.hstack((s.v, s.Omega))
    rows, again = m.rows(s.t, s.r, s.R, v), m.rows(other.t, other.r, other.R, w)
    n = _list_axes(m.system, other)
    v_dot, lam = m.accelerate(s.t, s.r, s.R, v)

    def push(A: np.ndarray, by: np.ndarray) -> np.ndarray:
        return m.divide_by_inertia(A.T @ by).reshape(-1, 6)

    S, S1 = m.schur(rows.A, rows.A), m.schur(again.A, again.A)
    impulse = push(again.A, solve(S1, -again.phi_dot))
    r, R = move(other.r, other.R, push(again.A, solve(S1, -again.phi)))
    return {
        "rank": np.array(float(np.linalg.matrix_rank(S, tol=1e-9))),
        "products of directions of hinge": np.tile(np.eye(3), (len(n), 1, 1)),
        "axis of hinge, times itself,": np.einsum("ni,nj->nij", n, n),
        "least component of hinge": np.zeros(len(n)),
        "rate of row": rows.phi_dot + rows.A @ (w - v).ravel(),
        "pushed velocity of body": w + push(rows.A, x),
        "divided velocity of body": m.divide_by_inertia(w.ravel()).reshape(-1, 6),
        "solution with S, as a velocity of body": push(rows.A, solve(S, y)),
        "acceleration of body": v_dot.reshape(-1, 6),
        "load as a velocity of body": push(rows.A, lam),
        "velocity of body, pushed by rows kept": w + push(rows.A, x),
        "projected velocity of body": w + impulse,
        "impulse as a velocity of body": impulse,
        "closed position of body": r,
        "closed pose of body": R,
        "multiplier of shifted row": np.linalg.solve(S + SHIFT * np.diag(np.diag(S)), x),
    }


def _list_axes(system: MultibodySystem, s: State) -> np.ndarray:
    """Return the axes of hinges in space, without those that are axes of space."""
    hinges = [j for j, sort in enumerate(system.joint_sort) if KINDS[sort] == JointKind.REVOLUTE]
    n = np.array([s.R[system.joint_i[j]] @ system.joint_u[j] for j in hinges]).reshape(-1, 3)
    return n[np.sort(np.abs(n), axis=1)[:, 1] > 1e-12]


SQUARES = (1e-8, 9.9e-3, 1.1e-2, 0.3, 0.85, 0.999, 1.3, 4.0)  # of angles: on both sides of where series begin
SCALE = 0.7
OF_ALGEBRA = ("multiply", "multiply_transposed", "turn_rotation", "set_dexp", "orthogonalise_rotations")
OF_ALGEBRA += ("evaluate_sine_ratios", "theta_dot")


def _evaluate_algebra(a: np.ndarray, b: np.ndarray, M: np.ndarray, nearly: np.ndarray) -> tuple[np.ndarray, ...]:
    """Call each function of ``algebra`` on each sample, as Python: what is compiled has none of its own."""
    own = {name: as_python(getattr(algebra, name)) for name in OF_ALGEBRA}
    rotated, dexp, orthogonal = np.zeros_like(M), np.zeros((len(a), 9)), nearly.copy()
    with interpret(algebra):
        for n in range(len(a)):
            own["turn_rotation"](M[n], *a[n], rotated[n])
            own["set_dexp"](*a[n], SCALE, dexp[n])
        own["orthogonalise_rotations"](orthogonal)
        ratios = [own["evaluate_sine_ratios"](x @ x) for x in a]
        products, back = ([own[name](A, *x) for A, x in zip(M, b, strict=True)] for name in OF_ALGEBRA[:2])
        rate = [own["theta_dot"](*x, *y) for x, y in zip(a, b, strict=True)]
    return tuple(map(np.array, (ratios, rotated, products, back, rate, dexp, orthogonal)))


@contextmanager
def interpret(module: ModuleType) -> Iterator[None]:
    """Let the functions of a module call each other as Python: what is compiled must not be called from there."""
    own = {name: as_python(f) for name, f in vars(module).items() if hasattr(f, "py_func") or hasattr(f, "function")}
    with patch.multiple(module, **own):
        yield


def as_python(function: Any) -> Any:
    """The plain Python of an inline function: numba's takes its place once something has been compiled."""
    return getattr(function, "py_func", None) or function.function


def _of_rotations() -> Law:
    """Products, exponentials and their derivatives."""
    random, n = np.random.default_rng(1), 3 * len(SQUARES)
    a, b, M = random.standard_normal((n, 3)), random.standard_normal((n, 3)), random.standard_normal((n, 3, 3))
    a *= np.sqrt(np.repeat(SQUARES, 3) / np.sum(a * a, axis=1))[:, None]
    nearly = so3.exp(b) + 1e-4 * M
    square = np.sum(a * a, axis=1)
    angle, hat = np.sqrt(square), so3.hat(a)
    g = 2.0 * np.sin(0.5 * angle) ** 2 / square
    h = sum((-square) ** k / math.factorial(2 * k + 3) for k in range(12))  # (a - sin a)/a^3, which cancels
    c = np.where(
        square < 1e-2,
        1.0 / 12.0 + square / 720.0 + square**2 / 30240.0 + square**3 / 1209600.0,
        (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / square,
    )
    ratio = np.sin(angle) / angle
    dexp = np.eye(3) - g[:, None, None] * hat + h[:, None, None] * hat @ hat
    across = np.cross(a, b)
    plain = {
        "sin(a)/a and (1 - cos a)/a^2 of sample": np.stack((ratio, g), axis=1),
        "rotation of sample": M @ (np.eye(3) + ratio[:, None, None] * hat + g[:, None, None] * hat @ hat),
        "product of sample": np.einsum("nij,nj->ni", M, b),
        "product with the transposed matrix of sample": np.einsum("nji,nj->ni", M, b),
        "dexp^-1 of sample": b + 0.5 * across + c[:, None] * np.cross(a, across),
        "dexp of sample": SCALE * dexp.reshape(n, 9),
        "orthogonalised matrix of sample": nearly @ (1.5 * np.eye(3) - 0.5 * np.swapaxes(nearly, 1, 2) @ nearly),
    }

    def evaluate() -> dict[str, np.ndarray]:
        return dict(zip(plain, _evaluate_algebra(a, b, M, nearly), strict=True))

    return Law("rotations", evaluate, plain, ROUNDED)


FREE_STEP, TURNED = 0.3, so3.exp(np.array([0.4, -0.7, 0.2]))
INERTIAS = [np.diag(one) for one in ((2, 3, 4), (2, 4, 3), (3, 2, 2), (2, 3, 2), (2, 2, 3), (2, 2, 2))]
INERTIAS += [Q @ np.diag(one) @ Q.T for Q in (TURNED, TURNED.T @ TURNED.T) for one in ((2, 3, 4), (3, 2, 2), (2, 2, 3))]


def _of_free_body(solver: str) -> Law:
    """Free bodies of three, two and one principal inertias, along their axes and not."""
    random, J = np.random.default_rng(1), np.array(INERTIAS, dtype=float)
    R, L = so3.exp(random.standard_normal((len(J), 3))), 1.5 * random.standard_normal((len(J), 3))
    free = solver == "rattle"
    turn = rattle.turn_freely if free else rattle.turn_discretely
    ends = [turn(*one) for one in zip(J, [FREE_STEP] * len(J), R, L, strict=True)]
    plain = dict(
        zip(("pose R of body", "momentum J Omega of body"), map(np.array, zip(*ends, strict=True)), strict=True)
    )

    def evaluate() -> dict[str, np.ndarray]:
        turned, momentum, axes = R.copy(), L.copy(), free_body.find_principal_axes(J)
        with interpret(algebra), interpret(free_body):
            for b in range(len(J)):
                if free:
                    free_body.turn_freely(axes, b, FREE_STEP, turned, momentum[b])
                else:
                    free_body.turn_discretely(J[b], FREE_STEP, turned[b], momentum[b])
        return dict(zip(plain, (turned, momentum), strict=True))

    return Law(f"{solver}, free body", evaluate, plain, 1e-13)


def _of_radau() -> Law:
    """Coefficients of Radau's step and of its error, and the tolerances that follow from those of the error."""
    rtol = np.array([1e-3, 1e-6, 1e-8, 1e-9, 1e-12])
    plain = {"a": radau_ggl.A, "c": radau_ggl.C, "e": radau_ggl.E, "gamma": np.array(radau_ggl.GAMMA)}
    plain["tolerance over 1e-13 at rtol"] = np.array([1e3, 1e3, 1e2, 10.0, 1.0])

    def evaluate() -> dict[str, np.ndarray]:
        tolerances = np.array(list(map(radau.choose_newton_tolerance, rtol))) / 1e-13
        found = (radau.A, radau.C, radau.ERROR, np.array(radau_error.GAMMA), tolerances)
        return dict(zip(plain, found, strict=True))

    return Law("radau_ggl, coefficients", evaluate, plain, ROUNDED)


def _of_saddle() -> Law:
    """A system of equations in the pattern of a linkage of joints of one to five rows."""
    bodies = np.array([[0, -1], [1, 0], [2, 1], [0, 2], [1, -1], [2, -1]])
    row, pairs = np.cumsum([0, 1, 2, 3, 4, 5, 3]), np.array([[0, 0], [1, 1], [2, 2], [0, 1], [1, 0], [2, 1]])
    lu = analyse_saddle(bodies, row, pairs, np.array([3, 4, 5]))[1]
    random, n = np.random.default_rng(1), len(lu.x)
    blocks, right, A = random.standard_normal(len(lu.blocks)), random.standard_normal(n), np.zeros((n, n))
    for p in range(len(lu.size)):
        for pair in range(lu.pair_start[p], lu.pair_start[p + 1]):
            width, place = lu.pair_width[pair], lu.pair_place[pair]
            own = blocks[place : place + lu.size[p] * width].reshape(-1, width)
            A[lu.start[p] : lu.start[p + 1], lu.pair_column[pair] : lu.pair_column[pair] + width] += own
    plain = {"unknown": np.linalg.solve(A, right), "logarithm of the pivots": np.array(np.linalg.slogdet(A)[1])}

    def solve_by_code() -> dict[str, np.ndarray]:
        lu.blocks[:], lu.x[:] = blocks, right
        BoundFunction(block_lu.factor, lu)()
        BoundFunction(block_lu.solve, lu)()
        return {"unknown": lu.x.copy(), "logarithm of the pivots": np.array(np.sum(np.log(lu.pivot)))}

    return Law("saddle", solve_by_code, plain, 1e-10)
