"""Build the overview of solvers by problems, each at its finest settings, coloured by how near it comes to a limit."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from .margin import Margin, find_margin
from .results import StoredResults, StoredRun, Variant, group_by_solver
from .scores import find_finest
from .variants import find_plain_label, select_plain_runs, select_variants
from .words import Mark, join_words, mark_status, number, plural

FEW = 0.5  # least fraction of the solvers that ran a column's variant, so that counts compare
# kinds of endings, best first; the last two have no error
RANKS = ("good", "inaccurate", "failed", "wrong", "open", "refused")
LEAST = 1e-16  # smaller margins are equal
EQUAL = 1.1  # margins within this ratio are equal: ten per cent do not distinguish solvers


@dataclass(frozen=True)
class HeatCell:
    """The result of a solver's finest settings on a problem: one coloured box of the heat map."""

    run: StoredRun

    @cached_property
    def mark(self) -> Mark:
        """The symbol, word and kind of the run's status."""
        return mark_status(self.run.status)

    @cached_property
    def margin(self) -> Margin | None:
        """The error that is the largest fraction of its limit; None if nothing was measured."""
        return find_margin(self.run)

    @property
    def level(self) -> int | None:
        """The class of colour, see ``LEVELS``; None for a run that ended early, whatever its error."""
        return None if self.margin is None or self.mark.kind in ("failed", "open", "refused") else self.margin.level

    @property
    def text(self) -> str:
        """The margin in few digits; for a run that stopped, the fraction of the time it reached; else empty."""
        r = self.run.record
        if self.mark.kind == "failed" and r.t_end_s > 0.0 and r.t_reached_s >= 0.0:
            return f"at {100.0 * r.t_reached_s / r.t_end_s:.0f} %"
        if self.level is None or self.margin is None or math.isinf(self.margin.ratio):
            return ""
        return number(self.margin.ratio, 2 if self.margin.ratio >= 0.1 else 1)

    @property
    def why(self) -> str:
        """The reason for the run's ending, or how near the run came to a limit."""
        return self.run.reasons[0] if self.run.reasons else self.margin.words if self.margin else ""

    @property
    def words(self) -> str:
        """The ending of the run and its reason, in words."""
        words = f"{self.run.record.solver} on {self.run.variant}, {self.run.step_words}: {self.mark.word}"
        return f"{words}: {self.why}" if self.why else words

    @property
    def order(self) -> tuple[int, float]:
        """The sort key that puts the best first."""
        ratio = self.margin.ratio if self.margin else math.inf
        return RANKS.index(self.mark.kind), max(ratio, LEAST)


@dataclass(frozen=True)
class HeatRow:
    """A solver's results; None on a problem that it did not run."""

    solver: str
    boxes: tuple[HeatCell | None, ...]

    @property
    def paper_label(self) -> str:
        """The solver's name in the paper."""
        return next((b.run.record.paper_label for b in self.boxes if b is not None), "")

    @property
    def succeeded(self) -> int:
        """The number of problems on which its finest settings are a success."""
        return sum(b is not None and b.run.is_success for b in self.boxes)

    @property
    def counted(self) -> int:
        """The number of problems on which it has an outcome: all but those not run or not finished here."""
        return sum(b is not None and not b.run.is_unfinished for b in self.boxes)

    @property
    def order(self) -> tuple[int, float, str]:
        """The sort key: most successes first, then the mean number of digits between errors and limits."""
        digits = [math.log10(min(b.order[1], 1e16)) for b in self.boxes if b is not None and b.margin]
        return -self.succeeded, sum(digits) / max(len(digits), 1), self.solver


@dataclass(frozen=True)
class HeatMap:
    """The results of all solvers on the same problems."""

    problems: tuple[Variant, ...]
    rows: tuple[HeatRow, ...]

    @property
    def title(self) -> str:
        """The sentence above the map: how many solvers stay within every limit on all problems.

        They are counted among the solvers that have an outcome on every problem, be it a stop or a refusal, or else
        among all.
        """
        count = len(self.problems)
        compared = [row for row in self.rows if row.counted == count] or self.rows
        within = sum(row.succeeded == count for row in compared)
        note = " (each set of parameters counted)" * (len({v.problem for v in self.problems}) < count)
        problems = self.problems[0].title if count == 1 else f"all {count} problems{note}"
        verb = "stays" if within == 1 else "stay"
        if len(compared) == len(self.rows):
            who, where = plural(len(compared), "solver"), f" on {problems}"
        else:
            who, where = f"{plural(len(compared), 'solver')} with an outcome on {problems}", ""
        return f"{within} of {who} {verb} within every limit{where}, each at its finest setting"


def sort_cells(boxes: Iterable[HeatCell]) -> list[HeatCell]:
    """Sort the cells, the best first, leaving out refused and unfinished runs."""
    return sorted((b for b in boxes if b.mark.kind not in ("open", "refused")), key=lambda b: b.order)


def describe_extremes(boxes: Sequence[HeatCell]) -> str:
    """Name the solvers that stay farthest below and come nearest to their limits, with settings and margins.

    Settings differ, so that neither is called the best; solvers within ``EQUAL`` of the first are named with it.
    """
    ranked = sort_cells(boxes)
    if len(ranked) < 2:
        return f"{ranked[0].words}." if ranked else "Every solver refused it."
    first, last = (
        f"{b.run.record.solver} ({b.run.step_words}): {'' if b.run.is_success else b.mark.word + ', '}"
        f"{b.why or 'no error is known'}"
        for b in (ranked[0], ranked[-1])
    )
    kind, part = ranked[0].order
    alike = [b.run.record.solver for b in ranked[1:] if b.order[0] == kind and b.order[1] <= EQUAL * part]
    if len(alike) == len(ranked) - 1:
        return f"Each solver at its finest setting: all {len(ranked)} stay as far below their limits, such as {first}."
    beside = f"; as far {'is' if len(alike) == 1 else 'are'} {join_words(alike)}" if alike else ""
    return f"Each solver at its finest setting: farthest below its limits is {first}{beside}. Last is {last}."


def make_cells(variant: Variant, label: str) -> list[HeatCell]:
    """Return the cell of each solver's finest settings under ``label``, else at default options, else at any."""
    own = select_plain_runs(variant, label)
    return [HeatCell(min(runs, key=lambda c: c.finest_first)) for runs in group_by_solver(own).values()]


def make_heat_map(results: StoredResults) -> HeatMap | None:
    """Return the overview of the problems that at least half of the solvers ran; None if there is no such problem.

    A cell has the solver's finest run of the plain comparison. Solvers outside it are shown with their default
    options, where they ran.
    """
    label = find_plain_label(results)
    runs = {
        (p.slug, s): run
        for p in select_variants(results, label)
        for s in results.solvers
        if (run := find_finest(p, s, label)) is not None
    }
    solvers = [s for s in results.solvers if any(s == other for _, other in runs)]
    least = max(FEW * len(solvers), 1)
    problems = tuple(p for p in results.variants if sum((p.slug, s) in runs for s in solvers) >= least)
    for p in problems:
        plain = group_by_solver(c for c in p.runs if not c.options)
        runs |= {(p.slug, s): min(own, key=lambda c: c.finest_first) for s, own in plain.items() if s not in solvers}
    solvers = [s for s in results.solvers if any((p.slug, s) in runs for p in problems)]
    rows = [
        HeatRow(s, tuple(HeatCell(runs[p.slug, s]) if (p.slug, s) in runs else None for p in problems)) for s in solvers
    ]
    return HeatMap(problems, tuple(sorted(rows, key=lambda row: row.order))) if problems else None
