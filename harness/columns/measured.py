"""Define what is measured along a motion: series, scales and limits, from which columns take their numbers.

``harness.judge.metrics.measure`` measures them, and imports these types.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from ..mechanics.types import ALLOWED, Law, Problem, Trajectory
from .numbers import count_predictable

DECIDED = 0.9  # share of the rows that must be known for a ratio of ``Truncation`` to be computed


@dataclass(frozen=True)
class Scales:
    """The largest displacement, speed, momentum and energy exchange of a motion, which errors are compared with."""

    length: float  # [m] largest ``measure_displacement`` of a body from its start: errors are compared with it
    speed: float  # [m/s] largest of a body (``measure_speeds``)
    momentum: float  # [kg m/s] largest sum of mass times speed
    energy: float  # [J] exchanged: the largest kinetic energy, or span of potential energy if that is larger
    reach: float  # [m] ``length`` over the whole time, also where the exact motion is known for a part only
    gap: float  # [m] ``reach``, at most ``bound_reach``: springs let a mechanism go farther than joints open
    exact_at: tuple[float, ...] = field(default=(), kw_only=True)  # [s] when the exact motion reaches these sizes
    run_at: tuple[int, ...] = field(default=(), kw_only=True)  # steps of the run that reach them

    @property
    def limits(self) -> Mapping[Law, float]:
        """The limits of the laws that hold at each time: [J] energy, [m] constraint, [m/s] its rate, [-] rotations."""
        scale = {Law.ENERGY: self.energy, Law.CONSTRAINT: self.gap, Law.CONSTRAINT_RATE: self.speed}
        return {law: part * scale.get(law, 1.0) for law, part in ALLOWED.items()}

    def of_unit(self, unit: str) -> float:
        """Return the scale that the drift of an invariant is compared with, by its SI unit; NaN for an unknown unit."""
        turning = self.momentum * self.reach
        known = {
            "J": self.energy,
            "m": self.length,
            "m/s": self.speed,
            "rad/s": self.speed / self.reach,
            "kg m/s": self.momentum,
            "kg m2/s": turning,
            "N m s": turning,
        }
        return known.get(unit, math.nan)


@dataclass(frozen=True)
class Truncation:
    """The errors of rates relative to what the step size explains, worst body; NaN where nothing is known.

    Those of accelerations and reactions are upper bounds where they are small (``judge.metrics.truncation.CLEAR``).
    """

    velocities: float = float("nan")  # against poses, or ``measure_unexplained_velocity`` if that is larger
    accelerations: float = float("nan")  # of index 1, against difference quotients of velocities
    reactions: float = float("nan")  # as joint loads on bodies, against those of index 1
    rate: float = float("nan")  # [1/s] the largest acceleration of a body over the largest speed
    rows: int = 0  # rows examined
    unsure: int = 0  # rows where accelerations of index 1 are uncertain; counted only where a ratio exceeds 1
    unsure_loads: int = 0  # rows where accelerations or loads are uncertain

    @property
    def shares(self) -> dict[str, float]:
        """The errors relative to what the step size explains, by name: velocities, accelerations, reactions."""
        return {"velocities": self.velocities, "accelerations": self.accelerations, "reactions": self.reactions}


@dataclass(frozen=True)
class JudgedBodies:
    """A set of bodies with the residuals of their laws, and the scales that residuals are compared with."""

    bodies: Int[np.ndarray, " n"]  # numbers of the bodies
    size: Scales
    laws: Mapping[Law, Float[np.ndarray, " nt"]]  # residuals that are zero at each time in the exact motion


@dataclass(frozen=True)
class MeasuredSeries:
    """The series measured at all accepted steps, (nt,) each.

    Comparisons with the reference are NaN beyond its horizon, and None without a reference.
    """

    t: Float[np.ndarray, " nt"]
    size: Scales
    mechanisms: tuple["JudgedBodies", ...]  # each with its own scales; a single one is the whole system
    energy: Float[np.ndarray, " nt"]  # T + V [J]
    energy_error: Float[np.ndarray, " nt"]  # T + V less its initial value and the work, as far as that is certain
    phi_norm: Float[np.ndarray, " nt"]  # |phi| of all rows, each in its own unit
    phi_dot_norm: Float[np.ndarray, " nt"]  # |phi_dot|
    eq81_norm: Float[np.ndarray, " nt"]  # [sqrt(J)] the norm of phi_dot, Eq. (81)
    orthogonality: Float[np.ndarray, " nt"]  # |R^T R - 1|, worst body
    steps_of_unknown_work: int = 0  # steps over which energy is not judged
    out_of_plane: Float[np.ndarray, " nt"] | None = None  # [m] worst body, of planar problems
    position_error: Float[np.ndarray, " nt"] | None = None  # [m] this and the next four: worst body
    orientation_error: Float[np.ndarray, " nt"] | None = None  # [rad]
    motion_error: Float[np.ndarray, " nt"] | None = (
        None  # position and orientation in one: ``scales.measure_displacement``
    )
    velocity_error: Float[np.ndarray, " nt"] | None = None  # [m/s]
    angular_velocity_error: Float[np.ndarray, " nt"] | None = None  # [rad/s]
    reference_own_error: Float[np.ndarray, " nt"] | None = None  # [m] as the reference states it
    rate_error: Float[np.ndarray, " nt"] | None = None  # error of velocities, rms over a body's matter [m/s]
    kinematic_defect: float = float("nan")  # share of the path, worst body (module ``rows``)
    kinematic_exact: float = 0.0  # the same of the exact motion at these times, where the run's exceeds ``RESOLVED``
    truncation: Truncation = field(default_factory=Truncation)  # filled where there is a reference
    motion_between: float = float("nan")  # [m] largest motion error between steps, while the motion is predictable
    motion_between_s: float = float("nan")  # when
    reaction_error: float = float("nan")  # [N], largest at the instants compared
    reaction_error_s: float = float("nan")  # when
    reaction_size: float = float("nan")  # [N] the exact force at that instant
    reaction_size_s: float = float("nan")
    moment_error: float = float("nan")  # [N m] error of the joints' moment on a body about its C, at the same instants
    moment_error_s: float = float("nan")
    moment_size: float = float("nan")  # [N m] the exact moment, or that of its force at the farthest joint
    moment_size_s: float = float("nan")
    reference_route: str = ""
    reference_horizon: float = float("nan")
    observables: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    reference_observables: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    invariants: dict[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # remarks on singular poses passed, and on a reference that ends early


@dataclass(frozen=True)
class MeasuredMotion:
    """A motion with its problem and what was measured along it: the argument of the function of a column."""

    problem: Problem
    trajectory: Trajectory
    series: MeasuredSeries

    @cached_property
    def compared(self) -> int:
        """The number of recorded times, from the start, that are compared with the reference; 0 without one."""
        m = self.series
        errors = (m.position_error, m.orientation_error, m.motion_error)
        if m.reference_own_error is None or any(a is None for a in errors):
            return 0
        return int(np.sum(~np.isnan(m.reference_own_error)))

    @cached_property
    def judged(self) -> int:
        """The number of recorded times, from the start, at which errors are judged: the motion is predictable there."""
        own = self.take_compared("reference_own_error")
        return count_predictable(self.series.t[: self.compared], own / self.series.size.length)

    def take_compared(self, name: str) -> Float[np.ndarray, " n"]:
        """Return the series ``name`` of errors at the steps that are compared."""
        values: np.ndarray = getattr(self.series, name)
        return values[: self.compared]

    def take_judged(self, name: str) -> Float[np.ndarray, " n"]:
        """Return the series ``name`` of errors at the steps at which errors are judged."""
        return self.take_compared(name)[: self.judged]
