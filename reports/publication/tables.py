"""Tables for papers, LaTeX and CSV: each number is rounded once, and both files have that one."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from ...harness.results import store
from ..model.columns import COLUMNS, Column
from ..model.results import Run, Variant
from ..model.tables import latex_number, latex_text
from ..model.words import NONE

DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
SHOWN: Sequence[Column] = tuple(c for c in COLUMNS if c.latex)


def write(variant: Variant, folder: Path, slug: str) -> list[Path]:
    """``<slug>.tex`` and ``<slug>.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"tex": latex_of(variant.title, variant.runs), "csv": csv_of(variant.runs)}
    for suffix, text in texts.items():
        store.write_text(folder / f"{slug}.{suffix}", text)
    return [folder / f"{slug}.{suffix}" for suffix in texts]


def csv_of(runs: Sequence[Run]) -> str:
    """A row a run; empty where a quantity does not exist."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["solver", *(c.key + (f" [{c.unit}]" if c.unit else "") for c in SHOWN)])
    out.writerows([run.record.solver, *(_plain(c, run) for c in SHOWN)] for run in runs)
    return text.getvalue()


def latex_of(title: str, runs: Sequence[Run]) -> str:
    """For booktabs."""
    kinds = "".join("l" if all(isinstance(c.of(k), str) for k in runs) else "r" for c in SHOWN)
    lines = [
        f"% {' '.join(title.split())}",
        "% needs \\usepackage{booktabs}",
        f"\\begin{{tabular}}{{l{kinds}}}",
        "\\toprule",
        " & ".join(["Solver", *(c.latex for c in SHOWN)]) + r" \\",
        "\\midrule",
    ]
    lines += [" & ".join([latex_text(k.record.solver), *(_latex(c, k) for c in SHOWN)]) + r" \\" for k in runs]
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}", ""])


def _latex(column: Column, run: Run) -> str:
    value = column.of(run)
    return latex_text(value) if isinstance(value, str) else latex_number(value, column.text(run))


def _plain(column: Column, run: Run) -> str:
    value, shown = column.of(run), column.text(run)
    if isinstance(value, str) or shown == NONE:
        return "" if shown == NONE else str(value)
    mantissa, times, power = shown.replace("\u202f", "").replace("−", "-").replace("∞", "inf").partition("×10")
    return mantissa + (f"e{power.translate(DIGITS)}" if times else "")
