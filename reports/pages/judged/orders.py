"""Order certificates as a page shows them: each fit with its points, and which of them it was made from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....harness.results.judgements.runs import Note, Order
from ...model.results import group_by, natural, slug
from ...model.words import Mark, plural
from ...plots.spec import Axis, Plot, Trace
from ..judgement import Links

FLOOR = 3.0  # of the floor: points below so many times it are said to lie on it
USED, EARLY, FLOORED = "used", "pre-asymptotic", "at the floor"
NOTES = {
    Note.NO_SCALE: "the records give no scale of its velocities",
    Note.CUT: "steps that were cut are left out",
    Note.UNRESOLVED: "errors that the reference cannot resolve are left out",
}


@dataclass(frozen=True)
class Point:
    """One run of the ladder of steps."""

    dt: float
    error: float
    kind: str


@dataclass(frozen=True)
class Certificate:
    """The order of one quantity of one solver on one variant, as it is shown."""

    of: Order
    points: tuple[Point, ...]
    mark: Mark
    words: str
    runs: tuple[tuple[str, str], ...]

    @property
    def fixed(self) -> bool:
        """A ladder of fixed steps; else of tolerances, over the mean step."""
        return self.of.against == "dt"

    @property
    def fit(self) -> tuple[tuple[float, float], ...]:
        """Two points of the line through those used, in the mean of their logarithms; none if there is no order."""
        used = [(math.log(p.dt), math.log(p.error)) for p in self.points if p.kind == USED and p.error > 0.0 < p.dt]
        if len(used) < 2 or not math.isfinite(self.of.order):
            return ()
        x, y = (sum(p[k] for p in used) / len(used) for k in (0, 1))
        ends = min(p[0] for p in used), max(p[0] for p in used)
        return tuple((math.exp(e), math.exp(y + self.of.order * (e - x))) for e in ends)

    @property
    def order(self) -> str:
        """``2.00``."""
        return f"{self.of.order:.2f}" if math.isfinite(self.of.order) else "–"

    @property
    def interval(self) -> str:
        """``1.98 to 2.03``."""
        return f"{self.of.low:.2f} to {self.of.high:.2f}" if math.isfinite(self.of.low + self.of.high) else "none"


def certificates(orders: Sequence[Order], links: Links) -> tuple[Certificate, ...]:
    """By problem, solver and quantity."""
    ordered = sorted(orders, key=lambda o: (natural(o.variant), o.solver, natural(o.case)))
    return tuple(Certificate(o, _points(o), verdict_mark(o.verdict), words(o), links.all(o.settings_ids))
                 for o in ordered)  # fmt: skip


VERDICTS = {  # of certificates and of drifts
    "certified": ("✓", "good"), "exact": ("✓", "good"), "bounded": ("✓", "good"),
    "above declared": ("△", "refused"), "below declared": ("✗", "wrong"),
    "trend": ("↗", "failed"), "wanders": ("≈", "failed"), "failed": ("★", "failed"),
    "measured": ("○", "refused"), "undecided": ("○", "refused"), "floor": ("○", "refused"),
    "too short": ("–", "refused"), "refused": ("–", "refused"), "not measured": ("★", "failed"),
}  # fmt: skip


def verdict_mark(verdict: str) -> Mark:
    """The mark of a verdict."""
    symbol, kind = VERDICTS[verdict]
    return Mark(symbol, verdict, kind)


def words(o: Order) -> str:
    """The fit in words, and what was left out of it."""
    runs = len(o.dt) + o.unfinished + o.unmeasured
    unfinished = f"{o.unfinished} of {runs} runs did not finish" if o.unfinished and o.verdict != "refused" else ""
    unmeasured = f"{o.unmeasured} of {runs} runs have no error to measure" if 0 < o.unmeasured < runs else ""
    return "; ".join(filter(None, (*_fit(o), unfinished, unmeasured, *(NOTES[n] for n in o.notes))))


def _fit(o: Order) -> list[str]:
    slopes = ", ".join(f"{s:.2f}" for s in o.slopes)
    if o.status:
        return [": ".join(filter(None, (o.status, o.message)))]
    if not o.is_measured:
        return ["too few errors to measure" if o.dt else "no error to measure: no reference"]
    if o.verdict in ("exact", "floor"):
        why = "rounding" if o.verdict == "exact" else "the level of the solver's own tolerance"
        return [f"no order to fit: at most {max(o.error):.1e} {o.unit} at every step, which is {why}"]
    if o.fit == "flat":
        return [f"does not depend on the step: about {sorted(o.error)[len(o.error) // 2]:.1e} {o.unit}"]
    if o.fit == "none":
        few = len(o.slopes) < 3
        return ["too few steps whose errors can be fitted" if few else
                f"no range of steps in which the error is a power of the step (slopes {slopes})"]  # fmt: skip
    inside = [h for h, used in zip(o.dt, o.used, strict=True) if used]
    steps = "steps" if o.against == "dt" else "mean steps"
    out = [f"order {o.order:.2f} ({o.low:.2f} to {o.high:.2f}) over {len(inside)} {steps} of {max(inside):.3g} to "
           f"{min(inside):.3g} s"]  # fmt: skip
    finest = f"finest {'slope' if len(o.slopes) == 1 else 'slopes'} {slopes}"
    if o.fit == "lost":
        do = "does" if len(o.slopes) == 1 else "do"
        return [f"{out[0]}, but the {finest} {do} not follow it, and no floor is seen"]
    if not math.isnan(o.exponent):
        out.append(f"error ~ rtol^{o.exponent:.2f} ({o.exponent_low:.2f} to {o.exponent_high:.2f})")
    if not math.isnan(o.declared):
        out[0] += f", declared {o.declared:g}"
    coarser = sum(h > max(inside) for h in o.dt)
    if coarser:
        out.append(f"{plural(coarser, 'coarser step is', 'coarser steps are')} not yet in that range")
    if math.isfinite(o.floor):
        floor = f"floor of {o.floor:.1e} {o.unit}"
        out.append(f"{finest} left out: at the {floor}" if o.against == "dt" else floor)
    return out


def _points(o: Order) -> tuple[Point, ...]:
    coarsest = max((dt for dt, used in zip(o.dt, o.used, strict=True) if used), default=math.inf)
    return tuple(Point(dt, error, _kind(dt, error, used, o.floor, coarsest))
                 for dt, error, used in zip(o.dt, o.error, o.used, strict=True))  # fmt: skip


def _kind(dt: float, error: float, used: bool, floor: float, coarsest: float) -> str:
    """A point left out of the fit is coarser than all used ones, or it lies on the floor."""
    if used:
        return USED
    return EARLY if dt > coarsest and not error <= FLOOR * floor else FLOORED


def ladders(found: Sequence[Certificate]) -> tuple[Plot, ...]:
    """Error against step, a plot for each quantity of each problem, a fit and its points for each method."""
    groups = group_by((c for c in found if c.points), lambda c: (c.of.variant, c.of.quantity))
    taken: set[str] = set()
    plots = []
    for (variant, quantity), own in groups.items():
        step = Axis("step, or mean step under error control", "s", log=True)
        error = Axis(f"error of {quantity}", own[0].of.unit, log=True)
        name = slug(f"order-{variant}-{quantity}", taken)
        fitted = [c for c in own if c.fit]
        title = f"{variant}: {quantity} converges with order {fitted[0].order}" if fitted else f"{variant}: {quantity}"
        plots.append(Plot(name, title, "", step, error, tuple(t for c in own for t in _traces(c))))
    return tuple(plots)


def _traces(c: Certificate) -> list[Trace]:
    out, case = [], c.of.case
    if c.fit:
        x, y = (np.array(v) for v in zip(*c.fit, strict=True))
        out.append(Trace(f"{case}: order {c.order}, {c.interval}", x, y, solver=c.of.solver))
    for kind in dict.fromkeys(p.kind for p in c.points):
        own = [p for p in c.points if p.kind == kind]
        words = [case if kind == USED else f"{case}: {kind}, left out of the fit"] * len(own)
        name = case if kind == USED else f"{case}, {kind}"
        out.append(Trace(name, np.array([p.dt for p in own]), np.array([p.error for p in own]), solver=c.of.solver,
                         mode="markers", words=words, hollow=kind != USED))  # fmt: skip
    return out
