"""The page of what holds beyond one run: orders, drift, symmetries, false successes."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ....harness.results.judgements.files import DRIFTS, ORDERS, SYMMETRIES, WRONG
from ....harness.results.words import words_of
from ...model.results import Results, grouped, slug
from ...model.words import Mark
from ...plots.spec import Axis, Plot, Trace
from ..base import Page, Site
from ..judgement import judged_or_published, links_of
from . import scorecard
from .drifts import anatomies, common_scale, drawn, parted, parts, words
from .orders import USED, Certificate, certificates, glance, verdict_mark
from .scorecard import MARKS, card


def ladders(found: Sequence[Certificate]) -> tuple[Plot, ...]:
    """Error against step, a plot for each quantity of each problem, a fit and its points for each solver."""
    groups = grouped((c for c in found if c.points), lambda c: (c.of.variant, c.of.quantity))
    taken: set[str] = set()
    plots = []
    for (variant, quantity), own in groups.items():
        step = Axis("step, or mean step under error control", "s", log=True)
        error = Axis(f"error of {quantity}", own[0].of.unit, log=True)
        name, title = slug(f"order-{variant}-{quantity}", taken), f"{variant}: {quantity}"
        plots.append(Plot(name, title, "", step, error, tuple(t for c in own for t in _traces(c)), wide=True))
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


def tally(found: Sequence[Certificate]) -> list[tuple[Mark, int]]:
    """How many of each verdict."""
    return Counter(c.mark for c in found).most_common()


def write(results: Results, site: Site) -> Page | None:
    """``certificates.html``."""
    links = links_of(results.runs)
    order, drift, symmetry, false = (
        judged_or_published(results.folder, f) for f in (ORDERS, DRIFTS, SYMMETRIES, WRONG)
    )
    orders, drifts, wrong = certificates(order.found or (), links), anatomies(drift.found or ()), false.found or ()
    long, short, none = parted(drifts)
    scale, plots = common_scale((*long, *short)), ladders(orders)
    whys = {name: (of.why, of.published) for name, of in
            (("orders", order), ("drift", drift), ("symmetries", symmetry), ("wrong", false))}  # fmt: skip
    return site.write(
        Page("Certificates", "certificates.html", nav=True, order=30), "certificates.html",
        scripts=["assets/judgement.js"], plots=plots, whys=whys, certificates=orders, links=links,
        order_counts=tally(orders), ladders=plots, glance=glance(orders), verdict_mark=verdict_mark,
        drifts=drifts, long=long, short=short, periodless=none, scale=scale, strip=lambda d: drawn(d, scale),
        parts=parts, drift_words=words, card=card(symmetry.found or ()), marks_of=MARKS, symmetry_words=scorecard.words,
        wrong=wrong, wrong_count=Counter((w.solver, w.problem) for w in wrong), reason_words=words_of,
    )  # fmt: skip
