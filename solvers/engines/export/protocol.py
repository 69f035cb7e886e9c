"""Engines behind plain data: a file of ``inside`` runs here, or in an environment and a process of its own.

``inside/NAME.py`` imports numpy and its engine alone. Its ``Model(data)`` raises ValueError with the reason where the
engine cannot take the model, and has::

    notes                what was modelled how, and the engine's version: sentences
    at_start()           fields of ``EngineModel`` by name, or without a mass matrix u_dot as ``rates`` and at rest as
                         ``rest_rates``, both without constraints; T, bias and constraints are the tree's where left out
    advance(steps, dt)   rows (q, u), coordinates and velocities of the tree, after each of the next steps;
                         with error control (dt = 0) rows (t, q, u) of at most so many accepted steps, up to t_end
    rows(a)              left out, or what makes such rows of those that ``advance`` returns; its time does not count
    stopped              why ``advance`` returned fewer rows, or ""

``data`` is that of module ``plain`` with ``options`` (fields of the adapter), ``dt`` or ``rtol``, and ``t_end``.
"""

import importlib
import json
from dataclasses import asdict, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from ....harness.code_meter import making_code
from ....harness.types import Problem, States, Status, StepControl, Trajectory
from ...formulations.packages import ENGINES, missing
from ...formulations.recording import Clock, Clocked, StepFailure
from ..inside.serve import step
from .engine import Taken, beyond
from .march import STRETCH, PartialStretch, march
from .model_check import EngineModel, check_states, force_refusal, mass_blocks, model_refusal
from .plain import plain
from .process import environment_of, process_of, seconds_of_processes
from .tree import spanning_tree


class Adapter(Clocked):
    """An engine of ``inside``; a dataclass of its options derives from this."""

    own_angles: ClassVar[bool] = True  # it counts the turns of its hinges
    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    inside: ClassVar[str]  # name of its file in ``inside`` and of its environment
    package: ClassVar[str]  # to import here where it has no environment
    wheel: ClassVar[str]
    remedy: ClassVar[str] = ENGINES
    takes: ClassVar[Taken] = Taken()
    eps: ClassVar[float] = 0.0  # of its numbers, where they are of single precision
    moving: ClassVar[bool] = False  # whether the model check asks for random velocities, too
    stretch: ClassVar[int] = STRETCH

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Why the engine cannot take the problem, or None."""
        absent = None if environment_of(self.inside) else missing(self.package, self.wheel, self.remedy)
        if (reason := absent or beyond(problem.system, self.takes) or self._cannot(problem, control)) is not None:
            return reason
        try:
            return self.differing(problem, control)
        except (ValueError, StepFailure) as error:
            return f"{self.name} does not take the model: {error}"

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate from the start to ``t_end``; set-up in the engine's process is set-up, too."""
        before = seconds_of_processes()
        found = super().solve(problem, control)
        spent = seconds_of_processes() - before
        return replace(found, setup_time=found.setup_time + max(spent - found.cpu_time, 0.0)) if spent else found

    def build(self, problem: Problem, control: StepControl) -> "Model":
        """The engine's model."""
        return Model(self, problem, control)

    def differing(self, problem: Problem, control: StepControl) -> str | None:
        """How the engine's model differs from ours, or None."""
        for _, state in check_states(problem) if self.moving else [("", problem.initial)]:
            posed = replace(problem, initial=state)
            model = self.build(posed, control)
            theirs, tree = model.at_start(), model.tree
            found = (force_refusal(self.name, posed, theirs, tree.loop_jacobian(), tree.levels, self.eps) if self.eps
                     else model_refusal(self.name, posed, theirs))  # fmt: skip
            if found is not None:
                return found
        return None

    def _cannot(self, problem: Problem, control: StepControl) -> str | None:
        """Why the options do not go with the problem, or None."""
        return None

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        model = self.build(problem, control)
        model.clock = clock
        return march(problem, control, model.advance, model.states, clock=clock, notes=model.notes(),
                     stretch=self.stretch, seconds=model.seconds)  # fmt: skip


class Model:
    """An engine's model by the protocol, and its state at the last step made."""

    def __init__(self, adapter: Any, problem: Problem, control: StepControl) -> None:
        self.problem, self.tree = problem, spanning_tree(problem.system, problem.initial)
        self.clock: Clock | None = None
        data = {**plain(self.tree, problem.system, problem.initial), "options": asdict(adapter), "dt": control.dt,
                "rtol": control.rtol, "t_end": problem.t_end}  # fmt: skip
        data = json.loads(json.dumps(data, default=lambda a: a.tolist()))
        python = environment_of(adapter.inside)
        with making_code:  # imports of the engine, and the kernels that its first step compiles
            self._made = (
                _Here(adapter.inside, data) if python is None else _There(process_of(adapter.inside, python), data)
            )

    def seconds(self) -> float:
        """CPU time [s] of stepping."""
        return self._made.stepping

    def advance(self, steps: int, dt: float) -> Float[np.ndarray, "k n"]:
        """Rows of the next steps."""
        before = self._made.stepping
        rows, stopped = self._made.advance(steps, dt)
        if self._made.apart and self.clock is not None:
            self.clock.whole.solver_began -= self._made.stepping - before  # the limit is on both processes
        if stopped:
            raise PartialStretch(Status.DIVERGED, stopped, rows)
        return rows

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """States of the bodies from rows (q, u)."""
        nq = len(self.tree.start)
        return self.tree.states(rows[:, :nq], rows[:, nq:])

    def at_start(self) -> EngineModel:
        """For the model check."""
        nu = len(self.tree.start_velocity)
        with making_code:  # it compiles other kernels than steps do
            answer = self._made.at_start()
        found = {name: np.array(a, dtype=float) if isinstance(a, list | np.ndarray) else a
                 for name, a in answer.items()}  # fmt: skip
        found["constraints"] = found.get("constraints", self.tree.loop_jacobian()).reshape(-1, nu)
        if "rates" in found:  # instead of forces
            T, u = self.tree.jacobian(), self.tree.start_velocity
            M = T.T @ mass_blocks(self.problem) @ T
            found = {"mass_matrix": M, "kinetic": 0.5 * float(u @ M @ u), "potential": None, **found}
            found |= {"forces": M @ found.pop("rates"), "rest_forces": M @ found.pop("rest_rates")}
        given: dict[str, Any] = {"T": self.tree.jacobian(), "bias": self.tree.bias(self.problem.initial), **found}
        return EngineModel(**given)

    def notes(self) -> tuple[str, ...]:
        """Notes on how joints and forces were modelled."""
        cuts = f"; {len(self.tree.cuts)} points of cut joints" if self.tree.cuts else ""
        return (
            f"{len(self.tree.limbs)} bodies as a tree of {len(self.tree.start_velocity)} velocities{cuts}",
            *self._made.notes,
        )


class _Here:
    """In this process."""

    apart, stepping = False, 0.0

    def __init__(self, inside: str, data: dict[str, Any]) -> None:
        module = importlib.import_module(f"..inside.{inside}", __package__)
        self._model = module.Model(data)
        self.notes = tuple(self._model.notes)

    def at_start(self) -> dict[str, Any]:
        return dict(self._model.at_start())

    def advance(self, steps: int, dt: float) -> tuple[np.ndarray, str]:
        rows, spent = step(self._model, steps, dt)
        self.stepping += spent
        return rows, self._model.stopped


class _There:
    """In the process of its engine."""

    apart = True

    def __init__(self, process: Any, data: dict[str, Any]) -> None:
        self._process = process
        found = process.ask("build", data=data)[0]
        self._number, self.notes = found["model"], (*found["notes"], "in a process of its own")

    @property
    def stepping(self) -> float:
        """CPU time [s] of stepping in that process."""
        return float(self._process.stepping)

    def at_start(self) -> dict[str, Any]:
        return dict(self._process.ask("at_start", model=self._number)[0])

    def advance(self, steps: int, dt: float) -> tuple[np.ndarray, str]:
        found, rows = self._process.ask("advance", model=self._number, steps=steps, dt=dt)
        return rows, found["stopped"]
