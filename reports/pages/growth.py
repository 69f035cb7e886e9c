"""What a step costs as a mechanism grows, where a run has several sizes of one problem."""

from collections import Counter

from ..model.motion import bodies_in
from ..model.reading import Run
from ..plots.interactive.growth import growth, growths
from .base import Page, Site


def write(run: Run, site: Site) -> Page | None:
    """``growth.html``; None where no problem comes in three sizes."""
    posed = Counter(p.problem for p in run.posings)
    bodies: dict[str, int] = {}
    for posing in run.posings:
        if posed[posing.problem] > 1:  # every cell of one posing has the same bodies: one series file tells
            some = next((s for c in posing.cells if c.succeeded and (s := run.series(c)) is not None), None)
            bodies |= {c.record.cell: bodies_in(some) for c in posing.cells} if some is not None else {}
    found = growths(run.cells, bodies)
    if not found:
        return None
    plots = [growth(problem, found, site.url) for problem in dict.fromkeys(g.problem for g in found)]
    return site.write(Page("Size", "growth.html", nav=True, order=35), "growth.html", plots=plots, found=found)
