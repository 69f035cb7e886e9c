"""Tables for papers: CSV with every digit, LaTeX with those a reader wants. The numbers are those of the page."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from ...harness.results import store
from .columns import COLUMNS, Column
from .results import Results, Run
from .words import BELOW_CLOCK, NONE

LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}",
}  # fmt: skip


def write_tables(results: Results, folder: Path) -> list[Path]:
    """One CSV and one LaTeX table a problem; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for variant in results.variants:
        for suffix, text in ((".csv", csv_of(variant.runs)), (".tex", latex_of(variant.title, variant.runs))):
            path = folder / f"{variant.slug}{suffix}"
            store.write_text(path, text)
            out.append(path)
    return out


def csv_of(runs: Sequence[Run]) -> str:
    """All columns, numbers in full; empty where a quantity does not exist."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(
        ["problem", "solver", "paper_label", *(c.key + (f" [{c.unit}]" if c.unit else "") for c in COLUMNS), "reason"]
    )
    for run in runs:
        r = run.record
        values = [_full(c, run) for c in COLUMNS]
        out.writerow([run.variant, r.solver, r.paper_label, *values, "; ".join(run.reasons)])
    return text.getvalue()


def latex_of(title: str, runs: Sequence[Run]) -> str:
    """The main columns, for booktabs; a failure keeps its row and says how it ended."""
    shown = [c for c in COLUMNS if c.latex]
    lines = [
        "% needs \\usepackage{booktabs}",
        f"\\begin{{tabular}}{{ll{''.join('l' if _is_text(c, runs) else 'r' for c in shown[1:])}}}",
        "\\toprule",
        " & ".join(["Solver", *(c.latex for c in shown)]) + r" \\",
        "\\midrule",
    ]
    for run in runs:
        values = [latex_text(run.record.solver), *(_latex(c, run) for c in shown)]
        lines.append(" & ".join(values) + r" \\")
    return "\n".join([f"% {_one_line(title)}", *lines, "\\bottomrule", "\\end{tabular}", ""])


def latex_text(text: str) -> str:
    """Any text, safe in LaTeX."""
    return "".join(LATEX.get(c, c) for c in _one_line(text))


def latex_number(value: float, shown: str) -> str:
    """The digits of ``shown`` in mathematics."""
    if math.isnan(value):
        return "--"
    if math.isinf(value):
        return r"$\infty$" if value > 0 else r"$-\infty$"
    if shown == BELOW_CLOCK:
        return shown
    plain = shown.replace("\u202f", r"\,").replace("−", "-")
    if "×10" in plain:
        mantissa, power = plain.split("×10")
        plain = f"{mantissa}\\times 10^{{{power.translate(str.maketrans('⁰¹²³⁴⁵⁶⁷⁸⁹⁻', '0123456789-'))}}}"
    return f"${plain}$"


def _full(column: Column, run: Run) -> str:
    value = column.of(run)
    if isinstance(value, str):
        return "" if value == NONE else value
    return "" if math.isnan(value) else repr(value)


def _latex(column: Column, run: Run) -> str:
    value = column.of(run)
    return latex_text(value) if isinstance(value, str) else latex_number(value, column.show(value))


def _is_text(column: Column, runs: Sequence[Run]) -> bool:
    return isinstance(column.of(runs[0]), str)


def _one_line(text: str) -> str:
    return " ".join(text.split())
