"""Print findings as one table: verdict, quantity, measured, required, and where found."""

from collections.abc import Iterable

from rich.text import Text

from ..harness.results.findings import Finding, Verdict
from .terminal import Column, print_json, print_table

STYLE = {
    Verdict.MET: "green",
    Verdict.FAILED: "bold red",
    Verdict.OPEN: "",
    Verdict.XPASS: "yellow",
    Verdict.XFAIL: "cyan",
}
COLUMNS = (
    Column("", right=False),
    Column("of", fold=True, least=12),
    Column("quantity", right=False, fold=True, least=20),
    Column("measured", right=False, fold=True),
    Column("required", right=False, fold=True, least=12, rank=1),
    Column("found", fold=True, rank=2),
)


def print_findings(findings: Iterable[Finding], *below: str, json: bool = False) -> None:
    """Print one row per finding, and the lines ``below``; or one JSON object per finding.

    Empty columns are left out, and the subject if all findings have the same.
    """
    found = list(findings)
    if json:
        for f in found:
            print_json(f.as_plain())
        return
    rows = [
        (
            Text(f.verdict, STYLE[f.verdict]),
            f.subject,
            f.quantity,
            f.text,
            f.limits,
            "" if f.words == f.text else f.words,
        )
        for f in found
    ]
    hidden = {1} if len({f.subject for f in found}) < 2 else set()  # 1: the subject, the column "of"
    shown = [k for k in range(len(COLUMNS)) if k not in hidden and (k < 2 or any(row[k] for row in rows))]
    print_table([COLUMNS[k] for k in shown], [[row[k] for k in shown] for row in rows], *below)
