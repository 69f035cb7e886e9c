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

from ....harness.base.generated import Program
from ....harness.base.tableaux import DOPRI853
from ....harness.mechanics.state import State
from ....harness.mechanics.types import Problem, StepControl, Trajectory
from ..compiled import host as kernel
from ..compiled.algebra import copy
from ..compiled.entries import BoundFunction, compile_inline, run
from ..compiled.host import FIRST_STEP, Method
from ..compiled.marching import SAFETY, STUCK, make_control
from ..methods.explicit_stages import evaluate_stages
from ..methods.rkmk import make_pair_method
from .choice import choose_code, make_evaluation
from .elimination import EliminationOrder
from .evaluation import Evaluation
from .relay import OPEN, JointMarcher, integrate_by_relay

# "Half" and "twice": tried with dop853_joint on Bricard's, Bennett's and a planar linkage, and on two four-bar cells,
# which pass singular positions.
# ratios to the value at the start: where a step is projected (half, twice: no bit changes), and in its stages
LEAST_PIVOT, LEAST_IN_STAGES = 3e-6, 1e-8
# the same: at it a singular position may be near. Half and twice change the cells by one evaluation of 375; twice takes
# 8 % more on Bennett's linkage.
LOW = 3e-3
# fewer take a step that is hard by itself for a poor order; more approach the position in tiny steps. Half, twice: no
# bit changes.
MOST_CUTS = 10
# error given to a step that comes too near, which cuts it to two thirds; half, twice: no bit changes
NEAR = 10.0
ONE = 1.0 + 1e-15  # error after which the next step is ``SAFETY`` of h
TRIALS = np.array([0.8, 1.25, 0.65, 1.5, 0.5, 0.9, 0.4, 0.3, 0.2, 0.1, 0.05])


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
    accelerate: Any
    measure: Any
    whole: Any
    finish: Any
    record: Any


def step(s: Any) -> None:
    """Evaluate the stages of a step of ``control.h`` and its error; project its end if the error is small enough.

    ``s`` is a ``Stages``; its ``control.error`` is set, which rejects the step above 1.
    """
    if not _is_stuck(s):
        _complete_step(s, _evaluate_step(s, 1, _evaluate_slope))  # the first slope is known from the step before


def step_at_once(s: Any) -> None:
    """Take a step like ``step``, by code of the mechanism that has all stages in one function."""
    c = s.control
    if _is_stuck(s):
        return
    s.given[0], s.given[1], s.given[2] = c.t, c.h, c.rtol
    c.evaluations += len(s.b) - 1
    run(s.whole)
    _complete_step(s, s.least[0])


def finish(s: Any) -> None:
    """Begin the next step at the projected end of an accepted one, and compute its record: poses, rates, reactions.

    The accelerations before the projection are the next step's first slope, except near a singular position, where they
    are evaluated again. After a passage the next step has the length that was tried first.
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
def _evaluate_step(s: Any, first: int, slope: Any) -> float:
    """Evaluate the stages from index ``first`` on by the function ``slope``, and the error; return the least pivot."""
    s.tries[3] = 1.0
    evaluate_stages(s, s, s.control.t, s.control.h, first, _combine_slopes, slope)
    _estimate_errors(s)
    s.given[1], s.given[2] = s.control.h, s.control.rtol
    run(s.measure)
    return s.tries[3]


@compile_inline
def _evaluate_slope(s: Any, t: float, i: int) -> None:
    """Set slope ``i`` to y_dot at the state ``y`` and ``t`` [s], and ``tries[3]`` to the least pivot so far."""
    s.given[0] = t
    run(s.accelerate)
    s.control.evaluations += 1
    s.tries[3] = min(s.tries[3], s.least[0])
    copy(s.y_dot, s.slopes[i])


@compile_inline
def _evaluate_slope_on_loops(s: Any, t: float, i: int) -> None:
    """Set slope ``i`` as ``_evaluate_slope`` does, after two projections of the state ``y`` onto the loops."""
    s.given[0] = t
    for _ in range(2):
        run(s.finish)
        copy(s.after, s.y)
        s.control.evaluations += 1
    _evaluate_slope(s, t, i)


@compile_inline
def _complete_step(s: Any, least: float) -> None:
    """Project the end of a step whose error is small enough, and set ``control.error``.

    ``least`` is the least pivot of its stages. Near a singular position a step whose error is too large is evaluated
    again with projected stages; if that fails, too, the next of ``TRIALS`` is set as its length.
    """
    c = s.control
    if not least > s.limits[3] and not s.error[0] <= 1.0:
        least = _evaluate_step(s, 0, _evaluate_slope_on_loops)
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
def _combine_slopes(s: Any, weights: Any, n: int, h: float) -> None:
    """Set y to start + h times the sum of ``weights`` times slopes, over the first ``n`` slopes."""
    copy(s.start, s.y)
    for i in range(n):
        w = h * weights[i]
        if w != 0.0:
            slope = s.slopes[i]
            for k in range(len(s.y)):
                s.y[k] += w * slope[k]


@compile_inline
def _estimate_errors(s: Any) -> None:
    """Set ``s.sums`` to both estimates of the step's error in y, divided by h."""
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


class PairMarcher(JointMarcher):
    """A march by steps of DOP853, error-controlled; ValueError where neither code nor recursion is possible."""

    def __init__(
        self,
        problem: Problem,
        state: np.ndarray,
        before: "PairMarcher | None" = None,
        chosen: EliminationOrder | None = None,
    ) -> None:
        """Begin at the problem's start, or at the state of the marcher ``before``, in the order ``chosen``."""
        super().__init__(problem, state, before)
        tree, bodies = self.tree, self.kernel
        self.code = before.code if before else choose_code(problem, tree)
        self.evaluation = make_evaluation(self.code, tree.nq, chosen)
        n, tableau = len(tree.start), DOPRI853
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
            np.array([LEAST_IN_STAGES, LEAST_PIVOT, OPEN * (self.reach or 1.0), LOW]),
            np.array([0.0, 0.0, 0.0, 1.0]),
            *self._programs,
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

    @property
    def present_state(self) -> np.ndarray:
        """Coordinates and velocities y at the end of the last step."""
        return self.stages.start  # type: ignore[no-any-return]

    def restart(self, order: EliminationOrder | None) -> "PairMarcher":
        """Return a marcher at the present state with this order of elimination; None stands for that of the start."""
        return PairMarcher(self.problem, self.state, self, order)

    def continue_without_pivots(self) -> tuple[kernel.Marcher, str]:
        """Return a march by the kernel of ``rkmk_dop853`` from the present state to the end, and a note on that."""
        t, k = float(self.state["t"]), self.kernel
        note = f"{self.explain(STUCK)} at t = {t:g} s; from there on by the kernel of rkmk_dop853"
        here = State(k.r.copy(), k.R.copy(), k.v[:, :3].copy(), k.v[:, 3:].copy(), t)
        rest = dataclasses.replace(self.problem, initial=here)
        return kernel.Marcher(rest, make_pair_method(DOPRI853), self.state), note


METHOD = Method(
    lambda kernel, state: None,
    step,
    finish,
    order=float(DOPRI853.order),
    counters=("evaluations", "rejected", "factorisations"),
)


def integrate(problem: Problem, control: StepControl) -> Trajectory:
    """Integrate by DOP853 in joint coordinates to the end, a limit or a failure, and return the trajectory."""
    state = make_control(
        t_end=problem.t_end,
        adaptive=True,
        order=METHOD.order,
        last_error=1e-4,
        rtol=control.rtol or 0.0,
        max_step=control.max_step or np.inf,
        next_step=min(FIRST_STEP, problem.t_end),
    )
    return integrate_by_relay(problem, control, METHOD, lambda: PairMarcher(problem, state))
