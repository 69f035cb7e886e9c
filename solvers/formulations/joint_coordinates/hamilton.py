"""Hamilton's equations of a tree, and the rows that close its loops, as machine code kept on disk.

Coordinates q and momenta p: an angle or a length of a hinge or a slide; of a ball a quaternion x, of any length, and
four momenta y. With E(x) w = w x, angular velocities u of balls and their momenta pi in the base frame,

    q_dot = u,            p_dot = T_q(q, u) + Q - G^T lam,                                  H(q) u = pi = p
    x_dot = E(x) u / 2,   y_dot = E(y) u / 2 + 2 E(x) (T_theta + Q_theta) / |x|^2 - G^T lam,   pi = E(x)^T y / 2

This is a canonical system in all of R^2n, R = R(x / |x|). Its energy depends on y by pi alone, so that |x|^2, a
quadratic form, is an invariant, and what y has along x has no effect. With ``radial`` the energy has a term
alpha (x . y)^2 / 2 beside, zero in motion, and |x|^2 = 1 is a row, for methods that do not keep quadratic invariants;
free spins are not in q, and ``close`` adds them to y.
G is the gradient of the rows that are kept.

    stage(t, q, p) -> q_dot, p_dot        without rows
    enter(y) -> p                         y = (q, u)
    gaps(t, q) -> phi                     push(t, q, lam) -> G^T lam
    factor(t, q) -> L                     solve(L, rhs) -> S^-1 rhs,   S = G H^-1 G^T
    close(t, q, p) -> y, lam              p - G^T lam moves on phi_dot = 0, with y
"""

import copy
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ....harness.code_meter import making_code
from ....harness.mechanics.fixed_order import product
from ....harness.mechanics.system import MultibodySystem
from ..generated import Code
from ..generated.code import print_functions
from ..rows.kept_code import texts_of_makers
from .code import (
    MOST_OPERATIONS,
    _column,
    _digest,
    _evaluate,
    _normalise,
    _own_text,
    _parts,
    choose_order,
    order_rows,
    too_large,
)
from .tree import Limb, Tree, snap

if TYPE_CHECKING:
    import casadi as ca

    from ..generated import Straight
    from .elimination import Factor
    from .motion import Motion


class HamiltonCode(NamedTuple):
    """The code of a mechanism, and sizes of its arrays."""

    code: Code
    rows: int  # kept, and with ``radial`` those of |x|^2
    entries: int  # of the factor
    operations: int  # of ``stage``


@making_code
def make_hamilton_code(
    system: MultibodySystem, tree: Tree, at: np.ndarray | None = None, *, radial: bool = False
) -> HamiltonCode:
    """Made, or loaded; ValueError where it is too large. Its orders of elimination are found at y, or at the start."""
    files = [Path(__file__), Path(__file__).with_name("spins.py")]
    text = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    key = f"{texts_of_makers()}\0{_own_text()}\0{text}\0{radial}\0{_digest(system, tree, at)}"
    code = Code(lambda: _print(system, tree, at, radial), key)
    about = np.zeros(3)
    code.function("about", 1)(about.ctypes.data)
    rows, entries, operations = (int(x) for x in about)
    if operations > MOST_OPERATIONS:
        raise ValueError(too_large(operations))
    return HamiltonCode(code, rows, entries, operations)


def _print(system: MultibodySystem, tree: Tree, at: np.ndarray | None, radial: bool) -> str:
    import casadi as ca

    from ..generated.functions import Straight, record_function

    functions, rows, entries = _functions(system, tree, at, radial)
    operations = len(record_function(functions["stage"]).tape.operations)
    if operations > MOST_OPERATIONS:
        functions = {}
    return print_functions({**functions, "about": Straight([], [ca.vertcat(rows, entries, operations)])})


def _functions(
    system: MultibodySystem, tree: Tree, at: np.ndarray | None, radial: bool
) -> "tuple[dict[str, Straight], int, int]":
    import casadi as ca

    from ..generated import Straight
    from .elimination import Factor
    from .motion import Motion
    from .spins import find_spins

    nq, nu = tree.nq, tree.nu
    t, q, p, y = ca.SX.sym("t"), ca.SX.sym("q", nq), ca.SX.sym("p", nq), ca.SX.sym("y", nq + nu)
    x, u, pi = y[:nq], y[nq:], ca.SX.sym("pi", nu)  # of unit quaternions
    balls = [limb for limb in tree.limbs if limb.ball]
    found = choose_order(system, tree, t, y, at)
    spins = find_spins(system, tree) if radial else []
    for spin in spins:
        spin.add_inertia(found.K, found.motion)
    first, kept = found.first, sorted(k for k in found.order.rows if k >= found.first)
    rows = [found.rows[k - first] for k in kept]
    whole = Factor(found.K, found.order.rows)
    H = {k: {row: entry for row, entry in found.K[k].items() if row < first} for k in range(first)}
    at_start = _evaluate(H, t, y, tree.start)
    of_tree = Factor(H, order_rows(at_start, nu, 3 * len(found.motion.opened)).rows)

    moving, resting = (Motion(system, tree, t, ca.vertcat(x, w)) for w in (u, ca.SX.zeros(nu)))
    energy = _kinetic_energy(moving)
    whole_energy = sum((spin.added_energy(moving) for spin in spins), energy)
    forces = _project_momenta(tree, x, ca.gradient(whole_energy, y)[:nq]) - _loads(moving, resting)
    phi, lam = _column([row.phi for row in rows]), ca.SX.sym("lam", len(kept) + (len(balls) if radial else 0))
    gradient = ca.gradient(ca.dot(phi, lam[: len(kept)]), y)[:nq] if rows else ca.SX.zeros(nq)
    impulse = {k: pi[k] for k in range(nu)}
    moved = of_tree.solve(impulse)
    closed = whole.solve(impulse | {k: -row.rate for k, row in zip(kept, rows, strict=True)})
    q_held, u_held = ca.SX(x), _column([closed[k] for k in range(nu)])
    for spin in spins:
        spin.add_turn(q_held, u_held, found.motion, pi)

    def express(outputs: Sequence[ca.SX], velocities: ca.SX, momenta: ca.SX) -> list[ca.SX]:
        """Expressions in unit quaternions at ``q``, velocities and momenta."""
        values = ca.Function("expressed", [t, y, pi, lam], list(outputs))
        out = values(t, ca.vertcat(_normalise(tree, q), velocities), momenta, lam)
        return list(out) if isinstance(out, tuple) else [out]

    rest, lowered = ca.SX.zeros(nu), _project_momenta(tree, q, p)
    (velocities,) = express([_column([moved[k] for k in range(nu)])], rest, lowered)
    (forces,) = express([forces], velocities, lowered)
    phi, gradient, held, mu, L = express(
        [
            phi, _project_momenta(tree, x, gradient), ca.vertcat(q_held, u_held),
            _column([closed[k] for k in kept]), _column(_entries(whole)),
        ], rest, lowered,
    )  # fmt: skip
    q_dot, p_dot = (
        _coordinate_rates(tree, q, velocities),
        _lift_momenta(tree, q, forces) + _coordinate_rates(tree, p, velocities, slides=0.0),
    )
    push = _lift_momenta(tree, q, gradient)
    entries, rhs = ca.SX.sym("L", L.numel()), lam
    corrected = _of_entries(whole, entries).solve({k: rhs[n] for n, k in enumerate(kept)})
    solved = [-corrected[k] for k in kept]
    for n, limb in enumerate(balls if radial else [], len(kept)):
        alpha, own = _softness(limb, at_start), _quaternion(limb)
        along = ca.dot(q[own], p[own])
        q_dot[own] += alpha * along * q[own]
        p_dot[own] -= alpha * along * p[own]
        square = ca.dot(q[own], q[own])
        phi, mu = ca.vertcat(phi, 0.5 * (square - 1.0)), ca.vertcat(mu, along / square)
        push[own] += lam[n] * q[own]
        solved.append(rhs[n] / alpha)
    functions = {
        "stage": Straight([t, q, p], [q_dot, p_dot]),
        "enter": Straight([y], [_lift_momenta(tree, x, ca.gradient(energy, y)[nq:])]),
        "gaps": Straight([t, q], [phi]),
        "push": Straight([t, q, lam], [push]),
        "factor": Straight([t, q], [L]),
        "solve": Straight([entries, rhs], [_column(solved)]),
        "close": Straight([t, q, p], [held, mu]),
    }
    return functions, lam.numel(), L.numel()


def _kinetic_energy(motion: "Motion") -> "ca.SX":
    import casadi as ca

    T = ca.SX(0)
    for b in motion.limb:
        F, system = motion.tree.frames[b], motion.system
        v, turn = motion.v[b] + ca.cross(motion.omega[b], motion.centre[b]), motion.R[b].T @ motion.omega[b]
        inertia = ca.SX(ca.DM(snap(product(product(F, system.regular_inertia[b]), F.T))))
        T += 0.5 * (system.mass[b] * ca.dot(v, v) + ca.dot(turn, inertia @ turn))
    return T


def _loads(moving: "Motion", resting: "Motion") -> "ca.SX":
    """Return what joints carry of weights and of loads at rest, along the velocities."""
    return resting.efforts(resting.compute_carried_loads(moving.applied_forces()))


def _quaternion(limb: Limb) -> slice:
    return slice(limb.q_at + len(limb.slides), limb.q_at + limb.sizes[0])


def _parts_of(limb: Limb, u: "ca.SX") -> "tuple[ca.SX, ca.SX]":
    """Rates of slides, and rates of turns."""
    ns = len(limb.slides)
    return u[limb.u_at : limb.u_at + ns, 0], u[limb.u_at + ns : limb.u_at + limb.sizes[1], 0]  # columns, even if empty


def _coordinate_rates(tree: Tree, q: "ca.SX", u: "ca.SX", slides: float = 1.0) -> "ca.SX":
    """Rates of coordinates at ``u``; with ``slides = 0``, of quaternions alone."""
    import casadi as ca

    out = ca.SX.zeros(tree.nq)
    for limb in tree.limbs:
        along, omega = _parts_of(limb, u)
        if limb.ball:
            own, ns = q[_quaternion(limb)], len(limb.slides)
            s, v = own[0], own[1:]
            out[_quaternion(limb)] = 0.5 * ca.vertcat(-ca.dot(omega, v), s * omega + ca.cross(omega, v))
            out[limb.q_at : limb.q_at + ns] = slides * along
        else:
            out[limb.q_at : limb.q_at + limb.sizes[0]] = slides * ca.vertcat(along, omega)
    return out


def _project_momenta(tree: Tree, q: "ca.SX", p: "ca.SX") -> "ca.SX":
    """pi of ``p``: the power of p along rates of coordinates is that of pi along velocities."""
    import casadi as ca

    out = ca.SX.zeros(tree.nu)
    for limb in tree.limbs:
        own, n = p[limb.q_at : limb.q_at + limb.sizes[0]], len(limb.slides)
        if limb.ball:
            x, y = q[_quaternion(limb)], own[n:]
            own = ca.vertcat(own[:n], 0.5 * (x[0] * y[1:] - y[0] * x[1:] + ca.cross(x[1:], y[1:])))
        out[limb.u_at : limb.u_at + limb.sizes[1]] = own
    return out


def _lift_momenta(tree: Tree, q: "ca.SX", pi: "ca.SX") -> "ca.SX":
    """p of ``pi``, of balls normal to the quaternion."""
    import casadi as ca

    out = _coordinate_rates(tree, q, pi)
    for limb in tree.limbs:
        if limb.ball:
            x = q[_quaternion(limb)]
            out[_quaternion(limb)] = out[_quaternion(limb)] * (4.0 / ca.dot(x, x))
    return out


def _softness(limb: Limb, H: dict[int, dict[int, float]]) -> float:
    """alpha of the inertia of a ball at the start: a quaternion of that inertia about all axes has 4 I along x."""
    at = limb.u_at + len(limb.slides)
    return 0.25 / float(np.mean([H[k][k] for k in range(at, at + 3)]))


def _entries(factor: "Factor") -> "list[ca.SX]":
    return [x for k in factor.order for x in (factor.inverse[k], *factor.L[k].values())]


def _of_entries(factor: "Factor", entries: "ca.SX") -> "Factor":
    """A factor with the same places."""
    out, numbers = copy.copy(factor), iter(_parts(entries))
    out.L, out.inverse = {}, {}
    for k in factor.order:
        out.inverse[k] = next(numbers)
        out.L[k] = {row: next(numbers) for row in factor.L[k]}
    return out
