"""Examine whether a code computes one motion for all forms of a mechanism, and the true one.

``own`` is the code's own error: how far half the step (or a tolerance ``FINER`` times as small) moves its answer, in
both forms together. A deviation counts beyond ten times that and ``floor`` of the size of the mechanism, with the
coarse and with the fine step (``judge.invariance``). The true motion is that of ``TRUTH`` at two tolerances, in both
forms; where these differ, the outcome is undecided.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from ...base.shapes import LARGEST
from ...catalogue import registry
from ...judge.distance import measure_distance
from ...judge.invariance import AMPLIFIED, bound_difference, do_routes_agree, exceeds_bound, is_fault_confirmed
from ...mechanics.dynamics import accelerations
from ...mechanics.state import State
from ...mechanics.types import Problem, Solver, Status, StepControl
from ...reference.computation import compute_reference, is_computable
from .mechanism import RandomMechanism
from .presenting import Form

FLOOR, FINER = 1e-7, 32.0
RTOL, CPU = 1e-7, 5.0  # tolerance of a code with error control; [s] for one motion
TRUTH, TRUE, NEARLY = "rkmk_dop853", 1e-12, 1e-10
SECOND = "scipy_strong_form"  # shares no equation with the first except the constraint rows


Places = tuple[tuple[float, ...], ...]  # of C of each body [m]


class Behaviour(StrEnum):
    """Classify the behaviour of a code on a mechanism."""

    SOUND = "sound"  # one answer, and no deviation from the true motion
    REFUSED = "refused"
    PARTLY_REFUSED = "refused in one form"
    FAILED = "failed"
    ONE_SIDED = "failed in one form"  # the true motion is known, and one form alone reaches the end
    UNDECIDED = "undecided"  # the true motion is not known well enough
    PRESENTATION = "answer depends on the form"
    TRUTH = "converges to a wrong motion"
    CRASHED = "crashed"


class OracleVerdict(StrEnum):
    """Classify the verdicts of independent solutions on a deviation."""

    CONFIRMED = "confirmed"  # they agree on the motion, and the code differs from it
    DISMISSED = "dismissed"  # they agree on the motion, and the code has it
    UNDECIDABLE = "not decidable"  # no reference, or the routes differ


FINDINGS = (Behaviour.PRESENTATION, Behaviour.TRUTH)  # deviations
SHOWN = (*FINDINGS, Behaviour.ONE_SIDED, Behaviour.CRASHED)


@dataclass(frozen=True)
class OracleOutcome:
    """The behaviour of ``solver`` on a mechanism in a form; deviations [m] with the coarse and with the fine step.

    Lengths that are infinite or NaN are replaced by the largest number, since JSON has neither.
    """

    solver: str
    kind: Behaviour
    form: Form = field(default_factory=Form)
    words: str = ""  # why it refused or failed
    deviation: tuple[float, float] = (0.0, 0.0)  # [m] with the coarse and the fine step
    own: float = 0.0  # [m] the code's own error: how far half the step moves its answer
    limit: float = 0.0  # [m] beyond which a deviation counts; 0 if there was nothing to compare
    number: int = -1  # number of the mechanism in its campaign

    def __post_init__(self) -> None:
        coarse, fine = (_finite(x) for x in self.deviation)
        for name, value in (("deviation", (coarse, fine)), ("own", _finite(self.own)), ("limit", _finite(self.limit))):
            object.__setattr__(self, name, value)

    @property
    def strength(self) -> float:
        """The smaller deviation, of coarse and fine step, over its limit; 0 without a limit."""
        return min(self.deviation) / self.limit if self.limit else 0.0


def describe_outcome(o: OracleOutcome) -> str:
    """Describe an outcome in a line: solver, mechanism, behaviour, form, and how far it is off."""
    numbers = f"{min(o.deviation):.2g} m, own error {o.own:.2g} m" if o.limit else o.words
    return f"{o.solver}, mechanism {o.number}: {o.kind} ({o.form}): {numbers}"


@dataclass(frozen=True)
class Oracle:
    """A mechanism in two forms, as drawn and in ``form``, on which codes are examined."""

    mechanism: RandomMechanism
    form: Form
    floor: float = FLOOR

    @cached_property
    def problem(self) -> Problem:
        """The problem as drawn."""
        return self.mechanism.problem()

    @cached_property
    def true_motion(self) -> tuple[State | None, float]:
        """The last state of the true motion, and how far its computations differ [m]; None, inf if one fails."""
        solver = registry.make_solver(TRUTH)
        forms = ((Form(), TRUE), (Form(), NEARLY), (self.form, TRUE))
        found = [self._find_end(solver, form, StepControl(rtol=rtol, cpu_limit=CPU)) for form, rtol in forms]
        ends = [end for end in found if isinstance(end, State)]
        if len(ends) < len(found):
            return None, np.inf
        return ends[0], max(self.measure_distance(ends[0], other) for other in ends[1:])

    def measure_distance(self, a: State, b: State) -> float:
        """Return the largest difference of two states over all bodies [m]: distance of C, or angle times gyration."""
        return float(measure_distance(a, b, self.problem.system.gyration))

    def examine(self, name: str, solver: Solver | None = None) -> OracleOutcome:
        """Solve the mechanism in both forms by the solver ``name``, and return how it behaves.

        Each form is solved twice: with the mechanism's step and half of it, or with two tolerances. A solver that
        refuses a weld as rows gets pins in its place. It is sound if its answers agree between the forms, and with the
        true motion, to ten times the difference that the finer solution makes. ``solver`` has the solver with its
        options; by default these are the default ones.
        """
        control = registry.find_entry("solver", name, registry.solvers()).control if solver is None else solver.control
        solver = registry.make_solver(name) if solver is None else solver
        steps = _make_controls(control, self.mechanism.dt)
        refused = self._find_refusal(solver, Form(), steps[0])
        if refused:
            return OracleOutcome(name, Behaviour.REFUSED, words=refused)
        form, found = self.form, OracleOutcome(name, Behaviour.SOUND, self.form)
        if (refused := self._find_refusal(solver, form, steps[0])) and form.split:
            form = replace(form, weld="pinned")
            refused = self._find_refusal(solver, form, steps[0])
        if refused:
            return replace(found, kind=Behaviour.PARTLY_REFUSED, words=refused, form=form)
        found = replace(found, form=form)
        motions = [[self._find_end(solver, f, step) for step in steps] for f in (Form(), form)]
        ends = [[m for m in pair if isinstance(m, State)] for pair in motions]
        if reasons := [m for pair in motions for m in pair if isinstance(m, str)]:
            alone = sorted(map(len, ends)) == [0, len(steps)]
            known = self.true_motion[1] <= self.floor * self.mechanism.size
            return replace(found, kind=Behaviour.ONE_SIDED if alone and known else Behaviour.FAILED, words=reasons[0])
        halves = [self.measure_distance(*pair) for pair in ends]
        true, spread = self.true_motion
        between = self.measure_distance(ends[0][0], ends[1][0]), self.measure_distance(ends[0][1], ends[1][1])
        found = replace(found, deviation=between, own=sum(halves))
        if true is None or spread > self.floor * self.mechanism.size:
            return replace(found, kind=Behaviour.UNDECIDED)
        floor = self.floor * self.mechanism.size + AMPLIFIED * spread
        found = replace(found, limit=bound_difference(sum(halves), floor))
        if exceeds_bound(min(between), found.limit):
            return replace(found, kind=Behaviour.PRESENTATION)
        for pair, half, which in zip(ends, halves, (Form(), form), strict=True):
            off = self.measure_distance(pair[0], true), self.measure_distance(pair[1], true)
            bound = bound_difference(half, floor)
            if exceeds_bound(min(off), bound):
                return replace(found, kind=Behaviour.TRUTH, deviation=off, own=half, limit=bound, form=which)
        return found

    def collect_answers(self, solver: Solver) -> tuple[dict[str, Places], tuple[str, ...]]:
        """Solve again; return the positions of C at the end of the motion [m], by form, and the notes of the run.

        They are those of ``solver`` with the fine step, in each form in which it succeeds, and of the true motion
        (``exact``), if it is known.
        """
        fine, out = _make_controls(solver.control, self.mechanism.dt)[1], dict[str, Places]()
        notes: tuple[str, ...] = ()
        if self.true_motion[0] is not None:
            out["exact"] = _list_positions(self.true_motion[0])
        for form in dict.fromkeys((Form(), self.form)):
            with np.errstate(all="ignore"), suppress(Exception):  # a foreign code may raise anything: no answer
                found = form.solve(solver, self.problem, fine)
                notes = notes or found.notes
                if found.status is Status.SUCCESS:
                    out[str(form)] = _list_positions(found.states[-1])
        return out, notes

    def decide(self, name: str, solver: Solver | None = None) -> tuple[OracleVerdict, str]:
        """Decide whether other routes confirm a deviation of the solver ``name``; return verdict and evidence.

        The deviation is examined again first. The routes are a computed reference and the solvers ``TRUTH`` and
        ``SECOND``. If nothing can be decided, the evidence says why.
        """
        solver = registry.make_solver(name) if solver is None else solver
        found = self.examine(name, solver)
        if found.kind not in FINDINGS:  # a run that fails or is refused now says nothing about the deviation
            verdict = OracleVerdict.DISMISSED if found.kind is Behaviour.SOUND else OracleVerdict.UNDECIDABLE
            return verdict, f"the deviation does not come back: {found.kind}"
        reference = _compute_end(self.problem)
        if reference is None:
            return OracleVerdict.UNDECIDABLE, "the second route states no error for the end of the motion"
        end, error, routes = reference
        true = self.true_motion[0]
        assert true is not None
        other = self._find_end(registry.make_solver(SECOND), Form(), StepControl(rtol=1e-10, cpu_limit=CPU))
        second = np.inf if isinstance(other, str) else self.measure_distance(other, end)
        # the second smallest, since the tested code may be one of them
        if not do_routes_agree(sorted((error, second, self.measure_distance(true, end)))[1], found.limit):
            return OracleVerdict.UNDECIDABLE, "the other routes differ by more than a tenth of the limit"
        fine, off = _make_controls(solver.control, self.mechanism.dt)[1], {}
        for form in dict.fromkeys((Form(), found.form)):
            mine = self._find_end(solver, form, fine)
            off[str(form)] = np.inf if isinstance(mine, str) else self.measure_distance(mine, end)
        others = {SECOND: second, TRUTH: self.measure_distance(true, end)}
        words = "; ".join(
            f"{who}: " + (f"{x:.2g} m" if np.isfinite(x) else "it does not reach the end")
            for who, x in (*off.items(), *others.items())
        )
        evidence = f"Distance from the reference ({routes}): {words}."
        if max(off.values()) == np.inf:
            return OracleVerdict.UNDECIDABLE, "the code does not reach the end again"
        confirmed = is_fault_confirmed(max(off.values()), found.limit)
        return (OracleVerdict.CONFIRMED if confirmed else OracleVerdict.DISMISSED), evidence

    def _find_refusal(self, solver: Solver, form: Form, step: StepControl) -> str | None:
        """Return why a solver refuses the problem in a form, or the exception that it raises; None if it accepts it."""
        try:
            reason = form.refuses(solver, self.problem, step)
            return None if reason is None else str(reason)  # the log holds text only
        except Exception as error:  # a foreign code may raise anything: a result
            return f"{type(error).__name__}: {' '.join(str(error).split())}"

    def _find_end(self, solver: Solver, form: Form, step: StepControl) -> State | str:
        """Solve in a form; return the last state of the bodies as drawn, or the reason why the end is not reached."""
        try:
            with np.errstate(all="ignore"):
                found = form.solve(solver, self.problem, step)
        except Exception as error:  # a solver may raise anything: an answer
            return f"{type(error).__name__}: {' '.join(str(error).split())}"
        last = found.states[-1]
        sound = all(np.all(np.isfinite(a)) for a in (last.r, last.R))
        if found.status is Status.SUCCESS and sound and abs(found.t[-1] / self.problem.t_end - 1.0) < 1e-9:
            return last
        return f"{found.status}: {found.message}"


def _compute_end(problem: Problem) -> tuple[State, float, str] | None:
    """Return the end of the motion by a route independent of the solvers, its error [m], and the route in words.

    Return None if there is no such route, or it does not reach the end.
    """
    start = problem.initial
    rates = accelerations(problem.system, start)
    if not any(map(np.any, (start.v, start.Omega, rates.v_dot, rates.Omega_dot))):
        return start, 0.0, "at rest and without accelerations, nothing moves"
    found = compute_reference(problem) if is_computable(problem.system) else None
    if found is None or found.horizon < problem.t_end:
        return None
    t, routes = np.array([problem.t_end]), "Newton-Euler in quaternions and Lagrange in natural coordinates"
    error = float(found.error(t)[0])
    return found.states(t)[0], error, f"{routes}, which agree to {error:.1g} m"


def _list_positions(end: State) -> Places:
    """Return the positions of C of all bodies [m] as tuples."""
    return tuple(tuple(map(float, r)) for r in end.r)


def _finite(length: float) -> float:
    """Return a length, or the largest number that a file can hold if it is infinite or NaN."""
    return float(np.nan_to_num(length, nan=LARGEST))


def _make_controls(control: str, dt: float) -> list[StepControl]:
    """Return the coarse and the fine step control of a solver whose ``control`` is ``dt`` or ``rtol``.

    ``dt`` [s] is the coarse step; tolerances are ``RTOL`` and one ``FINER`` times as small.
    """
    if control == "dt":
        return [StepControl(dt=step, cpu_limit=CPU) for step in (dt, 0.5 * dt)]
    return [StepControl(rtol=rtol, cpu_limit=CPU) for rtol in (RTOL, RTOL / FINER)]
