"""The failure atlas: how far each solver's runs get, and for every stop its last steps and its cause."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from ....harness.results.records import reasons_of
from ....harness.results.series import Series
from ....harness.results.words import law_of
from ...model.results import Results, Run, by_solver, group_by
from ...model.scores import Score, score
from ...model.words import plural
from ...plots.palette import Look
from ..base import Page, Site
from ..svg import panel
from .causes import CAUSES, Autopsy, Cause, autopsy

DRAWN = 80  # of the last rows
LISTED = 40  # runs named beside the one that is worked out; the pages of solvers and problems have all
SHOWN = (("dt", "step size", "s"), ("energy_error", "|energy error|", "J"), ("phi_norm", "|φ|", "m"))


def survival(runs: Sequence[Run]) -> dict[str, tuple[Score, float]]:
    """By solver: how its runs ended, and the part of the time at which the first of them stopped; 1 if none did."""
    ended = {name: [c for c in own if not c.unfinished] for name, own in sorted(by_solver(runs).items())}
    return {name: (score(own), min((part_reached(c) for c in own if c.stopped), default=1.0))
            for name, own in ended.items()}  # fmt: skip


def part_reached(run: Run) -> float:
    """Part of the asked time that was reached, 0 to 1; 0 for a run without a step."""
    r = run.record
    if not (r.t_end_s > 0.0 and math.isfinite(r.t_reached_s)):
        return 0.0
    return min(max(r.t_reached_s / r.t_end_s, 0.0), 1.0)


@dataclass(frozen=True)
class Family:
    """Stops of one solver on one problem, for one cause; the plainest variant and settings stand for all."""

    stops: tuple[Autopsy, ...]
    panels: tuple[Markup, ...] = ()  # of the head: the last steps drawn

    @property
    def head(self) -> Autopsy:
        return self.stops[0]


@dataclass(frozen=True)
class Group:
    """The stops of one cause."""

    cause: Cause
    families: tuple[Family, ...]

    @property
    def count(self) -> int:
        return sum(len(f.stops) for f in self.families)

    def of(self, solver: str) -> int:
        """How many are a solver's."""
        return sum(len(f.stops) for f in self.families if f.head.run.record.solver == solver)


def groups(results: Results, looks: Mapping[str, Look]) -> tuple[Group, ...]:
    """Every run that stopped, by cause in the order of ``CAUSES``."""
    stops = [autopsy(c, results.series(c, poses=False)) for c in results.runs if c.stopped and not c.unfinished]
    found = []
    for cause in CAUSES:
        own = {s.run.record.run_id: s for s in stops if s.cause is cause}
        families = [Family(tuple(own[c.record.run_id] for c in f),
                           zoom(f[0], results.series(f[0], poses=False), looks[f[0].record.solver].colour))
                    for f in families_of([s.run for s in own.values()])]  # fmt: skip
        if families:
            found.append(Group(cause, tuple(families)))
    return tuple(found)


def zoom(run: Run, series: Series | None, colour: str) -> tuple[Markup, ...]:
    """Step, energy error and |phi| of the last steps; nothing without a series."""
    if series is None or "t" not in series or len(series["t"]) < 3:
        return ()
    rows = min(DRAWN, len(series["t"]) - 1)
    return tuple(
        panel(title, unit, series[name][-rows:].tolist(), colour, star=run.stopped)
        for name, title, unit in SHOWN if name in series
    )  # fmt: skip


def group_broken(runs: Sequence[Run]) -> dict[str, tuple[tuple[Run, ...], ...]]:
    """The wrong ones by the first law they break, the most frequent first, and by solver and problem."""
    found = group_by((c for c in runs if c.status == "wrong"), _first_law)
    ordered = sorted(found.items(), key=lambda kv: (-len(kv[1]), kv[0]))
    return {law: families_of(own) for law, own in ordered}


def _first_law(run: Run) -> str:
    reasons = reasons_of(run.record.wrong_because)
    return law_of(reasons[0]) if reasons else "unknown"


def families_of(runs: Sequence[Run]) -> tuple[tuple[Run, ...], ...]:
    """By problem and solver, the largest first; in each the plainest variant and settings first."""
    plainest = sorted(runs, key=lambda c: (len(c.parameters), len(c.options), c.variant, c.record.case))
    found = group_by(plainest, lambda c: (c.record.problem, c.record.solver))
    return tuple(tuple(found[k]) for k in sorted(found, key=lambda k: (-len(found[k]), k)))


def title(all_of: Score) -> str:
    """How many stopped, and how many claim success without reason."""
    wrong = all_of.wrong
    say = "reports success and is" if wrong == 1 else "report success and are"
    return f"{all_of.stopped} of {plural(all_of.began, 'run')} stopped, {wrong} {say} wrong"


def write(results: Results, site: Site) -> Page | None:
    """``atlas.html``."""
    found = groups(results, site.looks)
    stopped = [c for c in results.runs if c.stopped and not c.unfinished]
    return site.write(
        Page("Failures", "atlas.html", nav=True, order=40), "atlas.html", scripts=["assets/judgement.js"],
        groups=found, title=title(score(results.runs)), survival=survival(results.runs),
        broken=group_broken(results.runs),
        refused=families_of([c for c in results.runs if c.status == "refused"]),
        part=part_reached, listed_at_most=LISTED, stopped_solvers=sorted({c.record.solver for c in stopped}),
        stopped_problems=sorted({c.record.problem for c in stopped}),
    )  # fmt: skip
