"""The page of method: how a run is judged, the terms, what each number means, where all runs are."""

from ....harness.results.words import law_of
from ....harness.types import ACCURATE, ALLOWED, Reason
from ...model.glossary import GLOSSARY
from ...model.results import Results
from ...model.tables import COLUMNS
from ..base import Page, Site


def write(results: Results, site: Site) -> Page | None:
    """``method.html``."""
    return site.write(Page("Method", "method.html", nav=True, order=90), "method.html", terms=GLOSSARY,
                      columns=COLUMNS, accurate=ACCURATE,
                      allowed=[(law_of(Reason(law)), part) for law, part in ALLOWED.items()])  # fmt: skip
