"""What a step costs as a mechanism grows, where there are several sizes of one problem."""

from collections import Counter

from ..model.motion import bodies_in
from ..model.results import Results
from ..plots.growth import growth, growths
from .base import Page, Site


def write(results: Results, site: Site) -> Page | None:
    """``growth.html``; None where no problem comes in three sizes."""
    variants = Counter(p.problem for p in results.variants)
    bodies: dict[str, int] = {}
    for variant in results.variants:
        if variants[variant.problem] > 1:  # its runs have the same bodies: one series file is enough
            some = next((s for c in variant.runs if c.succeeded and (s := results.series(c)) is not None), None)
            bodies |= {c.record.run_id: bodies_in(some) for c in variant.runs} if some is not None else {}
    found = growths(results.runs, bodies)
    if not found:
        return None
    plots = [growth(problem, found, site.url) for problem in dict.fromkeys(g.problem for g in found)]
    return site.write(Page("Size", "growth.html", nav=True, order=35), "growth.html", plots=plots, found=found)
