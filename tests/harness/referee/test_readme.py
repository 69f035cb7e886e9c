"""What the README says of verdicts is what is published."""

import json
import re

from mbsbench.harness.results.environment import ROOT

ROW = re.compile(r"^\| `([\w-]+)` \| .+ \| ([A-Z]+) \| (\d+ of \d+)", re.MULTILINE)


def test_verdicts_in_the_readme_are_the_published_ones():
    published = json.loads((ROOT / "results/published/claims.json").read_text(encoding="utf-8"))
    known = {c["id"]: c for c in published}
    rows = ROW.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert len(rows) >= 9
    for name, verdict, count in rows:
        assert known[name]["verdict"] == verdict, name
        assert f"olds in {count} settings" in known[name]["because"], name
