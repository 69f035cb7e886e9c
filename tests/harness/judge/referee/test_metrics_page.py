"""The page on claims lists every metric with its arguments, in the words of its function."""

import inspect

from mbsbench.harness.judge.referee.claims.measures import MEASURES
from mbsbench.harness.results.environment import ROOT

PAGE = ROOT / "docs" / "claims.md"
BEGIN, END = "<!-- metrics -->\n", "<!-- end -->\n"


def list_metrics() -> str:
    """Return the table of the page: a row per metric, by name."""
    rows = ["| metric | arguments | number |", "|---|---|---|"]
    for name, m in sorted(MEASURES.items()):
        required = ", ".join(m.wants)
        optional = ", ".join(k for k in m.takes if k not in m.wants)
        arguments = " ".join(filter(None, (required, f"[{optional}]" if optional else "")))
        first = (inspect.getdoc(m.of) or "").splitlines()[0].removeprefix("Return ")
        meaning = first.replace("|", r"\|").replace("``", "`")
        rows.append(f"| {name} | {arguments} | {meaning} |")
    return "\n".join(rows) + "\n"


def test_the_page_lists_the_metrics():
    """A new metric is found by who writes a claim; the message is what stands between the marks of the page."""
    listed = PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]
    assert listed == list_metrics(), f"between the marks of {PAGE.name} put\n{list_metrics()}"
