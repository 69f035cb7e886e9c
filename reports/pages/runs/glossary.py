"""The glossary: what the words of the report mean."""

from ...model.glossary import GLOSSARY
from ...model.results import Results
from ..base import Page, Site


def write(results: Results, site: Site) -> Page | None:
    """One table."""
    return site.write(Page("Glossary", "glossary.html", nav=True, order=95), "glossary.html", terms=GLOSSARY)
