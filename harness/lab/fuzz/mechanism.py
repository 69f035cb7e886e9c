"""Define a mechanism by numbers of its start in space; joints share points and axes, so any change keeps it closed.

Points and axes in the frames of bodies are computed from the poses at the start; velocities are projected onto the
joints.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ...mechanics import so3
from ...mechanics.consistency import InconsistentStart, project
from ...mechanics.dynamics import accelerations, equations
from ...mechanics.joints import Joint, JointKind
from ...mechanics.state import State
from ...mechanics.system import GROUND, MultibodySystem, RigidBody, SpringDamper, assemble
from ...mechanics.types import Problem

Vec = tuple[float, float, float]
ZERO: Vec = (0.0, 0.0, 0.0)
TURN, LONGEST = 0.05, 0.01  # angle of a step [rad] and longest step [s]
# relative to A_dot v and speeds squared: in 2,000 mechanisms the residual is at most 2e-11, or at least 0.005
GOES_ON = 1e-6
RANK = 1e-9  # relative to the largest singular value of A
FASTER = 2  # factor on the rates of springs, which are computed for point masses


@dataclass(frozen=True)
class RandomBody:
    """A body: mass [kg], inertia about C in its frame [kg m2], and its pose and velocities at the start."""

    mass: float
    inertia: tuple[Vec, Vec, Vec]
    place: Vec  # [m] C in space
    turn: Vec = ZERO  # [rad] rotation vector, body to space
    velocity: Vec = ZERO  # [m/s] of C, in space
    spin: Vec = ZERO  # [rad/s] Omega, in the body


@dataclass(frozen=True)
class RandomJoint:
    """A joint of bodies i and j (-1: ground) at a point of space, with axis; a distance has a second point."""

    kind: JointKind
    i: int
    j: int
    point: Vec
    axis: Vec = (0.0, 0.0, 1.0)
    far: Vec = ZERO  # [m] the second point, if the joint keeps a distance


@dataclass(frozen=True)
class Spring:
    """A spring-damper between points of bodies i and j, given in space at the start."""

    i: int
    j: int
    point_i: Vec
    point_j: Vec
    stiffness: float  # [N/m]
    rest: float  # [m] length without force
    damping: float = 0.0  # [N s/m]


@dataclass(frozen=True)
class RandomMechanism:
    """A random mechanism by the numbers of its start in space; the motion takes ``steps`` steps of ``dt``."""

    bodies: tuple[RandomBody, ...]
    connections: tuple[RandomJoint, ...] = ()
    springs: tuple[Spring, ...] = ()
    gravity: Vec = (0.0, 0.0, -9.81)
    dt: float = LONGEST  # [s] step
    steps: int = 100

    def problem(self) -> Problem:
        """Return the mechanism as a problem, with velocities projected onto the joints.

        Raise ValueError or InconsistentStart where no start satisfies the joints, or no motion has its velocities.
        """
        r = np.array([b.place for b in self.bodies] + [ZERO])
        R = so3.exp(np.array([b.turn for b in self.bodies] + [ZERO]))
        system = assemble(
            [RigidBody(b.mass, np.array(b.inertia)) for b in self.bodies],
            [_make_joint(c, k, r, R) for k, c in enumerate(self.connections)],
            np.array(self.gravity),
            [
                SpringDamper(
                    s.i,
                    _to_body_frame(r, R, s.i, s.point_i),
                    s.j,
                    _to_body_frame(r, R, s.j, s.point_j),
                    s.stiffness,
                    s.rest,
                    s.damping,
                )
                for s in self.springs
            ],
        )
        moving = np.array([(b.velocity, b.spin) for b in self.bodies])
        start = project(system, State(r[:-1], R[:-1], moving[:, 0], moving[:, 1]))
        _check_velocities(system, start)
        t_end = self.steps * self.dt
        return Problem("fuzz", system, start, t_end=t_end, dt=self.dt, section="", source="drawn at random")

    @property
    def size(self) -> float:
        """Largest extent of centres of mass, joints and springs along an axis of space [m]."""
        points = [b.place for b in self.bodies]
        points += [c.point for c in self.connections] + [s.point_j for s in self.springs]
        return max(float(np.max(np.ptp(np.array(points), axis=0))), 0.1)

    def choose_step(self) -> "RandomMechanism":
        """Return the mechanism with a step, at most ``LONGEST``, in which no angle or phase exceeds ``TURN``.

        The step, rounded to two digits, is estimated from rates, accelerations and springs at the start.
        """
        p = self.problem()
        rates = accelerations(p.system, p.initial)
        stiff = [s.stiffness / min(self.bodies[b].mass for b in (s.i, s.j) if b != GROUND) for s in self.springs]
        values = [
            np.abs(p.initial.Omega),
            np.abs(p.initial.v) / self.size,
            np.sqrt(np.abs(rates.v_dot) / self.size),
            np.sqrt(np.abs(rates.Omega_dot)),
            FASTER * np.sqrt(np.array(stiff)),
        ]
        fastest = max(float(np.max(a, initial=0.0)) for a in values)
        return replace(self, dt=float(f"{min(LONGEST, TURN / max(fastest, 1e-9)):.2g}"))


def _check_velocities(system: MultibodySystem, start: State) -> None:
    """Raise InconsistentStart unless A v_dot = -A_dot v has a solution v_dot at the start.

    Where two motions cross, as in a flat parallelogram, A loses rank, and A v = 0 also holds for sums of their
    velocities, with which nothing can move: any result of a code is then arbitrary.
    """
    e = equations(system, start)
    if not len(e.A):
        return
    v_dot = np.linalg.lstsq(e.A, -e.A_dot_v, rcond=RANK)[0]
    left, squares = np.linalg.norm(e.A @ v_dot + e.A_dot_v), np.sum(start.v**2) + np.sum(start.Omega**2)
    if left > GOES_ON * (np.linalg.norm(e.A_dot_v) + squares):
        raise InconsistentStart(f"no motion has the velocities of the start: A v_dot + A_dot v stays at {left:.2g}")


def _make_joint(c: RandomJoint, k: int, r: Float[np.ndarray, "places 3"], R: Float[np.ndarray, "places 3 3"]) -> Joint:
    """Return joint ``k`` with its arms and axes in the frames of its bodies, whose poses are ``r`` [m] and ``R``."""
    x = np.array(c.point)
    far = np.array(c.far) if c.kind == JointKind.DISTANCE else x
    ends = _to_body_frame(r, R, c.i, x), c.j, _to_body_frame(r, R, c.j, far)
    name = f"{c.kind} {k + 1}"
    if c.kind == JointKind.DISTANCE:
        return Joint(c.i, *ends, name=name, kind=c.kind, length=float(np.linalg.norm(x - far)))
    if c.kind == JointKind.SPHERICAL:
        return Joint(c.i, *ends, name=name, kind=c.kind)
    axis, across = np.array(c.axis), None
    if c.kind in (JointKind.FIXED, JointKind.PRISMATIC):
        across = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    sides = [(R[b].T @ axis, None if across is None else R[b].T @ across) for b in (c.i, c.j)]
    (axis_i, across_i), (axis_j, across_j) = sides
    return Joint(c.i, *ends, axis_i, axis_j, name, c.kind, across_i, across_j)


def _to_body_frame(
    r: np.ndarray, R: np.ndarray, body: int, x: Float[np.ndarray, " 3"] | Vec
) -> Float[np.ndarray, " 3"]:
    """Return a point of space ``x`` [m] in the frame of a body, relative to its C."""
    out: np.ndarray = R[body].T @ (np.array(x) - r[body])
    return out
