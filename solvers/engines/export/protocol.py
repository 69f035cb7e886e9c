"""Adapters of engines that build their model from plain data, in this process or in a separate one.

``inside/NAME.py`` imports numpy, its engine and files beside it alone. Its class ``Model(data)`` raises ValueError with
the reason where the engine cannot build the model, and has::

    notes                how the system was modelled, and the engine's version: sentences
    describe_start()     fields of ``EngineModel`` by name; instead of forces, u_dot as ``rates`` and at rest as
                         ``rest_rates``, both without constraints, may be given. T, bias and constraints are the tree's
                         where left out, with ``rates`` also mass matrix and kinetic energy
    advance(steps, dt)   rows (q, u), coordinates and velocities of the tree, after each of the next steps;
                         with error control (dt = 0) rows (t, q, u) of accepted steps, up to t_end
    rows(a)              optional: converts the result of ``advance`` to such rows; its time is not counted
    stopped              why ``advance`` returned fewer rows, or ""

``data`` is that of module ``plain`` with ``options`` (fields of the adapter), ``dt`` or ``rtol``, and ``t_end``.
"""

import importlib
import json
from dataclasses import asdict, replace
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Float

from ....harness.base.code_meter import making_code
from ....harness.mechanics.cut_trees.plain import flatten_tree
from ....harness.mechanics.cut_trees.tree import build_spanning_tree
from ....harness.mechanics.types import Problem, States, Status, StepControl, Trajectory
from ...formulations.packages import ENGINES, find_remedy
from ...formulations.recording import Clock, ClockedSolver, StepFailure
from ..inside.serve import step
from .engine import SupportedElements, refuse_unsupported
from .march import STRETCH, PartialStretch, march
from .model_check import EngineModel, list_check_states, make_mass_blocks, refuse_forces, refuse_model
from .process import find_environment, get_process, sum_process_seconds


class Adapter(ClockedSolver):
    """Base class of solvers that run an engine of ``inside``; a subclass is a dataclass of its options."""

    own_angles: ClassVar[bool] = True  # the engine counts the turns of its hinges
    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    inside: ClassVar[str]  # name of its file in ``inside`` and of its environment
    package: ClassVar[str]  # module to import in this process where the engine has no environment
    wheel: ClassVar[str]
    remedy: ClassVar[str] = ENGINES
    takes: ClassVar[SupportedElements] = SupportedElements()
    eps: ClassVar[float] = 0.0  # precision of its numbers, where they are single
    checks_random_velocities: ClassVar[bool] = False  # whether the model check asks for random velocities, too
    stretch: ClassVar[int] = STRETCH

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the engine cannot integrate the problem, or None.

        Causes: the engine is missing, elements that it does not have, unsuitable options, or a model that differs from
        this project's equations.
        """
        absent = None if find_environment(self.inside) else find_remedy(self.package, self.wheel, self.remedy)
        if (
            reason := absent or refuse_unsupported(problem.system, self.takes) or self._refuse_options(problem, control)
        ) is not None:
            return reason
        try:
            return self.compare_model(problem, control)
        except (ValueError, StepFailure) as error:
            return f"{self.name} does not take the model: {error}"

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate from the start to ``t_end`` and return the trajectory.

        CPU time of the engine's process that is not spent on steps is added to the set-up time of the run.
        """
        before = sum_process_seconds()
        found = super().solve(problem, control)
        spent = sum_process_seconds() - before
        return replace(found, setup_time=found.setup_time + max(spent - found.cpu_time, 0.0)) if spent else found

    def build(self, problem: Problem, control: StepControl) -> "Model":
        """Build the engine's model of the problem, in this process or in the engine's, and return it."""
        return Model(self, problem, control)

    def compare_model(self, problem: Problem, control: StepControl) -> str | None:
        """Return the refusal of an engine's model that differs from this project's equations, or None if they agree.

        It is compared at the start, and with ``checks_random_velocities`` at two random velocities; in single precision
        by forces, else by all quantities.
        """
        for _, state in list_check_states(problem) if self.checks_random_velocities else [("", problem.initial)]:
            posed = replace(problem, initial=state)
            model = self.build(posed, control)
            theirs, tree = model.describe_start(), model.tree
            found = (
                refuse_forces(self.name, posed, theirs, tree.loop_jacobian(), tree.levels, self.eps)
                if self.eps
                else refuse_model(self.name, posed, theirs)
            )
            if found is not None:
                return found
        return None

    def _refuse_options(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the adapter's options do not suit the problem, or None; adapters override it."""
        return None

    def _integrate(self, problem: Problem, control: StepControl, clock: Clock) -> Trajectory:
        """Build the engine's model, integrate to ``t_end``, a limit or a failure, and return the trajectory."""
        model = self.build(problem, control)
        model.clock = clock
        return march(
            problem,
            control,
            model.advance,
            model.states,
            clock=clock,
            notes=model.notes(),
            stretch=self.stretch,
            seconds=model.read_seconds,
        )


class Model:
    """An engine's model behind the protocol, in its state after the last step."""

    def __init__(self, adapter: Any, problem: Problem, control: StepControl) -> None:
        """Build the model of the engine, in this process or its own; the CPU time counts as making code."""
        self.problem, self.tree = problem, build_spanning_tree(problem.system, problem.initial)
        self.clock: Clock | None = None
        data = {
            **flatten_tree(self.tree, problem.system, problem.initial),
            "options": asdict(adapter),
            "dt": control.dt,
            "rtol": control.rtol,
            "t_end": problem.t_end,
        }
        data = json.loads(json.dumps(data, default=lambda a: a.tolist()))
        python = find_environment(adapter.inside)
        with making_code:  # imports of the engine, and the kernels that its first step compiles
            self._backend = (
                _LocalModel(adapter.inside, data)
                if python is None
                else _RemoteModel(get_process(adapter.inside, python), data)
            )

    def read_seconds(self) -> float:
        """Return the CPU time [s] that the engine has spent on steps so far."""
        return self._backend.stepping

    def advance(self, steps: int, dt: float) -> Float[np.ndarray, "k n"]:
        """Advance by ``steps`` steps of ``dt`` [s]; return the engine's row of coordinates and velocities after each.

        CPU time of a separate process is charged to ``clock``. Raises ``PartialStretch``, with the rows before, where
        the engine stops.
        """
        before = self._backend.stepping
        rows, stopped = self._backend.advance(steps, dt)
        if self._backend.is_remote and self.clock is not None:
            self.clock.whole.solver_began -= self._backend.stepping - before  # the limit is on both processes
        if stopped:
            raise PartialStretch(Status.DIVERGED, stopped, rows)
        return rows

    def states(self, rows: Float[np.ndarray, "k n"]) -> States:
        """Convert rows (q, u) of the tree to poses and velocities of the bodies."""
        nq = len(self.tree.start)
        return self.tree.states(rows[:, :nq], rows[:, nq:])

    def describe_start(self) -> EngineModel:
        """Return the engine's model at the start for the model check; what it does not state is taken from the tree.

        If it states accelerations, forces are M times these, with this project's M unless it states its own.
        """
        nu = len(self.tree.start_velocity)
        with making_code:  # the check compiles other kernels than steps do
            answer = self._backend.describe_start()
        found = {
            name: np.array(a, dtype=float) if isinstance(a, list | np.ndarray) else a for name, a in answer.items()
        }
        found["constraints"] = found.get("constraints", self.tree.loop_jacobian()).reshape(-1, nu)
        if "rates" in found:  # accelerations given instead of forces
            T, u = self.tree.jacobian(), self.tree.start_velocity
            M = T.T @ make_mass_blocks(self.problem) @ T
            found = {"mass_matrix": M, "kinetic": 0.5 * float(u @ M @ u), "potential": None, **found}
            found |= {"forces": M @ found.pop("rates"), "rest_forces": M @ found.pop("rest_rates")}
        given: dict[str, Any] = {"T": self.tree.jacobian(), "bias": self.tree.bias(self.problem.initial), **found}
        return EngineModel(**given)

    def notes(self) -> tuple[str, ...]:
        """Return notes for the run: the tree and its cut joints, then the engine's own."""
        cuts = f"; {len(self.tree.cuts)} points of cut joints" if self.tree.cuts else ""
        return (
            f"{len(self.tree.limbs)} bodies as a tree of {len(self.tree.start_velocity)} velocities{cuts}",
            *self._backend.notes,
        )


class _LocalModel:
    """An engine's model in this process."""

    is_remote, stepping = False, 0.0

    def __init__(self, inside: str, data: dict[str, Any]) -> None:
        module = importlib.import_module(f"..inside.{inside}", __package__)
        self._model = module.Model(data)
        self.notes = tuple(self._model.notes)

    def describe_start(self) -> dict[str, Any]:
        """Return the fields of ``EngineModel`` that the engine states, by name."""
        return dict(self._model.describe_start())

    def advance(self, steps: int, dt: float) -> tuple[np.ndarray, str]:
        """Advance by ``steps`` steps of ``dt`` [s]; return a row after each, and why the engine stopped, or ""."""
        rows, spent = step(self._model, steps, dt)
        self.stepping += spent
        return rows, self._model.stopped


class _RemoteModel:
    """An engine's model in the engine's process."""

    is_remote = True

    def __init__(self, process: Any, data: dict[str, Any]) -> None:
        self._process = process
        found = process.request_answer("build", data=data)[0]
        self._number, self.notes = found["model"], (*found["notes"], "in a process of its own")

    @property
    def stepping(self) -> float:
        """CPU time [s] of steps in that process, of all its models."""
        return float(self._process.stepping)

    def describe_start(self) -> dict[str, Any]:
        """Return the fields of ``EngineModel`` that the engine states, by name."""
        return dict(self._process.request_answer("at_start", model=self._number)[0])

    def advance(self, steps: int, dt: float) -> tuple[np.ndarray, str]:
        """Advance by ``steps`` steps of ``dt`` [s]; return a row after each, and why the engine stopped, or ""."""
        found, rows = self._process.request_answer("advance", model=self._number, steps=steps, dt=dt)
        return rows, found["stopped"]
