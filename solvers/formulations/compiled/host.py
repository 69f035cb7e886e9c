"""From a problem to a trajectory: the kernel, a method, its march in stretches, limits, spooling."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from ....harness.catalogue.options import option
from ....harness.code_meter import Stopwatch, making_code, settle
from ....harness.types import Problem, States, Status, StepControl, Trajectory
from ..refusals import without_phi
from . import marching, mechanism
from .entries import Bound, reach
from .kernel import Kernel, empty_kernel, finish_kernel, make_kernel, start_at
from .marching import March, Record, empty_record, march, new_control

FIRST_STEP = 1e-4  # [s] grown from, five-fold a step at most
ROUNDINGS = 16.0  # of the largest coordinate in a component of phi
EVALUATIONS_THAT_PAY = 300_000  # with the kernel, that cost as much as code of the mechanism takes to make
STRETCH_BYTES = 8e6  # of recorded steps between two looks at the clock


@dataclass(frozen=True)
class Method:
    """A method as the march needs it: bundles and functions of one step."""

    prepare: Callable[[Kernel, np.ndarray], Any]  # the bundle of a step, with the control and the kernel in it
    step: Callable[[Any], None]
    finish: Callable[[Any], None]
    start: Callable[[Any], None] | None = None  # from the initial state; without: ``accelerate`` of the kernel
    order: float = 0.0  # of the error estimate in h; 0: fixed steps
    rate: float = 0.0  # [rad/s] of reversible step control; 0: none
    counters: tuple[str, ...] = ("rejected",)  # fields of the control
    needs: tuple[str, ...] = ()  # entries of the kernel beside those that these functions name
    notes: tuple[str, ...] = field(default=())
    most_cuts: int = 0  # halvings of a fixed step that fails
    tells: tuple[str, ...] = ()  # diagnostics of each step: what ``told`` of its bundle holds
    explain: Callable[[Any, int], str] | None = None  # words for an outcome of the march
    relieve: Callable[[Problem, Any], Any] | None = None  # another marcher that takes turns with this method's
    code: str = "kernel"  # or "mechanism", or "auto": whose entries the kernel has


UNTOLD = np.zeros(0)


def tolerance_of(asked: float, problem: Problem) -> tuple[float, tuple[str, ...]]:
    """``asked`` [m] of phi, or the roundings of phi where a system so large or so far away has more: noted then."""
    system = problem.system
    largest = max(np.max(np.abs(a), initial=0.0) for a in (problem.initial.r, system.joint_s_i, system.joint_s_j))
    rounding = ROUNDINGS * float(np.finfo(float).eps) * float(largest)
    if rounding <= asked:
        return asked, ()
    words = f"tolerance {rounding:.2g} instead of {asked:g}: {ROUNDINGS:g} roundings of the largest coordinate"
    return rounding, (words,)


def run_plainly(
    integrate: Callable[..., Trajectory], problem: Problem, control: StepControl, asked: float, **more: Any
) -> Trajectory:
    """A run of ``solvers/plain`` with the tolerance of the compiled method, noted where it is not the one asked for."""
    tolerance, notes = tolerance_of(asked, problem)
    out = integrate(problem, control, tolerance, **more)
    return replace(out, notes=(*out.notes, *notes))


def refuse_unused(solver: Any, *names: str) -> str | None:
    """Why a solver with plain code is refused whose options ``names``, which that does not read, were given."""
    defaults = {f.name: f.default for f in fields(solver)}
    given = [name for name in names if getattr(solver, name) != defaults[name]]
    return f"plain steps do not read {', '.join(given)}: leave it out" if given and solver.code == "plain" else None


WITH_PLAIN = ("kernel", "mechanism", "auto", "plain")


def code_option(*choices: str) -> Any:
    """The option ``code`` of a solver."""
    words = {
        "kernel": "the kernel's loops", "mechanism": "straight code made for the mechanism",
        "auto": "the kernel until making such code pays (at once where it is kept on disk)",
        "plain": "none: plain NumPy, as the source prints it (solvers/plain), thousands of times slower",
    }  # fmt: skip
    chosen = choices or ("kernel", "mechanism", "auto")
    return option(
        "kernel", f"machine code of rows, factors and projections: {', or '.join(words[c] for c in chosen)}",
        choices=chosen,
    )  # fmt: skip


class Marched:
    """A solver whose method marches here. Redundant rows are dropped as they appear."""

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    code: str = "kernel"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Mechanisms of which no code is made, where it is asked for."""
        return mechanism.refusal(problem.system, empty_kernel(problem.system)) if self.code == "mechanism" else None

    def _method(self, problem: Problem, control: StepControl) -> Method:
        raise NotImplementedError

    def _plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """March by the method of ``solvers/plain``, where ``code`` may be plain."""
        raise NotImplementedError

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """March to the end, with the fixed step ``control.dt`` or error control at ``control.rtol``."""
        if self.code == "plain":
            return self._plain(problem, control)
        return integrate(problem, control, self._method(problem, control))


class ClosedMarch(Marched):
    """One that solves for phi = 0 at the ends of steps."""

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Rows without phi, and mechanisms of which no code is made, where it is asked for."""
        return without_phi(problem.system) or super().refuses(problem, control)


class Marcher:
    """A method at work: its kernel, and bundles of its step and of its march, at the start of a problem."""

    def __init__(self, problem: Problem, method: Method, state: np.ndarray) -> None:
        functions = [method.step, method.finish, *([method.start] if method.start else [])]
        needed = {*([] if method.start else ["accelerate"]), *method.needs}.union(
            *(reach(function).names for function in functions)
        )
        self.method, self.state, self._system = method, state, problem.system
        self.notes, self._may_change = list[str](), False
        self._needed = frozenset(needed)
        kernel = self._choose_kernel(self._needed)
        start_at(kernel, problem.initial)
        self.bundle = method.prepare(kernel, state)
        self._bind(kernel)
        self._told = self.bundle.told if method.tells else UNTOLD
        self.start = Bound(method.start, self.bundle) if method.start else self.kernel.accelerate.run
        self.start()
        self.reaction = self.kernel.lam[self.kernel.order][None]
        self.stretch(0)  # compiles, or loads

    def _choose_kernel(self, needed: frozenset[str]) -> Kernel:
        if self.method.code == "kernel":
            return make_kernel(self._system, needed)
        empty = empty_kernel(self._system)
        if self.method.code == "mechanism":
            return self._use_code(empty)
        reason = mechanism.refusal(self._system, empty)
        if reason is None and mechanism.is_made(self._system, empty, needed):
            try:
                return self._use_code(empty)
            except mechanism.NoCode as error:
                reason = str(error)
        self._may_change = reason is None
        self.notes.append(f"code of the kernel{f' ({_cause(reason)})' if reason else ''}")
        return finish_kernel(self._system, empty, needed)

    def _use_code(self, kernel: Kernel) -> Kernel:
        made = mechanism.use_code(self._system, kernel, self._needed)
        since = f" from t = {self.state['t']:g} s on" if self._may_change else ""
        self.notes.append(f"code of the mechanism{since}: {made.operations} operations an evaluation")
        return made.kernel

    def _bind(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self._entries = Bound(self.method.step, self.bundle), Bound(self.method.finish, self.bundle)

    @making_code
    def _change_code(self) -> None:
        """From the kernel to code of the mechanism, where a run is so long that it pays."""
        try:
            kernel = self._use_code(self.kernel)
            for entry in ("rows", "factorise"):  # a method may have left them for the next step
                if entry in self._needed:
                    getattr(kernel, entry).run()
            self.bundle = self.bundle._replace(kernel=kernel)
            self._bind(kernel)
        except mechanism.NoCode as error:
            self.notes[-1] += f" ({_cause(str(error))})"
        self._may_change = False

    @property
    def _evaluations(self) -> int:
        """As far as a method counts them: its factors and iterations, each with rows and a solution."""
        c = self.state
        return max(int(c["evaluations"]), int(c["factorisations"]) + int(c["iterations"]))

    def stretch(self, n: int) -> Record:
        """Up to ``n`` steps from where it stands; ``state`` says why it has ended."""
        if self._may_change and self._evaluations > EVALUATIONS_THAT_PAY:
            self._change_code()
        record = empty_record(n, len(self.kernel.mass), len(self.kernel.lam), len(self._told))
        Bound(march, March(self.state, self.kernel, record, self._told, *(e.entry for e in self._entries)))()
        return Record(*(a[: self.state["recorded"]] for a in record))

    def explain(self, outcome: int) -> str:
        """Why the march has ended."""
        return self.method.explain(self.bundle, outcome) if self.method.explain else ENDS[outcome][1]


def integrate(problem: Problem, control: StepControl, method: Method) -> Trajectory:
    """March to the end or to a failure, which is a status."""
    watch = Stopwatch()
    state = new_control(
        t_end=problem.t_end, adaptive=method.order > 0.0, order=method.order, rate=method.rate, last_error=1e-4,
        rtol=control.rtol or 0.0, max_step=control.max_step or np.inf, dt=control.dt or 0.0,
        next_step=min(FIRST_STEP, problem.t_end), most_cuts=method.most_cuts,
    )  # fmt: skip
    try:
        marcher = Marcher(problem, method, state)
    except mechanism.NoCode as error:
        from ..recording import no_trajectory

        return no_trajectory(problem, Status.REFUSED, str(error))
    if method.relieve:
        return _march(problem, control, method, method.relieve(problem, marcher), watch)
    out = _march(problem, control, method, marcher, watch)
    return replace(out, notes=(*out.notes, *marcher.notes))


def _march(problem: Problem, control: StepControl, method: Method, marcher: Any, watch: Stopwatch) -> Trajectory:
    """March; ``watch`` runs since the call began. Code that is made on the way is set-up."""
    system, state, order = problem.system, marcher.state, marcher.kernel.order
    room = int(max(16, min(5000, STRETCH_BYTES / (8 * (1 + 18 * system.nb + system.nrows)))))
    settle()
    set_up = watch.solver
    done: list[Record] = []
    taken, status, message = 0, Status.SUCCESS, ""
    while True:
        record = marcher.stretch(min(room, control.max_steps - taken))
        done.append(record)
        taken += len(record.t)
        if control.spool is not None and len(record.t):
            control.spool.take(record.t, _states(record))
        outcome, t = int(state["outcome"]), float(state["t"])
        if outcome == marching.FINISHED:
            break
        if outcome != marching.FULL:
            status, message = ENDS[outcome][0], f"{marcher.explain(outcome)} at t = {t:g} s"
            break
        limit = None
        if taken >= control.max_steps:
            limit = f"max_steps = {control.max_steps}"
        elif control.cpu_limit is not None and watch.solver > control.cpu_limit:
            limit = f"CPU limit of {control.cpu_limit:g} s"
        if limit:
            status, message = Status.STALLED, f"{limit} reached at t = {t:g} s"
            break
    cpu, set_up = watch.solver - set_up, set_up + watch.code
    whole = Record(*(np.concatenate(a) for a in zip(*done, strict=True)))
    first, moved = problem.initial, _states(whole)
    reaction = np.concatenate((marcher.reaction, whole.lam[:, order]))
    return Trajectory(
        t=np.concatenate(([0.0], whole.t)),
        states=States(*(np.concatenate((getattr(first, n)[None], getattr(moved, n))) for n in NAMES)),
        status=status, message=message, notes=method.notes,
        counters={"steps": taken, **{WORDS.get(name, name): int(state[name]) for name in method.counters}},
        reaction=reaction, cpu_time=cpu, setup_time=set_up,
        diagnostics={n: np.concatenate(([np.nan], a)) for n, a in zip(method.tells, whole.told.T, strict=True)},
    )  # fmt: skip


def _cause(refusal: str) -> str:
    """What stands in the way, without the advice to use the kernel, which is done."""
    return refusal.split(": use")[0]


NAMES = ("r", "R", "v", "Omega")
WORDS = {"iterations": "newton_iterations", "cuts": "step_cuts"}  # of counters in results, where they differ
ENDS = {
    marching.UNDERFLOW: (Status.STEP_UNDERFLOW, "the error test asks for a step below the spacing of times"),
    marching.NOT_FINITE: (Status.DIVERGED, "the motion is no longer finite"),
    marching.STUCK: (Status.STEP_UNDERFLOW, "the iteration of a step does not converge with this step"),
    marching.TURNED: (
        Status.STEP_UNDERFLOW,
        "a body turns by more than half a turn in this step, or would: take a shorter one",
    ),
}


def _states(record: Record) -> States:
    return States(record.r, record.R, record.v[:, :, :3], record.v[:, :, 3:])
