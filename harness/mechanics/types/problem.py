"""Define a problem: a system, its start, and all that is known about its motion."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ...base.text import check_text
from ..presentation import Presentation
from ..state import State, States, rotate_states
from ..system import MultibodySystem
from ..zero_inertia import check_axes


class Trait(StrEnum):
    """The purpose of a problem; ``list`` groups problems by it."""

    SINGULAR = "singular"  # the rank of A drops at instants
    REDUNDANT = "redundant"  # more rows than their rank, at all times
    STIFF = "stiff"  # time constants far below those of the motion
    CHAOTIC = "chaotic"
    LONG = "long"  # hundreds of turns or swings
    DAMPED = "damped"  # dampers: energy leaves by work that enters the balance
    DRIVEN = "driven"  # applied forces, torques or prescribed motions, whose work enters the balance
    NONHOLONOMIC = "nonholonomic"  # rows that restrict velocities only


@dataclass(frozen=True)
class Observable:
    """A scalar of the motion to compare and plot, in the problem's home frame."""

    name: str
    symbol: str  # mathtext, without $
    unit: str
    of: Callable[[States], Float[np.ndarray, " nt"]]  # its values at the times of a motion


@dataclass(frozen=True)
class Invariant:
    """A scalar that the exact motion conserves, in the problem's home frame."""

    name: str
    unit: str
    of: Callable[[States], Float[np.ndarray, " nt"]]  # its values at the times of a motion


class ReferenceKind(StrEnum):
    """The degree to which the stated error of a reference can be trusted."""

    PROVED = "proved"  # a bound in ball arithmetic, from the start's float64 numbers to the returned pose
    FORMULA = "formula"  # exact except for rounding, which is estimated
    CERTIFIED = "certified"  # integrated in two formulations of its own, whose difference bounds the error
    COMPUTED = "computed"  # integrated in two general formulations from the system's data only


@runtime_checkable
class Reference(Protocol):
    """A reference motion, computed by none of the solvers under test; without a ``kind`` it is ``computed``."""

    @property
    def route(self) -> str:
        """The method of computation, in a line."""
        ...

    @property
    def horizon(self) -> float:
        """The time up to which ``error`` is certified [s]."""
        ...

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s]."""
        ...

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return a certified bound on the position error of any body at ``t`` [m]."""
        ...


@dataclass(frozen=True, repr=False)
class Problem:
    """A system, its start, and all that is known about its motion.

    ``frame`` rotates the home frame (the paper's) to space: the identity unless the problem is presented in another
    frame.
    """

    name: str
    system: MultibodySystem
    initial: State
    t_end: float  # [s]
    dt: float  # [s] the paper's step for ODE-GC
    section: str  # e.g. "Sect. 5.4"
    source: str  # source of every number
    observables: tuple[Observable, ...] = ()
    invariants: tuple[Invariant, ...] = ()
    reference_from: Callable[[State], Reference | None] | None = None  # exact motion from a start in the home frame
    parameters: Mapping[str, Any] = field(default_factory=dict)
    frame: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    planar_normal: Float[np.ndarray, " 3"] | None = None  # home frame; given if the exact motion is planar
    energy_allowed: float | None = None  # [J] the benchmark's own limit on max |E - E0|, if it has one
    presentation: Presentation = field(
        default_factory=Presentation
    )  # how it is presented to a solver (run.presenting); nothing here changes
    literal_start: bool = False  # starts as printed although phi_dot is not zero: the check is waived, with a note
    retrace: bool = False  # True to integrate back from the end with velocities reversed

    def __post_init__(self) -> None:
        """Raise ValueError for a name or unit that is no plain text, and for axes that ``check_axes`` refuses."""
        for what in ("name", "section"):
            check_text(f"problem {self.name}: {what}", getattr(self, what))
        named: tuple[Observable | Invariant, ...] = (*self.observables, *self.invariants)
        for one in named:
            kind = type(one).__name__.lower()
            check_text(f"problem {self.name}: name of an {kind}", one.name)
            check_text(f"problem {self.name}: unit of {kind} {one.name}", one.unit)
        if 0.0 < self.t_end < math.inf:
            check_axes(self.system, self.initial, self.t_end)

    def __repr__(self) -> str:
        """Return name, parameters, size and duration in one line."""
        given = f"[{', '.join(f'{k}={v}' for k, v in self.parameters.items())}]" if self.parameters else ""
        s = self.system
        bodies = "1 body" if s.nb == 1 else f"{s.nb} bodies"
        joints = "1 joint" if s.nj == 1 else f"{s.nj} joints"
        return f"<Problem {self.name}{given}: {bodies}, {joints}, {s.nrows} rows; {self.t_end:g} s, dt = {self.dt:g} s>"

    def check_begin(self) -> None:
        """Raise ValueError unless the start has t = 0, where every motion of a user's problem begins.

        Only solvers make problems that begin later: the rest of a motion, with another choice of rows.
        """
        if self.initial.t != 0.0:
            raise ValueError(
                f"problem {self.name}: the start has t = {self.initial.t:g} s, and every motion begins at t = 0: "
                "shift drives and loads in time instead"
            )

    def home(self, s: States) -> States:
        """Return the motion ``s``, given in space, rotated to the home frame: the paper's axes."""
        return rotate_states(s, self.frame.T)

    def observe(self, s: States) -> dict[str, Float[np.ndarray, " nt"]]:
        """Return the observables of the motion ``s``, given in space: a value at each of its times, by name."""
        at_home = self.home(s)
        return {o.name: o.of(at_home) for o in self.observables}

    def reference(self) -> Reference | None:
        """Return the problem's own reference motion, in space; None if none is known or the start opens the joints."""
        if self.reference_from is None or self.literal_start:
            return None
        exact = self.reference_from(self.home(States.one(self.initial))[0])
        return None if exact is None else _TurnedReference(exact, self.frame)


def classify_reference(reference: Reference) -> ReferenceKind:
    """Return how far the stated error of a reference can be trusted: its ``kind``, ``computed`` if it has none."""
    return ReferenceKind(getattr(reference, "kind", ReferenceKind.COMPUTED))


TURNED = 16.0 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class _TurnedReference:
    """A reference given in the home frame, rotated to space by ``frame``."""

    home: Reference
    frame: Float[np.ndarray, "3 3"]

    @property
    def route(self) -> str:
        return self.home.route

    @property
    def kind(self) -> ReferenceKind:
        """The kind in the home frame; ``formula`` at best where rotated, as a proof does not cover that rounding."""
        home = classify_reference(self.home)
        return ReferenceKind.FORMULA if home is ReferenceKind.PROVED and self._is_turned else home

    @property
    def _is_turned(self) -> bool:
        """True unless ``frame`` is the identity: then nothing is rotated and no rounding added."""
        return not np.array_equal(self.frame, np.eye(3))

    @property
    def horizon(self) -> float:
        return self.home.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s], in space."""
        s = self.home.states(t)
        return (rotate_states(s, self.frame) if self._is_turned else s).with_times(t)

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return the error in the home frame [m], plus an estimate of the rounding of the rotation to space."""
        if not self._is_turned:
            return self.home.error(t)
        s = self.home.states(t)
        speed = max(float(np.max(np.abs(a), initial=0.0)) for a in (s.Omega, s.v))
        size = 1.0 if not s.r.size else max(1.0, float(np.max(np.abs(s.r))))
        return self.home.error(t) + TURNED * size * (1.0 + speed * np.abs(t))
