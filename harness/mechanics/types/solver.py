"""Define input and output of a solver: steps or tolerance, a trajectory."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from ..state import State, States
from .problem import Problem
from .verdicts import Status


class Spool(Protocol):
    """A receiver of accepted steps during a run, which are kept if the process is killed (harness/run/spool)."""

    rows: int  # rows taken so far

    def due(self) -> bool:
        """Return whether it is time to pass the steps since the last block; cheap, call it after every step."""
        ...

    def take(self, t: Float[np.ndarray, " nt"] | list[float], states: States) -> None:
        """Take the steps since the last call, at the times ``t`` [s], with or without the start."""
        ...


# below it SciPy silently uses this value, others take steps of no length
LEAST_RTOL = 100.0 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class StepControl:
    """The step control: exactly one of ``dt`` (fixed step [s]) and ``rtol`` (error control, with equal atol)."""

    dt: float | None = None
    rtol: float | None = None
    max_step: float | None = None  # [s] for error control only
    max_steps: int = 10_000_000  # accepted steps before the run counts as stalled
    cpu_limit: float | None = None  # [s] CPU time at which the solver stops itself and returns what it has
    spool: Spool | None = field(default=None, compare=False, repr=False)  # receiver of steps during the run

    def __post_init__(self) -> None:
        """Raise ValueError unless the control is one of fixed steps or of a tolerance, with numbers in their ranges."""
        if (self.dt is None) == (self.rtol is None):
            raise ValueError(f"give exactly one of dt and rtol (got dt={self.dt}, rtol={self.rtol})")
        for name in ("dt", "rtol", "max_step", "cpu_limit"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be a finite number > 0 (got {value})")
        if self.rtol is not None and self.rtol < LEAST_RTOL:
            raise ValueError(f"rtol must be at least {LEAST_RTOL:.3g}: rounding allows no less (got {self.rtol:g})")
        if self.max_step is not None and self.dt is not None:
            raise ValueError(
                f"max_step goes with rtol, not with a fixed dt (got dt={self.dt}, max_step={self.max_step})"
            )
        if self.max_steps < 1:
            raise ValueError(f"max_steps must be >= 1 (got {self.max_steps})")


@dataclass(frozen=True, repr=False)
class Trajectory:
    """A solver's own accepted steps, never resampled; on failure those before it.

    ``reaction`` is the force conjugate to phi at the times ``t``: ``A^T reaction`` is the reaction on the bodies ([N]
    for point rows, [N m] for axis rows), NaN where the solver has none; never a raw lambda, by which Eqs. (36) and (92)
    mean different things. ``diagnostics`` are further series of the solver's own, (nt,) each.
    """

    t: Float[np.ndarray, " nt"]
    states: States
    status: Status
    message: str
    counters: Mapping[str, int]
    reaction: Float[np.ndarray, "nt nrows"] | None = None
    diagnostics: Mapping[str, Float[np.ndarray, " nt"]] = field(default_factory=dict)
    events: tuple[Mapping[str, Any], ...] = ()  # e.g. singular passages: plain numbers and strings
    notes: tuple[str, ...] = ()  # choices the solver made, e.g. which redundant rows it dropped
    cpu_time: float = float("nan")  # [s] CPU time of the integration, without compilation and set-up
    setup_time: float = float("nan")  # [s] CPU time of compilation, symbolic analysis, consistent start
    # end of the integration back to the start, velocities reversed again (run.presenting)
    returned: State | None = None

    def __post_init__(self) -> None:
        """Give the states their times; raise ValueError unless there is one state per time and the times increase."""
        t = np.asarray(self.t, dtype=float)
        if t.ndim != 1 or len(t) != len(self.states) or len(t) == 0:
            raise ValueError(
                f"expected one state a time, at least the start (got {t.shape} times, {len(self.states)} states)"
            )
        if not (np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
            raise ValueError("the times of a trajectory must be finite and increase")
        object.__setattr__(self, "states", self.states.with_times(t))

    def __repr__(self) -> str:
        bodies = "1 body" if self.states.nb == 1 else f"{self.states.nb} bodies"
        return f"<Trajectory of {bodies} at {len(self.t)} times to {self.t[-1]:.6g} s: {self.status}>"


@runtime_checkable
class Solver(Protocol):
    """A frozen dataclass of options (``harness.catalogue.options``) with two methods; one file in ``solvers/`` each.

    A solver of fixed steps may also have ``order``, the order in dt that certificates test. ``paper_label`` and
    ``order`` are class variables, or properties if they depend on the options.
    """

    name: ClassVar[str]
    control: ClassVar[str]  # "dt" or "rtol": which of the two in ``StepControl`` it takes

    @property
    def paper_label(self) -> str:
        """The paper's name of such a solver; empty if none."""
        ...

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return the reason, in one line, why this solver cannot take the problem with these steps; None if it can."""
        ...

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate from ``problem.initial`` to ``problem.t_end``; a failure is a status, not an exception."""
        ...
