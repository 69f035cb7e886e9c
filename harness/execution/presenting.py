"""A solver behind a presentation: it gets the presented system, its motion is returned in the problem's terms.

With ``retrace`` it is then sent back from where it ended, velocities reversed; where it arrives is kept.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..code_meter import solver_seconds
from ..mechanics.presentation import Presentation
from ..mechanics.state import State, States
from ..types import Problem, Solver, Spool, Status, StepControl, Trajectory


def present_solver(solver: Solver, problem: Problem) -> "Solver | PresentedSolver":
    """``solver`` as it must be called on ``problem``: itself, unless the problem is presented in another way."""
    plain = problem.presentation == Presentation() and not problem.retrace
    return solver if plain else PresentedSolver(solver)


@dataclass(frozen=True)
class PresentedSolver:
    """``refuses`` and ``solve`` of a solver, both in terms of the problem as it stands."""

    solver: Solver

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Why the solver cannot take the presented problem."""
        return self.solver.refuses(*present_problem(problem, control))

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """There and, if the problem asks for it, back."""
        began = solver_seconds()
        there = self._there(problem, control)
        if not problem.retrace or there.status is not Status.SUCCESS:
            return there
        last = there.states[-1]
        turned = dataclasses.replace(problem, initial=State(last.r, last.R, -last.v, -last.Omega))
        left = None if control.cpu_limit is None else max(control.cpu_limit - (solver_seconds() - began), 1e-3)
        back = self._there(turned, dataclasses.replace(control, spool=None, cpu_limit=left))
        if back.status is not Status.SUCCESS:
            words = f"the way back ended with {back.status} at {back.t[-1]:.6g} s: {back.message}"
            return dataclasses.replace(there, notes=(*there.notes, words))
        end = back.states[-1]
        cost = {name: getattr(there, name) + getattr(back, name) for name in ("cpu_time", "setup_time")}
        return dataclasses.replace(there, returned=State(end.r, end.R, -end.v, -end.Omega), **cost)

    def _there(self, problem: Problem, control: StepControl) -> Trajectory:
        return bring_home(self.solver.solve(*present_problem(problem, control)), problem)


def bring_home(found: Trajectory, problem: Problem) -> Trajectory:
    """The motion of the presented ``problem`` in its own terms."""
    presentation, system = problem.presentation, problem.system
    if presentation == Presentation() or found.states.nb != system.nb:  # of a wrong size: the caller tells
        return found
    return dataclasses.replace(
        found,
        t=np.asarray(found.t, dtype=float) / presentation.unit_time,
        states=presentation.states_back(system, found.states),
        reaction=None if found.reaction is None else presentation.reaction_back(system, np.asarray(found.reaction)),
    )


@dataclass
class _SpoolAtHome:
    """Hands steps over in the problem's own terms, as the spool's reader expects them."""

    spool: Spool
    problem: Problem

    @property
    def rows(self) -> int:
        return self.spool.rows

    def due(self) -> bool:
        return self.spool.due()

    def take(self, t: Float[np.ndarray, " nt"] | list[float], states: States) -> None:
        presentation = self.problem.presentation
        self.spool.take(np.asarray(t) / presentation.unit_time, presentation.states_back(self.problem.system, states))


def present_problem(problem: Problem, control: StepControl) -> tuple[Problem, StepControl]:
    """The problem and the steps as a solver gets them."""
    p = problem.presentation
    if p == Presentation():
        return problem, control
    changes: dict[str, Any] = {
        name: value * p.unit_time for name in ("dt", "max_step") if (value := getattr(control, name)) is not None
    }
    if control.spool is not None:
        changes["spool"] = _SpoolAtHome(control.spool, problem)
    seen = dataclasses.replace(
        problem, system=p.system(problem.system), initial=p.state(problem.system, problem.initial),
        t_end=problem.t_end * p.unit_time, dt=problem.dt * p.unit_time, presentation=Presentation(),
        # in terms of the bodies as they stand: of no use to a solver
        observables=(), invariants=(), reference_from=None, planar_normal=None,
    )  # fmt: skip
    return seen, dataclasses.replace(control, **changes)
