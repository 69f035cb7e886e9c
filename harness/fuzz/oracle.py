"""Does a code give one answer to all forms of a mechanism, and the right one?

``own`` is the code's own error: how far half the step (or a tolerance ``FINER`` times as small) moves its answer, in
both forms together. A deviation counts beyond ``TIMES`` of it and ``floor`` of the size of the mechanism, with the
coarse and with the fine step. The truth is ``TRUTH`` at two tolerances, in both forms; where these differ nothing is
decided.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from ..catalogue import registry
from ..mechanics.dynamics import accelerations
from ..mechanics.state import State
from ..reference.computation import compute_reference, is_computable
from ..shapes import LARGEST
from ..types import Problem, Solver, Status, StepControl
from .mechanism import Mechanism
from .presenting import Form

TIMES, FLOOR, FINER = 10.0, 1e-7, 32.0
RTOL, CPU = 1e-7, 5.0  # of a code under error control; [s] for one motion
TRUTH, TRUE, NEARLY = "rkmk_dop853", 1e-12, 1e-10
SECOND = "scipy_strong_form"  # shares no equation with the first beyond the rows
AMPLIFIED = 1e3  # by which the answers of a worse code may differ more than those of the truth


Answer = tuple[State, ...]
Places = tuple[tuple[float, ...], ...]  # of C of each body [m]


class Kind(StrEnum):
    """How a code does on a mechanism."""

    SOUND = "sound"
    REFUSED = "refused"
    PARTLY_REFUSED = "refused in one form"
    FAILED = "failed"
    ONE_SIDED = "failed in one form"
    UNDECIDED = "undecided"
    PRESENTATION = "answer depends on the form"
    TRUTH = "converges to a wrong motion"
    CRASHED = "crashed"


class Verdict(StrEnum):
    """What other routes say of a deviation."""

    CONFIRMED = "confirmed"  # they agree on the motion, and the code is off it
    DISMISSED = "dismissed"  # they agree on the motion, and the code is on it
    UNDECIDABLE = "not decidable"  # no reference, or the routes differ


FINDINGS = (Kind.PRESENTATION, Kind.TRUTH)  # deviations
SHOWN = (*FINDINGS, Kind.ONE_SIDED, Kind.CRASHED)


@dataclass(frozen=True)
class Outcome:
    """How ``solver`` does on a mechanism in a form; lengths in m, with the coarse and with the fine step.

    Lengths beyond all numbers are the largest: JSON has no infinity, and what is written must be read again.
    """

    solver: str
    kind: Kind
    form: Form = field(default_factory=Form)
    words: str = ""
    deviation: tuple[float, float] = (0.0, 0.0)
    own: float = 0.0
    limit: float = 0.0
    number: int = -1

    def __post_init__(self) -> None:
        coarse, fine = (_finite(x) for x in self.deviation)
        for name, value in (("deviation", (coarse, fine)), ("own", _finite(self.own)), ("limit", _finite(self.limit))):
            object.__setattr__(self, name, value)

    @property
    def strength(self) -> float:
        """The deviation over its limit."""
        return min(self.deviation) / self.limit if self.limit else 0.0


@dataclass(frozen=True)
class Oracle:
    """A mechanism in two forms: as drawn, and in ``form``."""

    mechanism: Mechanism
    form: Form
    floor: float = FLOOR

    @cached_property
    def problem(self) -> Problem:
        """As drawn."""
        return self.mechanism.problem()

    @cached_property
    def truth(self) -> tuple[State | None, float]:
        """The end of the true motion, and how far its computations differ [m]; None if one failed."""
        solver = registry.make_solver(TRUTH)
        ends = [_final_state(self._motion(solver, form, StepControl(rtol=rtol, cpu_limit=CPU)))
                for form, rtol in ((Form(), TRUE), (Form(), NEARLY), (self.form, TRUE))]  # fmt: skip
        if any(end is None for end in ends):
            return None, np.inf
        one, *others = (end for end in ends if end is not None)
        return one, max(self.apart(one, other) for other in others)

    def apart(self, a: State, b: State) -> float:
        """Largest distance of C, or angle times radius of gyration [m]."""
        turned = np.linalg.norm(a.R - b.R, axis=(1, 2)) / np.sqrt(2.0) * self.problem.system.gyration
        return float(max(np.max(np.linalg.norm(a.r - b.r, axis=1)), np.max(turned)))

    def examine(self, name: str, solver: Solver | None = None) -> Outcome:
        """The outcome for the solver ``name``, with its default options unless it is given."""
        control = registry.entry_of("solver", name, registry.solvers()).control if solver is None else solver.control
        solver = registry.make_solver(name) if solver is None else solver
        steps = _steps(control, self.mechanism.dt)
        refused = self._refusal(solver, Form(), steps[0])
        if refused:
            return Outcome(name, Kind.REFUSED, words=refused)
        form, found = self.form, Outcome(name, Kind.SOUND, self.form)
        if (refused := self._refusal(solver, form, steps[0])) and form.split:
            form = replace(form, weld="pinned")
            refused = self._refusal(solver, form, steps[0])
        if refused:
            return replace(found, kind=Kind.PARTLY_REFUSED, words=refused, form=form)
        found = replace(found, form=form)
        motions = [[self._motion(solver, f, step) for step in steps] for f in (Form(), form)]
        reached = [[_final_state(m) is not None for m in pair] for pair in motions]
        if not all(map(all, reached)):
            words = next(m if isinstance(m, str) else "it claims success but does not reach the end"
                         for pair in motions for m in pair if _final_state(m) is None)  # fmt: skip
            alone = sorted(map(any, reached)) == [False, True] and sorted(map(all, reached)) == [False, True]
            known = self.truth[1] <= self.floor * self.mechanism.size
            return replace(found, kind=Kind.ONE_SIDED if alone and known else Kind.FAILED, words=words)
        ends = [[m[-1] for m in pair if not isinstance(m, str)] for pair in motions]
        halves = [self.apart(*pair) for pair in ends]
        true, spread = self.truth
        between = self.apart(ends[0][0], ends[1][0]), self.apart(ends[0][1], ends[1][1])
        found = replace(found, deviation=between, own=sum(halves))
        if true is None or spread > self.floor * self.mechanism.size:
            return replace(found, kind=Kind.UNDECIDED)
        floor = self.floor * self.mechanism.size + AMPLIFIED * spread
        found = replace(found, limit=TIMES * sum(halves) + floor)
        if min(between) > found.limit:
            return replace(found, kind=Kind.PRESENTATION)
        for pair, half, which in zip(ends, halves, (Form(), form), strict=True):
            off = self.apart(pair[0], true), self.apart(pair[1], true)
            limit = TIMES * half + floor
            if min(off) > limit:
                return replace(found, kind=Kind.TRUTH, deviation=off, own=half, limit=limit, form=which)
        return found

    def answers(self, solver: Solver) -> tuple[dict[str, Places], tuple[str, ...]]:
        """Where the exact motion ends, and by form that of ``solver`` with the fine step; its notes."""
        fine, out = _steps(solver.control, self.mechanism.dt)[1], dict[str, Places]()
        notes: tuple[str, ...] = ()
        if self.truth[0] is not None:
            out["exact"] = _places(self.truth[0])
        for form in dict.fromkeys((Form(), self.form)):
            with np.errstate(all="ignore"), suppress(Exception):  # of code that is not ours: no answer
                found = form.solve(solver, self.problem, fine)
                notes = notes or found.notes
                if found.status is Status.SUCCESS:
                    out[str(form)] = _places(found.states[-1])
        return out, notes

    def decide(self, name: str, solver: Solver | None = None) -> tuple[Verdict, str]:
        """Whether other routes confirm a deviation of ``name``, and their evidence or why they cannot."""
        solver = registry.make_solver(name) if solver is None else solver
        found = self.examine(name, solver)
        if found.kind not in FINDINGS:  # a run that fails or is refused now shows nothing about the deviation
            again = Verdict.DISMISSED if found.kind is Kind.SOUND else Verdict.UNDECIDABLE
            return again, f"the deviation does not come back: {found.kind}"
        reference = _reference(self.problem)
        if reference is None:
            return Verdict.UNDECIDABLE, "the second route states no error for the end of the motion"
        end, sure, routes = reference
        true = self.truth[0]
        assert true is not None
        other = _final_state(self._motion(registry.make_solver(SECOND), Form(), StepControl(rtol=1e-10, cpu_limit=CPU)))
        second = np.inf if other is None else self.apart(other, end)
        if sorted((sure, second, self.apart(true, end)))[1] > 0.1 * found.limit:  # the tested code may be one of them
            return Verdict.UNDECIDABLE, "the other routes differ by more than a tenth of the limit"
        fine, off = _steps(solver.control, self.mechanism.dt)[1], {}
        for form in dict.fromkeys((Form(), found.form)):
            mine = _final_state(self._motion(solver, form, fine))
            off[str(form)] = np.inf if mine is None else self.apart(mine, end)
        others = {SECOND: second, TRUTH: self.apart(true, end)}
        words = "; ".join(f"{who}: " + (f"{x:.2g} m" if np.isfinite(x) else "it does not reach the end")
                          for who, x in (*off.items(), *others.items()))  # fmt: skip
        evidence = f"Distance from the reference ({routes}): {words}."
        if max(off.values()) == np.inf:
            return Verdict.UNDECIDABLE, "the code does not reach the end again"
        # two answers that differ by more than the limit cannot both be within 0.4 of it of the reference
        return (Verdict.CONFIRMED if max(off.values()) > 0.4 * found.limit else Verdict.DISMISSED), evidence

    def _refusal(self, solver: Solver, form: Form, step: StepControl) -> str | None:
        try:
            reason = form.refuses(solver, self.problem, step)
            return None if reason is None else str(reason)  # the log takes text alone
        except Exception as error:  # of code that is not ours: a result
            return f"{type(error).__name__}: {' '.join(str(error).split())}"

    def _motion(self, solver: Solver, form: Form, step: StepControl) -> "Answer | str":
        """The states of the bodies as drawn, or how it ended before the end."""
        try:
            with np.errstate(all="ignore"):
                found = form.solve(solver, self.problem, step)
        except Exception as error:
            return f"{type(error).__name__}: {' '.join(str(error).split())}"
        last = found.states[-1]
        sound = all(np.all(np.isfinite(a)) for a in (last.r, last.R))
        if found.status is Status.SUCCESS and sound and abs(found.t[-1] / self.problem.t_end - 1.0) < 1e-9:
            return (last,)
        return f"{found.status}: {found.message}"


def _reference(problem: Problem) -> tuple[State, float, str] | None:
    """The end of the motion by a route that is none of the solvers, its error [m], and the route in words."""
    start = problem.initial
    rates = accelerations(problem.system, start)
    if not any(map(np.any, (start.v, start.Omega, rates.v_dot, rates.Omega_dot))):
        return start, 0.0, "at rest and without accelerations, nothing moves"
    found = compute_reference(problem) if is_computable(problem.system) else None
    if found is None or found.horizon < problem.t_end:
        return None
    t, routes = np.array([problem.t_end]), "Newton-Euler in quaternions and Lagrange in natural coordinates"
    sure = float(found.error(t)[0])
    return found.states(t)[0], sure, f"{routes}, which agree to {sure:.1g} m"


def _places(end: State) -> Places:
    return tuple(tuple(map(float, r)) for r in end.r)


def _finite(length: float) -> float:
    return float(np.nan_to_num(length, nan=LARGEST))


def _steps(control: str, dt: float) -> list[StepControl]:
    """The coarse and the fine one."""
    if control == "dt":
        return [StepControl(dt=step, cpu_limit=CPU) for step in (dt, 0.5 * dt)]
    return [StepControl(rtol=rtol, cpu_limit=CPU) for rtol in (RTOL, RTOL / FINER)]


def _final_state(motion: "Answer | str") -> State | None:
    return None if isinstance(motion, str) else motion[-1]
