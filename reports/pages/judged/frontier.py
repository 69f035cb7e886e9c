"""The page of the cheapest solver for an error, on every problem."""

from ...model.frontier import frontiers
from ...model.results import Results, grouped
from ..base import Page, Site


def write(results: Results, site: Site) -> Page | None:
    """``frontier.html``; None where no two solvers reach a target."""
    found = frontiers(results)
    if not found:
        return None
    by_variant = grouped(found, lambda f: f.variant)
    return site.write(Page("Frontier", "frontier.html", nav=True, order=26), "frontier.html", found=found,
                      by_variant=by_variant)  # fmt: skip
