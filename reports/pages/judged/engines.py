"""Compare solvers at the settings that their users get and at the best of one tuning budget."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....harness.results.least_cost import find_cheapest
from ...model.accuracy import ErrorMeasure, choose_measure
from ...model.results import StoredResults, StoredRun, Variant, group_by
from ...model.words import format_decade
from ...plots.spec import Axis, Plot, Trace, choose_end_mark
from ..base import Page, Site

SHIPPED, TUNED = "as shipped", "tuned"  # labels of the runs
TARGET = 1e-3  # error that tuning aims at, in the unit of the problem's error
MADE_BY = re.compile(r"[a-z][\w-]* \d+\.\d\S*")  # package and version, which every run of an engine notes
SOUND = ("success", "inaccurate", "wrong")  # statuses of runs that reached the end


@dataclass(frozen=True)
class ContestPair:
    """A solver on a problem; ``best`` is its cheapest run within the target, else its most accurate one."""

    who: str  # see ``name_contestant``
    shipped: StoredRun | None  # its run as shipped, if there is one
    best: StoredRun
    tried: int  # number of tuned settings

    @property
    def made_by(self) -> str:
        """The package and version that computed the runs; empty for solvers of this package."""
        return ", ".join(list_packages([self.best] if self.shipped is None else [self.shipped, self.best]))


@dataclass(frozen=True)
class Contest:
    """The pairs of a problem, the most accurate as shipped first."""

    variant: Variant
    measure: ErrorMeasure
    pairs: tuple[ContestPair, ...] = ()

    def error(self, run: StoredRun | None) -> float:
        """Return the error of a run; NaN if it is missing or did not reach the end."""
        return self.measure.of(run) if run is not None and run.status in SOUND else math.nan

    def rank(self, run: StoredRun | None) -> float:
        """Return the error of a run to sort by, infinite for one that is missing or did not reach its end."""
        return error if (error := self.error(run)) == error else math.inf

    def count_within(self, runs: Sequence[StoredRun | None]) -> tuple[int, int]:
        """Count the runs within the target, and those that were run and not refused."""
        made = [run for run in runs if run is not None and run.status != "refused"]
        return sum(self.error(run) <= TARGET for run in made), len(made)

    @property
    def tally(self) -> np.ndarray:
        """The counts within the target and in total, as shipped (first row) and tuned (second row)."""
        return np.array([self.count_within([getattr(p, which) for p in self.pairs]) for which in ("shipped", "best")])


def list_contests(results: StoredResults) -> list[Contest]:
    """Return a contest for each problem with a reference that solvers ran as shipped; tuned runs are in it, too."""
    out = []
    for variant in results.variants:
        runs = [c for label in (SHIPPED, TUNED) for c in variant.labels().get(label, ())]
        measure = choose_measure(runs)
        if measure is not None and variant.labels().get(SHIPPED):
            contest = Contest(variant, measure)
            pairs = [_make_pair(contest, who, own) for who, own in group_by(runs, name_contestant).items()]
            pairs.sort(key=lambda p: (contest.rank(p.shipped), contest.rank(p.best), p.who))
            out.append(replace(contest, pairs=tuple(pairs)))
    return out


def list_packages(runs: Iterable[StoredRun]) -> list[str]:
    """List the packages with versions that computed ``runs``, from their notes: ``mujoco 4.0.1``."""
    return sorted({note for run in runs for note in run.notes if MADE_BY.fullmatch(note)})


def describe_budget(found: Sequence[Contest]) -> str:
    """Describe the tuning budget, read from the runs: settings per solver, steps or tolerances, and CPU limit."""
    tuned = [c.record for contest in found for c in contest.variant.labels().get(TUNED, ())]
    if not tuned:
        return "nothing has been tuned yet"
    tried, limit = (
        _format_range([p.tried for c in found for p in c.pairs]),
        _format_range([r.cpu_limit_s for r in tuned]),
    )
    steps, tolerances = ([getattr(r, name) for r in tuned if getattr(r, name) > 0.0] for name in ("dt_s", "rtol"))
    spans = [
        f"{what} {_format_range(values)}{unit}"
        for what, values, unit in (("steps of", steps, " s"), ("tolerances of", tolerances, ""))
        if values
    ]
    return f"{tried} settings of each, {' or '.join(spans)}, {limit} s of CPU a run"


def _format_range(values: Sequence[float]) -> str:
    """Format the least and the largest of numbers: ``0.001 to 0.1``, or one number if they are equal."""
    least, most = min(values), max(values)
    return f"{least:g}" if least == most else f"{least:g} to {most:g}"


def name_contestant(run: StoredRun) -> str:
    """Return the solver's name, with its option ``solver`` for an engine that has several."""
    return " ".join([run.record.solver, *([str(run.options["solver"])] if "solver" in run.options else [])])


def _make_pair(contest: Contest, who: str, runs: Sequence[StoredRun]) -> ContestPair:
    """Return a contestant's run as shipped, and the best of all its ``runs``, as a pair."""
    shipped = next((c for c in runs if c.record.label == SHIPPED), None)
    best = find_cheapest(runs, TARGET, contest.error, lambda c: c.record.cpu_median_s) or min(runs, key=contest.rank)
    return ContestPair(who, shipped, best, sum(c.record.label == TUNED for c in runs))


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``engines.html`` to the site and return the page; None if no solver ran as shipped."""
    found = list_contests(results)
    if not found:
        return None
    plots = [_plot_contest(c, site) for c in found]
    shipped, tuned = np.sum([c.tally for c in found], axis=0)
    within = f"within {format_decade(TARGET)} m or rad"
    title = f"As shipped, {shipped[0]} of {shipped[1]} come {within}; tuned, {tuned[0]} of {tuned[1]}"
    return site.write(
        Page("Engines", "engines.html", nav=True, order=31),
        "engines.html",
        plots=plots,
        title=title,
        target=TARGET,
        budget=describe_budget(found),
        hidden=frozenset({"settings", "solver"}),
        contests=list(zip(found, plots, strict=True)),
    )


def _plot_contest(contest: Contest, site: Site) -> Plot:
    """Plot error against CPU time with a line from each contestant as shipped to its best settings."""
    measure, traces = contest.measure, []
    for pair in contest.pairs:
        runs = [c for c in dict.fromkeys((pair.shipped, pair.best)) if c is not None]
        runs = [c for c in runs if contest.error(c) >= 0.0 and c.record.cpu_median_s > 0.0]
        if runs:
            traces.append(
                Trace(
                    pair.who,
                    np.array([c.record.cpu_median_s for c in runs]),
                    np.array([contest.error(c) for c in runs]),
                    solver=runs[0].record.solver,
                    mode="lines+markers",
                    ends=[choose_end_mark(c.status) for c in runs],
                    urls=[site.url(c) for c in runs],
                    words=[f"{pair.who}, {c.record.label}: {c.settings()}" for c in runs],
                )
            )
    shipped, tuned = contest.tally
    finding = f"within {format_decade(TARGET)} {measure.unit} as shipped {shipped[0]} of {shipped[1]}"
    return Plot(
        f"engines-{contest.variant.slug}",
        f"{measure.what[0].upper()}{measure.what[1:]} as shipped and tuned",
        "Each line leads from a contestant as shipped to its best settings. Cross: wrong.",
        Axis("CPU time", "s", log=True),
        Axis(measure.what, measure.unit, log=True),
        traces,
        finding=f"{contest.variant.title}: {finding}, tuned {tuned[0]} of {tuned[1]}",
    )
