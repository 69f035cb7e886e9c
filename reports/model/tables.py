"""The columns of every table, and the tables for papers: CSV with every digit, LaTeX with those a reader wants."""

import csv
import io
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...harness.places import Place
from ...harness.results.records import cpu_range
from ...harness.results.shadows import SYMPLECTIC
from ...harness.results.words import judged_error
from . import words
from .accuracy import energy_kind, measure_for
from .results import Run, Variant, by_solver
from .words import BELOW_CLOCK, NONE, format_cpu_time, mark

Value = float | str
WRAPPED = {  # columns of words that may be long
    "settings": r">{\raggedright\arraybackslash}p{17mm}", "status": r">{\raggedright\arraybackslash}p{13mm}",
    "cpu_median": r">{\raggedleft\arraybackslash}p{9mm}",
}  # fmt: skip
DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}",
}  # fmt: skip


def _spread(c: Run) -> Value:
    low, high = map(format_cpu_time, cpu_range(c.record))
    return f"{low} to {high} ({c.record.repeats})" if c.record.repeats > 1 else NONE


OTHERS: Mapping[str, Callable[[Run], Value]] = {  # columns that are no field of a record
    "settings": lambda c: c.settings(),
    "status": lambda c: mark(c.status).word,
    "energy_kind": energy_kind,
    "symplectic": lambda c: c.nearest.symplectic if c.nearest else "",
    "cpu_spread": _spread,
}


@dataclass(frozen=True)
class Column:
    """A column as ``columns.toml`` has it."""

    key: str
    head: str
    doc: str
    unit: str = ""
    record: str = ""  # where its value comes from: a field of the record, a judged error, a field of the nearest motion
    error: str = ""
    nearest: str = ""
    show: str = "number"  # function of ``words``
    latex: str = ""  # head in LaTeX; empty leaves the column out there

    def of(self, run: Run) -> Value:
        """The number or text itself."""
        if self.record:
            return getattr(run.record, self.record)
        if self.error:
            return judged_error(run.record, self.error, self.unit)
        if self.nearest:
            value: float | None = getattr(run.nearest, self.nearest, None)
            return math.nan if value is None else value
        return OTHERS[self.key](run)

    def text(self, run: Run) -> str:
        """As shown."""
        value = self.of(run)
        return (value or NONE) if isinstance(value, str) else getattr(words, self.show)(value)

    @property
    def heading(self) -> str:
        return f"{self.head} [{self.unit}]" if self.unit else self.head


FILE = Path(__file__).parent / "columns.toml"
TEXT = FILE.read_text(encoding="utf-8").replace("SYMPLECTIC", f"{SYMPLECTIC:g}")
COLUMNS = tuple(Column(key, **given) for key, given in tomllib.loads(TEXT).items())


def list_printed_columns(runs: Sequence[Run]) -> Sequence[Column]:
    """The columns of a table for a paper: one error, that of the pages."""
    measure = measure_for(runs)
    other = "position_error" if measure and measure.unit == "rad" else "orientation_error"
    return [c for c in COLUMNS if c.latex and c.key != other]


def write_tables(variants: Sequence[Variant], folder: Place) -> list[Path]:
    """One CSV and one LaTeX table a problem; returns the files."""
    out = []
    for variant in variants:
        for suffix, text in ((".csv", csv_of(variant.runs)), (".tex", latex_of(variant.title, variant.runs))):
            place = folder / f"{variant.slug}{suffix}"
            place.write(text, durable=False)
            out.append(place.path)
    return out


def csv_of(runs: Sequence[Run]) -> str:
    """All columns, numbers in full; empty where a quantity does not exist."""
    rows = []
    for c in runs:
        found = (k.of(c) for k in COLUMNS)
        values = ["" if v == NONE or v != v else v if isinstance(v, str) else repr(v) for v in found]
        rows.append([c.variant, c.record.solver, c.record.paper_label, *values, "; ".join(c.reasons)])
    heads = (f"{c.key} [{c.unit}]" if c.unit else c.key for c in COLUMNS)
    return format_csv([["problem", "solver", "paper_label", *heads, "reason"], *rows])


def format_csv(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def latex_of(title: str, runs: Sequence[Run]) -> str:
    """The main columns, one column of a journal wide, for booktabs: each solver with its runs below it.

    A failure keeps its row and says how it ended.
    """
    columns, measure = list_printed_columns(runs), measure_for(runs)
    kinds = "".join(WRAPPED.get(c.key, "r") for c in columns)
    out = [" & ".join(c.latex for c in columns) + r" \\", r"\midrule"]
    for solver, own in by_solver(runs).items():
        out.append(rf"\multicolumn{{{len(columns)}}}{{@{{}}l}}{{{latex_text(solver)}}} \\*")
        for run in own:
            cells = ((c.of(run), c.text(run)) for c in columns)
            words = (latex_text(v) if isinstance(v, str) else latex_number(v, s) for v, s in cells)
            out.append(" & ".join(words) + r" \\")
    until = "" if measure is None or measure.until is None else f", errors up to {measure.until:.4g} s"
    start = [f"% {_one_line(title)}{until}", r"% needs \usepackage{booktabs,array}",
             r"{\footnotesize\setlength{\tabcolsep}{2pt}%", rf"\begin{{tabular}}{{@{{}}{kinds}@{{}}}}",
             r"\toprule"]  # fmt: skip
    return "\n".join([*start, *out, r"\bottomrule", r"\end{tabular}}", ""])


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


def _one_line(text: str) -> str:
    return " ".join(text.split())
