"""A solver from one function: ``@step``, a step of fixed size, and ``@rhs``, accelerations that scipy integrates.

Time, limits, recording, the spool and counters are here; the function knows the system and a state.
"""

import dataclasses
import inspect
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.integrate as si
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ..code_meter import solver_seconds
from ..mechanics.consistency import InconsistentStart
from ..mechanics.counting import Count, counting
from ..mechanics.dynamics import Rates
from ..mechanics.jacobian import independent_rows
from ..mechanics.state import State, States
from ..mechanics.step_time import REMEDY, step_from
from ..mechanics.system import MultibodySystem
from ..types import Problem, Status, StepControl, Trajectory
from .options import option
from .registry import keyword_options, solver

METHODS = {m.__name__: m for m in (si.RK23, si.RK45, si.DOP853, si.Radau, si.BDF, si.LSODA)}
Advance = Callable[[float, State], tuple[float, State, np.ndarray | None]]
Refuses = Callable[[MultibodySystem, State], str | None]


class StepFailed(Exception):
    """Raise it in a step or an rhs that cannot go on: the run ends as ``diverged``, with its words as the reason."""


class Stop(Exception):
    """Why a march cannot go on."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status, self.message = status, message


def step(name: str, *, order: float = math.nan, refuses: Refuses | None = None) -> Callable[[Callable[..., Any]], type]:
    """Mark ``(system, state, dt) -> state`` or ``-> (state, reaction)`` as a solver of fixed steps of that order.

    Keyword parameters annotated with a ``Parameter`` are its options.
    """
    return lambda function: _solver_from(function, name, _Steps, {"order": order}, refuses)


def rhs(name: str, *, refuses: Refuses | None = None) -> Callable[[Callable[..., Any]], type]:
    """Mark ``(system, state) -> Rates`` as a solver with error control; its option ``method`` is one of scipy's."""
    return lambda function: _solver_from(function, name, _Rates, {}, refuses)


def _solver_from(
    function: Callable[..., Any],
    name: str,
    base: "type[_Steps | _Rates]",
    declared: dict[str, Any],
    refuses: Refuses | None,
) -> type:
    own = keyword_options(f"solver {name}", function, len(base.TAKES))
    fields = [(k, type(default), option(default, p.doc, p.unit, **_limits(p))) for k, (default, p) in own.items()]
    body = {**declared, "function": staticmethod(function), "refused": staticmethod(refuses or (lambda *_: None)),
            "own": tuple(own), "__doc__": inspect.getdoc(function) or ""}  # fmt: skip

    def solve(self: Any, problem: Problem, control: StepControl) -> Trajectory:
        found: Trajectory = base.solve(self, problem, control)
        return found

    solve.__wrapped__ = function  # type: ignore[attr-defined]  # whoever looks for the code finds the author's
    body["solve"] = solve
    made = dataclasses.make_dataclass(function.__name__, fields, bases=(base,), namespace=body, frozen=True)
    made.__module__ = function.__module__
    return solver(name)(made)


def _limits(p: Any) -> dict[str, Any]:
    return {k: v for k, v in vars(p).items() if k not in ("doc", "unit")}


@dataclass(frozen=True)
class _FromFunction:
    """Fields that both have."""

    paper_label: ClassVar[str] = ""
    function: ClassVar[Any]
    refused: ClassVar[Any]  # Refuses, called without self
    own: ClassVar[tuple[str, ...]]  # options of the function

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """The author's description."""
        found: str | None = self.refused(problem.system, problem.initial)
        return found

    def call(self, *arguments: Any) -> Any:
        """The function with its options."""
        return self.function(*arguments, **{k: getattr(self, k) for k in self.own})


@dataclass(frozen=True)
class _Steps(_FromFunction):
    TAKES: ClassVar[tuple[str, ...]] = ("system", "state", "dt")
    control: ClassVar[str] = "dt"

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Steps of ``control.dt``, the last one cut to end at ``t_end``."""
        dt = float(control.dt or math.nan)
        steps = max(1, math.ceil(problem.t_end / dt - 1e-9))
        done = 0

        def advance(t: float, s: State) -> tuple[float, State, np.ndarray | None]:
            nonlocal done
            done += 1
            ahead = problem.t_end if done == steps else done * dt
            with step_from(t):
                found = self.call(problem.system, s, ahead - t)
            state, reaction = found if isinstance(found, tuple) else (found, None)
            if not isinstance(state, State):
                raise TypeError(f"a step must return a State, or a State and a reaction (got {type(state).__name__})")
            if state.t == 0.0:  # the default; any other time is replaced by that of the step's end
                raise ValueError(f"a step returned a state with t = 0 s at its end, t = {ahead:.6g} s; {REMEDY}")
            return ahead, state, reaction

        return _march(problem, control, advance, None, lambda: {"rejected": 0})  # none is ever cut


@dataclass(frozen=True)
class _Rates(_FromFunction):
    TAKES: ClassVar[tuple[str, ...]] = ("system", "state")
    control: ClassVar[str] = "rtol"
    method: str = option("DOP853", "method of scipy.integrate", choices=tuple(METHODS))

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Accepted steps of the method on (r, quaternion, v, Omega); atol = rtol."""
        began, nb = solver_seconds(), problem.system.nb
        cuts = np.cumsum([3, 4, 3]) * nb

        def rates(s: State) -> Rates:
            with step_from(s.t):
                found = self.call(problem.system, s)
            if not isinstance(found, Rates):
                raise TypeError(f"an rhs must return Rates (got {type(found).__name__})")
            return found

        def state(t: float, y: Float[np.ndarray, " n"]) -> State:
            r, q, v, Omega = (a.reshape(nb, -1) for a in np.split(y, cuts))
            return State(r, Rotation.from_quat(q, scalar_first=True).as_matrix(), v, Omega, t)

        def y_dot(t: float, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            _check_clock(control, began)
            d, q = rates(state(t, y)), y[cuts[0] : cuts[1]].reshape(nb, 4)
            turning = np.concatenate((np.zeros((nb, 1)), d.Omega), axis=1)
            return np.concatenate([a.ravel() for a in (d.v, 0.5 * _product(q, turning), d.v_dot, d.Omega_dot)])

        s = problem.initial
        q = Rotation.from_matrix(s.R).as_quat(scalar_first=True)
        y = np.concatenate([a.ravel() for a in (s.r, q, s.v, s.Omega)])
        limits: dict[str, Any] = {"rtol": control.rtol, "atol": control.rtol, "max_step": control.max_step or np.inf}
        with counting(Count()) as begun:
            first = rates(s).reaction
            run = METHODS[self.method](y_dot, 0.0, y, problem.t_end, **limits)

        def advance(t: float, s: State) -> tuple[float, State, np.ndarray | None]:
            with np.errstate(all="ignore"):
                said = run.step()
            if run.status == "failed":
                raise Stop(Status.STEP_UNDERFLOW, str(said).rstrip(".").lower())
            here = state(run.t, run.y)
            return run.t, here, rates(here).reaction

        return _march(problem, control, advance, first, lambda: {"evaluations": run.nfev}, begun)


def _march(
    problem: Problem, control: StepControl, advance: Advance, first: np.ndarray | None,
    counters: Callable[[], dict[str, int]], begun: Count | None = None,
) -> Trajectory:  # fmt: skip
    """The motion; ``begun``: calls of ``accelerations`` made before, which replace evaluations counted otherwise."""
    began = solver_seconds()
    t, s = 0.0, problem.initial
    times, states, reactions = [t], [s], [first]
    status, message = Status.SUCCESS, "reached the end"
    count = begun or Count()
    try:
        while t < problem.t_end:
            if len(times) > control.max_steps:
                raise Stop(Status.STALLED, f"the limit of {control.max_steps} accepted steps was reached")
            _check_clock(control, began)
            with counting(count):
                t, s, reaction = advance(t, s)
            s = dataclasses.replace(s, t=t)
            if not all(np.all(np.isfinite(a)) for a in vars(s).values()):
                raise Stop(Status.DIVERGED, "the state is no longer finite")
            times.append(t)
            states.append(s)
            reactions.append(reaction)
            if control.spool is not None and control.spool.due():
                new = slice(control.spool.rows, None)
                control.spool.take(times[new], _stack_states(states[new]))
    except Stop as stop:
        status, message = stop.status, stop.message
    except (StepFailed, InconsistentStart, ArithmeticError) as error:  # of a motion that has gone astray
        status, message = Status.DIVERGED, str(error) or type(error).__name__
    except np.linalg.LinAlgError as error:
        redundant = describe_redundant_rows(problem) if "ingular" in str(error) else ""
        status, message = Status.DIVERGED, f"{error}{redundant and f': {redundant}'}"
    if status is not Status.SUCCESS:
        message = f"stopped at t = {times[-1]:.6g} s: {message}"
    own = {"evaluations": count.evaluations, "factorisations": count.factorisations} if count.evaluations else {}
    none = np.full(problem.system.nrows, math.nan)
    known = [none if a is None else np.asarray(a, dtype=float) for a in reactions]
    return Trajectory(
        np.array(times), _stack_states(states), status, message, {"steps": len(times) - 1, **counters(), **own},
        reaction=None if all(a is None for a in reactions) else np.array(known), cpu_time=solver_seconds() - began,
    )  # fmt: skip


def describe_redundant_rows(problem: Problem) -> str:
    """Return what to do about redundant constraint rows, which make the saddle-point matrix singular; else nothing."""
    rows, rank = problem.system.nrows, len(independent_rows(problem.system, problem.initial))
    if rank == rows:
        return ""
    return (f"{problem.name} has redundant rows ({rows} rows of rank {rank}): solve by least squares "
            "(numpy.linalg.lstsq), as accelerations() does, or refuse such problems (refuses=)")  # fmt: skip


def _check_clock(control: StepControl, began: float) -> None:
    if control.cpu_limit is not None and solver_seconds() - began > control.cpu_limit:
        raise Stop(Status.STALLED, f"the CPU limit of {control.cpu_limit:g} s was reached")


def _stack_states(states: list[State]) -> States:
    return States(*(np.array([getattr(s, name) for s in states]) for name in ("r", "R", "v", "Omega")))


def _product(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Product of quaternions (nb, 4), w first."""
    w, u, x, v = p[:, :1], p[:, 1:], q[:, :1], q[:, 1:]
    return np.concatenate((w * x - np.sum(u * v, axis=1)[:, None], w * v + x * u + np.cross(u, v)), axis=1)
