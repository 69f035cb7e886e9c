"""What the README says of verdicts is what is published."""

import re

from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.judgements.files import CLAIMS, PUBLISHED, read

ROW = re.compile(r"^\| `([\w-]+)` \| .+ \| ([A-Z]+) \| (\d+ of \d+)", re.MULTILINE)


def test_verdicts_in_the_readme_are_the_published_ones():
    known = {c.id: c for c in read(CLAIMS, PUBLISHED)}
    rows = ROW.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(rows) >= 9
    for name, verdict, count in rows:
        because = known[name].because
        assert (known[name].verdict, f"{because.holds} of {because.settings}") == (verdict, count), name
