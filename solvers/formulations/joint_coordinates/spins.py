"""Free spins of slender bodies: RATTLE moves bodies of more inertia about their axes, and adds the rest of the turn.

A body of revolution that balls on its axis e hold, and on which no force but weight acts, keeps pi_e = e . pi, its
angular momentum about e. With J about e, its energy has two parts,

    pi_e^2 / (2 J) = pi_e^2 / (2 (J + added))  +  pi_e^2 / 2 (1 / J - 1 / (J + added)),

of which the second turns the body about e at a constant rate. Both flows commute, and so do steps, which are the same
however the body is turned about e: many steps by the first part, then one turn by rate x t, are many steps of both,
as symplectic and as reversible.

Without this, long steps h have no solution. The momentum at its middle gives both ends of a step a pi_e that is off by
about h w J_across where the body turns across e at a rate w; 1 / J makes a fast spin of that, and the couplings of the
bodies a turn across. I - h/2 d2H/dqdp, by which an end follows from that momentum, is singular where
h w sqrt(J_across / J) is of order one. If the inertia about e is as large as that about P across e, it is singular only
where h w is of order one. Bodies that hang on this one are not counted: their share depends on the balls that are
opened, while the added inertia has to stay the same over a run.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from ....harness.mechanics.fixed_order import apply, dot, principal_axes
from ....harness.mechanics.forces import DECLARED
from ....harness.mechanics.joint_tree import NOISE, Limb, Tree, remove_rounding
from ....harness.mechanics.system import MultibodySystem
from .motion import TreeMotion


class Spin(NamedTuple):
    """A free spin of a limb: its axis in the base frame at the start, the inertia about it, and the added inertia."""

    limb: Limb
    axis: Float[np.ndarray, " 3"]
    inertia: float
    added: float

    @property
    def _velocities(self) -> slice:
        """Slice of the ball's angular velocity among the tree's velocities."""
        limb = self.limb
        return slice(limb.u_at + len(limb.slides), limb.u_at + limb.sizes[1])

    def _direction(self, motion: TreeMotion) -> ca.SX:
        """Return the spin's axis in the pose of ``motion``, in the base frame."""
        return motion.R[self.limb.body] @ ca.SX(ca.DM(self.axis))

    def add_inertia(self, H: dict[int, dict[int, ca.SX]], motion: TreeMotion) -> None:
        """Add the spin's ``added`` inertia about its axis to the mass matrix ``H``, given by columns, in place."""
        e, first = self._direction(motion), self._velocities.start
        for a in range(3):
            for c in range(3):
                H[first + a][first + c] = H[first + a].get(first + c, 0) + self.added * e[a] * e[c]

    def added_energy(self, motion: TreeMotion) -> ca.SX:
        """Return the kinetic energy [J] of the added inertia at the motion's velocities."""
        return 0.5 * self.added * ca.dot(self._direction(motion), motion.u[self._velocities]) ** 2

    def add_turn(self, q: ca.SX, u: ca.SX, motion: TreeMotion, pi: ca.SX) -> None:
        """Add the rotation about the axis that the steps omit, since t = 0, to ``q``, and its rate to ``u``, in place.

        ``pi`` are the momenta conjugate to the tree's velocities; the rate is proportional to that about the axis.
        """
        e, limb = self._direction(motion), self.limb
        rate = (1.0 / self.inertia - 1.0 / (self.inertia + self.added)) * ca.dot(e, pi[self._velocities])
        own = slice(limb.q_at + len(limb.slides), limb.q_at + limb.sizes[0])
        half, x = 0.5 * rate * motion.t, q[own]
        c, n, s, v = ca.cos(half), ca.sin(half) * ca.SX(ca.DM(self.axis)), x[0], x[1:]
        q[own] = ca.vertcat(c * s - ca.dot(v, n), c * v + s * n + ca.cross(v, n))
        u[self._velocities] += rate * e


def find_spins(system: MultibodySystem, tree: Tree) -> list[Spin]:
    """Return the free spins of a tree: those of slender bodies of revolution with ball joints on their axes alone.

    Bodies with a declared force on them have none.
    """
    pushed = {int(b) for kind in DECLARED for end in "ij" for b in getattr(system, f"{kind}_{end}", ())}
    out = []
    for limb in tree.limbs:
        arms = _list_ball_points(system, limb.body)
        if not limb.ball or arms is None or limb.body in pushed:
            continue
        J, axes = principal_axes(system.regular_inertia[limb.body])
        off_axis = float(np.max(np.linalg.norm(np.cross(axes[:, 0], arms), axis=1), initial=0.0))
        added = 0.5 * (J[1] + J[2]) + system.mass[limb.body] * dot(limb.centre, limb.centre) - J[0]
        is_round = J[2] - J[1] <= NOISE * J[2] and off_axis <= NOISE * float(np.max(np.abs(arms), initial=0.0))
        if is_round and added > 0.0:
            out.append(
                Spin(limb, remove_rounding(apply(tree.frames[limb.body], axes[:, 0])), float(J[0]), float(added))
            )
    return out


def _list_ball_points(system: MultibodySystem, body: int) -> Float[np.ndarray, "n 3"] | None:
    """Return the points (n, 3) [m, body frame] of all joints on ``body``; None if one of these is not spherical."""
    ends = ((system.joint_i, system.joint_s_i), (system.joint_j, system.joint_s_j))
    if any(system.joint_kind(int(k)) != "spherical" for of, _ in ends for k in np.flatnonzero(of == body)):
        return None
    return np.concatenate([arms[of == body] for of, arms in ends])
