"""What each run cost and how far off it was: from the judgement where there is one, else from the records."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.accuracy import measure_for
from ..model.reading import Run
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

    posing: str
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
    """All runs of a problem as posed."""

    posing: str
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


def fields(run: Run, rows: Sequence[Entry], links: Links) -> tuple[Field, ...]:
    """One a posing that has a point; judged points where there are any."""
    points = [p for e in rows if (p := _judged(e, links)) is not None] or _recorded(run)
    out: list[Field] = []
    slugs = {p.title: p.slug for p in run.posings}
    order = {p.title: k for k, p in enumerate(run.posings)}
    for name in sorted({p.posing for p in points}, key=lambda n: (order.get(n, len(order)), n)):
        own = tuple(p for p in points if p.posing == name)
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
    cell = links.cell(e.text("cell"))
    if cell is None and not e.text("solver"):
        return None
    works = {key: e.number("cpu_s" if key == "cpu" else key) for key, _, _ in WORKS}
    errors = {"error": e.number("error"), "energy": e.number("energy_drift_J"), "phi": e.number("phi_max")}
    return Work(
        e.text("posing") or (cell.posing if cell else e.text("problem")),
        e.text("problem"),
        e.text("solver"),
        e.text("case") or links.words(e.text("cell")),
        links.page(e.text("cell")),
        e.text("status") or (cell.status if cell else "unknown"),
        e.text("label"),
        cell is not None and not cell.options,
        e.flag("best") is True,
        works,
        errors,
        cell.method if cell else e.text("solver"),
        cell.step_words if cell else "",
        cell.fineness if cell else 0.0,
        e.text("error_kind") or "error",
        e.text("unit"),
        e.number("reference_own_error"),
    )


def _recorded(run: Run) -> list[Work]:
    """Straight from the records: all but which settings are the best."""
    out = []
    for posing in run.posings:
        measure = measure_for(posing.cells)
        for c in posing.cells:
            r = c.record
            counted = {"evaluations": r.evaluations, "factorisations": r.factorisations, "steps": float(r.steps)}
            both = r.evaluations + (0.0 if math.isnan(r.factorisations) else r.factorisations)
            works = {"operations": both, **counted, "cpu": r.cpu_median_s}
            error = measure.of(c) if measure else math.nan
            errors = {"error": error, "energy": r.energy_drift_max_J, "phi": r.phi_max}
            kind, unit, own = (measure.what, measure.unit, measure.own) if measure else ("error", "", math.nan)
            out.append(Work(c.posing, r.problem, r.solver, r.case, page_of(c), c.status, r.label, not c.options,
                            False, works, errors, c.method, c.step_words, c.fineness, kind, unit, own))  # fmt: skip
    return out


def ended(cell_status: str) -> str:
    """How plots mark a point: nothing, a star or a cross."""
    return "wrong" if cell_status == "wrong" else "" if cell_status in ("success", "unknown") else "failed"
