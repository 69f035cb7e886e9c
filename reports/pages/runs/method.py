"""Explain how a run is judged, the terms, the meaning of each number, and where all runs are."""

from ....harness.mechanics.types import ACCURATE, ALLOWED, Reason
from ....harness.results.words import find_broken_law
from ...model.columns import COLUMNS
from ...model.glossary import GLOSSARY
from ...model.results import StoredResults
from ..base import Page, Site


def write(results: StoredResults, site: Site) -> Page | None:
    """Add ``method.html`` to the site and return the page."""
    return site.write(
        Page("Method", "method.html", nav=True, order=90),
        "method.html",
        terms=GLOSSARY,
        columns=COLUMNS,
        accurate=ACCURATE,
        allowed=[(find_broken_law(Reason(law)), part) for law, part in ALLOWED.items()],
    )
