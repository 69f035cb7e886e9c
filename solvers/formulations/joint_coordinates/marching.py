"""DOP853 on the coordinates of a tree, error-controlled, each accepted step projected onto its loops (compiled).

A step is rejected where a pivot falls to ``LEAST_IN_STAGES`` of its start in one of its evaluations, as it does where
the rank of the rows changes, or to ``LEAST_PIVOT`` where it is projected, or where rows left out are open there.

Motions pass singular positions smoothly, but accelerations off the loops do not: gaps are divided by the distance from
the position. A step whose pivots fall to ``LOW`` and whose error is too large is tried again on f(P(P(y))), with P the
projection: the same motion to the same order, without that division. It fails only where a stage almost meets the
position; other lengths, ``TRIALS`` of the first one, then move the stages. The step after it has that first length
again: after short ones, steps would approach the position without passing it. After ``MOST_CUTS`` other rejections
another order of elimination continues if it has safe pivots there, else the kernel does, to the end.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from ....harness.base.code_meter import Stopwatch, collect_garbage, making_code
from ....harness.mechanics.state import State
from ....harness.mechanics.types import Problem, Status, StepControl, Trajectory
from ..compiled import host as kernel
from ..compiled.algebra import copy
from ..compiled.entries import BoundFunction, compile_inline, run
from ..compiled.host import ENDS, FIRST_STEP, NO_DIAGNOSTICS, Method, _march
from ..compiled.marching import FULL, SAFETY, STUCK, March, Record, allocate_record, make_control, march
from ..generated import Program
from ..methods.rkmk import make_pair_method
from ..methods.tableaux import DOPRI853
from ..recording import no_trajectory
from ..recursion.evaluation import TreeMechanism
from .choice import choose_code, make_evaluation
from .code import JointCode
from .elimination import Order
from .evaluation import Evaluation
from .pivots import LostRank
from .tree import Tree, build_spanning_tree

# ratios to the value at the start: where a step is projected, and in its stages
LEAST_PIVOT, LEAST_IN_STAGES = 3e-6, 1e-8
LOW = 3e-3  # the same: at it a singular position may be near
FAIR = 0.03  # the same: above it an earlier order continues
OPEN = 1e-6  # gap of rows that were left out, as a share of the mechanism's size
# fewer take a step that is hard by itself for a poor order; more approach the position in tiny steps
MOST_CUTS = 10
NEAR = 10.0  # error given to a step that comes too near, which cuts it to two thirds
ONE = 1.0 + 1e-15  # error after which the next step is ``SAFETY`` of h
TRIALS = np.array([0.8, 1.25, 0.65, 1.5, 0.5, 0.9, 0.4, 0.3, 0.2, 0.1, 0.05])
ROOM, MOST_AT_ONCE = 1_000_000, 1000  # bytes and steps that are recorded before Python takes them over


class Bodies(NamedTuple):
    """The record of an accepted step; its names are those of a kernel."""

    r: Any  # (nb, 3)
    R: Any  # (nb, 3, 3)
    v: Any  # (nb, 6)
    v_dot: Any  # (nb, 6)
    lam: Any  # (nrows,) reactions
    order: Any  # (nrows,)


class Stages(NamedTuple):
    """The bundle of one step."""

    control: Any
    given: Any  # (3,) t, h, rtol, the input of code
    a: Any  # tableau: (s, s)
    b: Any  # (s,)
    c: Any  # (s,)
    estimate: Any  # (2, s + 1)
    start: Any  # (n,)
    y: Any  # (n,)
    y_dot: Any  # (n,)
    after: Any  # (n,) projected
    slopes: Any  # (s, n)
    sums: Any  # (2, n)
    error: Any  # (1,)
    least: Any  # (1,) pivot of the last evaluation, or of all of a step in one
    guard: Any  # (2,) least pivot and gap of the step
    limits: Any  # (4,) least pivot of stages and at the end, largest gap, pivot of a passage
    tries: Any  # (4,) rejections before this step; first length of a passage, or 0, and its trials; least pivot
    accelerate: int
    measure: int
    whole: int
    finish: int
    record: int


def step(s: Any) -> None:
    """Evaluate the stages of a step of ``control.h`` and its error; project it if the error is small enough."""
    if not _is_stuck(s):
        _complete_step(s, _evaluate_step(s, 0))


def step_at_once(s: Any) -> None:
    """Take a step like ``step``, by code that has all stages in one function."""
    c = s.control
    if _is_stuck(s):
        return
    s.given[0], s.given[1], s.given[2] = c.t, c.h, c.rtol
    c.evaluations += len(s.b) - 1
    run(s.whole)
    _complete_step(s, s.least[0])


def finish(s: Any) -> None:
    """Continue from the projected state of an accepted step, and compute what is recorded of it.

    The accelerations before the projection are the next step's first slope, except near a singular position, where they
    are evaluated again.
    """
    c = s.control
    c.factorisations = c.evaluations
    copy(s.after, s.y)
    copy(s.after, s.start)
    copy(s.y_dot, s.slopes[0])
    run(s.record)
    if not s.tries[3] > s.limits[3]:  # accelerations before the projection are far off there
        run(s.accelerate)
        copy(s.y_dot, s.slopes[0])
        c.evaluations += 1
    if s.tries[1] > 0.0:  # the next step is as long
        c.h, c.error, c.last_error = s.tries[1] / SAFETY, 1.0, 1.0
    s.tries[0], s.tries[1], s.tries[2] = c.rejected, 0.0, 0.0


@compile_inline
def _is_stuck(s: Any) -> bool:
    """Return whether a step has been rejected ``MOST_CUTS`` times, trials apart; if so, set ``control.status``."""
    c = s.control
    if c.rejected - s.tries[0] - s.tries[2] < MOST_CUTS:
        return False
    c.status = STUCK
    return True


@compile_inline
def _evaluate_step(s: Any, projections: int) -> float:
    """Evaluate all stages, each after so many ``projections`` onto the loops, and the error; return the least pivot.

    Without projections the first slope is known from the step before.
    """
    c, n = s.control, len(s.b)
    least = 1.0
    for i in range(0 if projections else 1, n):
        _combine(s, s.a[i], i, s.y, c.h)
        s.given[0] = c.t + c.h * s.c[i]
        for _ in range(projections):
            run(s.finish)
            copy(s.after, s.y)
        run(s.accelerate)
        c.evaluations += 1 + projections
        least = min(least, s.least[0])
        copy(s.y_dot, s.slopes[i])
    _combine(s, s.b, n, s.y, c.h)
    _add_errors(s)
    s.given[1], s.given[2] = c.h, c.rtol
    run(s.measure)
    return least


@compile_inline
def _complete_step(s: Any, least: float) -> None:
    """Project a step whose error is small enough, and set ``control.error``.

    ``least`` is the least pivot of its stages. Near a singular position the step is evaluated again, and the next
    length to try is set.
    """
    c = s.control
    if not least > s.limits[3] and not s.error[0] <= 1.0:
        least = _evaluate_step(s, 2)
    c.error = s.error[0]
    near = not least > s.limits[0]
    s.guard[0], s.guard[1] = least, 0.0
    if c.error <= 1.0 and not near:
        s.given[0] = c.t + c.h
        run(s.finish)
        c.evaluations += 1
        near = not (s.guard[0] > s.limits[1] and s.guard[1] < s.limits[2])
        least = min(least, s.guard[0])
    if near:
        c.error = max(c.error, NEAR)
    s.tries[3], tried = least, int(s.tries[2])
    if not least > s.limits[3] and not c.error <= 1.0 and tried < len(TRIALS):
        if tried == 0:
            s.tries[1] = c.h
        s.tries[2] += 1.0
        c.h, c.error = s.tries[1] * TRIALS[tried] / SAFETY, ONE


@compile_inline
def _combine(s: Any, weights: Any, n: int, out: Any, h: float) -> None:
    """Set out = start + h sum weights slopes, over the first ``n`` slopes."""
    copy(s.start, out)
    for i in range(n):
        w = h * weights[i]
        if w != 0.0:
            slope = s.slopes[i]
            for k in range(len(out)):
                out[k] += w * slope[k]


@compile_inline
def _add_errors(s: Any) -> None:
    """Set ``s.sums`` to both estimates of the step's error, divided by h."""
    for e in range(2):
        total = s.sums[e]
        for k in range(len(total)):
            total[k] = 0.0
        for i in range(len(s.b)):
            w = s.estimate[e, i]
            if w != 0.0:
                slope = s.slopes[i]
                for k in range(len(total)):
                    total[k] += w * slope[k]


class Marcher:
    """A march in a mechanism's joint coordinates; ValueError where neither code nor recursion is possible."""

    tree: Tree
    code: JointCode | TreeMechanism
    _room: tuple[Record, BoundFunction] | None = None

    def __init__(
        self, problem: Problem, state: np.ndarray, before: "Marcher | None" = None, chosen: Order | None = None
    ) -> None:
        """Begin at the problem's start, or at the state of the marcher ``before``, in the order ``chosen``."""
        system, tree = problem.system, before.tree if before else build_spanning_tree(problem.system, problem.initial)
        self.tree, self.code = tree, before.code if before else choose_code(problem, tree)
        self.evaluation = make_evaluation(self.code, tree.nq, chosen)
        nb, n, tableau = system.nb, len(tree.start), DOPRI853
        self.state = state
        self.kernel = bodies = Bodies(
            np.zeros((nb, 3)),
            np.zeros((nb, 3, 3)),
            np.zeros((nb, 6)),
            np.zeros((nb, 6)),
            np.zeros(system.nrows),
            np.arange(system.nrows),
        )
        given, y, y_dot, after, lam, guard, start = (np.zeros(k) for k in (3, n, n, n, self.code.rows, 2, n))
        t, slopes, sums, error, least = given[:1], np.zeros((len(tableau.b), n)), np.zeros((2, n)), *np.zeros((2, 1))
        own = self.evaluation
        at_once = own if isinstance(own, Evaluation) and self.code.is_small and chosen is None else None
        self._programs = [
            own.accelerate(t, y, y_dot, least),
            own.measure(given, start, y, sums, error),
            at_once.step_at_once(given, start, slopes[0], y, error, least) if at_once else Program([]),
            own.finish(t, y, after, y_dot, lam, guard),
            own.record(t, after, y_dot, lam, *bodies[:5]),
        ]
        reach = max(float(np.max(np.abs(a), initial=0.0)) for a in (problem.initial.r, system.joint_s_i))
        self.stages = Stages(
            state,
            given,
            tableau.a,
            tableau.b,
            tableau.c,
            tableau.error,
            start,
            y,
            y_dot,
            after,
            slopes,
            sums,
            error,
            least,
            guard,
            np.array([LEAST_IN_STAGES, LEAST_PIVOT, OPEN * (reach or 1.0), LOW]),
            np.array([0.0, 0.0, 0.0, 1.0]),
            *(program.entry for program in self._programs),
        )
        one = step_at_once if at_once else step
        self._entries = BoundFunction(one, self.stages), BoundFunction(finish, self.stages)
        t[0], first = state["t"], before.stages.start if before else tree.start
        y[:] = first
        self._programs[3].run()
        self._entries[1]()
        y[:], start[:] = first, first
        self.reaction = bodies.lam.copy()[None]
        self.stretch(0)

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps, or as many as the record holds; return the record of those accepted.

        ``state["outcome"]`` says why the march ended.
        """
        if self._room is None:
            bytes_of_a_step = 8 * (1 + 18 * len(self.kernel.r) + len(self.kernel.lam))
            self._room = self._make_record(min(1 + ROOM // bytes_of_a_step, MOST_AT_ONCE))
        record, march_on = self._room if n >= len(self._room[0].t) else self._make_record(n)
        march_on()
        taken = Record(*(a[: self.state["recorded"]] for a in record))
        return Record(*(a.copy() for a in taken)) if self.state["outcome"] == FULL else taken

    def _make_record(self, n: int) -> tuple[Record, BoundFunction]:
        """Return a record for ``n`` steps, and the compiled march that fills it."""
        record = allocate_record(n, len(self.kernel.r), len(self.kernel.lam))
        for a in record:
            a.fill(0.0)  # the system provides pages as they are touched
        bundle = March(self.state, self.kernel, record, NO_DIAGNOSTICS, *(e.entry for e in self._entries))  # type: ignore[arg-type]
        return record, BoundFunction(march, bundle)

    @property
    def present_state(self) -> np.ndarray:
        """Coordinates and velocities y at the end of the last step."""
        return self.stages.start

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march."""
        if outcome != STUCK:
            return ENDS[outcome][1]
        pivot, gap = self.stages.guard
        return (
            f"the constraints are near a change of rank (least pivot {pivot:.2g} of its start, rows left out open by "
            f"{gap:.2g})"
        )


class Relay:
    """A march in joint coordinates; where it is stuck, another order of elimination continues, or the kernel."""

    def __init__(self, problem: Problem, code: Marcher) -> None:
        self.state, self.kernel, self.reaction = code.state, code.kernel, code.reaction
        self.changes, self._notes = list[float](), list[str]()
        self._problem, self._runner, self._orders = problem, code, list[Order | None]([None])
        self._fallback: kernel.Marcher | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the times at which pivots were chosen anew, and on a change to the kernel."""
        times = ", ".join(f"{t:g}" for t in self.changes[:3]) + (", ..." if len(self.changes) > 3 else "")
        return (*([f"pivots chosen anew at t = {times} s"] if self.changes else []), *self._notes)

    def stretch(self, n: int) -> Record:
        """March up to ``n`` steps and return their record, reactions in the system's order.

        Where the march is stuck, change to another order of elimination, or to the kernel.
        """
        if self._fallback:
            record: Record = self._fallback.stretch(n)
            return record._replace(lam=record.lam[:, self._fallback.kernel.order])
        record = self._runner.stretch(n)
        if self.state["outcome"] == STUCK:
            record = Record(*(a.copy() for a in record))  # its memory may be reused
            with making_code:
                if not self._choose_pivots():
                    self.state["outcome"] = STUCK  # the marchers tried have changed it
                    self._continue_without_pivots()
            collect_garbage()
        return record

    def _choose_pivots(self) -> bool:
        """Change to an order of elimination whose pivots are safe at the present state; return whether there is one.

        An earlier order is preferred. At the time of the last change there is none.
        """
        t = float(self.state["t"])
        if self.changes and not t > self.changes[-1]:
            return False
        for order in self._orders:
            other = self._make_marcher(order)
            if other.stages.guard[0] > FAIR:
                break
        else:
            before = self._runner
            try:
                order = before.evaluation.find_order(t, before.present_state, before.tree.start)
            except LostRank:
                return False
            other = self._make_marcher(order)
            self._orders.append(order)
        self._runner = other
        self.changes.append(t)
        return True

    def _make_marcher(self, order: Order | None) -> Marcher:
        """Return a marcher at the present state with this order of elimination; None stands for that of the start."""
        return Marcher(self._problem, self.state, self._runner, order)

    def _continue_without_pivots(self) -> None:
        """Continue from the present state to the end by the kernel of ``rkmk_dop853``, and note it."""
        t, k = float(self.state["t"]), self._runner.kernel
        self._notes.append(f"{self._runner.explain(STUCK)} at t = {t:g} s; from there on by the kernel of rkmk_dop853")
        here = State(k.r.copy(), k.R.copy(), k.v[:, :3].copy(), k.v[:, 3:].copy(), t)
        rest = dataclasses.replace(self._problem, initial=here)
        self._fallback = kernel.Marcher(rest, make_pair_method(DOPRI853), self.state)

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march, after the notes on changes."""
        return "; ".join([*self.notes, (self._fallback or self._runner).explain(outcome)])


METHOD = Method(
    lambda kernel, state: None,
    step,
    finish,
    order=float(DOPRI853.order),
    counters=("evaluations", "rejected", "factorisations"),
)


def integrate(problem: Problem, control: StepControl) -> Trajectory:
    """Integrate in joint coordinates to the end, a limit or a failure, and return the trajectory with its status."""
    watch = Stopwatch()
    state = make_control(
        t_end=problem.t_end,
        adaptive=True,
        order=METHOD.order,
        last_error=1e-4,
        rtol=control.rtol or 0.0,
        max_step=control.max_step or np.inf,
        next_step=min(FIRST_STEP, problem.t_end),
    )
    try:
        marcher = Marcher(problem, state)
    except ValueError as error:
        return no_trajectory(problem, Status.REFUSED, str(error))
    relay = Relay(problem, marcher)
    out = _march(problem, control, METHOD, relay, watch)
    notes = [marcher.code.words]
    if marcher.code.rows:
        notes.append(
            f"{marcher.code.rows_in_use} of {marcher.code.rows} rows of the loops hold, the others depend on them"
        )
    return dataclasses.replace(out, notes=(*notes, *relay.notes))
