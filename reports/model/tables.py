"""Tables for papers: CSV with every digit, LaTeX with those a reader wants. The numbers are those of the page."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from ...harness.files import write_text
from .columns import COLUMNS, Column
from .results import Run, Variant
from .words import BELOW_CLOCK, NONE

SHOWN: Sequence[Column] = tuple(c for c in COLUMNS if c.latex)
DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}",
}  # fmt: skip


def write_tables(variants: Sequence[Variant], folder: Path, *, rounded: bool = False) -> list[Path]:
    """One CSV and one LaTeX table a problem; returns the files. A ``rounded`` CSV has the numbers of the LaTeX one."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for variant in variants:
        values = rounded_csv_of(variant.runs) if rounded else csv_of(variant.runs)
        for suffix, text in ((".csv", values), (".tex", latex_of(variant.title, variant.runs))):
            out.append(folder / f"{variant.slug}{suffix}")
            write_text(out[-1], text)
    return out


def csv_of(runs: Sequence[Run]) -> str:
    """All columns, numbers in full; empty where a quantity does not exist."""
    rows = [[c.variant, c.record.solver, c.record.paper_label, *(_full(k, c) for k in COLUMNS), "; ".join(c.reasons)]
            for c in runs]  # fmt: skip
    return _csv([["problem", "solver", "paper_label", *map(_head, COLUMNS), "reason"], *rows])


def rounded_csv_of(runs: Sequence[Run]) -> str:
    """The columns of the LaTeX table with the same digits."""
    rows = [[c.record.solver, *(_rounded(k, c) for k in SHOWN)] for c in runs]
    return _csv([["solver", *map(_head, SHOWN)], *rows])


def _csv(rows: Sequence[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _head(column: Column) -> str:
    return f"{column.key} [{column.unit}]" if column.unit else column.key


def latex_of(title: str, runs: Sequence[Run]) -> str:
    """The main columns, for booktabs; a failure keeps its row and says how it ended."""
    kinds = "".join("l" if isinstance(c.of(runs[0]), str) else "r" for c in SHOWN)
    rows = [["Solver", *(c.latex for c in SHOWN)]]
    rows += [[latex_text(run.record.solver), *(_latex(c, run) for c in SHOWN)] for run in runs]
    head, *body = [" & ".join(row) + r" \\" for row in rows]
    start = [f"% {_one_line(title)}", r"% needs \usepackage{booktabs}", rf"\begin{{tabular}}{{l{kinds}}}"]
    return "\n".join([*start, r"\toprule", head, r"\midrule", *body, r"\bottomrule", r"\end{tabular}", ""])


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
        plain = f"{mantissa}\\times 10^{{{power.translate(DIGITS)}}}"
    return f"${plain}$"


def _full(column: Column, run: Run) -> str:
    value = column.of(run)
    if isinstance(value, str):
        return "" if value == NONE else value
    return "" if math.isnan(value) else repr(value)


def _latex(column: Column, run: Run) -> str:
    value = column.of(run)
    return latex_text(value) if isinstance(value, str) else latex_number(value, column.show(value))


def _rounded(column: Column, run: Run) -> str:
    value, shown = column.of(run), column.text(run)
    if isinstance(value, str) or shown == NONE:
        return "" if shown == NONE else str(value)
    mantissa, times, power = shown.replace("\u202f", "").replace("−", "-").replace("∞", "inf").partition("×10")
    return mantissa + (f"e{power.translate(DIGITS)}" if times else "")


def _one_line(text: str) -> str:
    return " ".join(text.split())
