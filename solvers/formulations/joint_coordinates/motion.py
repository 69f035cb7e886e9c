"""Motion of a tree as expressions in its coordinates: poses, velocities, inertia, loads, in the base frame.

For each body, about its point P: mass m, h = m (C - P), inertia I. At accelerations a of P and alpha of the body

    f = m (a - g) + W h,   n = I alpha + omega x I omega + h x (a - g),   W = [alpha]x + omega omega^T - omega^2

the tree's joints carry (f, n) of all bodies outboard of them (Newton-Euler), and H u_dot = (f, n) of unit accelerations
of composite bodies. Nothing outboard of a ball turns with its parent: its moment is an equation of its own and is not
transmitted.
"""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ....harness.mechanics import forces
from ....harness.mechanics.declaring import Pose
from ....harness.mechanics.fixed_order import apply, dot, product
from ....harness.mechanics.joint_tree import Limb, Tree, remove_rounding
from ....harness.mechanics.system import GROUND, MultibodySystem
from ..rows.expressions import express_time_function, list_force_parameters
from ..rows.symbols import Symbol

ZERO = ca.SX.zeros(3)
DIRECTIONS = {"p_i": "i", "p_j": "j", "u": "i", "n": "j", "p": "i"}  # vectors of forces that are fixed in a body


class Axes(NamedTuple):
    """Directions in which the velocities of a limb move it, in the base frame."""

    slides: list[ca.SX]
    turns: list[ca.SX]


class Wrench(NamedTuple):
    """A force, and its moment about a body's P."""

    f: ca.SX
    n: ca.SX


class TreeMotion:
    """A tree at time t and ``y`` (coordinates, then velocities); its accelerations are at ``u_dot``, zero by default.

    ``opened`` balls transmit nothing in ``inertia`` and in loop rows: the P of each moves freely there, by three more
    velocities after the others, and three more rows hold it on its parent. H is then sparse, which long chains need.
    """

    def __init__(
        self,
        system: MultibodySystem,
        tree: Tree,
        t: ca.SX,
        y: ca.SX,
        u_dot: ca.SX | None = None,
        opened: Sequence[int] = (),
    ) -> None:
        """Express the motion of all bodies symbolically, by recursion from the ground outward.

        ``t`` is the time [s]; ``y`` stacks the tree's coordinates q and velocities u. ``u_dot`` are the rates of u,
        zero by default. ``opened`` are the bodies whose balls are opened (see the class).
        """
        self.system, self.tree, self.t, self.opened = system, tree, t, opened
        self.q, self.u = y[: tree.nq], y[tree.nq :]
        self._u_dot = u_dot if u_dot is not None else ca.SX.zeros(tree.nu)
        self.limb = {limb.body: limb for limb in tree.limbs}  # by body, with the joint to its parent
        # all that follow are by body, in the base frame
        # rotation from the body's frame, angular velocity and acceleration, and W as in the module's equations
        self.R, self.omega, self.alpha, self.W = ({GROUND: x} for x in (ca.SX.eye(3), ZERO, ZERO, ca.SX.zeros(3, 3)))
        # position, velocity and acceleration of the body's point P
        self.P, self.v, self.a = ({GROUND: ZERO} for _ in range(3))
        # directions in which the velocities move it, the vector from its parent's P to P, h = m (C - P), and C - P
        self.axes, self.arm, self.h, self.centre = {}, {}, {}, {GROUND: ZERO}  # type: ignore[var-annotated]
        for limb in tree.limbs:
            self._move(limb)

    def _move(self, limb: Limb) -> None:
        """Set pose, velocity, acceleration and axes of a limb's body from the motion of its parent."""
        b, p, ns = limb.body, limb.parent, len(limb.slides)
        R, omega, alpha = self.R[p], self.omega[p], self.alpha[p]
        q = [self.q[limb.q_at + k] for k in range(limb.sizes[0])]
        u, u_dot = ([x[limb.u_at + k] for k in range(limb.sizes[1])] for x in (self.u, self._u_dot))
        slides = [R @ ca.SX(ca.DM(a)) for a in limb.slides]
        L = R @ ca.SX(ca.DM(limb.arm)) + weighted_sum(slides, q)
        across = weighted_sum(slides, u)
        self.arm[b], self.P[b] = L, self.P[p] + L
        self.v[b] = self.v[p] + ca.cross(omega, L) + across
        self.a[b] = self.a[p] + self.W[p] @ L + 2.0 * ca.cross(omega, across) + weighted_sum(slides, u_dot)
        turns = []
        if limb.ball:
            R, omega, alpha = _convert_quaternion(q[ns:]), ca.vertcat(*u[ns:]), ca.vertcat(*u_dot[ns:])
            turns = [ca.SX(ca.DM(a)) for a in np.eye(3)]
        else:
            for k, axis in enumerate(limb.turns):
                turns.append(R @ ca.SX(ca.DM(axis)))
                spin = turns[-1] * u[ns + k]
                alpha = alpha + ca.cross(omega, spin) + turns[-1] * u_dot[ns + k]
                omega = omega + spin
                R = _rotate_about(R, axis, q[ns + k])
        self.R[b], self.omega[b], self.alpha[b], self.axes[b] = R, omega, alpha, Axes(slides, turns)
        self.W[b] = ca.skew(alpha) + omega @ omega.T - ca.dot(omega, omega) * ca.SX.eye(3)
        self.centre[b] = R @ ca.SX(ca.DM(limb.centre))
        self.h[b] = self.system.mass[b] * self.centre[b]

    def q_dot(self, u: ca.SX) -> ca.SX:
        """Return the rates q_dot of the coordinates at velocities ``u``."""
        return coordinate_rates(self.tree, self.q, u)

    def assemble_inertia(self) -> dict[int, dict[int, ca.SX]]:
        """Return the mass matrix H by columns {row: entry}, both halves, zeros omitted, by composite bodies.

        Velocities that opened balls free come after those of the tree.
        """
        H: dict[int, dict[int, ca.SX]] = {k: {} for k in range(self.tree.nu + 3 * len(self.opened))}
        m, h, inertia = dict(enumerate(self.system.mass.tolist())), dict(self.h), dict(self.compute_body_inertias())
        for limb in reversed(self.tree.limbs):
            b, p, L = limb.body, limb.parent, self.arm[limb.body]
            for k, (f, n) in self._list_momenta(limb, m[b], h[b], inertia[b]):
                for row, entry in self.project_load(b, Wrench(f, n)):
                    if not entry.is_zero():
                        H[k][row] = H[row][k] = entry
            if p != GROUND and b not in self.opened:
                carried = ZERO if limb.ball else h[b]
                g = carried + 0.5 * m[b] * L
                inertia[p] = inertia[p] + 2.0 * ca.dot(L, g) * ca.SX.eye(3) - L @ g.T - g @ L.T
                inertia[p] = inertia[p] if limb.ball else inertia[p] + inertia[b]
                h[p], m[p] = h[p] + carried + m[b] * L, m[p] + m[b]
        return H

    def compute_body_inertias(self) -> dict[int, ca.SX]:
        """Return the inertia of each body about its point P, in the base frame."""
        out = {}
        for limb in self.tree.limbs:
            b, c, F = limb.body, limb.centre, self.tree.frames[limb.body]
            about_c = product(product(F, self.system.regular_inertia[b]), F.T)
            J = remove_rounding(about_c + self.system.mass[b] * (dot(c, c) * np.eye(3) - np.outer(c, c)))
            out[b] = _rotate_inertia(self.R[b] @ ca.SX(ca.DM(0.5 * (J + J.T))), self.R[b])
        return out

    def _list_momenta(self, limb: Limb, m: float, h: ca.SX, inertia: ca.SX) -> list[tuple[int, Wrench]]:
        """Return (index, momentum) for each velocity of a limb: the momentum about P at a unit of the velocity.

        It is that of the limb and all bodies outboard, of which ``m``, ``h`` and ``inertia`` are mass, first moment and
        inertia about P.
        """
        slides = [Wrench(m * w, ca.cross(h, w)) for w in self.axes[limb.body].slides]
        turns = [Wrench(ca.cross(s, h), inertia @ s) for s in self.axes[limb.body].turns]
        free = [(k, Wrench(m * e, ca.cross(h, e))) for k, e in self.list_freed_directions(limb.body)]
        return [*enumerate([*slides, *turns], limb.u_at), *free]

    def list_freed_directions(self, b: int) -> list[tuple[int, ca.SX]]:
        """Return (index, direction) of the three velocities that an opened ball of ``b`` frees; empty if not opened."""
        if b not in self.opened:
            return []
        at = self.tree.nu + 3 * self.opened.index(b)
        return [(at + k, ca.SX(ca.DM(e))) for k, e in enumerate(np.eye(3))]

    def project_load(self, b: int, load: Wrench, until: int = GROUND) -> list[tuple[int, ca.SX]]:
        """Return (index of velocity, generalised force of ``load`` on body ``b``) for the velocities from b inward.

        ``load`` is about the P of b. The list ends before body ``until``, or at an opened ball with the velocities that
        this frees.
        """
        out = []
        while b != until:
            limb, axes = self.limb[b], self.axes[b]
            entries = [*(ca.dot(w, load.f) for w in axes.slides), *(ca.dot(s, load.n) for s in axes.turns)]
            out += list(enumerate(entries, limb.u_at))
            if b in self.opened:
                return [*out, *((k, ca.dot(e, load.f)) for k, e in self.list_freed_directions(b))]
            load, b = self.transmit_load(b, load), limb.parent
        return out

    def transmit_load(self, b: int, load: Wrench) -> Wrench:
        """Return the part of a ``load`` on body ``b`` that its joint transmits to the parent, about the parent's P.

        A ball transmits no moment.
        """
        n = ca.cross(self.arm[b], load.f)
        return Wrench(load.f, n if self.limb[b].ball else n + load.n)

    def compute_carried_loads(self, loads: dict[int, Wrench]) -> dict[int, Wrench]:
        """Return the wrench that each body's joint carries, about its P, for this motion under ``loads`` and gravity.

        This is the inward sweep of the recursive Newton-Euler algorithm.
        """
        out, inertias = {}, self.compute_body_inertias()
        for b in self.limb:
            m, h, omega, fall = self.system.mass[b], self.h[b], self.omega[b], self.a[b] - self._gravity()
            spin = inertias[b] @ omega
            n = inertias[b] @ self.alpha[b] + ca.cross(omega, spin) + ca.cross(h, fall)
            out[b] = Wrench(m * fall + self.W[b] @ h - loads[b].f, n - loads[b].n)
        for limb in reversed(self.tree.limbs):
            b, p = limb.body, limb.parent
            if p != GROUND:
                more = self.transmit_load(b, out[b])
                out[p] = Wrench(out[p].f + more.f, out[p].n + more.n)
        return out

    def compute_generalised_forces(self, carried: dict[int, Wrench]) -> ca.SX:
        """Return the generalised forces (nu,): the components of the ``carried`` wrenches along the limbs' axes."""
        out = []
        for limb in self.tree.limbs:
            axes, (f, n) = self.axes[limb.body], carried[limb.body]
            out += [*(ca.dot(w, f) for w in axes.slides), *(ca.dot(s, n) for s in axes.turns)]
        return ca.vertcat(*out) if out else ca.SX(0, 1)

    def _gravity(self) -> ca.SX:
        """Return the acceleration of gravity [m/s2] in the base frame."""
        return ca.SX(ca.DM(remove_rounding(apply(self.tree.base, self.system.gravity))))

    def compute_applied_forces(self) -> dict[int, Wrench]:
        """Return the wrench of all declared forces on each body, about its P, without its weight."""
        out = {b: Wrench(ZERO, ZERO) for b in self.limb}
        s = self.system
        for kind, declared in forces.DECLARED.items():
            for k, numbers in enumerate(list_force_parameters(s, kind)):
                i = int(getattr(s, f"{kind}_i")[k])
                j = int(getattr(s, f"{kind}_j")[k]) if declared.pair else GROUND
                poses = self._make_pose(i), self._make_pose(j)
                push = declared.push(*poses, self._collect_parameters(kind, numbers, (i, j)))
                force, torque, point = (ca.vertcat(*[_unwrap_symbol(x) for x in part]) for part in push)
                for b, sign in ((i, 1.0), (j, -1.0)):
                    if b != GROUND:
                        moment = torque + ca.cross(point - self.P[b], force)
                        out[b] = Wrench(out[b].f + sign * force, out[b].n + sign * moment)
        return out

    def _collect_parameters(self, kind: str, numbers: np.ndarray, ends: tuple[int, int]) -> SimpleNamespace:
        """Return the parameters of a force by name as ``Symbol``, with vectors transformed to the frames of the tree.

        ``numbers`` are the parameters one after the other, ``ends`` the bodies i and j of the force.
        """
        parts: dict[str, Any] = {}
        at, declared = 0, forces.DECLARED[kind]
        follows = kind == "load" and bool(numbers[9])
        for name, shape in declared.numbers.items():
            size = 7 if name == "factor" else int(np.prod(shape))
            own, at = numbers[at : at + size], at + size
            if name == "factor":
                parts[name] = Symbol(express_time_function(ca.SX(ca.DM(own)), self.t))
            elif shape:
                end = DIRECTIONS.get(name) or ("i" if follows else "")
                frame = self.frame(ends["ij".index(end)]) if end else self.tree.base
                parts[name] = _wrap_symbols(remove_rounding(product(own.reshape(-1, 3), frame.T)).reshape(shape))
            else:
                parts[name] = Symbol(ca.SX(float(own[0])))
        return SimpleNamespace(**parts)

    def frame(self, b: int) -> np.ndarray:
        """Return the rotation matrix from the frame of ``b``, space for the ground, to the base frame at the start."""
        return self.tree.frames[b] if b != GROUND else self.tree.base

    def _make_pose(self, b: int) -> Pose:
        """Return position of C, rotation and velocities of body ``b`` in the base frame, as arrays of ``Symbol``."""
        C = self.P[b] + self.centre[b]
        v = self.v[b] + ca.cross(self.omega[b], self.centre[b])
        return Pose(*(_wrap_symbols(x) for x in (C, self.R[b], v, self.omega[b])))


def coordinate_rates(tree: Tree, q: ca.SX, u: ca.SX) -> ca.SX:
    """Return the rates of a tree's coordinates at ``q`` and velocities ``u``; quaternions in ``q`` have length one."""
    out = []
    for limb in tree.limbs:
        if not limb.sizes[1]:
            continue  # an empty slice of a single number would be a row
        ns, at, own = len(limb.slides), limb.q_at, u[limb.u_at : limb.u_at + limb.sizes[1]]
        if limb.ball:
            s, x = q[at + ns], q[at + ns + 1 : at + ns + 4]
            own = ca.vertcat(own[:ns], -0.5 * ca.dot(own[ns:], x), 0.5 * (s * own[ns:] + ca.cross(own[ns:], x)))
        out.append(own)
    return ca.vertcat(*out) if out else ca.SX(0, 1)


def weighted_sum(directions: list[ca.SX], values: Sequence[ca.SX]) -> ca.SX:
    """Return the sum of ``directions`` times ``values``, of which there may be more."""
    out = ZERO
    for a, x in zip(directions, values, strict=False):
        out = out + a * x
    return out


def _convert_quaternion(q: Sequence[ca.SX]) -> ca.SX:
    """Return the rotation matrix of a unit quaternion (scalar first)."""
    s, x, y, z = q
    return ca.vertcat(
        ca.horzcat(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - s * z), 2.0 * (x * z + s * y)),
        ca.horzcat(2.0 * (x * y + s * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - s * x)),
        ca.horzcat(2.0 * (x * z - s * y), 2.0 * (y * z + s * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def _rotate_about(R: ca.SX, axis: np.ndarray, angle: ca.SX) -> ca.SX:
    """Return R exp(angle hat(axis)): two columns, and the third as their cross product."""
    c, s = ca.cos(angle), ca.sin(angle)
    along = np.outer(axis, axis)
    turn = c * ca.SX(ca.DM(np.eye(3) - along)) + s * ca.skew(ca.SX(ca.DM(axis))) + ca.SX(ca.DM(along))
    x, z = R @ turn[:, 0], R @ turn[:, 2]
    return ca.horzcat(x, ca.cross(z, x), z)


def _rotate_inertia(RJ: ca.SX, R: ca.SX) -> ca.SX:
    """Return the symmetric product (R J) R^T from ``RJ`` = R J; both halves are the same expressions."""
    out = ca.SX.zeros(3, 3)
    for a in range(3):
        for c in range(a + 1):
            out[a, c] = out[c, a] = ca.dot(RJ[a, :].T, R[c, :].T)
    return out


def _wrap_symbols(a: Any) -> np.ndarray:
    """Return the entries of an array, or of a CasADi matrix, as an array of ``Symbol``; a column becomes a vector."""
    if isinstance(a, np.ndarray):
        return np.array([Symbol(ca.SX(float(x))) for x in a.ravel()], dtype=object).reshape(a.shape)
    out = np.array([Symbol(a[r, c]) for r in range(a.shape[0]) for c in range(a.shape[1])], dtype=object)
    return out.reshape(a.shape if a.shape[1] > 1 else a.shape[0])


def _unwrap_symbol(x: Any) -> Any:
    """Return the CasADi expression of a ``Symbol``, or a number as it is."""
    return x.x if isinstance(x, Symbol) else x
