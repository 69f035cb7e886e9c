"""Make solvers from one function: ``@step``, a step of fixed size, or ``@rhs``, accelerations that scipy integrates.

The function gets the system and a state. Time, limits, recording, the spool and counters are handled here.
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

from ..base.code_meter import solver_seconds
from ..mechanics.consistency import InconsistentStart
from ..mechanics.counting import CallCount, collect_counts
from ..mechanics.dynamics import Rates
from ..mechanics.jacobian import independent_rows
from ..mechanics.marching import StepFailure, march
from ..mechanics.state import State, States
from ..mechanics.step_time import REMEDY, begin_step
from ..mechanics.system import MultibodySystem
from ..mechanics.types import Problem, Status, StepControl, Trajectory
from .options import option
from .registry import read_keyword_options, solver

METHODS = {m.__name__: m for m in (si.RK23, si.RK45, si.DOP853, si.Radau, si.BDF, si.LSODA)}
# from (t [s], state at t) to the next accepted step: its t [s], state, and reaction or None
Advance = Callable[[float, State], tuple[float, State, np.ndarray | None]]
# from (system, start) to the reason of a refusal, or None
Refuses = Callable[[MultibodySystem, State], str | None]


class StepFailed(Exception):
    """Signal in a step or an rhs that it cannot continue: the run ends as ``diverged``, with the message as reason."""


def step(name: str, *, order: float = math.nan, refuses: Refuses | None = None) -> Callable[[Callable[..., Any]], type]:
    """Return a decorator that turns a function ``(system, state, dt) -> state`` into a solver with fixed steps dt [s].

    The function may also return ``(state, reaction)``. Its keyword parameters annotated with a ``Parameter`` become
    options of the solver ``name``. ``order`` is the power of dt with which its error falls (NaN: none is claimed).
    ``refuses(system, state)`` returns the reason why it cannot take a problem with this start, or None.
    """
    return lambda function: _make_solver_class(function, name, _Steps, {"order": order}, refuses)


def rhs(name: str, *, refuses: Refuses | None = None) -> Callable[[Callable[..., Any]], type]:
    """Return a decorator that makes an adaptive solver called ``name`` from a function ``(system, state) -> Rates``.

    Its option ``method`` selects the integrator of scipy. ``refuses(system, state)`` returns the reason why the solver
    does not accept this system and initial state, or None.
    """
    return lambda function: _make_solver_class(function, name, _Rates, {}, refuses)


def _make_solver_class(
    function: Callable[..., Any],
    name: str,
    base: "type[_Steps | _Rates]",
    declared: dict[str, Any],
    refuses: Refuses | None,
) -> type:
    """Return a solver class, marked as solver ``name``, that integrates by the author's ``function``.

    It is derived from ``base``, which calls the function once per step or per evaluation. ``declared`` are further
    attributes of the class, such as its order; ``refuses`` is the author's, or None.
    """
    own = read_keyword_options(f"solver {name}", function, len(base.TAKES))
    fields = [(k, type(default), option(default, p.doc, p.unit, **_list_limits(p))) for k, (default, p) in own.items()]
    body = {
        **declared,
        "function": staticmethod(function),
        "refused": staticmethod(refuses or (lambda *_: None)),
        "own": tuple(own),
        "__doc__": inspect.getdoc(function) or "",
    }

    def solve(self: Any, problem: Problem, control: StepControl) -> Trajectory:
        """Solve the problem as the base class does, by the author's function."""
        found: Trajectory = base.solve(self, problem, control)
        return found

    solve.__wrapped__ = function  # type: ignore[attr-defined]  # ``inspect`` finds the author's code
    body["solve"] = solve
    made = dataclasses.make_dataclass(function.__name__, fields, bases=(base,), namespace=body, frozen=True)
    made.__module__ = function.__module__
    return solver(name)(made)


def _list_limits(p: Any) -> dict[str, Any]:
    """Return the allowed values of a Parameter (choices, above, at_least, at_most) as keywords of ``option``."""
    return {k: v for k, v in vars(p).items() if k not in ("doc", "unit")}


@dataclass(frozen=True)
class _FromFunction:
    """The fields and methods that both kinds of solvers made from a function share."""

    paper_label: ClassVar[str] = ""
    function: ClassVar[Any]
    refused: ClassVar[Any]  # Refuses, called without self
    own: ClassVar[tuple[str, ...]]  # options of the function

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the author's ``refuses`` declines the problem; None if it accepts it, or if there is none."""
        found: str | None = self.refused(problem.system, problem.initial)
        return found

    def call(self, *arguments: Any) -> Any:
        """Call the author's function with ``arguments``, and with the options of this solver as keywords."""
        return self.function(*arguments, **{k: getattr(self, k) for k in self.own})


@dataclass(frozen=True)
class _Steps(_FromFunction):
    """A solver by the author's function for one step."""

    TAKES: ClassVar[tuple[str, ...]] = ("system", "state", "dt")
    control: ClassVar[str] = "dt"

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate with steps of ``control.dt``, the last one cut to end at ``t_end``."""
        dt = float(control.dt or math.nan)
        steps = max(1, math.ceil(problem.t_end / dt - 1e-9))
        done = 0

        def advance(t: float, s: State) -> tuple[float, State, np.ndarray | None]:
            """Return time [s], state and reaction one step after the state ``s`` at ``t`` [s].

            Raise TypeError or ValueError if the author's function returns something invalid.
            """
            nonlocal done
            done += 1
            ahead = problem.t_end if done == steps else done * dt
            with begin_step(t):
                found = self.call(problem.system, s, ahead - t)
            state, reaction = found if isinstance(found, tuple) else (found, None)
            if not isinstance(state, State):
                raise TypeError(f"a step must return a State, or a State and a reaction (got {type(state).__name__})")
            if state.t == 0.0:  # the default; any other time is replaced by that of the step's end
                raise ValueError(f"a step returned a state with t = 0 s at its end, t = {ahead:.6g} s; {REMEDY}")
            return ahead, state, reaction

        # steps of fixed size are never rejected
        return _march(problem, control, advance, None, lambda: {"rejected": 0})


@dataclass(frozen=True)
class _Rates(_FromFunction):
    """A solver by the author's function for accelerations."""

    TAKES: ClassVar[tuple[str, ...]] = ("system", "state")
    control: ClassVar[str] = "rtol"
    method: str = option("DOP853", "method of scipy.integrate", choices=tuple(METHODS))

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate (r, quaternion, v, Omega), Omega in the body frame, and record the method's accepted steps.

        atol equals rtol. An error before the first step is raised, since there is no motion to keep: StepFailure if the
        limit on CPU time is reached, StepFailed and others from the author's function.
        """
        start_time, nb = solver_seconds(), problem.system.nb
        cuts = np.cumsum([3, 4, 3]) * nb

        def rates(s: State) -> Rates:
            """Return the accelerations and reactions that the author's function gives at ``s``; check their type."""
            with begin_step(s.t):
                found = self.call(problem.system, s)
            if not isinstance(found, Rates):
                raise TypeError(f"an rhs must return Rates (got {type(found).__name__})")
            return found

        def state(t: float, y: Float[np.ndarray, " n"]) -> State:
            """Return the state at ``t`` [s] from scipy's vector y of (r, quaternion, v, Omega)."""
            r, q, v, Omega = (a.reshape(nb, -1) for a in np.split(y, cuts))
            return State(r, Rotation.from_quat(q, scalar_first=True).as_matrix(), v, Omega, t)

        def y_dot(t: float, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
            """Return the time derivative of scipy's vector y at ``t`` [s]; raise StepFailure at the limit of CPU."""
            _check_clock(control, start_time)
            d, q = rates(state(t, y)), y[cuts[0] : cuts[1]].reshape(nb, 4)
            turning = np.concatenate((np.zeros((nb, 1)), d.Omega), axis=1)
            return np.concatenate(
                [a.ravel() for a in (d.v, 0.5 * _multiply_quaternions(q, turning), d.v_dot, d.Omega_dot)]
            )

        start = problem.initial
        q = Rotation.from_matrix(start.R).as_quat(scalar_first=True)
        y = np.concatenate([a.ravel() for a in (start.r, q, start.v, start.Omega)])
        limits: dict[str, Any] = {"rtol": control.rtol, "atol": control.rtol, "max_step": control.max_step or np.inf}
        with collect_counts(CallCount()) as calls:
            first = rates(start).reaction
            run = METHODS[self.method](y_dot, 0.0, y, problem.t_end, **limits)

        def advance(t: float, s: State) -> tuple[float, State, np.ndarray | None]:
            """Return time [s], state and reaction after scipy's next step; raise StepFailure if it cannot take one.

            The arguments are not used, since scipy keeps the same time and state itself.
            """
            with np.errstate(all="ignore"):
                said = run.step()
            if run.status == "failed":
                raise StepFailure(Status.STEP_UNDERFLOW, str(said).rstrip(".").lower())
            here = state(run.t, run.y)
            return run.t, here, rates(here).reaction

        return _march(problem, control, advance, first, lambda: {"evaluations": run.nfev}, calls)


def _march(
    problem: Problem,
    control: StepControl,
    advance: Advance,
    first: np.ndarray | None,
    counters: Callable[[], dict[str, int]],
    calls: CallCount | None = None,
) -> Trajectory:
    """March by ``advance`` from the problem's start to its end, and return the motion with all accepted steps.

    ``first`` is the reaction at the start (None: unknown). ``counters()`` is called at the end and returns what the
    method counted; ``calls`` counts the calls of ``accelerations`` before the first step (None: none). If that is ever
    called, these numbers replace those of ``counters``. An error in a step becomes the status of the motion, which
    keeps the steps before it.
    """
    start_time = solver_seconds()
    times, states, reactions = [0.0], [problem.initial], [first]
    count = calls or CallCount()

    def take_step() -> None:
        """Append the next step to the motion and, when due, pass steps to the spool; raise StepFailure if it fails."""
        try:
            with collect_counts(count):
                t, s, reaction = advance(times[-1], states[-1])
        except (StepFailed, InconsistentStart, ArithmeticError) as error:
            raise StepFailure(Status.DIVERGED, str(error) or type(error).__name__) from None
        except np.linalg.LinAlgError as error:
            redundant = describe_redundant_rows(problem) if "ingular" in str(error) else ""
            raise StepFailure(Status.DIVERGED, f"{error}{redundant and f': {redundant}'}") from None
        s = dataclasses.replace(s, t=t)
        if not all(np.all(np.isfinite(a)) for a in vars(s).values()):
            raise StepFailure(Status.DIVERGED, "the state is no longer finite")
        times.append(t)
        states.append(s)
        reactions.append(reaction)
        if control.spool is not None and control.spool.due():
            new = slice(control.spool.rows, None)
            control.spool.take(times[new], _stack_states(states[new]))

    status, message = march(times, problem, control, lambda: _check_clock(control, start_time), take_step)
    own = {"evaluations": count.evaluations, "factorisations": count.factorisations} if count.evaluations else {}
    none = np.full(problem.system.nrows, math.nan)
    known = [none if a is None else np.asarray(a, dtype=float) for a in reactions]
    return Trajectory(
        np.array(times),
        _stack_states(states),
        status,
        message,
        {"steps": len(times) - 1, **counters(), **own},
        reaction=None if all(a is None for a in reactions) else np.array(known),
        cpu_time=solver_seconds() - start_time,
    )


def describe_redundant_rows(problem: Problem) -> str:
    """Return advice on the redundant constraint rows of a problem, which make a saddle-point matrix singular.

    Empty if it has none.
    """
    rows, rank = problem.system.nrows, len(independent_rows(problem.system, problem.initial))
    if rank == rows:
        return ""
    return (
        f"{problem.name} has redundant rows ({rows} rows of rank {rank}): solve by least squares "
        "(numpy.linalg.lstsq), as accelerations() does, or refuse such problems (refuses=)"
    )


def _check_clock(control: StepControl, start_time: float) -> None:
    """Raise StepFailure if the CPU time since ``start_time`` [s] exceeds the limit of ``control``."""
    if control.cpu_limit is not None and solver_seconds() - start_time > control.cpu_limit:
        raise StepFailure(Status.STALLED, f"the CPU limit of {control.cpu_limit:g} s was reached")


def _stack_states(states: list[State]) -> States:
    """Return single states as the states of a motion, with time as the first axis."""
    return States(*(np.array([getattr(s, name) for s in states]) for name in ("r", "R", "v", "Omega")))


def _multiply_quaternions(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the products p q of two arrays of quaternions (nb, 4), w first."""
    w, u, x, v = p[:, :1], p[:, 1:], q[:, :1], q[:, 1:]
    return np.concatenate((w * x - np.sum(u * v, axis=1)[:, None], w * v + x * u + np.cross(u, v)), axis=1)
