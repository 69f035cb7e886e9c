"""Evaluate the exact motion of one body on one fixed hinge under gravity: a compound pendulum about any axis.

The joint carries the component of gravity along the axis. Across it the angle phi of the arm from gravity obeys (I_C +
m d^2) phi_ddot = -m g d sin(phi), with I_C about the axis and d the distance of C from it. This is the motion of a body
on a ball joint that is symmetric about its arm and swings in a plane: module ``lagrange_top``. Without an arm or
gravity the body turns steadily; between swinging and turning over it comes to rest upright, phi = 2 gd(w t + c).

The data of both are rounded, and near an upright rest the motion magnifies that: the error is the sum of that of the
formula and of the change of the motion for data that differ by a few roundings.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ...harness.mechanics.so3 import hat
from ...harness.mechanics.state import State, States
from ...harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, assemble
from ...harness.mechanics.types import ReferenceKind
from .balls import BallTooWide
from .one_body import find_one_body_motion
from .pinned_body import ROUNDING

DATA = 16.0 * ROUNDING  # relative uncertainty of data, and the change of those of a disturbed motion
SURE = 4.0  # safety factor on the effect of three disturbances
WORST = 1e-3  # [rad] error at which the motion ends, since roundings determine the rest
NOTHING = 1e-14  # relative size below which gravity or the arm counts as zero
NEARLY = 1e-12  # relative: energies that are one but for rounding
TIMES = 400  # number of times at which errors are evaluated, besides requested ones

Angle = Callable[[Float[np.ndarray, " nt"]], tuple[np.ndarray, np.ndarray, np.ndarray]]  # phi - phi_0, its rate, error


@dataclass(frozen=True)
class Swing:
    """A pendulum: ``pull`` = m g d / (I_C + m d^2) [1/s2], angle from gravity [rad] and rate [rad/s] at the start."""

    pull: float
    phi: float
    rate: float

    def find_angle(self) -> Angle:
        """Return a function from times [s] to the angle turned [rad], its rate [rad/s] and the angle's error [rad].

        Raise ArithmeticError if no formula is known for this swing.
        """
        if self.pull == 0.0:
            return lambda t: (self.rate * t, np.full(len(t), self.rate), ROUNDING * np.abs(self.rate * t))
        arm = np.array([0.5, 0.0, 0.0])
        weight = 2.0 * self.pull * np.array([0.5, 0.0, 0.0])  # the inertia is 1/4 about C: I_O = 1/2, m g d = g / 2
        system = assemble([RigidBody(1.0, 0.25 * np.eye(3))], [Joint(0, -arm)], weight)
        R = np.array([[np.cos(self.phi), -np.sin(self.phi), 0.0], [np.sin(self.phi), np.cos(self.phi), 0.0], [0, 0, 1]])
        Omega = np.array([0.0, 0.0, self.rate])
        start = State((R @ arm)[None], R[None], (R @ np.cross(Omega, arm))[None], Omega[None])
        try:
            found = find_one_body_motion(system, start)
        except (BallTooWide, ArithmeticError):
            found = None
        if found is None:
            return self._find_motion_to_rest()  # raises ArithmeticError for any other motion

        def by_theta(t: Float[np.ndarray, " nt"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """Return the angle turned [rad], its rate [rad/s] and its error [rad] at ``t`` [s], by theta functions."""
            s = found.states(t)
            turn = np.arctan2(s.R[:, 0, 1, 0], s.R[:, 0, 0, 0]) - self.phi
            return turn, s.Omega[:, 0, 2], found.angle_error(t)

        return by_theta

    def _find_motion_to_rest(self) -> Angle:
        """Return the function of ``find_angle`` for a motion towards an upright rest or away from it, or for a rest.

        Its error grows as exp(w t), w^2 = ``pull``. Raise ArithmeticError for any other motion.
        """
        w = np.sqrt(self.pull)
        lacking = self.rate**2 - 4.0 * self.pull * np.cos(0.5 * self.phi) ** 2  # of the energy of an upright rest
        hanging = self.rate == 0.0 and np.cos(self.phi) > 0.0 and abs(np.sin(self.phi)) <= NEARLY
        if not hanging and not abs(lacking) <= NEARLY * (self.rate**2 + 4.0 * self.pull):
            raise ArithmeticError("no closed form of this swing was found")
        phi = np.arctan2(np.sin(self.phi), np.cos(self.phi))
        direction = np.sign(self.rate) or 1.0
        resting = abs(self.rate) <= 1e-12 * w  # at rest, hanging or upright
        begin = np.arctanh(np.clip(np.sin(0.5 * direction * phi), -1.0, 1.0)) if not resting else 0.0

        def gudermann(t: Float[np.ndarray, " nt"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            """Return the angle turned [rad], its rate [rad/s] and its error [rad] at ``t`` [s]: phi = 2 gd(w t + c)."""
            grown = DATA * np.exp(np.minimum(w * np.abs(t), 700.0))
            if resting:
                return np.zeros(len(t)), np.zeros(len(t)), grown if np.cos(phi) < 0.0 else np.full(len(t), DATA)
            x = w * t + begin
            turned = direction * 2.0 * np.arcsin(np.tanh(x))
            return turned - phi, direction * 2.0 * w / np.cosh(np.minimum(np.abs(x), 700.0)), grown

        return gudermann


@dataclass(frozen=True)
class HingedMotion:
    """The motion of the body by the angle of ``swing``, with an estimate of its error."""

    swing: Swing
    start: State
    point: Float[np.ndarray, " 3"]  # point of the axis [m, space]
    axis: Float[np.ndarray, " 3"]  # [space]
    gyration: float
    t_end: float
    kind: ReferenceKind = ReferenceKind.FORMULA

    @property
    def route(self) -> str:
        """Formula, and the kind of its error bound."""
        return f"elliptic functions (compound pendulum on a fixed hinge), {self.kind}"

    @property
    def ends(self) -> str:
        """Reason why the motion is known for less than the problem's time; empty if it is known throughout."""
        return (
            "" if self.horizon == self.t_end else "near an upright rest data within their rounding part from there on"
        )

    @cached_property
    def _angle(self) -> Angle:
        """The angle turned as a function of time."""
        return self.swing.find_angle()

    @cached_property
    def _disturbed_angles(self) -> list[Angle]:
        """The angles, as functions of time, of three pendulums whose data differ by a few roundings."""
        s = self.swing
        swings = (
            Swing(s.pull * (1.0 + DATA), s.phi, s.rate),
            Swing(s.pull, s.phi + DATA, s.rate),
            Swing(s.pull, s.phi, s.rate + DATA * max(abs(s.rate), np.sqrt(s.pull))),
        )
        return [swing.find_angle() for swing in swings]

    @cached_property
    def _error_growth(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] over the whole motion, and the largest error of the angle [rad] up to each."""
        early = np.geomspace(1e-6 * self.t_end, self.t_end, TIMES)
        t = np.union1d(np.linspace(0.0, self.t_end, TIMES + 1), early)
        t[-1] = self.t_end
        return t, np.maximum.accumulate(self._angle_error(t))

    def _angle_error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return an estimate of the angle's error [rad] at ``t`` [s]: of the formula, and of rounding of the data."""
        turn, _, own = self._angle(t)
        apart = [np.abs((other(t)[0] - turn + np.pi) % (2.0 * np.pi) - np.pi) for other in self._disturbed_angles]
        return own + DATA + SURE * np.sum(apart, axis=0)

    @cached_property
    def horizon(self) -> float:
        """End of the problem [s], or the time when data within their rounding differ by ``WORST``."""
        t, error = self._error_growth
        inside = int(np.searchsorted(error, WORST))
        return self.t_end if inside == len(t) else float(t[max(inside - 1, 0)])

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s]: the start, rotated about the axis by the angle turned (Rodrigues)."""
        t = np.asarray(t, dtype=float)
        turn, rate, _ = self._angle(t)
        K = hat(self.axis)
        Q = np.eye(3) + np.sin(turn)[:, None, None] * K + (1.0 - np.cos(turn))[:, None, None] * (K @ K)
        R, arm = Q @ self.start.R[0], Q @ (self.start.r[0] - self.point)
        v = rate[:, None] * np.cross(self.axis, arm)
        Omega = rate[:, None] * (self.start.R[0].T @ self.axis)
        return States((self.point + arm)[:, None], R[:, None], v[:, None], Omega[:, None])

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return an estimate [m] of the position error at ``t`` [s] of points within the radius of gyration from C."""
        t = np.asarray(t, dtype=float)
        times, grown = self._error_growth
        before = grown[np.minimum(np.searchsorted(times, t), len(times) - 1)]
        distance = float(np.linalg.norm(self.start.r[0] - self.point))
        return (distance + self.gyration) * before + DATA * (distance + float(np.linalg.norm(self.point)))


def is_hinged(system: MultibodySystem) -> bool:
    """Return whether the system is one body on one hinge to the ground, under gravity only."""
    forces = (system.spring_k, system.torsion_k, system.load_i, system.user_i)
    if (system.nb, system.nj) != (1, 1) or any(map(len, forces)) or np.any(system.joint_moving):
        return False
    return (system.joint_points[0], system.joint_lines[0], system.joint_axes[0], system.joint_j[0]) == (3, 0, 2, GROUND)


def find_hinged_motion(system: MultibodySystem, start: State, t_end: float) -> HingedMotion | None:
    """Return the exact motion of a body on a hinge from ``start`` up to ``t_end`` [s].

    Return None for any other system (``is_hinged``), and if no closed form is known.
    """
    if not is_hinged(system):
        return None
    R, J, m = start.R[0], system.regular_inertia[0], float(system.mass[0])
    u = system.joint_u[0] / np.linalg.norm(system.joint_u[0])
    axis = R @ u
    axis /= np.linalg.norm(axis)
    point = system.joint_s_j[0]
    arm = start.r[0] - point
    arm = arm - (arm @ axis) * axis
    weight = system.gravity - (system.gravity @ axis) * axis
    d, g = float(np.linalg.norm(arm)), float(np.linalg.norm(weight))
    size = float(np.linalg.norm(start.r[0] - point)) + float(system.gyration[0])
    is_free = d <= NOTHING * size or g <= NOTHING * float(np.linalg.norm(system.gravity))
    pull = 0.0 if is_free else m * g * d / float(u @ J @ u + m * d * d)
    phi = 0.0 if is_free else float(np.arctan2(axis @ np.cross(weight, arm), weight @ arm))
    swing = Swing(pull, phi, float(u @ start.Omega[0]))
    found = HingedMotion(swing, start, point, axis, float(system.gyration[0]), t_end)
    try:
        found.horizon  # noqa: B018  computes the swing and the disturbed ones
    except ArithmeticError:
        return None
    return found
