"""Show how far each solver's runs get, and for every stop its last steps and its cause."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from ....harness.mechanics.types import Status
from ....harness.results.series import Series
from ....harness.results.words import find_broken_law
from ...model.results import StoredResults, StoredRun, group_by, group_by_solver
from ...model.scores import SolverScore, count_outcomes
from ...model.words import claim_success, number, plural
from ...plots.spec import LineStyle
from ..base import Page, Site
from ..svg import draw_panel

DRAWN = 80  # most rows drawn, from the end
LISTED = 40  # runs named beside the one shown in detail; the pages of solvers and problems list all
SHOWN = (("dt", "step size", "s"), ("energy_error", "|energy error|", "J"), ("phi_norm", "|φ|", "m"))
LAST = 120  # rows at the end that are examined
COLLAPSE = 1e-3  # fraction of the usual step: a smaller step is no longer a choice of accuracy
NEAR_CHART = 0.05  # |sin theta| below which the angles' rates are 20 times the body's
ENERGY = 0.1  # fraction of the exchangeable energy at which a claimed success is wrong
APART = 0.01  # fraction of the mechanism's size at which a joint is open and a claimed success is wrong
GROWTH = 100.0  # growth within the last rows that exceeds an oscillation
CAUSES = ("killed", "unmoved", "chart", "dependent", "energy", "apart", "collapse", "corrector", "limit")


def tabulate_survival(runs: Sequence[StoredRun]) -> dict[str, tuple[SolverScore, float]]:
    """Return by solver how its runs ended, and the least fraction of the time that a stopped run reached; 1 for none.

    Unfinished runs are left out.
    """
    ended = {name: [c for c in own if not c.is_unfinished] for name, own in sorted(group_by_solver(runs).items())}
    return {
        name: (count_outcomes(own), min((compute_reached_fraction(c) for c in own if c.has_stopped), default=1.0))
        for name, own in ended.items()
    }


def compute_reached_fraction(run: StoredRun) -> float:
    """Return the fraction of the requested time that was reached, 0 to 1; 0 for a run without a step."""
    r = run.record
    if not (r.t_end_s > 0.0 and math.isfinite(r.t_reached_s)):
        return 0.0
    return min(max(r.t_reached_s / r.t_end_s, 0.0), 1.0)


def group_stops(
    results: StoredResults, stopped: Sequence[StoredRun], looks: Mapping[str, LineStyle]
) -> dict[str, dict[str, Any]]:
    """Group the runs that ``stopped`` by cause, in the order of ``CAUSES``, and into families by solver and problem.

    A cause has its families, the number of runs by solver, and their total. A family is represented by the run with the
    plainest settings: by its last steps and the evidence in its series. ``looks`` are line styles by solver.
    """
    found = {c.record.run_id: find_first_cause(c, results.series(c, poses=False)) for c in stopped}
    out = {}
    for cause in CAUSES:
        families: list[dict[str, Any]] = [
            {
                "runs": own,
                "evidence": found[own[0].record.run_id][1],
                "panels": plot_last_steps(
                    own[0], results.series(own[0], poses=False), looks[own[0].record.solver].colour
                ),
            }
            for own in group_families([c for c in stopped if found[c.record.run_id][0] == cause])
        ]
        if families:
            counts = Counter(c.record.solver for f in families for c in f["runs"])
            out[cause] = {"families": families, "counts": counts, "total": counts.total()}
    return out


def plot_last_steps(run: StoredRun, series: Series | None, colour: str) -> tuple[Markup, ...]:
    """Draw a panel each of step size, energy error and |phi| over the last ``DRAWN`` steps; none without a series."""
    if series is None or "t" not in series or len(series["t"]) < 3:
        return ()
    rows = min(DRAWN, len(series["t"]) - 1)
    return tuple(
        draw_panel(title, unit, series.tail(name, rows).tolist(), colour, star=run.has_stopped)
        for name, title, unit in SHOWN
        if name in series
    )


def group_broken(runs: Sequence[StoredRun]) -> dict[str, tuple[tuple[StoredRun, ...], ...]]:
    """Group the wrong ones of ``runs`` by the first law they break, the most frequent first, and into families."""

    def first_law(run: StoredRun) -> str:
        """Return the law that the run breaks, the first if there are several."""
        return next(map(find_broken_law, run.record.reasons), "unknown")

    found = group_by((c for c in runs if c.status == "wrong"), first_law)
    ordered = sorted(found.items(), key=lambda kv: (-len(kv[1]), kv[0]))
    return {law: group_families(own) for law, own in ordered}


def group_families(runs: Sequence[StoredRun]) -> tuple[tuple[StoredRun, ...], ...]:
    """Group runs by problem and solver, the largest group first; in each the plainest variant and settings first."""
    plainest = sorted(runs, key=lambda c: (len(c.parameters), len(c.options), c.variant, c.record.case))
    found = group_by(plainest, lambda c: (c.record.problem, c.record.solver))
    return tuple(tuple(found[k]) for k in sorted(found, key=lambda k: (-len(found[k]), k)))


def state_stops(score: SolverScore) -> str:
    """Return words on how many runs stopped, and how many claim a success that is false."""
    wrong = score.wrong
    return f"{score.stopped} of {plural(score.began, 'run')} stopped, {wrong} {claim_success(wrong)}"


def find_first_cause(run: StoredRun, series: Series | None) -> tuple[str, list[str]]:
    """Return the first of ``CAUSES`` that applies to a stopped run, and the evidence in its series, in words.

    Without two rows of a series there is no evidence, and the cause is "killed" for a crash or a memory limit, else
    "unmoved".
    """
    r, died = run.record, run.status in (Status.CRASHED, Status.MEMORY)
    if series is None or "t" not in series or len(series["t"]) < 2:
        return "killed" if died else "unmoved", []
    signs = [
        s
        for s in (
            _check_chart(series),
            _check_last_value(
                series, "energy", "energy_error", "J", r.energy_scale_J, ENERGY, "energy error {} the energy exchanged"
            ),
            _check_last_value(series, "apart", "phi_norm", "m", r.length_scale_m, APART, "|φ| {} the mechanism's size"),
            _check_step(series),
        )
        if s is not None
    ]
    ended = {
        "killed": died,
        "dependent": run.status == Status.SINGULAR,
        "corrector": run.status in (Status.DIVERGED, Status.STEP_UNDERFLOW),
        "limit": True,
    }
    applies = {key for key, found, _ in signs if found} | {key for key, found in ended.items() if found}
    evidence = [words for _, _, words in signs]
    if r.steps and r.series_rows and r.series_rows < r.steps + 1:
        rows = f"{r.series_rows} of {r.steps + 1} rows"
        evidence.append(f"the series is thinned to {rows}: its last rows span more steps")
    return next(c for c in CAUSES if c in applies), evidence


def _check_step(series: Series) -> tuple[str, bool, str] | None:
    """Return the cause "collapse", whether the step size collapsed at the end, and words; None below two steps."""
    dt = series["dt"][1:] if "dt" in series else np.empty(0)
    dt = dt[np.isfinite(dt)]
    if len(dt) < 2:
        return None
    usual, last = find_usual_step(dt), float(np.min(dt[-3:]))
    if last < COLLAPSE * usual:
        return "collapse", True, f"the step fell from its usual {number(usual)} s to {number(last)} s"
    return "collapse", False, f"the step did not collapse: {number(last)} s at the end, usually {number(usual)} s"


def find_usual_step(dt: Float[np.ndarray, " n"]) -> float:
    """Return the step size such that half of the time was covered by smaller steps and half by larger ones [s].

    The many small steps before a stop then hardly count.
    """
    ordered = np.sort(dt)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.5 * np.sum(ordered))])


def _check_last_value(
    series: Series, cause: str, name: str, unit: str, scale: float, limit: float, words: str
) -> tuple[str, bool, str] | None:
    """Return ``cause``, whether the last value of the series ``name`` exceeds ``limit`` times ``scale``, and evidence.

    The evidence is ``words`` with that value and its percentage of the scale, and with its growth over the last rows if
    that exceeds an oscillation. None is returned without values or scale.
    """
    tail = np.abs(series.tail(name, LAST)) if name in series else np.zeros(0)
    if not len(tail) or not scale > 0.0:
        return None
    last = float(tail[-1])
    share = f"{number(100.0 * last / scale)} %" if not last / scale < 1e-5 else "less than 0.001 %"
    said = words.format(f"{number(last)} {unit} at the end, {share} of")
    before = tail[: len(tail) // 2]
    before = before[np.isfinite(before) & (before > 0.0)]
    factor = last / float(np.median(before)) if len(before) and math.isfinite(last) else 0.0
    if factor > GROWTH:
        said += f", {number(factor)} times its median {len(tail) // 2} to {len(tail)} steps before"
    return cause, not last <= limit * scale, said


def _check_chart(series: Series) -> tuple[str, bool, str] | None:
    """Return the cause "chart", True, and words if the motion came near a singularity of its chart, else None.

    Solvers in Euler angles record |sin theta|, which vanishes there; others record nothing.
    """
    if "diag_chart_margin" not in series:
        return None
    margin = np.abs(series.tail("diag_chart_margin", LAST))
    least = float(np.fmin.reduce(margin, initial=np.inf))  # NaN is left out
    if least >= NEAR_CHART:
        return None
    return "chart", True, f"|sin θ| came down to {number(least)} within the last {len(margin)} steps"


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``atlas.html`` to the site and return the page."""
    stopped = [c for c in results.runs if c.has_stopped and not c.is_unfinished]
    return site.write(
        Page("Failures", "atlas.html", nav=True, order=40),
        "atlas.html",
        scripts=["assets/judgement.js"],
        groups=group_stops(results, stopped, site.looks),
        title=state_stops(count_outcomes(results.runs)),
        survival=tabulate_survival(results.runs),
        broken=group_broken(results.runs),
        refused=group_families([c for c in results.runs if c.status == "refused"]),
        part=compute_reached_fraction,
        listed_at_most=LISTED,
        stopped_solvers=sorted({c.record.solver for c in stopped}),
        stopped_problems=sorted({c.record.problem for c in stopped}),
    )
