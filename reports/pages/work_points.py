"""What each run cost and how far off it was: from the judgement where there is one, else from the records."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.accuracy import measure_for
from ..model.results import Results
from .judgement import Entry
from .links import Links, page_of

WORKS = (
    ("operations", "evaluations and factorisations", ""),
    ("evaluations", "evaluations", ""),
    ("factorisations", "factorisations", ""),
    ("steps", "accepted steps", ""),
    ("cpu", "CPU time", "s"),
)
ERRORS = (("error", "error", ""), ("energy", "largest energy error", "J"), ("phi", "largest |φ|", "m"))


@dataclass(frozen=True)
class Work:
    """One run as a point; ``works`` and ``errors`` by the keys of ``WORKS`` and ``ERRORS``."""

    variant: str
    problem: str
    solver: str
    words: str
    page: str
    status: str
    label: str
    default: bool  # no option but step or tolerance
    best: bool
    works: dict[str, float]
    errors: dict[str, float]
    method: str  # runs of one method at several steps are joined by a line
    step: str = ""  # step or tolerance in words
    fineness: float = 0.0
    kind: str = "error"
    unit: str = ""
    own: float = math.nan  # error of the reference itself


@dataclass(frozen=True)
class Field:
    """All runs of a variant."""

    variant: str
    slug: str
    points: tuple[Work, ...]

    @property
    def kind(self) -> str:
        """Which error it is, with its unit; of most points, so that different kinds are not mixed."""
        kinds = [f"{p.kind} [{p.unit}]" if p.unit else p.kind for p in self.points if p.errors["error"] >= 0.0]
        return max(set(kinds), key=lambda k: (kinds.count(k), k)) if kinds else "error"

    @property
    def own(self) -> float:
        """The reference's own error: points below it are not told apart."""
        return max((p.own for p in self.points if p.own > 0.0), default=math.nan)


@dataclass(frozen=True)
class Profile:
    """One solver: after how much work it has reached how many of all targets."""

    solver: str
    work: str
    total: int
    at: tuple[float, ...] = ()  # work at each target reached, sorted
    tuned: bool = True  # by the best of all settings; else by default options alone

    @property
    def share(self) -> float:
        return len(self.at) / self.total if self.total else 0.0


def fields(results: Results, rows: Sequence[Entry], links: Links) -> tuple[Field, ...]:
    """One a variant that has a point; judged points where there are any."""
    points = [p for e in rows if (p := _judged(e, links)) is not None] or _recorded(results)
    out: list[Field] = []
    slugs = {p.title: p.slug for p in results.variants}
    order = {p.title: k for k, p in enumerate(results.variants)}
    for name in sorted({p.variant for p in points}, key=lambda n: (order.get(n, len(order)), n)):
        own = tuple(p for p in points if p.variant == name)
        if any(_drawable(p) for p in own):
            out.append(Field(name, slugs.get(name, f"other-{len(out)}"), own))
    return tuple(out)


def profiles(rows: Sequence[Entry], *, tuned: bool = True) -> tuple[Profile, ...]:
    """As judged, by kind of work, those that no machine changes first, and by solver."""
    order, found = [key for key, _, _ in WORKS], []
    for e in rows:
        at = tuple(sorted(v for v in e.numbers("target_work") if math.isfinite(v)))
        total = e.number("total")
        found.append(Profile(e.text("solver"), e.text("work"), int(total) if total >= 0.0 else len(at), at, tuned))
    known = {work: k for k, work in enumerate(order)}
    return tuple(sorted(found, key=lambda p: (known.get(p.work, len(order)), p.work, p.solver)))


def _drawable(p: Work) -> bool:
    return any(v >= 0.0 for v in p.works.values()) and any(v >= 0.0 for v in p.errors.values())


def _judged(e: Entry, links: Links) -> Work | None:
    run = links.run(e.text("run"))
    if run is None and not e.text("solver"):
        return None
    works = {key: e.number("cpu_s" if key == "cpu" else key) for key, _, _ in WORKS}
    errors = {"error": e.number("error"), "energy": e.number("energy_drift_J"), "phi": e.number("phi_max")}
    return Work(
        e.text("variant") or (run.variant if run else e.text("problem")),
        e.text("problem"),
        e.text("solver"),
        e.text("case") or links.words(e.text("run")),
        links.page(e.text("run")),
        e.text("status") or (run.status if run else "unknown"),
        e.text("label"),
        run is not None and not run.options,
        e.flag("best") is True,
        works,
        errors,
        run.method if run else e.text("solver"),
        run.step_words if run else "",
        run.fineness if run else 0.0,
        e.text("error_kind") or "error",
        e.text("unit"),
        e.number("reference_own_error"),
    )


def _recorded(results: Results) -> list[Work]:
    """Straight from the records: all but which settings are the best."""
    out = []
    for variant in results.variants:
        measure = measure_for(variant.runs)
        for c in variant.runs:
            r = c.record
            counted = {"evaluations": r.evaluations, "factorisations": r.factorisations, "steps": float(r.steps)}
            both = r.evaluations + (0.0 if math.isnan(r.factorisations) else r.factorisations)
            works = {"operations": both, **counted, "cpu": r.cpu_median_s}
            error = measure.of(c) if measure else math.nan
            errors = {"error": error, "energy": r.energy_drift_max_J, "phi": r.phi_max}
            kind, unit, own = (measure.what, measure.unit, measure.own) if measure else ("error", "", math.nan)
            out.append(Work(c.variant, r.problem, r.solver, r.case, page_of(c), c.status, r.label, not c.options,
                            False, works, errors, c.method, c.step_words, c.fineness, kind, unit, own))  # fmt: skip
    return out


def ended(run_status: str) -> str:
    """How plots mark a point: nothing, a star or a cross."""
    return "wrong" if run_status == "wrong" else "" if run_status in ("success", "unknown") else "failed"
