"""Findings as one table: verdict, quantity, measured, required, and where it was found."""

from collections.abc import Iterable

from rich.text import Text

from ..harness.results.findings import Finding, Verdict
from .screen import Column, print_json, print_table

STYLE = {Verdict.MET: "green", Verdict.FAILED: "bold red", Verdict.OPEN: ""}
COLUMNS = (
    Column("", right=False), Column("quantity", right=False, fold=True, least=20),
    Column("measured", right=False, fold=True), Column("required", right=False, fold=True, least=12, rank=1),
)  # fmt: skip
WHERE = Column("found", fold=True, rank=2)


def print_findings(found: Iterable[Finding], *below: str, json: bool = False) -> None:
    """One row a finding, or one JSON object."""
    if json:
        for f in found:
            print_json(f.as_plain())
        return
    rows = [
        (Text(f.verdict, STYLE[f.verdict]), f.measured.quantity, f.measured.text, f.required.text,
         f.measured.words if f.measured.text != f.measured.words else "")
        for f in found
    ]  # fmt: skip
    located = any(row[-1] for row in rows)
    print_table((*COLUMNS, WHERE) if located else COLUMNS, rows if located else [row[:-1] for row in rows], *below)
