"""Write tables for papers: CSV with every digit, LaTeX with few."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from ...harness.base.confined_paths import ConfinedPath
from .accuracy import choose_measure
from .columns import COLUMNS, PageColumn
from .results import StoredRun, Variant, group_by_solver
from .words import BELOW_CLOCK, NONE

WRAPPED = {  # columns with long words
    "settings": r">{\raggedright\arraybackslash}p{17mm}",
    "status": r">{\raggedright\arraybackslash}p{13mm}",
    "cpu_median": r">{\raggedleft\arraybackslash}p{9mm}",
}
DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
}


def list_printed_columns(runs: Sequence[StoredRun]) -> Sequence[PageColumn]:
    """Return the columns of a printed table, with position or orientation error: the one that judges the runs."""
    measure = choose_measure(runs)
    other = "position_error" if measure and measure.unit == "rad" else "orientation_error"
    return [c for c in COLUMNS if c.latex and c.key != other]


def write_tables(variants: Sequence[Variant], folder: ConfinedPath) -> list[Path]:
    """Write a CSV and a LaTeX table for each variant into ``folder``; return the paths."""
    out = []
    for variant in variants:
        for suffix, text in (
            (".csv", format_as_csv(variant.runs)),
            (".tex", format_as_latex(variant.title, variant.runs)),
        ):
            place = folder / f"{variant.slug}{suffix}"
            place.write(text, durable=False)
            out.append(place.path)
    return out


def format_as_csv(runs: Sequence[StoredRun]) -> str:
    """Format all columns as CSV with full precision; a quantity that does not exist is empty."""
    rows = []
    for c in runs:
        found = (k.of(c) for k in COLUMNS)
        values = ["" if v == NONE or v != v else v if isinstance(v, str) else repr(v) for v in found]
        rows.append([c.variant, c.record.solver, c.record.paper_label, *values, "; ".join(c.reasons)])
    heads = (f"{c.key} [{c.unit}]" if c.unit else c.key for c in COLUMNS)
    return format_csv([["problem", "solver", "paper_label", *heads, "reason"], *rows])


def format_csv(rows: Sequence[Sequence[str]]) -> str:
    """Format rows of cells as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def format_as_latex(title: str, runs: Sequence[StoredRun]) -> str:
    """Format the main columns as a LaTeX table (booktabs) of the width of a journal column, grouped by solver.

    A failed run keeps its row and states how it ended.
    """
    columns, measure = list_printed_columns(runs), choose_measure(runs)
    kinds = "".join(WRAPPED.get(c.key, "r") for c in columns)
    out = [" & ".join(c.latex for c in columns) + r" \\", r"\midrule"]
    for solver, own in group_by_solver(runs).items():
        out.append(rf"\multicolumn{{{len(columns)}}}{{@{{}}l}}{{{escape_latex(solver)}}} \\*")
        for run in own:
            cells = ((c.of(run), c.text(run)) for c in columns)
            words = (escape_latex(v) if isinstance(v, str) else format_latex_number(v, s) for v, s in cells)
            out.append(" & ".join(words) + r" \\")
    until = "" if measure is None or measure.until is None else f", errors up to {measure.until:.4g} s"
    start = [
        f"% {_join_lines(title)}{until}",
        r"% needs \usepackage{booktabs,array}",
        r"{\footnotesize\setlength{\tabcolsep}{2pt}%",
        rf"\begin{{tabular}}{{@{{}}{kinds}@{{}}}}",
        r"\toprule",
    ]
    return "\n".join([*start, *out, r"\bottomrule", r"\end{tabular}}", ""])


def escape_latex(text: str) -> str:
    """Escape text for LaTeX."""
    return "".join(LATEX.get(c, c) for c in _join_lines(text))


def format_latex_number(value: float, shown: str) -> str:
    """Return a number in LaTeX: ``shown``, as ``words`` formats it, in math mode; words for NaN and infinities."""
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


def _join_lines(text: str) -> str:
    """Return the text with each stretch of blanks and line ends replaced by one blank."""
    return " ".join(text.split())
