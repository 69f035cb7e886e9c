"""What the README says of verdicts is what is published."""

import re

from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.judgements.files import CLAIMS, PUBLISHED, read_judgement
from mbsbench.reports.model.claim_words import share

CELL = r"(–|[A-Z]+(?: \d+ of \d+[^|]*)?)"
ROW = re.compile(rf"^\| `([\w-]+)` \| [^|]+ \| {CELL} \| {CELL} \|", re.MULTILINE)


def said(finding):
    """A verdict with its settings, as in the table."""
    return f"{finding.verdict} {share(finding)}".strip() if finding else "–"


def test_verdicts_in_the_readme_are_the_published_ones():
    known = {c.id: c for c in read_judgement(CLAIMS, PUBLISHED)}
    rows = ROW.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(rows) >= 9
    for name, paper, beyond in rows:
        assert (said(known[name].paper), said(known[name].beyond)) == (paper, beyond.strip()), name
