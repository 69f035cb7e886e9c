"""Compute clouds: motions of one solver from starts drawn around a problem's, in processes that may crash."""

import dataclasses
import math
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ...base.code_meter import listen_to_numba, solver_seconds
from ...base.forked_process import TICK, ForkedProcess
from ...catalogue import registry
from ...catalogue.suites.spec import make_step_control
from ...mechanics.consistency import perturb
from ...mechanics.motion import energy
from ...mechanics.state import State, States
from ...mechanics.types import Observable, Problem, Solver, Status, StepControl
from ...run.worker import solve
from .sampling import interpolate_state

MEMORY = 8000.0  # [MB] of a process
DRAWN = 120  # times of a picture


@dataclass(frozen=True)
class Ensemble:
    """A problem with the random starts around its own, at the times of scores.

    Each start has a normally distributed change of every pose and velocity, of relative size ``spread``, projected onto
    the constraints (``mechanics.consistency.perturb``).
    """

    problem: Problem  # with t_end at the last of ``at``
    spread: float
    seed: int
    at: tuple[float, ...]  # [s] times of scores, increasing
    observables: tuple[Observable, ...]  # functions of the state alone, energy included

    def draw_start(self, member: int) -> State:
        """Draw the start of a member by its number and the seed alone: the size of the ensemble does not matter."""
        seed = int(np.random.SeedSequence((self.seed, member)).generate_state(1)[0])
        return perturb(self.problem.system, self.problem.initial, self.spread, seed)

    @property
    def times(self) -> Float[np.ndarray, " nt"]:
        """Times [s] of the curves in pictures, from 0 to the last score."""
        return np.linspace(0.0, self.at[-1], DRAWN)


@dataclass(frozen=True)
class ConfiguredSolver:
    """A solver with its options, its step control, and the name of this setting."""

    name: str  # of the solver
    setting: str
    solver: Solver
    control: StepControl


def configure_solver(problem: Problem, solver: str, given: Mapping[str, str]) -> ConfiguredSolver:
    """Return a solver at its default options, with those step controls of ``given`` that apply to it.

    ``given`` has ``dt``, ``rtol`` or ``max_step`` as text; the step control that the solver does not have is left out.
    """
    entry = registry.find_entry("solver", solver, registry.solvers())
    others = {"dt": ("rtol", "max_step"), "rtol": ("dt",)}[entry.control]
    control = make_step_control(solver, entry.control, problem, {k: v for k, v in given.items() if k not in others})
    setting = f"{entry.control}={getattr(control, entry.control):g}"
    return ConfiguredSolver(solver, setting, registry.make_solver(solver), control)


def configure_truth(problem: Problem, solver: str, rtol: float) -> ConfiguredSolver:
    """Return the solver of the true motions at tolerance ``rtol``, with code for the mechanism if it has such code.

    Making it takes time, which thousands of members repay.
    """
    code = configure_solver(problem, solver, {"rtol": str(rtol)})
    if "code" not in registry.find_entry("solver", solver, registry.solvers()).parameters:
        return code
    own = registry.make_solver(solver, {"code": "mechanism"})
    return code if own.refuses(problem, code.control) else dataclasses.replace(code, solver=own)


@dataclass(frozen=True)
class Cloud:
    """The motions of all members by one solver; NaN where a member did not get so far."""

    code: ConfiguredSolver
    values: Float[np.ndarray, "n observables at"]  # at the times of scores
    C: Float[np.ndarray, "n at nb 3"]  # [m] centres of mass
    drawn: Float[np.ndarray, "n observables nt"]  # at the times of pictures
    failures: tuple[str, ...]  # a line for each member that did not reach the end
    cpu_s: float  # of all members, without code generation

    @property
    def label(self) -> str:
        """The solver's name and its setting, as legends show it."""
        return f"{self.code.name} {self.code.setting}"


def make_ensemble(problem: Problem, spread: float, seed: int, at: Sequence[float]) -> Ensemble:
    """Return an ensemble of starts around the problem's, whose motions end at the last of the times ``at`` [s].

    Observables that depend on more than the state are left out, and the energy is added. Raise ValueError unless the
    times are positive and increase.
    """
    if not at or min(at) <= 0.0 or list(at) != sorted(set(at)):
        raise ValueError(f"times of scores must be > 0 and increase (got {', '.join(map('{:g}'.format, at))})")
    parameters = {**problem.parameters, "t_end": at[-1]}
    problem = dataclasses.replace(problem, t_end=at[-1], parameters=parameters)
    total = Observable("energy", "E", "J", partial(energy, problem.system))
    plain = Ensemble(problem, spread, seed, tuple(at), ())
    # the second of two states, alone and after the first: an observable of the state alone is the same
    pair = problem.home(_stack_states([plain.draw_start(0), plain.draw_start(1)]))
    last = pair.at(slice(1, 2))
    own = {
        o.name: o
        for o in (*problem.observables, total)
        if np.allclose(o.of(pair)[1:], o.of(last), rtol=1e-12, atol=1e-14)  # differences by rounding
    }
    return dataclasses.replace(plain, observables=tuple(own.values()))


def run_cloud(ensemble: Ensemble, code: ConfiguredSolver, members: Sequence[int], jobs: int) -> Cloud:
    """Solve ``members`` in up to ``jobs`` processes and return their cloud; a crash loses one member only."""
    with tempfile.TemporaryDirectory() as place:
        left = [list(members[j::jobs]) for j in range(jobs)]
        active = {j: _start_process(ensemble, code, own, Path(place)) for j, own in enumerate(left) if own}
        while active:
            time.sleep(TICK)
            for j, process in list(active.items()):
                ended = process.check_end()
                if ended is None:
                    continue
                del active[j]
                left[j] = [k for k in left[j] if not _name_file(Path(place), k).exists()]
                if left[j]:
                    _write_member(Path(place), left[j].pop(0), _make_empty_parts(ensemble), ended.words, 0.0)
                if left[j]:
                    active[j] = _start_process(ensemble, code, left[j], Path(place))
        read = [np.load(_name_file(Path(place), k), allow_pickle=False) for k in members]
        lines = [f"member {k}: {f['failure']}" for k, f in zip(members, read, strict=True) if str(f["failure"])]
        values, C, drawn = (np.stack([f[name] for f in read]) for name in ("values", "C", "drawn"))
        return Cloud(code, values, C, drawn, tuple(lines), sum(float(f["cpu_s"]) for f in read))


def _start_process(e: Ensemble, code: ConfiguredSolver, members: Sequence[int], place: Path) -> ForkedProcess:
    """Start a process that runs ``members`` one after the other and writes a file for each into ``place``."""

    def target(send: Callable[[str], None]) -> None:
        """Run the members, and write the file of each with its CPU time."""
        listen_to_numba()
        for k in members:
            began = solver_seconds()
            parts, failure = _run_member(e, code, k)
            _write_member(place, k, parts, failure, solver_seconds() - began)

    return ForkedProcess(target, limit=1e8, memory=MEMORY, wall=math.inf)


Parts = tuple[np.ndarray, np.ndarray, np.ndarray]  # values, C, drawn


def _run_member(e: Ensemble, code: ConfiguredSolver, member: int) -> tuple[Parts, str]:
    """Solve a member; return its numbers, NaN at times it did not reach, and why it failed, or ""."""
    parts = _make_empty_parts(e)
    try:
        problem = dataclasses.replace(e.problem, initial=e.draw_start(member))
        handover = solve(problem, code.solver, code.control)
        trajectory = handover.trajectory
        if trajectory is None:
            return parts, handover.report.message
        _sample_motion(e, trajectory.states, parts)
        if trajectory.status is not Status.SUCCESS:
            return parts, f"{trajectory.status}: {trajectory.message}"
        return parts, "" if np.all(np.isfinite(parts[0])) else "claims success, but does not reach the end"
    except Exception as error:  # the failure of a member is its result
        return parts, f"{type(error).__name__}: {error}"


def _sample_motion(e: Ensemble, s: States, parts: Parts) -> None:
    """Fill the arrays ``parts`` of a member with its motion ``s``, at the times that it reached."""
    values, C, drawn = parts
    reached = s.times[-1] * (1.0 + 1e-9)
    for k, t in enumerate(e.at):
        if t <= reached:
            one = States.one(interpolate_state(s, t))
            C[k] = one.r[0]
            values[:, k] = [o.of(e.problem.home(one))[0] for o in e.observables]
    after = np.minimum(np.searchsorted(s.times, e.times), len(s) - 1)
    near = s.at(np.unique(np.concatenate((np.maximum(after - 1, 0), after))))  # the steps around each time
    seen = e.problem.home(near)
    drawn[:] = [np.interp(e.times, near.times, o.of(seen), right=math.nan) for o in e.observables]


def _make_empty_parts(e: Ensemble) -> Parts:
    """Return the arrays of a member that is not solved yet: all NaN."""
    n, nb = len(e.observables), e.problem.system.nb
    shapes = ((n, len(e.at)), (len(e.at), nb, 3), (n, DRAWN))
    return tuple(np.full(shape, np.nan) for shape in shapes)  # type: ignore[return-value]


def _write_member(place: Path, member: int, parts: Parts, failure: str, cpu_s: float) -> None:
    """Write the file of a member, completely or not at all: its numbers, its failure, its CPU time [s]."""
    values, C, drawn = parts
    whole = place / f"{member}.part.npz"
    np.savez(whole, values=values, C=C, drawn=drawn, failure=np.array(failure), cpu_s=np.array(cpu_s))
    whole.rename(_name_file(place, member))


def _name_file(place: Path, member: int) -> Path:
    """Return the path of the file of a member in the folder ``place``."""
    return place / f"{member}.npz"


def _stack_states(states: Sequence[State]) -> States:
    """Join single states along the axis of time."""
    return States(*(np.stack([getattr(s, name) for s in states]) for name in ("r", "R", "v", "Omega")))
