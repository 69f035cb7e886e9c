"""Symplectic steps of fixed size on Hamilton's equations of a tree and of its loops (compiled).

A step by a ``CollocationTableau`` finds q_dot, p_dot of its stages and lam of its rows in sweeps: each stage from the
newest values of the others, then lam of all nodes by one step of a simplified Newton method,

    (C x S) d lam = phi / h^2,   C = a_node a_row,   S = G H^-1 G^T at the start of the step,

until only rounding changes. The first estimate extrapolates earlier steps. q and p are summed with compensation
(Kahan). Where pivots are poor at the end of a step, another order of elimination continues with the same q and p.

Sweeps converge linearly, at a rate of about h times the fastest rate of the motion. Where so many are needed that
rounding could decide whether ``MOST_SWEEPS`` are enough, Anderson's method accelerates them (module ``acceleration``).
"""

from typing import Any, NamedTuple

import numpy as np

from ....harness.base.generated import Program
from ....harness.mechanics.types import Problem, StepControl, Trajectory
from ..compiled.algebra import clear, copy, take_larger
from ..compiled.entries import BoundFunction, compile_inline, run
from ..compiled.host import ENDS, ROUNDINGS, Method
from ..compiled.marching import FULL, STUCK, make_control
from ..methods.iteration import FAILED, GO_ON, SETTLED, iterate
from ..recursion.evaluation import TreeEvaluation
from ..recursion.phases import TreeClosing, TreePhase
from ..refusals import refuse_without_phi
from .acceleration import MEMORY, accelerate
from .choice import choose_phase, make_evaluation, refuse_loop_rows
from .collocation import DEPTH, CollocationTableau
from .elimination import EliminationOrder
from .evaluation import Calls, Evaluation
from .hamilton import HamiltonCode
from .relay import OPEN, JointMarcher, integrate_by_relay

# twice what the longest steps with any accuracy take. Half ends one of six runs of gauss_joint, a chain at long steps,
# a step sooner; twice changes none.
MOST_SWEEPS = 60
# sweeps between two checks of their rate. Of five runs of gauss_joint half (2) changes the sweeps by -2 to 0 %, twice
# by 0 to 15 %, with most at long steps.
LOOK = 5
# acceleration begins where these would leave more than ``TIGHT``; 11 and 21 do as well. Of six runs of gauss_joint,
# three at long steps, half changes the sweeps by -2 to 0 %, twice by 0 to 74 %.
PLAIN_SWEEPS = 16
# changes above the first are not rounding; those below the second are mostly rounding. Half and twice of the second
# change the sweeps by -0.6 to 0.3 %.
LOOSE, TIGHT = 1e-9, 1e-13
# sweeps without halving the changes that indicate rounding; two are enough below ``TIGHT``. Of the six runs half ends
# the sweeps of two after 1 and 2 % less, twice those of one 0.3 % later.
IDLE = 4
# limit of the estimated further changes, relative to q and p. Half takes 2 to 9 % more sweeps, twice 0 to 10 % fewer;
# ends differ by 1e-13 at most.
ROUNDING = 3e-17
SHORTER = ": take a shorter one, on chains as 1 / (links x speed); gauss_joint takes longer ones than rattle_joint"
CALLS = ("stage", "gaps", "push", "solve", "close", "finish", "record")
# shares of their first values: others are searched for, and the march ends. Half and twice of the first change the
# sweeps by at most 0.8 % on Bricard's and Bennett's linkages, and no bit of a planar one and of two four-bar cells;
# those of the second change none.
POOR_PIVOT, LEAST_PIVOT = 1e-3, 1e-6
FASTEST = 1e-2  # assumed convergence of a sweep, at best


class CollocationStages(NamedTuple):
    """The bundle of one step: the tableau and its arrays."""

    control: Any
    t: Any  # (1,)
    c: Any  # (s,)
    a: Any  # (s, s)
    a_p: Any  # (s, s)
    b: Any  # (s,)
    nodes: Any  # (m,)
    a_node: Any  # (m, s)
    a_row: Any  # (s, m)
    b_row: Any  # (m,)
    newton: Any  # (m - 1, m - 1) C^-1
    guess: Any  # (d, s, d s) by stages of the step before, of the two before, ...
    guess_rows: Any  # (d, m - 1, d m)
    start: Any  # (2, nq) q and p
    rest: Any  # (2, nq) compensation of their last sums
    z: Any  # (2, nq)
    z_dot: Any  # (2, nq)
    unknowns: Any  # (n,) F, pushes and lam behind each other
    F: Any  # (s, 2, nq) z_dot of the stages
    before: Any  # (d, s, 2, nq) F of steps before, the last one last
    lam: Any  # (m, r)
    lam_before: Any  # (d, m, r)
    phi: Any  # (m - 1, r)
    rows: Any  # (r,) input and output of code
    kept: Any  # numbers of the rows in use
    gaps: Any  # (r,)
    solved: Any  # (r,)
    push: Any  # (nq,)
    pushes: Any  # (m, nq)
    y: Any  # (ny,)
    after: Any  # (ny,)
    guard: Any  # (2,)
    limits: Any  # (4,) least pivot, largest gap of rows that were left out, rounding of phi, ``PLAIN_SWEEPS``
    past: Any  # (2,) number of steps before that are known, and their h
    most: Any  # (1,) largest number of sweeps in a step
    least: Any  # (1,) change in this step
    seen: Any  # (1,) change when the rate was last checked
    idle: Any  # (1,) sweeps since the least change was halved
    known: Any  # (1,) what ``accelerate`` knows of earlier sweeps, -1 for nothing
    slow: Any  # (1,) 1 once sweeps are accelerated
    entered: Any  # (n,) unknowns before a sweep
    left: Any  # (n,) those after the sweep before
    weights: Any  # (k,) of changes of F and pushes, as ``_evaluate_stages`` measures them
    change: Any  # (k,) weighted, of a sweep
    change_before: Any  # (k,)
    basis: Any  # (MEMORY, k) orthonormal, of changes of changes
    images: Any  # (MEMORY, n) differences of the unknowns after a sweep along each
    stage: Any
    gap: Any
    pushed: Any
    solve: Any
    close: Any
    finish: Any
    record: Any


def step(s: Any) -> None:
    """Solve for the stages and multipliers of a step of ``control.h`` [s] by sweeps; ``finish`` completes the step.

    ``s`` is a ``CollocationStages``. ``control.status`` becomes STUCK where sweeps do not converge or pivots are poor.
    """
    c, h = s.control, s.control.h
    if not (s.guard[0] > s.limits[0] and s.guard[1] < s.limits[1]):
        c.status = STUCK
        return
    if abs(h - s.past[1]) > 1e-9 * h:
        s.past[0], s.past[1] = 0.0, h
    _estimate_step(s, c.t)
    s.least[0], s.seen[0], s.idle[0], s.known[0], s.slow[0] = np.inf, 0.0, 0, -1, 0
    if not iterate(s, _sweep_and_correct, _classify_sweep, MOST_SWEEPS):
        c.status = STUCK


def finish(s: Any) -> None:
    """Add the increments of the step to q and p, project velocities at its end, and compute its record.

    ``s`` is a ``CollocationStages``. Recorded accelerations and reactions are those of index 1. Slopes and multipliers
    are kept for later estimates.
    """
    c, h = s.control, s.control.h
    n, m = len(s.start[0]), len(s.nodes)
    copy(s.start, s.z)
    for e in range(2):
        for k in range(n):
            change = 0.0
            for i in range(len(s.b)):
                change += s.b[i] * s.F[i, e, k]
            if e == 1:
                for j in range(m - 1):
                    change -= s.b_row[j] * s.pushes[j, k]
            _add_compensated(s, e, k, h * change)
    s.t[0] = c.t + h
    run(s.close)
    if len(s.rows) > 0:
        for r in range(len(s.rows)):
            s.lam[m - 1, r] = s.rows[r] / (h * s.b_row[m - 1])
        run(s.pushed)
        for k in range(n):
            _add_compensated(s, 1, k, -s.push[k])
    copy(s.z, s.start)
    d = len(s.before)
    for k in range(d - 1):
        copy(s.before[k + 1], s.before[k])
        copy(s.lam_before[k + 1], s.lam_before[k])
    copy(s.F, s.before[d - 1])
    copy(s.lam, s.lam_before[d - 1])
    s.past[0] = min(s.past[0] + 1.0, float(d))
    run(s.finish)
    run(s.record)


@compile_inline
def _sweep_and_correct(s: Any, i: int, stale: bool) -> float:
    """Evaluate all stages and correct all multipliers once; return the larger of both relative changes.

    ``i`` is the number of sweeps before; ``stale`` is an argument of ``iterate`` that is not used.
    """
    c = s.control
    c.iterations += 1
    s.most[0] = max(s.most[0], i + 1.0)
    if s.slow[0] != 0:
        copy(s.unknowns, s.entered)
    size = _evaluate_stages(s, c.t, c.h)
    if len(s.rows) > 0:
        size = take_larger(size, _correct_multipliers(s, c.t, c.h))
    return size


@compile_inline
def _classify_sweep(s: Any, i: int, size: float, last: float) -> int:
    """Return SETTLED where only rounding changes, FAILED where a change is not finite, else GO_ON after sweep ``i``.

    ``size`` and ``last`` are its change and the one before. Acceleration begins where the sweeps up to
    ``PLAIN_SWEEPS`` would leave a change above ``TIGHT``; accelerated sweeps are combined here.
    """
    if not np.isfinite(size):
        return FAILED
    s.idle[0] += 1
    if size < 0.5 * s.least[0]:
        s.least[0], s.idle[0] = size, 0
    settled = s.idle[0] >= (2 if size < TIGHT else IDLE) or size * max(size / last, FASTEST) < ROUNDING
    if size == 0.0 or (size < LOOSE and settled):
        return SETTLED
    if s.slow[0] != 0:
        if s.idle[0] == 0 or size > TIGHT:  # weights for changes that are rounding would magnify it
            s.known[0] = accelerate(s, s.control.h, s.known[0])
    elif i % LOOK == 0:
        if i > 0:
            expected = size
            for _ in range(i, int(s.limits[3]) - 1, LOOK):
                expected *= size / s.seen[0]
            if expected > TIGHT:
                s.slow[0] = 1
        s.seen[0] = size
    return GO_ON


@compile_inline
def _add_compensated(s: Any, e: int, k: int, change: float) -> None:
    """Add ``change`` to entry (e, k) of ``z``, with Kahan's compensation, whose remainder is kept in ``rest``."""
    change += s.rest[e, k]
    total = s.z[e, k] + change
    s.rest[e, k] = change - (total - s.z[e, k])
    s.z[e, k] = total


@compile_inline
def _estimate_step(s: Any, t: float) -> None:
    """Set the slopes ``F`` of the stages and the multipliers ``lam`` to values extrapolated from earlier steps.

    Without earlier steps all stages get the slope at the start, at ``t`` [s], and lam is zero.
    """
    past, d, stages, m = int(s.past[0]), len(s.before), len(s.b), len(s.nodes)
    if past == 0:
        s.t[0] = t
        copy(s.start, s.z)
        run(s.stage)
        s.control.evaluations += 1
    for i in range(stages):
        if past == 0:
            copy(s.z_dot, s.F[i])
        else:
            clear(s.F[i])
        for k in range(d - past, d):
            for j in range(stages):
                w = s.guess[past - 1, i, k * stages + j]
                for at, value in np.ndenumerate(s.before[k, j]):
                    s.F[i][at] += w * value
    for j in range(m - 1):
        clear(s.lam[j])
        for k in range(d - past, d):
            for i in range(m):
                for r in range(len(s.rows)):
                    s.lam[j, r] += s.guess_rows[past - 1, j, k * m + i] * s.lam_before[k, i, r]
        _compute_push(s, j, t, s.control.h)


@compile_inline
def _evaluate_stages(s: Any, t: float, h: float) -> float:
    """Set the slopes ``F`` of all stages once, from the newest values; return the largest change of q and p by it.

    Changes of q are relative to 1 + |q|, those of p to the largest momentum.
    """
    n, m = len(s.start[0]), len(s.nodes)
    worst = 0.0
    change = moment = 0.0
    for i in range(len(s.b)):
        for k in range(n):
            q = p = 0.0
            for j in range(len(s.b)):
                q += s.a[i, j] * s.F[j, 0, k]
                p += s.a_p[i, j] * s.F[j, 1, k]
            for j in range(m - 1):
                p -= s.a_row[i, j] * s.pushes[j, k]
            s.z[0, k] = s.start[0, k] + h * q
            s.z[1, k] = s.start[1, k] + h * p
        s.t[0] = t + s.c[i] * h
        run(s.stage)
        s.control.evaluations += 1
        for k in range(n):
            worst = take_larger(worst, h * abs(s.z_dot[0, k] - s.F[i, 0, k]) / (1.0 + abs(s.z[0, k])))
            change = take_larger(change, h * abs(s.z_dot[1, k] - s.F[i, 1, k]))
            moment = max(moment, abs(s.z[1, k]), h * abs(s.z_dot[1, k]))
            if not np.isfinite(s.z_dot[0, k] + s.z_dot[1, k]):
                worst = np.inf
        copy(s.z_dot, s.F[i])
    return take_larger(worst, change / moment) if moment > 0.0 else worst


@compile_inline
def _move_to_node(s: Any, j: int, t: float, h: float) -> None:
    """Set the time and the coordinates ``z[0]`` to those of node ``j``, where phi = 0 is required."""
    s.t[0] = t + s.nodes[j] * h
    for k in range(len(s.start[0])):
        q = 0.0
        for i in range(len(s.b)):
            q += s.a_node[j, i] * s.F[i, 0, k]
        s.z[0, k] = s.start[0, k] + h * q


@compile_inline
def _compute_push(s: Any, j: int, t: float, h: float) -> None:
    """Set ``pushes[j]`` to G^T lam, the generalised force of the multipliers of node ``j``."""
    if len(s.rows) > 0:
        _move_to_node(s, j, t, h)
        copy(s.lam[j], s.rows)
        run(s.pushed)
        copy(s.push, s.pushes[j])


@compile_inline
def _correct_multipliers(s: Any, t: float, h: float) -> float:
    """Correct the multipliers of all nodes by one simplified Newton step; return the largest |phi|.

    Where that is only rounding, nothing is corrected and 0 is returned.
    """
    m, nr = len(s.nodes), len(s.rows)
    worst = 0.0
    for j in range(1, m):
        _move_to_node(s, j, t, h)
        run(s.gap)
        for n in range(len(s.kept)):
            gap = s.gaps[s.kept[n]]
            worst = take_larger(worst, abs(gap))
            if not np.isfinite(gap):
                worst = np.inf
        copy(s.gaps, s.rows)
        run(s.solve)
        copy(s.solved, s.phi[j - 1])
    if worst <= s.limits[2]:
        worst = 0.0
    for j in range(m - 1):
        if worst > 0.0:
            for r in range(nr):
                change = 0.0
                for i in range(m - 1):
                    change += s.newton[j, i] * s.phi[i, r]
                s.lam[j, r] += change / (h * h)
        _compute_push(s, j, t, h)
    return worst


class Closing:
    """K at the end of a step, with which velocities are projected there and lam of the next step is corrected."""

    def __init__(self, evaluation: Evaluation, own: HamiltonCode, least: np.ndarray) -> None:
        """Allocate work arrays; ``kept`` are the indices of the rows in use: of loops, then of quaternion lengths."""
        self._evaluation, self._own, self._least = evaluation, own, least
        pattern = evaluation.made.pattern
        self._y, self._b = np.zeros(evaluation.nq + pattern.nu), np.zeros(pattern.nu + pattern.rows)
        self._u, self._lam, self._rates = np.zeros(pattern.nu), np.zeros(pattern.rows), np.zeros(evaluation.nq)
        loops = [k - pattern.first for k in evaluation.order.rows if k >= pattern.first]
        self.kept = np.array([*sorted(loops), *range(pattern.rows, own.rows)], dtype=np.int64)

    def factor(self, t: np.ndarray, z: np.ndarray) -> Program:
        """Return the program that factorises K at the coordinates and momenta ``z``."""
        return Program(self._factor(t, z), self)

    def close(self, t: np.ndarray, z: np.ndarray, y: np.ndarray, rows: np.ndarray) -> Program:
        """Return the program that projects velocities onto phi_dot = 0 at the end ``z`` = (q, p) of a step.

        It sets ``y`` = (q, u), and ``rows`` to the multipliers of the last node, impulses.
        """
        solve = self._evaluation.solve(self._b, self._u, self._lam)
        return Program(
            [*self._factor(t, z), *solve, self._make_call("close", t, *z, self._u, self._lam, y, rows)], self
        )

    def solve(self, rows: np.ndarray, solved: np.ndarray) -> Program:
        """Return the program that sets ``solved`` to S^-1 ``rows``, with S = G H^-1 G^T of the last factor."""
        loops, radial = (np.split(x, [self._evaluation.made.rows]) for x in (rows, solved))
        steps = self._evaluation.solve_rows(loops[0], radial[0])
        return Program([*steps, *([self._make_call("soften", loops[1], radial[1])] if len(loops[1]) else [])], self)

    def _factor(self, t: np.ndarray, z: np.ndarray) -> Calls:
        """Return the steps that compute the pose and K at ``z``, with added inertia of free spins, and factorise K."""
        e, variable = self._evaluation, self._evaluation.made.pattern.variable
        pose, loads = self._make_call("pose", t, *z, self._y, self._b), np.zeros_like(self._b)
        if not self._own.spins:
            return [pose, *e.entries(t, self._y, loads, self._rates), *e.factor(self._least)]
        K = np.zeros(variable)
        entries = e.make_call("entries", t, self._y, K, loads, self._rates)
        return [pose, *entries, self._make_call("add_spins", self._y, K, e.K[:variable]), *e.factor(self._least)]

    def _make_call(self, name: str, *arrays: np.ndarray) -> tuple[int, list[np.ndarray]]:
        """Return the call of the function ``name`` of Hamilton's equations with these arrays; nothing is run."""
        return self._own.code.address(name), list(arrays)


def make_closing(
    evaluation: Evaluation | TreeEvaluation, own: HamiltonCode | TreePhase, least: np.ndarray
) -> Closing | TreeClosing:
    """Return the object whose programs factorise K and project velocities at the ends of steps.

    ``evaluation`` and ``own``, Hamilton's equations, are both code or both recursion. Code sets ``least`` to the least
    pivot.
    """
    if isinstance(evaluation, TreeEvaluation) and isinstance(own, TreePhase):
        return TreeClosing(evaluation, own)
    assert isinstance(evaluation, Evaluation) and isinstance(own, HamiltonCode)  # chosen together
    return Closing(evaluation, own, least)


class SymplecticMarcher(JointMarcher):
    """A symplectic march of a mechanism; ValueError where neither code nor recursion is possible."""

    hamilton: HamiltonCode | TreePhase

    def __init__(
        self,
        problem: Problem,
        state: np.ndarray,
        tableau: CollocationTableau,
        before: "SymplecticMarcher | None" = None,
        chosen: EliminationOrder | None = None,
        *,
        radial: bool,
    ) -> None:
        """Begin at the problem's start, or at the state of the marcher ``before``, in the order ``chosen``."""
        super().__init__(problem, state, before)
        tree, bodies, reach = self.tree, self.kernel, self.reach
        self.code, own = (before.code, before.hamilton) if before else choose_phase(problem, tree, radial=radial)
        self.evaluation = make_evaluation(self.code, tree.nq, chosen)
        self.hamilton, self.tableau, self.radial = own, tableau, radial
        ny, nq, r = len(tree.start), tree.nq, own.rows
        stages, m = len(tableau.b), len(tableau.nodes)
        t, y, after, y_dot, lam, guard = (np.zeros(k) for k in (1, ny, ny, ny, self.code.rows, 2))
        z, z_dot, push = np.zeros((2, nq)), np.zeros((2, nq)), np.zeros(nq)
        rows, gaps, solved = np.zeros((3, r))
        sizes = (stages, 2, nq), (m, nq), (m, r)
        ends = np.cumsum([0, *(int(np.prod(size)) for size in sizes)]).tolist()
        room = np.zeros(ends[-1])
        F, pushes, lam_of_nodes = (room[a:b].reshape(size) for a, b, size in zip(ends, ends[1:], sizes, strict=False))
        unknowns, changing = (room, ends[2]) if r else (room[: ends[1]], ends[1])
        steps = {
            "stage": [t, z[0], z[1], z_dot[0], z_dot[1]],
            "gaps": [t, z[0], gaps],
            "push": [t, z[0], rows, push],
            "enter": [y, z[1]],
        }
        programs = {name: own.bind(name, *arrays) for name, arrays in steps.items()}
        shared = isinstance(own, HamiltonCode) and not own.spins
        closing_evaluation = self.evaluation if shared else make_evaluation(self.code, nq, chosen)
        closing = make_closing(closing_evaluation, own, guard[:1] if shared else np.zeros(1))
        programs |= {
            "close": closing.close(t, z, y, rows),
            "solve": closing.solve(rows, solved),
            "finish": self.evaluation.finish(t, y, after, y_dot, lam, guard, **({"factored": True} if shared else {})),
            "record": self.evaluation.record(t, after, y_dot, lam, *bodies[:5]),
        }
        self._programs = list(programs.values())
        self.stages = CollocationStages(
            state,
            t,
            *tableau[2:],
            tableau.invert_newton_matrix(),
            *tableau.compute_estimate_weights(),
            np.zeros((2, nq)),
            np.zeros((2, nq)),
            z,
            z_dot,
            unknowns,
            F,
            np.zeros((DEPTH, stages, 2, nq)),
            lam_of_nodes,
            np.zeros((DEPTH, m, r)),
            np.zeros((m - 1, r)),
            rows,
            closing.kept,
            gaps,
            solved,
            push,
            pushes,
            y,
            after,
            guard,
            np.array(
                [
                    POOR_PIVOT,
                    OPEN * (reach or 1.0),
                    ROUNDINGS * np.finfo(float).eps * max(reach, 1.0),
                    PLAIN_SWEEPS,
                ]
            ),
            np.zeros(2),
            np.zeros(1),
            np.zeros(1),
            np.zeros(1),
            np.zeros(1, dtype=np.int64),
            np.zeros(1, dtype=np.int64),
            np.zeros(1, dtype=np.int64),
            unknowns.copy(),
            unknowns.copy(),
            np.zeros(changing),
            np.zeros(changing),
            np.zeros(changing),
            np.zeros((MEMORY, changing)),
            np.zeros((MEMORY, len(unknowns))),
            *(programs[name] for name in CALLS),
        )
        t[0], y[:] = state["t"], before.present_state if before else tree.start
        begin = self.evaluation.finish(t, y, after, y_dot, lam, guard)
        for program in (begin, programs["record"]):  # projected velocities, the reaction
            program.run()
        self.reaction = bodies.lam.copy()[None]
        if before:  # the same canonical coordinates; the rows in use may be others
            for name in ("start", "rest", "most"):
                getattr(self.stages, name)[:] = getattr(before.stages, name)
        else:
            y[:] = after
            z[0] = y[:nq]
            programs["enter"].run()
            self.stages.start[:] = z
        z[:] = self.stages.start
        closing.factor(t, z).run()
        self._entries = BoundFunction(step, self.stages), BoundFunction(finish, self.stages)
        self.stretch(0)

    @property
    def present_state(self) -> np.ndarray:
        """Coordinates and velocities y at the end of the last step."""
        return self.stages.y  # type: ignore[no-any-return]

    @property
    def has_poor_pivots(self) -> bool:
        """Flag of poor pivots, or of rows left out that are open, with which the march cannot continue."""
        s = self.stages
        return not (s.guard[0] > s.limits[0] and s.guard[1] < s.limits[1])

    def restart(self, order: EliminationOrder | None) -> "SymplecticMarcher":
        """Return a marcher at the same canonical coordinates, with this order of elimination."""
        return SymplecticMarcher(self.problem, self.state, self.tableau, self, order, radial=self.radial)

    def continue_without_pivots(self) -> None:
        """Continue with the present pivots if they exceed ``LEAST_PIVOT`` and no row left out is open."""
        s = self.stages
        if s.limits[0] > LEAST_PIVOT and s.guard[0] > LEAST_PIVOT and s.guard[1] < s.limits[1]:
            s.limits[0], self.state["outcome"] = LEAST_PIVOT, FULL

    def explain(self, outcome: int) -> str:
        """Return the message for an ``outcome`` of the march, with advice: rattle, or a shorter step."""
        if self.has_poor_pivots:
            return f"{super().explain(outcome)}: use rattle"
        helps = SHORTER if outcome == STUCK and isinstance(self.hamilton, TreePhase) else ""
        return f"{ENDS[outcome][1]}{helps}"

    @property
    def notes(self) -> list[str]:
        """Notes on the evaluation of the mechanism, on its loops, and on what acts on it."""
        system, notes = self.problem.system, [self.hamilton.words, *super().notes[1:]]
        if not system.is_conservative:
            act = "user forces" if len(system.user_i) else "dampers, loads or drives"
            notes.append(f"{act} act: the order holds, a claim on energy does not")
        return notes

    @property
    def counters(self) -> dict[str, int]:
        """Largest number of sweeps that a step has taken."""
        return {"most_sweeps": int(self.stages.most[0])}


METHOD = Method(lambda kernel, state: None, step, finish, counters=("evaluations", "iterations"))


def refuse_problem(problem: Problem) -> str | None:
    """Return the refusal of rows without phi, or of a mechanism too large for both code and recursion, or None."""
    return refuse_without_phi(problem.system) or refuse_loop_rows(problem)


def integrate(
    problem: Problem, control: StepControl, tableau: CollocationTableau, *, radial: bool = False
) -> Trajectory:
    """Integrate by symplectic steps of ``tableau`` with the fixed step ``control.dt``, and return the trajectory.

    ``radial`` includes the energy and the rows that keep quaternions at length one, for methods that do not keep
    quadratic invariants.
    """
    state = make_control(t_end=problem.t_end, dt=control.dt or 0.0)
    return integrate_by_relay(
        problem, control, METHOD, lambda: SymplecticMarcher(problem, state, tableau, radial=radial)
    )
