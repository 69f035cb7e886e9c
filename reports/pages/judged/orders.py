"""Describe orders of convergence and energy drifts in words, marks and plots."""

import math
from collections.abc import Sequence

import numpy as np

from ....harness.results.judgements.runs import Order, Unjudged
from ...model.results import group_by, make_natural_key, make_slug
from ...model.words import Mark, plural
from ...plots.slopes import NEAR, add_triangles
from ...plots.spec import Axis, Plot, Trace

FLOOR = 3.0  # points below this many times the floor are said to lie on it
USED, EARLY, FLOORED = "used", "pre-asymptotic", "at the floor"
NOTES = {
    Unjudged.NO_SCALE: "the records give no scale of its velocities",
    Unjudged.CUT: "steps that were cut are left out",
    Unjudged.UNRESOLVED: "errors that the reference cannot resolve are left out",
}
VERDICTS = {  # verdicts of certificates and of drifts
    "certified": ("✓", "good"),
    "exact": ("✓", "good"),
    "bounded": ("✓", "good"),
    "above declared": ("△", "refused"),
    "below declared": ("✗", "wrong"),
    "trend": ("↗", "failed"),
    "wanders": ("≈", "failed"),
    "failed": ("★", "failed"),
    "measured": ("○", "refused"),
    "undecided": ("○", "refused"),
    "floor": ("○", "refused"),
    "too short": ("–", "refused"),
    "refused": ("–", "refused"),
    "not measured": ("★", "failed"),
}


def sort_by_case(found: Sequence[Order]) -> list[Order]:
    """Sort orders by problem, solver and quantity."""
    return sorted(found, key=lambda o: (make_natural_key(o.variant), o.solver, make_natural_key(o.case)))


def mark_verdict(verdict: str) -> Mark:
    """Return the mark of a verdict on an order or a drift."""
    symbol, kind = VERDICTS[verdict]
    return Mark(symbol, verdict, kind)


def describe_order(o: Order) -> str:
    """Describe the fit of an order and the runs that are not in it."""
    runs = len(o.dt) + o.unfinished + o.unmeasured
    unfinished = f"{o.unfinished} of {runs} runs did not finish" if o.unfinished and o.verdict != "refused" else ""
    unmeasured = f"{o.unmeasured} of {runs} runs have no error to measure" if 0 < o.unmeasured < runs else ""
    return "; ".join(
        filter(None, (*_describe_fit(o), unfinished, unmeasured, *(NOTES.get(n, n.value) for n in o.notes)))
    )


def _describe_fit(o: Order) -> list[str]:
    """Return clauses on the fitted order with its range of steps, or on why there is none."""
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
        return [
            "too few steps whose errors can be fitted"
            if few
            else f"no range of steps in which the error is a power of the step (slopes {slopes})"
        ]
    inside = [h for h, used in zip(o.dt, o.used, strict=True) if used]
    steps = "steps" if o.against == "dt" else "mean steps"
    out = [
        f"order {o.order:.2f} ({o.low:.2f} to {o.high:.2f}) over {len(inside)} {steps} of {max(inside):.3g} to "
        f"{min(inside):.3g} s"
    ]
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


def list_points(o: Order) -> list[tuple[float, float, str]]:
    """Return step [s], error and use of each run: ``USED`` in the fit, ``EARLY`` (pre-asymptotic) or ``FLOORED``."""
    coarsest = max((dt for dt, used in zip(o.dt, o.used, strict=True) if used), default=math.inf)
    out = []
    for dt, error, used in zip(o.dt, o.error, o.used, strict=True):
        early = dt > coarsest and not error <= FLOOR * o.floor
        out.append((dt, error, USED if used else EARLY if early else FLOORED))
    return out


def find_fit_ends(o: Order) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the steps [s] and the errors at both ends of the fitted line; None without an order.

    The line has the order as its slope and passes through the mean of the used points' logarithms.
    """
    used = [(dt, error) for dt, error, kind in list_points(o) if kind == USED and error > 0.0 < dt]
    if len(used) < 2 or not math.isfinite(o.order):
        return None
    x, y = np.log(used).T
    ends = np.array([x.min(), x.max()])
    return np.exp(ends), np.exp(y.mean() + o.order * (ends - x.mean()))


def plot_ladders(orders: Sequence[Order]) -> list[Plot]:
    """Plot error against step, one plot per quantity of each problem, with a fit and its points per method."""
    groups = group_by((o for o in orders if o.dt), lambda o: (o.variant, o.quantity))
    taken: set[str] = set()
    plots = []
    for (variant, quantity), own in groups.items():
        step = Axis("step, or mean step under error control", "s", log=True)
        error = Axis(f"error of {quantity}", own[0].unit, log=True)
        name = make_slug(f"order-{variant}-{quantity}", taken)
        fitted = sorted((o for o in own if find_fit_ends(o)), key=lambda o: o.order)
        ends = " to ".join(dict.fromkeys(f"{o.order:.2f} ({o.case})" for o in fitted[:1] + fitted[-1:]))
        order = f" converges with order {ends}" if fitted else ""
        title, drawn = f"{variant}: {quantity}{order}", tuple(t for o in own for t in _make_traces(o))
        plots.append(put_triangles(Plot(name, title, "", step, error, drawn), own))
    return plots


def put_triangles(plot: Plot, orders: Sequence[Order]) -> Plot:
    """Return the plot with a slope triangle near each fit of ``orders`` whose order is nearly whole."""
    found = [(o, fit) for o in orders if (fit := find_fit_ends(o)) and abs(o.order - round(o.order)) <= NEAR]
    return add_triangles(plot, [(round(o.order), Trace(o.case, *fit)) for o, fit in found])


def _make_traces(o: Order) -> list[Trace]:
    """Return a ladder as traces: the fitted line, and its points grouped by their use in the fit."""
    out = []
    if fit := find_fit_ends(o):
        interval = f"{o.low:.2f} to {o.high:.2f}" if math.isfinite(o.low + o.high) else "none"
        out.append(Trace(f"{o.case}: order {o.order:.2f}, {interval}", *fit, solver=o.solver))
    for kind, own in group_by(list_points(o), lambda p: p[2]).items():
        words = o.case if kind == USED else f"{o.case}: {kind}, left out of the fit"
        name = o.case if kind == USED else f"{o.case}, {kind}"
        out.append(
            Trace(
                name,
                np.array([p[0] for p in own]),
                np.array([p[1] for p in own]),
                solver=o.solver,
                mode="markers",
                words=[words] * len(own),
                hollow=kind != USED,
            )
        )
    return out
