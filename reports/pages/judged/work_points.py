"""Cost and error of each run: from the judgement where there is one, else from the records."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ....harness.results.judgements.runs import WorkPoint, WorkProfile
from ...model.results import Results
from ...model.words import mark
from ...plots.work import ERRORS, WORKS, Point, kind_of, list_points, method_of, reference_error
from ..judgement import Links, page_of


@dataclass(frozen=True)
class Field:
    """All runs of a variant; ``absent``: solvers without a point, and why."""

    variant: str
    slug: str
    points: tuple[Point, ...]
    absent: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """Which error most points have, with its unit."""
        what, unit = kind_of(self.points)
        return f"{what} [{unit}]" if unit else what

    @property
    def own(self) -> float:
        """The reference's stated error: errors below it cannot be compared."""
        return reference_error(self.points)


def fields(results: Results, judged: Sequence[WorkPoint], links: Links) -> tuple[Field, ...]:
    """One a variant that has a point, those that most solvers ran first; judged points where there are any."""
    points = [_judge_point(p, links) for p in judged] or [p for v in results.variants for p in list_points(v, page_of)]
    out: list[Field] = []
    slugs = {p.title: p.slug for p in results.variants}
    order = {p.title: k for k, p in enumerate(results.variants)}
    for name in sorted({p.variant for p in points}, key=lambda n: (order.get(n, len(order)), n)):
        own = tuple(p for p in points if p.variant == name)
        drawn = {p.solver for p in own if any(p.drawable(error, work) for error in ERRORS for work in WORKS)}
        if drawn:
            absent = tuple(f"{s} ({_describe_failures(results, name, s)})" for s in results.solvers if s not in drawn)
            out.append(Field(name, slugs.get(name, f"other-{len(out)}"), own, absent))
    return tuple(sorted(out, key=lambda f: len(f.absent)))


def _describe_failures(results: Results, variant: str, solver: str) -> str:
    """How the runs ended that no plot can show."""
    ends = Counter(mark(c.status).word for c in results.runs if (c.variant, c.record.solver) == (variant, solver))
    return ", ".join(ends) or "not run"


def profiles(found: Sequence[WorkProfile]) -> list[WorkProfile]:
    """As judged, by kind of work, those that no machine changes first, and by solver."""
    return sorted(found, key=lambda p: (list(WORKS).index(p.work), p.solver))


def _judge_point(p: WorkPoint, links: Links) -> Point:
    run = links.runs.get(p.settings_id)
    works = {key: p.cpu_s if key == "cpu" else float(getattr(p, key)) for key in WORKS}
    errors = {"error": p.error, "energy": p.energy_drift_J, "phi": p.phi_max}
    point = Point(
        p.variant, p.problem, p.solver, p.case, links.page(p.settings_id), p.status, p.label, works, errors, p.solver,
        best=p.best, kind=p.error_kind, unit=p.unit, own=p.reference_own_error,
    )  # fmt: skip
    if run is None:
        return point
    r = run.record
    return replace(point, method=method_of(run), default=not run.options, step=run.step_words,
                   size=run.step_or_tolerance, cpu=(r.cpu_min_s, r.cpu_max_s), repeats=r.repeats)  # fmt: skip
