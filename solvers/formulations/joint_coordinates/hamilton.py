"""Hamilton's equations of a tree, and the rows that close its loops, as machine code kept on disk.

Coordinates q and momenta p: an angle or a length of a hinge or a slide; for a spherical joint (ball) a quaternion x, of
any length, and four momenta y. With E(x) w = w x, angular velocities u of balls and their momenta pi in the base frame,

    q_dot = u,            p_dot = T_q(q, u) + Q - G^T lam,                                  H(q) u = pi = p
    x_dot = E(x) u / 2,   y_dot = E(y) u / 2 + 2 E(x) (T_theta + Q_theta) / |x|^2 - G^T lam,   pi = E(x)^T y / 2

This is a canonical system in all of R^2n, R = R(x / |x|). Its energy depends on y by pi alone, so that |x|^2, a
quadratic form, is an invariant, and the component of y along x has no effect. With ``radial`` the energy has another
term alpha (x . y)^2 / 2, zero in motion, and |x|^2 = 1 is a row, for methods that do not keep quadratic invariants;
free spins are then not in q, and ``close`` adds them to y. G is the gradient of all rows; rows left out have lam = 0.

    stage(t, q, p) -> q_dot, p_dot        without rows
    enter(y) -> p                         y = (q, u)
    gaps(t, q) -> phi                     push(t, q, lam) -> G^T lam
    pose(t, q, p) -> y, b                 y at rest, with unit quaternions; b: momenta, and rates of rows
    add_spins(y, K) -> K                  with ``radial``, where there are free spins
    close(t, q, p, u, lam) -> y, lam      from the solution: p - G^T lam moves on phi_dot = 0, with y
    soften(phi) -> lam                    of the rows |x|^2

S^-1, S = G H^-1 G^T, is that of the code of module ``code``: of its K at y, in its order of elimination or by lists.
"""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ....harness.base.code_meter import making_code
from ....harness.base.generated import Code, Program
from ....harness.base.generated.code import print_functions
from ....harness.mechanics.fixed_order import product
from ....harness.mechanics.joint_tree import Limb, Tree, remove_rounding
from ....harness.mechanics.system import MultibodySystem
from .code import (
    MOST_OPERATIONS,
    CodeTooLarge,
    _evaluate_matrix,
    _join_column,
    _normalise_quaternions,
    _split_column,
    digest_mechanism,
    find_equations,
    list_entries,
    refuse_size,
)
from .elimination import Factor, Matrix
from .pivots import order_rows

if TYPE_CHECKING:
    import casadi as ca

    from ....harness.base.generated import GeneratedFunction
    from .code import JointEquations
    from .motion import TreeMotion


class HamiltonCode(NamedTuple):
    """The code of Hamilton's equations of a mechanism, and its sizes."""

    code: Code
    rows: int  # rows of the loops, and with ``radial`` those of |x|^2
    spins: int
    operations: int  # operations of ``stage``

    @property
    def words(self) -> str:
        """Note for the trajectory, which says that code evaluates the stages."""
        return f"code of {self.operations} operations a stage"

    def bind(self, name: str, *arrays: np.ndarray) -> Program:
        """Return the program that calls the code's function ``name`` with these arrays; nothing is run."""
        return Program([(self.code.address(name), arrays)], self)


@making_code
def make_hamilton_code(system: MultibodySystem, tree: Tree, *, radial: bool = False) -> HamiltonCode:
    """Return the code of Hamilton's equations of a mechanism, loaded from disk or made and stored.

    ``radial`` includes the energy and the rows that keep quaternions at length one. Raises ``CodeTooLarge``, a
    ValueError, above ``MOST_OPERATIONS``.
    """
    files = [Path(__file__), Path(__file__).with_name("spins.py")]
    text = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    equations = digest_mechanism(system, tree)
    code = Code(lambda: _generate_ir(system, tree, equations, radial), f"{equations}\0{text}\0{radial}")
    about = np.zeros(3)
    code.function("about", 1)(about.ctypes.data)
    rows, spins, operations = (int(x) for x in about)
    if operations > MOST_OPERATIONS:
        raise CodeTooLarge(refuse_size(operations))
    return HamiltonCode(code, rows, spins, operations)


def _generate_ir(system: MultibodySystem, tree: Tree, equations: str, radial: bool) -> str:
    """Return the LLVM IR of the functions and of ``about``, which states their sizes; of that alone if too large."""
    import casadi as ca

    from ....harness.base.generated.functions import GeneratedFunction, record_function

    functions, rows, spins = _write_functions(system, tree, find_equations(system, tree, equations), radial)
    operations = len(record_function(functions["stage"]).tape.operations)
    if operations > MOST_OPERATIONS:
        functions = {}
    return print_functions({**functions, "about": GeneratedFunction([], [ca.vertcat(rows, spins, operations)])})


def _write_functions(
    system: MultibodySystem, tree: Tree, found: "JointEquations", radial: bool
) -> "tuple[dict[str, GeneratedFunction], int, int]":
    """Return the functions of the module's docstring by name as expressions, the number of rows, and of free spins."""
    import casadi as ca

    from ....harness.base.generated import GeneratedFunction
    from .motion import TreeMotion
    from .spins import find_spins

    nq, nu, first, rows = tree.nq, tree.nu, found.first, found.rows
    t, y, q, p = found.t, found.y, ca.SX.sym("q", nq), ca.SX.sym("p", nq)
    x, u, pi = y[:nq], y[nq:], ca.SX.sym("pi", nu)  # with unit quaternions
    balls = [limb for limb in tree.limbs if limb.ball]
    spins = find_spins(system, tree) if radial else []
    added: Matrix = {k: {} for k in range(first)}
    for spin in spins:
        spin.add_inertia(added, found.motion)
    H = {
        k: {row: entry + added[k].get(row, 0) for row, entry in found.K[k].items() if row < first} for k in range(first)
    }
    at_start = _evaluate_matrix(H, t, y, tree.start)
    of_tree = Factor(H, order_rows({k: dict(column) for k, column in at_start.items()}, nu, found.held).rows)

    moving, resting = (TreeMotion(system, tree, t, ca.vertcat(x, w)) for w in (u, ca.SX.zeros(nu)))
    energy = _express_kinetic_energy(moving)
    whole_energy = sum((spin.added_energy(moving) for spin in spins), energy)
    forces = _project_momenta(tree, x, ca.gradient(whole_energy, y)[:nq]) - _express_loads(moving, resting)
    phi, lam = _join_column([row.phi for row in rows]), ca.SX.sym("lam", len(rows) + (len(balls) if radial else 0))
    gradient = ca.gradient(ca.dot(phi, lam[: len(rows)]), y)[:nq] if rows else ca.SX.zeros(nq)
    moved = of_tree.solve({k: pi[k] for k in range(nu)})
    q_held, u_held = ca.SX(x), ca.SX(u)
    for spin in spins:
        spin.add_turn(q_held, u_held, found.motion, pi)

    def express(outputs: Sequence[ca.SX], velocities: ca.SX, momenta: ca.SX) -> list[ca.SX]:
        """Return ``outputs`` as expressions of ``q``, with unit quaternions, and of these velocities and momenta."""
        values = ca.Function("expressed", [t, y, pi, lam], list(outputs))
        out = values(t, ca.vertcat(_normalise_quaternions(tree, q), velocities), momenta, lam)
        return list(out) if isinstance(out, tuple) else [out]

    rest, lowered, given_u = ca.SX.zeros(nu), _project_momenta(tree, q, p), ca.SX.sym("u", nu)
    (velocities,) = express([_join_column([moved[k] for k in range(nu)])], rest, lowered)
    (forces,) = express([forces], velocities, lowered)
    phi, gradient, slips = express(
        [phi, _project_momenta(tree, x, gradient), _join_column([-row.rate for row in rows])], rest, lowered
    )
    (held,) = express([ca.vertcat(q_held, u_held)], given_u, lowered)
    q_dot, p_dot = (
        _express_coordinate_rates(tree, q, velocities),
        _lift_momenta(tree, q, forces) + _express_coordinate_rates(tree, p, velocities, slides=0.0),
    )
    push, mu = _lift_momenta(tree, q, gradient), -lam[: len(rows)]
    softened = ca.SX.sym("phi", len(balls) if radial else 0)
    soft = []
    for n, limb in enumerate(balls if radial else []):
        alpha, own = _compute_softness(limb, at_start), _slice_quaternion(limb)
        along = ca.dot(q[own], p[own])
        q_dot[own] += alpha * along * q[own]
        p_dot[own] -= alpha * along * p[own]
        square = ca.dot(q[own], q[own])
        phi, mu = ca.vertcat(phi, 0.5 * (square - 1.0)), ca.vertcat(mu, along / square)
        push[own] += lam[len(rows) + n] * q[own]
        soft.append(softened[n] / alpha)
    functions = {
        "stage": GeneratedFunction([t, q, p], [q_dot, p_dot]),
        "enter": GeneratedFunction([y], [_lift_momenta(tree, x, ca.gradient(energy, y)[nq:])]),
        "gaps": GeneratedFunction([t, q], [phi]),
        "push": GeneratedFunction([t, q, lam], [push]),
        "pose": GeneratedFunction(
            [t, q, p], [ca.vertcat(_normalise_quaternions(tree, q), rest), ca.vertcat(lowered, slips)]
        ),
        "close": GeneratedFunction([t, q, p, given_u, lam[: len(rows)]], [held, mu]),
        "soften": GeneratedFunction([softened], [_join_column(soft)]),
    }
    if spins:
        variable, _ = list_entries(found)
        K = ca.SX.sym("K", len(variable))
        entries = [
            entry + added[k].get(row, 0) if k < first else entry
            for (k, row), entry in zip(variable, _split_column(K), strict=True)
        ]
        functions["add_spins"] = GeneratedFunction([y, K], [_join_column(entries)])
    return functions, lam.numel(), len(spins)


def _express_kinetic_energy(motion: "TreeMotion") -> "ca.SX":
    """Return the kinetic energy [J] of all bodies of a motion as an expression, without added inertia of spins."""
    import casadi as ca

    T = ca.SX(0)
    for b in motion.limb:
        F, system = motion.tree.frames[b], motion.system
        v, turn = motion.v[b] + ca.cross(motion.omega[b], motion.centre[b]), motion.R[b].T @ motion.omega[b]
        inertia = ca.SX(ca.DM(remove_rounding(product(product(F, system.regular_inertia[b]), F.T))))
        T += 0.5 * (system.mass[b] * ca.dot(v, v) + ca.dot(turn, inertia @ turn))
    return T


def _express_loads(moving: "TreeMotion", resting: "TreeMotion") -> "ca.SX":
    """Return minus the generalised forces of weights and applied forces, along the tree's velocities.

    ``moving`` has the velocities on which forces depend; ``resting``, the same pose at rest, adds no inertial forces.
    """
    return resting.compute_generalised_forces(resting.compute_carried_loads(moving.compute_applied_forces()))


def _slice_quaternion(limb: Limb) -> slice:
    """Return the slice of the quaternion of a limb's ball joint among the coordinates."""
    return slice(limb.q_at + len(limb.slides), limb.q_at + limb.sizes[0])


def _split_velocities(limb: Limb, u: "ca.SX") -> "tuple[ca.SX, ca.SX]":
    """Return the velocities of a limb among ``u``: those of its slides, and those of its hinges or ball."""
    ns = len(limb.slides)
    return u[limb.u_at : limb.u_at + ns, 0], u[limb.u_at + ns : limb.u_at + limb.sizes[1], 0]  # columns, even if empty


def _express_coordinate_rates(tree: Tree, q: "ca.SX", u: "ca.SX", slides: float = 1.0) -> "ca.SX":
    """Return q_dot at coordinates ``q`` and velocities ``u``; with ``slides`` = 0, only the rates of quaternions."""
    import casadi as ca

    out = ca.SX.zeros(tree.nq)
    for limb in tree.limbs:
        along, omega = _split_velocities(limb, u)
        if limb.ball:
            own, ns = q[_slice_quaternion(limb)], len(limb.slides)
            s, v = own[0], own[1:]
            out[_slice_quaternion(limb)] = 0.5 * ca.vertcat(-ca.dot(omega, v), s * omega + ca.cross(omega, v))
            out[limb.q_at : limb.q_at + ns] = slides * along
        else:
            out[limb.q_at : limb.q_at + limb.sizes[0]] = slides * ca.vertcat(along, omega)
    return out


def _project_momenta(tree: Tree, q: "ca.SX", p: "ca.SX") -> "ca.SX":
    """Return the momenta pi, conjugate to velocities, from ``p``, conjugate to coordinates: pi . u = p . q_dot."""
    import casadi as ca

    out = ca.SX.zeros(tree.nu)
    for limb in tree.limbs:
        own, n = p[limb.q_at : limb.q_at + limb.sizes[0]], len(limb.slides)
        if limb.ball:
            x, y = q[_slice_quaternion(limb)], own[n:]
            own = ca.vertcat(own[:n], 0.5 * (x[0] * y[1:] - y[0] * x[1:] + ca.cross(x[1:], y[1:])))
        out[limb.u_at : limb.u_at + limb.sizes[1]] = own
    return out


def _lift_momenta(tree: Tree, q: "ca.SX", pi: "ca.SX") -> "ca.SX":
    """Return the momenta p, conjugate to coordinates, from ``pi``; a ball joint's are normal to its quaternion."""
    import casadi as ca

    out = _express_coordinate_rates(tree, q, pi)
    for limb in tree.limbs:
        if limb.ball:
            x = q[_slice_quaternion(limb)]
            out[_slice_quaternion(limb)] = out[_slice_quaternion(limb)] * (4.0 / ca.dot(x, x))
    return out


def _compute_softness(limb: Limb, H: dict[int, dict[int, float]]) -> float:
    """Return alpha of a ball joint's radial energy alpha (x . y)^2 / 2: 1 / (4 I), with I its mean inertia in ``H``.

    The quaternion of a body with the inertia I about all axes has the inertia 4 I. ``H`` is that at the start.
    """
    at = limb.u_at + len(limb.slides)
    return 0.25 / float(np.mean([H[k][k] for k in range(at, at + 3)]))
