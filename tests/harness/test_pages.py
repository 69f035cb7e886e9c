"""Pages written by hand are short: a budget of words in all, lines that fit a screen."""

import re

import pytest

from mbsbench.harness.results.environment import ROOT

GENERATED = {"verdicts.md"}
PAGES = sorted(p for p in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")) if p.name not in GENERATED)
GENERATED_TABLES = re.compile(r"<!-- [^>]*written by make joints -->.*?<!-- end -->", re.DOTALL)
WORDS = 18_000  # of all pages together
LONGEST = 140  # characters of a line


def words(text):
    """Words that somebody wrote; as ``wc -w`` counts them."""
    return len(GENERATED_TABLES.sub("", text).split())


def test_all_pages_together_keep_to_the_budget():
    """Who adds a page deletes another."""
    counts = {p.name: words(p.read_text(encoding="utf-8")) for p in PAGES}
    assert sum(counts.values()) <= WORDS, sorted(counts.items(), key=lambda c: -c[1])


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_lines_fit(page):
    """Rows of tables, and lines that one link fills, cannot be broken."""
    lines = page.read_text(encoding="utf-8").splitlines()
    long = [line for line in lines if len(line) > LONGEST and not re.match(r"\||!?\[[^]]*\]\(\S*\)$", line)]
    assert not long, long
