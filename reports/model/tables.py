"""Tables for papers: CSV with every digit, LaTeX with those a reader wants. The numbers are those of the page."""

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from ...harness.results import store
from .columns import COLUMNS, Column
from .reading import Cell, Run
from .words import BELOW_CLOCK, NONE

LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}",
}  # fmt: skip


def write_tables(run: Run, folder: Path) -> list[Path]:
    """One CSV and one LaTeX table a problem; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for posing in run.posings:
        for suffix, text in ((".csv", csv_of(posing.cells)), (".tex", latex_of(posing.title, posing.cells))):
            path = folder / f"{posing.slug}{suffix}"
            store.write_text(path, text)
            out.append(path)
    return out


def csv_of(cells: Sequence[Cell]) -> str:
    """All columns, numbers in full; empty where a quantity does not exist."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(
        ["problem", "solver", "paper_label", *(c.key + (f" [{c.unit}]" if c.unit else "") for c in COLUMNS), "reason"]
    )
    for cell in cells:
        r = cell.record
        values = [_full(c, cell) for c in COLUMNS]
        out.writerow([cell.posing, r.solver, r.paper_label, *values, "; ".join(cell.reasons)])
    return text.getvalue()


def latex_of(title: str, cells: Sequence[Cell]) -> str:
    """The main columns, for booktabs; a failure keeps its row and says how it ended."""
    shown = [c for c in COLUMNS if c.latex]
    lines = [
        "% needs \\usepackage{booktabs}",
        f"\\begin{{tabular}}{{ll{''.join('l' if _is_text(c, cells) else 'r' for c in shown[1:])}}}",
        "\\toprule",
        " & ".join(["Solver", *(c.latex for c in shown)]) + r" \\",
        "\\midrule",
    ]
    for cell in cells:
        values = [latex_text(cell.record.solver), *(_latex(c, cell) for c in shown)]
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


def _full(column: Column, cell: Cell) -> str:
    value = column.of(cell)
    if isinstance(value, str):
        return "" if value == NONE else value
    return "" if math.isnan(value) else repr(value)


def _latex(column: Column, cell: Cell) -> str:
    value = column.of(cell)
    return latex_text(value) if isinstance(value, str) else latex_number(value, column.show(value))


def _is_text(column: Column, cells: Sequence[Cell]) -> bool:
    return isinstance(column.of(cells[0]), str)


def _one_line(text: str) -> str:
    return " ".join(text.split())
