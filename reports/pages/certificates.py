"""The page of what holds beyond one run: orders, drift, metamorphic checks, successes that are none."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..model.results import Results, slug
from ..model.words import Mark
from ..plots.spec import Axis, Plot, Trace
from .base import Page, Site
from .drifts import anatomies, common_scale, drawn, parted
from .judgement import Entry, judged
from .links import Links, links_of
from .orders import USED, Certificate, certificates, glance, told
from .scorecard import card

NAMES = ("certificates", "drift", "metamorphic", "wrong")


@dataclass(frozen=True)
class Wrong:
    """A success that is none."""

    case: str
    page: str
    solver: str
    problem: str
    because: tuple[str, ...]


def wrongs(rows: Sequence[Entry], links: Links) -> tuple[Wrong, ...]:
    """As judged; those of the records where nothing is."""
    return tuple(
        Wrong(e.text("case") or links.words(e.text("run")), links.page(e.text("run")), e.text("solver"),
              e.text("problem"), e.texts("because"))
        for e in rows
    )  # fmt: skip


def ladders(found: Sequence[Certificate]) -> tuple[Plot, ...]:
    """Error against step, a plot for each quantity of each problem, a fit and its points for each solver."""
    keys = dict.fromkeys((c.variant, c.quantity) for c in found)
    taken: set[str] = set()
    plots = []
    for variant, quantity in keys:
        own = [c for c in found if (c.variant, c.quantity) == (variant, quantity) and c.points]
        if own:
            axes = (
                Axis("step, or mean step under error control", "s", log=True),
                Axis(f"error of {quantity}", own[0].unit, log=True),
            )
            name, title = slug(f"order-{variant}-{quantity}", taken), f"{variant}: {quantity}"
            plots.append(Plot(name, title, "", *axes, tuple(t for c in own for t in _traces(c)), wide=True))
    return tuple(plots)


def _traces(c: Certificate) -> list[Trace]:
    out = []
    if c.fit:
        x, y = (np.array(v) for v in zip(*c.fit, strict=True))
        out.append(Trace(f"{c.case}: order {told(c)}, {c.interval}", x, y, solver=c.solver))
    for kind in dict.fromkeys(p.kind for p in c.points):
        own = [p for p in c.points if p.kind == kind]
        words = [c.case if kind == USED else f"{c.case}: {kind}, left out of the fit"] * len(own)
        name = c.case if kind == USED else f"{c.case}, {kind}"
        out.append(Trace(name, np.array([p.dt for p in own]), np.array([p.error for p in own]), solver=c.solver,
                         mode="markers", words=words, hollow=kind != USED))  # fmt: skip
    return out


def tally(found: Sequence[Certificate]) -> list[tuple[Mark, int]]:
    """How many of each verdict."""
    return Counter(c.mark for c in found).most_common()


def write(results: Results, site: Site) -> Page | None:
    """``certificates.html``."""
    links = links_of(results.runs)
    files = {name: judged(results.folder, name) for name in NAMES}
    orders, drifts = certificates(files["certificates"].rows, links), anatomies(files["drift"].rows, links)
    long, short, none = parted(drifts)
    wrong = wrongs(files["wrong"].rows, links)
    scale, plots = common_scale((*long, *short)), ladders(orders)
    return site.write(
        Page("Certificates", "certificates.html", nav=True, order=30), "certificates.html",
        scripts=["assets/judgement.js"], plots=plots, whys={k: v.why for k, v in files.items()}, certificates=orders,
        order_counts=tally(orders), ladders=plots, told=told, glance=glance(orders),
        drifts=drifts, long=long, short=short,
        periodless=none, scale=scale, strip=lambda a: drawn(a, scale), card=card(files["metamorphic"].rows, links),
        wrong=wrong, wrong_count=Counter((w.solver, w.problem) for w in wrong),
    )  # fmt: skip
