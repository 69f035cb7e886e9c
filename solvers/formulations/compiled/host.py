"""Integration by compiled methods: the kernel, a method, its march in batches of steps, limits, and the trajectory."""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import numpy as np

from ....harness.base.code_meter import Stopwatch, collect_garbage, making_code
from ....harness.catalogue.options import option
from ....harness.mechanics.types import Problem, States, Status, StepControl, Trajectory
from ..refusals import refuse_without_phi
from . import marching, mechanism
from .entries import PYTHON, BoundFunction, digest_callees, is_interpreted
from .kernel import Kernel, allocate_kernel, finish_kernel, forget_choice, make_kernel, set_state
from .marching import March, Record, allocate_record, make_control, march
from .row_choice import IN_USE

# [s] first step, which grows five-fold a step at most. Half takes up to one step more in ten runs of rkmk_dopri5, twice
# up to two less, of 17 to 500.
FIRST_STEP = 1e-4
ROUNDINGS = 16.0  # roundings of the largest coordinate in a component of phi
EVALUATIONS_THAT_PAY = 300_000  # kernel evaluations that cost as much as making code of the mechanism
# bytes of steps between two readings of the clock: more overrun limits, fewer leave compiled code more often
STRETCH_BYTES = 8e6


@dataclass(frozen=True)
class Method:
    """The functions and settings of a method that the march needs, and the function that makes its step's bundle."""

    # makes the bundle of a step, which contains the control and the kernel
    prepare: Callable[[Kernel, np.ndarray], Any]
    step: Callable[[Any], None]
    finish: Callable[[Any], None]
    start: Callable[[Any], None] | None = None  # called at the initial state; if None, ``accelerate`` of the kernel is
    order: float = 0.0  # order of the error estimate in h; 0: fixed steps
    rate: float = 0.0  # [rad/s] scale of reversible step control; 0: none
    counters: tuple[str, ...] = ("rejected",)  # counters: fields of the control
    needs: tuple[str, ...] = ()  # entries of the kernel beside those that these functions name
    notes: tuple[str, ...] = field(default=())
    most_cuts: int = 0  # halvings of a fixed step that fails
    diagnostic_names: tuple[
        str, ...
    ] = ()  # names of each step's diagnostics, which are in ``diagnostics`` of its bundle
    explain: Callable[[Any, int], str] | None = None  # words for an outcome of the march
    make_fallback: Callable[[Problem, Any], Any] | None = (
        None  # makes another marcher that alternates with this method's
    )
    code: str = "kernel"  # "kernel", "mechanism" or "auto": the code behind the kernel's entries


NO_DIAGNOSTICS = np.zeros(0)


def choose_tolerance(asked: float, problem: Problem) -> tuple[float, tuple[str, ...]]:
    """Return the tolerance for phi, ``asked`` [m] or, where that is larger, the rounding of phi; and a note if so."""
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
    """Integrate by a method of ``solvers/plain``, with the tolerance that its compiled form takes for ``asked`` [m].

    A note is added to the trajectory if that differs from ``asked``. ``more`` are further arguments of ``integrate``.
    """
    tolerance, notes = choose_tolerance(asked, problem)
    out = integrate(problem, control, tolerance, **more)
    return replace(out, notes=(*out.notes, *notes))


def refuse_unused(solver: Any, *names: str) -> str | None:
    """Return the refusal of a solver with code=plain whose options ``names`` are not at their defaults, or None.

    Plain code ignores these options. A solver with other code is never refused.
    """
    defaults = {f.name: f.default for f in fields(solver)}
    changed = [name for name in names if getattr(solver, name) != defaults[name]]
    return f"plain steps do not read {', '.join(changed)}: leave it out" if changed and solver.code == "plain" else None


WITH_PLAIN = ("kernel", "mechanism", "auto", "plain")


def code_option(*choices: str) -> Any:
    """Return the option ``code`` of a solver, with default "kernel" and these choices: by default all but "plain"."""
    words = {
        "kernel": "the kernel's loops",
        "mechanism": "straight code made for the mechanism",
        "auto": "the kernel until making such code pays (at once where it is kept on disk)",
        "plain": "none: plain NumPy, as the source prints it (solvers/plain), thousands of times slower",
    }
    chosen = choices or ("kernel", "mechanism", "auto")
    return option(
        "kernel",
        f"machine code of rows, factors and projections: {', or '.join(words[c] for c in chosen)}",
        choices=chosen,
    )


class MarchedSolver:
    """A solver whose method is marched by ``integrate``. Redundant rows are dropped as they appear."""

    name: ClassVar[str]
    paper_label: ClassVar[str] = ""
    control: ClassVar[str] = "dt"
    code: str = "kernel"

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why code of the mechanism cannot be made, if the option requires it, or None."""
        return (
            mechanism.find_code_refusal(problem.system, allocate_kernel(problem.system))
            if self.code == "mechanism"
            else None
        )

    def _make_method(self, problem: Problem, control: StepControl) -> Method:
        """Return the method to march, with the solver's options; each solver defines its own."""
        raise NotImplementedError

    def _integrate_plain(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate by the method of ``solvers/plain``, for solvers whose ``code`` may be "plain"."""
        raise NotImplementedError

    def solve(self, problem: Problem, control: StepControl) -> Trajectory:
        """Integrate to the end of the problem, and return the trajectory.

        The step is fixed at ``control.dt``, or controlled by the error at ``control.rtol``, as the method requires.
        """
        if self.code == "plain":
            return self._integrate_plain(problem, control)
        return integrate(problem, control, self._make_method(problem, control))


class HolonomicMarchedSolver(MarchedSolver):
    """A marched solver that solves phi = 0 at the ends of steps, and thus needs phi in every row."""

    def refuses(self, problem: Problem, control: StepControl) -> str | None:
        """Return why the problem is refused, or None.

        Reasons: rows without phi, or no code of the mechanism where it is required.
        """
        return refuse_without_phi(problem.system) or super().refuses(problem, control)


class Marcher:
    """A method in progress: its kernel, and the bundles of its step and march, at first at the start of a problem."""

    def __init__(self, problem: Problem, method: Method, state: np.ndarray) -> None:
        """Prepare the march from the start of ``problem``, and compile or load its code; no step is taken.

        ``state`` is the record of ``make_control``, which the march shares.
        """
        functions = [method.step, method.finish, *([method.start] if method.start else [])]
        needed = {*([] if method.start else ["accelerate"]), *method.needs}.union(
            *(digest_callees(function).names for function in functions)
        )
        self.method, self.state, self._system = method, state, problem.system
        self.notes, self._may_change = list[str](), False
        self._needed = frozenset(needed)
        kernel = self._choose_kernel(self._needed)
        set_state(kernel, problem.initial)
        self.bundle = method.prepare(kernel, state)
        self._bind_entries(kernel)
        self._diagnostics = self.bundle.diagnostics if method.diagnostic_names else NO_DIAGNOSTICS
        self.start = BoundFunction(method.start, self.bundle) if method.start else self.kernel.accelerate.run
        self.start()
        self.reaction = self.kernel.lam[self.kernel.order][None]
        self.stretch(0)  # compiles or loads the code

    def _choose_kernel(self, needed: frozenset[str]) -> Kernel:
        """Return the kernel with the ``needed`` entries, by loops or by code of the mechanism as the option says.

        "auto" takes code that is kept on disk, else the loops, which may be replaced later. A note is stored that says
        which, but for option "kernel".
        """
        if self.method.code == "kernel":
            return make_kernel(self._system, needed)
        empty = allocate_kernel(self._system)
        if self.method.code == "mechanism":
            return self._use_code(empty)
        reason = mechanism.find_code_refusal(self._system, empty)
        if reason is None and mechanism.is_code_kept(self._system, empty, needed):
            try:
                return self._use_code(empty)
            except mechanism.NoMechanismCode as error:
                reason = str(error)
        self._may_change = reason is None
        self.notes.append(f"code of the kernel{f' ({_strip_advice(reason)})' if reason else ''}")
        return finish_kernel(self._system, empty, needed)

    def _use_code(self, kernel: Kernel) -> Kernel:
        """Return the kernel with entries of code made for the mechanism, and store a note on its size and first time.

        Raises ``NoMechanismCode`` where none can be made.
        """
        made = mechanism.use_code(self._system, kernel, self._needed)
        since = f" from t = {self.state['t']:g} s on" if self._may_change else ""
        self.notes.append(f"code of the mechanism{since}: {made.operations} operations an evaluation")
        return made.kernel

    def _bind_entries(self, kernel: Kernel) -> None:
        """Set the present kernel, and compile or load the method's step and finish for the present bundle."""
        self.kernel = kernel
        self._entries = BoundFunction(self.method.step, self.bundle), BoundFunction(self.method.finish, self.bundle)

    @making_code
    def _change_code(self) -> None:
        """Change from the kernel's loops to code of the mechanism; if none can be made, note why and keep them."""
        try:
            kernel = self._use_code(self.kernel)
            forget_choice(kernel)  # pivots of this code are others
            for entry in ("rows", "factorise"):  # a method may use their results in the next step
                if entry in self._needed:
                    getattr(kernel, entry).run()
            self.bundle = self.bundle._replace(kernel=kernel)
            self._bind_entries(kernel)
        except mechanism.NoMechanismCode as error:
            self.notes[-1] += f" ({_strip_advice(str(error))})"
        self._may_change = False

    @property
    def _evaluations(self) -> int:
        """Number of evaluations of the kernel so far: as counted, or factorisations plus iterations if that is more."""
        c = self.state
        return max(int(c["evaluations"]), int(c["factorisations"]) + int(c["iterations"]))

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps from the present state; return the record of those accepted.

        ``state["outcome"]`` is set to the reason why the march ended. With option "auto" the code is changed first
        once so many evaluations were made that it pays.
        """
        pays = self._may_change and self._evaluations > EVALUATIONS_THAT_PAY
        if pays and self.kernel.state["chosen"] != IN_USE:
            self._change_code()
        record = allocate_record(n, len(self.kernel.mass), len(self.kernel.lam), len(self._diagnostics))
        BoundFunction(march, March(self.state, self.kernel, record, self._diagnostics, *self._entries))()
        return Record(*(a[: self.state["recorded"]] for a in record))

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march, the method's own or the general one."""
        return self.method.explain(self.bundle, outcome) if self.method.explain else ENDS[outcome][1]


def integrate(problem: Problem, control: StepControl, method: Method) -> Trajectory:
    """Integrate a problem by a method to the end, a limit or a failure, and return the trajectory with its status."""
    watch = Stopwatch()
    state = make_control(
        t_end=problem.t_end,
        adaptive=method.order > 0.0,
        order=method.order,
        rate=method.rate,
        last_error=1e-4,
        rtol=control.rtol or 0.0,
        max_step=control.max_step or np.inf,
        dt=control.dt or 0.0,
        next_step=min(FIRST_STEP, problem.t_end),
        most_cuts=method.most_cuts,
    )
    try:
        marcher = Marcher(problem, method, state)
    except mechanism.NoMechanismCode as error:
        from ..recording import no_trajectory

        return no_trajectory(problem, Status.REFUSED, str(error))
    whole = method.make_fallback(problem, marcher) if method.make_fallback else marcher
    out = _march(problem, control, method, whole, watch)
    own = () if method.make_fallback else marcher.notes
    return replace(out, notes=(*out.notes, *own, *list_interpreter_notes()))


def list_interpreter_notes() -> tuple[str, ...]:
    """Return the note of a run whose steps Python's interpreter runs; none for machine code."""
    words = f"steps by Python's interpreter ({PYTHON}=1): last bits and times are its own"
    return (words,) if is_interpreted(march) else ()


def _march(problem: Problem, control: StepControl, method: Method, marcher: Any, watch: Stopwatch) -> Trajectory:
    """March, a batch of steps at a time, to the end, a failure or a limit, and return the trajectory.

    ``marcher`` is a ``Marcher`` or one with the same methods. ``watch`` has run since the call of ``integrate`` began;
    making code during the run counts as set-up. Each batch goes to the control's spool, if there is one.
    """
    system, state, order = problem.system, marcher.state, marcher.kernel.order
    room = int(max(16, min(5000, STRETCH_BYTES / (8 * (1 + 18 * system.nb + system.nrows)))))
    collect_garbage()
    set_up = watch.solver
    done: list[Record] = []
    taken, status, message = 0, Status.SUCCESS, ""
    while True:
        record = marcher.stretch(min(room, control.max_steps - taken))
        done.append(record)
        taken += len(record.t)
        if control.spool is not None and len(record.t):
            control.spool.take(record.t, _collect_states(record))
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
    first, moved = problem.initial, _collect_states(whole)
    reaction = np.concatenate((marcher.reaction, whole.lam[:, order]))
    return Trajectory(
        t=np.concatenate(([0.0], whole.t)),
        states=States(*(np.concatenate((getattr(first, n)[None], getattr(moved, n))) for n in NAMES)),
        status=status,
        message=message,
        notes=method.notes,
        counters={"steps": taken, **{WORDS.get(name, name): int(state[name]) for name in method.counters}},
        reaction=reaction,
        cpu_time=cpu,
        setup_time=set_up,
        diagnostics={
            n: np.concatenate(([np.nan], a)) for n, a in zip(method.diagnostic_names, whole.diagnostics.T, strict=True)
        },
    )


def _strip_advice(refusal: str) -> str:
    """Return the reason of a refusal without its advice to use the kernel, which has been followed."""
    return refusal.split(": use")[0]


NAMES = ("r", "R", "v", "Omega")
WORDS = {"iterations": "newton_iterations", "cuts": "step_cuts"}  # names of counters in results, where they differ
ENDS = {
    marching.UNDERFLOW: (Status.STEP_UNDERFLOW, "the error test asks for a step below the spacing of times"),
    marching.NOT_FINITE: (Status.DIVERGED, "the motion is no longer finite"),
    marching.STUCK: (Status.STEP_UNDERFLOW, "the iteration of a step does not converge with this step"),
    marching.TURNED: (
        Status.STEP_UNDERFLOW,
        "a body turns by more than half a turn in this step, or would: take a shorter one",
    ),
}


def _collect_states(record: Record) -> States:
    """Return poses and velocities of all bodies at the steps of a record."""
    return States(record.r, record.R, record.v[:, :, :3], record.v[:, :, 3:])
