"""The glossary is stated once: the page in docs/ and the tooltips of the report are made from one file."""

import re

from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.types import Status
from mbsbench.reports.model.glossary import GLOSSARY, markdown, term


def test_the_page_in_docs_is_the_table_that_the_reports_use():
    """Made anew by ``python -m mbsbench.reports.model.glossary``."""
    assert markdown() in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")


def test_every_status_and_verdict_has_an_entry_of_one_sentence():
    """A reader meets them on every page."""
    assert {str(s) for s in Status} | {"SUPPORTED", "REFUTED", "CONDITIONAL", "MIXED", "UNTESTABLE"} <= GLOSSARY.keys()
    assert all(text.endswith(".") and "\n" not in text for text in GLOSSARY.values())


def test_every_term_of_a_template_is_in_the_glossary():
    """A tooltip without a meaning would stop the report."""
    used = set()
    for path in (ROOT / "reports" / "templates").glob("*.html"):
        used |= set(re.findall(r"""term\(["']([^"']+)["']""", path.read_text(encoding="utf-8")))
    assert used and used <= GLOSSARY.keys()


def test_texts_are_escaped():
    """They stand in an attribute."""
    assert term("law", "<b>") == f'<abbr title="{GLOSSARY["law"]}">&lt;b&gt;</abbr>'
