"""Wrap a solver for a presentation: it solves the presented problem, and its motion is converted back.

With ``retrace`` it is then started from the end with velocities reversed, and the state where it arrives is kept. "The
problem's own terms" are the time, units and numbering of bodies and rows before it was presented.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..base.code_meter import solver_seconds
from ..mechanics.presentation import Presentation
from ..mechanics.state import State, States
from ..mechanics.types import Problem, Solver, Spool, Status, StepControl, Trajectory


def present_solver(solver: Solver, problem: Problem) -> "Solver | PresentedSolver":
    """Return ``solver``, or a ``PresentedSolver`` around it if the problem is presented in another way or retraced."""
    plain = problem.presentation == Presentation() and not problem.retrace
    return solver if plain else PresentedSolver(solver)


@dataclass(frozen=True)
class PresentedSolver:
    """A solver that is called with a problem in its own terms, and that solves it as it is presented."""

    solver: Solver

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the solver cannot take the presented problem; None if it can."""
        return self.solver.refuses(*present_problem(problem, control))

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Solve the presented problem; return the motion in the problem's own terms.

        With ``retrace`` the motion is then integrated back from its end with reversed velocities. The last state of
        that integration, with velocities reversed again, becomes ``returned``, and the costs of both add up. If the
        integration back fails, the motion only gets a note.
        """
        began = solver_seconds()
        there = self._solve_presented(problem, control)
        if not problem.retrace or there.status is not Status.SUCCESS:
            return there
        last = there.states[-1]
        turned = dataclasses.replace(problem, initial=State(last.r, last.R, -last.v, -last.Omega))
        left = None if control.cpu_limit is None else max(control.cpu_limit - (solver_seconds() - began), 1e-3)
        back = self._solve_presented(turned, dataclasses.replace(control, spool=None, cpu_limit=left))
        if back.status is not Status.SUCCESS:
            words = f"the way back ended with {back.status} at {back.t[-1]:.6g} s: {back.message}"
            return dataclasses.replace(there, notes=(*there.notes, words))
        end = back.states[-1]
        cost = {name: getattr(there, name) + getattr(back, name) for name in ("cpu_time", "setup_time")}
        return dataclasses.replace(there, returned=State(end.r, end.R, -end.v, -end.Omega), **cost)

    def _solve_presented(self, problem: Problem, control: StepControl) -> Trajectory:
        """Solve from the start to the end once, and return the motion in the problem's own terms."""
        return restore_trajectory(self.solver.solve(*present_problem(problem, control)), problem)


def restore_trajectory(found: Trajectory, problem: Problem) -> Trajectory:
    """Convert a motion ``found`` of the presented problem to the problem's own terms: its time, bodies, units and rows.

    A motion with a wrong number of bodies is returned as it is.
    """
    presentation, system = problem.presentation, problem.system
    if presentation == Presentation() or found.states.nb != system.nb:  # of a wrong size, which the caller reports
        return found
    return dataclasses.replace(
        found,
        t=np.asarray(found.t, dtype=float) / presentation.unit_time,
        states=presentation.restore_states(system, found.states),
        reaction=None if found.reaction is None else presentation.restore_reaction(system, np.asarray(found.reaction)),
    )


@dataclass
class _PresentedSpool:
    """A spool that passes on steps of a presented problem in the problem's own terms, as readers expect them."""

    spool: Spool
    problem: Problem

    @property
    def rows(self) -> int:
        """Number of steps taken so far."""
        return self.spool.rows

    def due(self) -> bool:
        """Return whether it is time to pass steps on."""
        return self.spool.due()

    def take(self, t: Float[np.ndarray, " nt"] | list[float], states: States) -> None:
        """Pass steps on to the spool, converted to the problem's own terms."""
        presentation = self.problem.presentation
        self.spool.take(
            np.asarray(t) / presentation.unit_time, presentation.restore_states(self.problem.system, states)
        )


def present_problem(problem: Problem, control: StepControl) -> tuple[Problem, StepControl]:
    """Return the problem and the step control as a solver gets them: mirrored, renumbered, in other units.

    A spool is wrapped so that it receives steps in the problem's own terms.
    """
    p = problem.presentation
    if p == Presentation():
        return problem, control
    changes: dict[str, Any] = {
        name: value * p.unit_time for name in ("dt", "max_step") if (value := getattr(control, name)) is not None
    }
    if control.spool is not None:
        changes["spool"] = _PresentedSpool(control.spool, problem)
    seen = dataclasses.replace(
        problem,
        system=p.system(problem.system),
        initial=p.state(problem.system, problem.initial),
        t_end=problem.t_end * p.unit_time,
        dt=problem.dt * p.unit_time,
        presentation=Presentation(),
        # these refer to the original bodies, and a solver does not use them
        observables=(),
        invariants=(),
        reference_from=None,
        planar_normal=None,
    )
    return seen, dataclasses.replace(control, **changes)
