"""The first picture: solvers by problems, each at its finest settings, coloured by how near to a limit it comes."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from .margin import Margin, margin
from .results import Results, Run, Variant, by_solver
from .scores import finest
from .variants import broadest, plain_runs, themselves
from .words import Mark, join_words, mark, number, plural

FEW = 0.5  # of the solvers: a variant that fewer ran is no column, or their counts would not compare
RANKS = ("good", "inaccurate", "failed", "wrong", "open", "refused")  # of endings, best first; the last have no error
LEAST = 1e-16  # margins below are equal
EQUAL = 1.1  # ratio of margins that are equal: a tenth of a margin is no difference between solvers


@dataclass(frozen=True)
class Box:
    """A solver on a problem."""

    run: Run

    @cached_property
    def mark(self) -> Mark:
        return mark(self.run.status)

    @cached_property
    def margin(self) -> Margin | None:
        return margin(self.run)

    @property
    def level(self) -> int | None:
        """Class of colour; none for a run that ended before its time, whatever its error was until then."""
        return None if self.margin is None or self.mark.kind in ("failed", "open", "refused") else self.margin.level

    @property
    def text(self) -> str:
        """The margin in few digits; of a run that stopped the part of the time it reached."""
        r = self.run.record
        if self.mark.kind == "failed" and r.t_end_s > 0.0 and r.t_reached_s >= 0.0:
            return f"at {100.0 * r.t_reached_s / r.t_end_s:.0f} %"
        if self.level is None or self.margin is None or math.isinf(self.margin.part):
            return ""
        return number(self.margin.part, 2 if self.margin.part >= 0.1 else 1)

    @property
    def why(self) -> str:
        """Why it ended so, or how near to a limit."""
        return self.run.reasons[0] if self.run.reasons else self.margin.words if self.margin else ""

    @property
    def words(self) -> str:
        """How it ended and why."""
        words = f"{self.run.record.solver} on {self.run.variant}, {self.run.step_words}: {self.mark.word}"
        return f"{words}: {self.why}" if self.why else words

    @property
    def order(self) -> tuple[int, float]:
        """The best first."""
        part = self.margin.part if self.margin else math.inf
        return RANKS.index(self.mark.kind), max(part, LEAST)


@dataclass(frozen=True)
class Row:
    """A solver; None on a problem that it did not run."""

    solver: str
    boxes: tuple[Box | None, ...]

    @property
    def paper_label(self) -> str:
        """The paper's name of it."""
        return next((b.run.record.paper_label for b in self.boxes if b is not None), "")

    @property
    def succeeded(self) -> int:
        return sum(b is not None and b.run.is_success for b in self.boxes)

    @property
    def counted(self) -> int:
        """Problems that it ran and that it finished here, well or not."""
        return sum(b is not None and not b.run.is_unfinished for b in self.boxes)

    @property
    def order(self) -> tuple[int, float, str]:
        """Most successes first, then by the mean digits between errors and limits."""
        digits = [math.log10(min(b.order[1], 1e16)) for b in self.boxes if b is not None and b.margin]
        return -self.succeeded, sum(digits) / max(len(digits), 1), self.solver


@dataclass(frozen=True)
class Heat:
    """All solvers on the same problems."""

    problems: tuple[Variant, ...]
    rows: tuple[Row, ...]

    @property
    def title(self) -> str:
        """Who stays within all limits, of those that ran every problem to their own end; of all where none did."""
        complete = [row for row in self.rows if row.counted == len(self.problems)] or self.rows
        whole = sum(row.succeeded == len(self.problems) for row in complete)
        apart = " (each set of parameters counted)" * (len({v.problem for v in self.problems}) < len(self.problems))
        name = self.problems[0].title if len(self.problems) == 1 else f"all {len(self.problems)} problems{apart}"
        ran = "" if len(complete) == len(self.rows) else f" that ran {name}"
        stay = f"{'stays' if whole == 1 else 'stay'} within every limit{'' if ran else f' on {name}'}"
        return f"{whole} of {plural(len(complete), 'solver')}{ran} {stay}, each at its finest setting"


def rank(boxes: Iterable[Box]) -> list[Box]:
    """The best first; without those that refused or did not finish here."""
    return sorted((b for b in boxes if b.mark.kind not in ("open", "refused")), key=lambda b: b.order)


def farthest_and_nearest(boxes: Sequence[Box]) -> str:
    """Who stays farthest below its limits and who does not, each with its setting and its largest share of a limit.

    Settings differ, so that neither is called the best; those within ``EQUAL`` of the first are named with it.
    """
    ranked = rank(boxes)
    if len(ranked) < 2:
        return f"{ranked[0].words}." if ranked else "Every solver refused it."
    first, last = (
        f"{b.run.record.solver} ({b.run.step_words}): {'' if b.run.is_success else b.mark.word + ', '}"
        f"{b.why or 'no error is known'}" for b in (ranked[0], ranked[-1])
    )  # fmt: skip
    kind, part = ranked[0].order
    alike = [b.run.record.solver for b in ranked[1:] if b.order[0] == kind and b.order[1] <= EQUAL * part]
    if len(alike) == len(ranked) - 1:
        return f"Each solver at its finest setting: all {len(ranked)} stay as far below their limits, such as {first}."
    beside = f"; as far {'is' if len(alike) == 1 else 'are'} {join_words(alike)}" if alike else ""
    return f"Each solver at its finest setting: farthest below its limits is {first}{beside}. Last is {last}."


def boxes_of(variant: Variant, label: str) -> list[Box]:
    """Boxes of each solver's finest settings under a label, else under those there are."""
    own = plain_runs(variant, label)
    return [Box(min(runs, key=lambda c: c.finest_first)) for runs in by_solver(own).values()]


def heat(results: Results) -> Heat | None:
    """The problems of the plain comparison that at least half of its solvers ran; None where nothing was run.

    Solvers that are not in that comparison are shown with their default options, where they ran.
    """
    label = broadest(results)
    runs = {(p.slug, s): run for p in themselves(results, label) for s in results.solvers
            if (run := finest(p, s, label)) is not None}  # fmt: skip
    solvers = [s for s in results.solvers if any(s == other for _, other in runs)]
    least = max(FEW * len(solvers), 1)
    problems = tuple(p for p in results.variants if sum((p.slug, s) in runs for s in solvers) >= least)
    for p in problems:
        plain = by_solver(c for c in p.runs if not c.options)
        runs |= {(p.slug, s): min(own, key=lambda c: c.finest_first) for s, own in plain.items() if s not in solvers}
    solvers = [s for s in results.solvers if any((p.slug, s) in runs for p in problems)]
    rows = [Row(s, tuple(Box(runs[p.slug, s]) if (p.slug, s) in runs else None for p in problems)) for s in solvers]
    return Heat(problems, tuple(sorted(rows, key=lambda row: row.order))) if problems else None
