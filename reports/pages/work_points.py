"""What each run cost and how far off it was: from the judgement where there is one, else from the records."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.results import Results
from ..plots.work import ERRORS, WORKS, Point, Profile, kind_of, method_of, recorded, reference_error
from .judgement import Entry
from .links import Links, page_of


@dataclass(frozen=True)
class Field:
    """All runs of a variant."""

    variant: str
    slug: str
    points: tuple[Point, ...]

    @property
    def kind(self) -> str:
        """Which error most points have, with its unit."""
        what, unit = kind_of(self.points)
        return f"{what} [{unit}]" if unit else what

    @property
    def own(self) -> float:
        """The reference's own error: points below it cannot be distinguished."""
        return reference_error(self.points)


def fields(results: Results, rows: Sequence[Entry], links: Links) -> tuple[Field, ...]:
    """One a variant that has a point; judged points where there are any."""
    points = [p for e in rows if (p := _judged(e, links)) is not None] or [
        p for variant in results.variants for p in recorded(variant, page_of)
    ]
    out: list[Field] = []
    slugs = {p.title: p.slug for p in results.variants}
    order = {p.title: k for k, p in enumerate(results.variants)}
    for name in sorted({p.variant for p in points}, key=lambda n: (order.get(n, len(order)), n)):
        own = tuple(p for p in points if p.variant == name)
        if any(p.drawable(error, work) for p in own for error in ERRORS for work in WORKS):
            out.append(Field(name, slugs.get(name, f"other-{len(out)}"), own))
    return tuple(out)


def profiles(rows: Sequence[Entry], *, tuned: bool = True) -> tuple[Profile, ...]:
    """As judged, by kind of work, those that no machine changes first, and by solver."""
    order, found = list(WORKS), []
    for e in rows:
        at = tuple(sorted(v for v in e.numbers("target_work") if math.isfinite(v)))
        total = e.number("total")
        found.append(Profile(e.text("solver"), e.text("work"), int(total) if total >= 0.0 else len(at), at, tuned))
    known = {work: k for k, work in enumerate(order)}
    return tuple(sorted(found, key=lambda p: (known.get(p.work, len(order)), p.work, p.solver)))


def _judged(e: Entry, links: Links) -> Point | None:
    run = links.run(e.text("run"))
    if run is None and not e.text("solver"):
        return None
    works = {key: e.number("cpu_s" if key == "cpu" else key) for key in WORKS}
    errors = {"error": e.number("error"), "energy": e.number("energy_drift_J"), "phi": e.number("phi_max")}
    return Point(
        e.text("variant") or (run.variant if run else e.text("problem")),
        e.text("problem"),
        e.text("solver"),
        e.text("case") or links.words(e.text("run")),
        links.page(e.text("run")),
        e.text("status") or (run.status if run else "unknown"),
        e.text("label"),
        works,
        errors,
        method_of(run) if run else e.text("solver"),
        default=run is not None and not run.options,
        best=e.flag("best") is True,
        step=run.step_words if run else "",
        size=run.step_or_tolerance if run else 0.0,
        kind=e.text("error_kind") or "error",
        unit=e.text("unit"),
        own=e.number("reference_own_error"),
        cpu=(run.record.cpu_min_s, run.record.cpu_max_s) if run else (math.nan, math.nan),
        repeats=run.record.repeats if run else 0,
    )
