"""The columns of every table, and the tables for papers: CSV with every digit, LaTeX with those a reader wants."""

import csv
import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...harness.places import Place
from ...harness.results.shadows import SYMPLECTIC
from ...harness.results.words import judged_error
from .accuracy import energy_kind, measure_for
from .results import Run, Variant, by_solver
from .words import BELOW_CLOCK, NONE, format_cpu_time, format_signed, mark, number, time, whole

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


@dataclass(frozen=True)
class Column:
    """``of`` gives the number or text itself, ``show`` how a reader sees it."""

    key: str
    head: str
    unit: str
    doc: str
    of: Callable[[Run], Value]
    show: Callable[[float], str] = number
    latex: str = ""  # head in LaTeX; empty leaves the column out there

    def text(self, run: Run) -> str:
        """As shown."""
        value = self.of(run)
        return (value or NONE) if isinstance(value, str) else self.show(value)

    @property
    def heading(self) -> str:
        return f"{self.head} [{self.unit}]" if self.unit else self.head


def _of(name: str) -> Callable[[Run], Value]:
    return lambda c: getattr(c.record, name)


def _error_column(name: str, unit: str) -> Callable[[Run], Value]:
    return lambda c: judged_error(c.record, name, unit)


def _near(name: str) -> Callable[[Run], Value]:
    def of(c: Run) -> Value:
        value: float | None = getattr(c.nearest, name, None)
        return math.nan if value is None else value

    return of


def _spread(c: Run) -> Value:
    r = c.record
    return f"{format_cpu_time(r.cpu_min_s)} to {format_cpu_time(r.cpu_max_s)} ({r.repeats})" if r.repeats > 1 else NONE


COLUMNS: Sequence[Column] = (
    Column("label", "Group", "", "Label of the run in its suite.", _of("label")),
    Column("settings", "Settings", "", "Step or tolerance, and options that differ from the defaults.",
           lambda c: c.settings(), latex="Settings"),
    Column("status", "Status", "", "How the run ended; wrong: success was claimed, but a law is broken; "
           "inaccurate: all laws hold, but the motion is off the reference.",
           lambda c: mark(c.status).word, latex="Status"),
    Column("t_reached", "t reached", "s", "Time of the last accepted step.", _of("t_reached_s"), time),
    Column("energy_drift_max", "max |E−E₀|", "J",
           "Largest energy error over all accepted steps; the work of dampers, loads, user forces and drives is "
           "subtracted.", _of("energy_drift_max_J"), latex=r"$\max|E-E_0|$ [J]"),
    Column("energy_drift_end", "E−E₀ at end", "J", "Energy error at the last step, with its sign.",
           _of("energy_drift_end_J"), format_signed),
    Column("energy_trend", "Energy trend", "J/s", "Least-squares slope of the energy error over time.",
           _of("energy_trend_W"), format_signed),
    Column("energy_kind", "Energy error", "", "Drifts if its mean shifts from the first to the last quarter of the "
           "run by over a third of its largest value, else bounded; this says nothing of its size.", energy_kind),
    Column("position_error", "Position error", "m", "Largest distance of a centre of mass from its exact position, up "
           "to the time that errors are judged to.", _error_column("position_error", "m"), latex="Error [m]"),
    Column("orientation_error", "Orientation error", "rad", "Largest angle between a body and its exact orientation, "
           "up to there.", _error_column("orientation_error", "rad"), latex="Error [rad]"),
    Column("motion_error", "Motion error", "m", "Largest distance of a body from its exact pose, root mean square over "
           "its matter: position and orientation in one number; up to there.", _error_column("motion_error", "m")),
    Column("judged_to", "judged to", "s", "Errors are judged up to this time: beyond it the motion is chaotic and no "
           "solver can track it, so only energy and constraints count.", _of("judged_to_s"), time),
    Column("position_error_whole", "Position error to the end of the reference", "m",
           "The same up to where the reference or the run ends.", _of("position_error_max_m")),
    Column("orientation_error_whole", "Orientation error to the end of the reference", "rad", "The same.",
           _of("orientation_error_max_rad")),
    Column("motion_error_whole", "Motion error to the end of the reference", "m", "The same.",
           _of("motion_error_max_m")),
    Column("accurate_until", "Accurate until", "s", "Time at which the motion error first passes a tenth of the reach; "
           "the end of the comparison if it never does.", _of("accurate_until_s"), time),
    Column("accurate_until_1pct", "to 1 %", "s", "The same for a hundredth.", _of("accurate_until_1pct_s"), time),
    Column("accurate_until_0p1pct", "to 0.1 %", "s", "The same for a thousandth.", _of("accurate_until_0p1pct_s"),
           time),
    Column("true_motion", "True motion within", "m", "Largest distance of a centre of mass from some true motion, as "
           "mbsbench shadow finds it: what counts once chaos has made the error meaningless.", _near("largest_m")),
    Column("true_motion_until", "over", "s", "Up to this time.", _near("until_s"), time),
    Column("symplectic", "Symplectic", "", "Whether the modified energy of a fixed step swings by less than "
           f"{SYMPLECTIC:g} of the scale; coarse steps may hide it.",
           lambda c: c.nearest.symplectic if c.nearest else ""),
    Column("compared_to", "Compared to", "s", "Last step before the reference or the run ends.", _of("compared_to_s"),
           time),
    Column("reference_own_error", "Stated error", "m",
           "Error that the reference states for itself: smaller errors cannot be distinguished.",
           _of("reference_own_error_m")),
    Column("phi_max", "max |φ|", "m", "Largest norm of the constraint residual: how far joints come apart.",
           _of("phi_max"), latex=r"$\max\|\phi\|$ [m]"),
    Column("phi_dot_max", "max |φ̇|", "m/s", "Largest norm of its rate.", _of("phi_dot_max")),
    Column("eq81_max", "Eq. (81)", "√J",
           "The paper's norm of the constraint rates, √(φ̇ᵀ M̄ φ̇), at its largest.", _of("eq81_max_sqrtJ")),
    Column("orthogonality_max", "|RᵀR−1|", "",
           "Largest deviation of a rotation matrix from orthogonality.", _of("orthogonality_max")),
    Column("out_of_plane", "Out of plane", "m", "Largest distance from the plane that the exact motion stays in.",
           _of("out_of_plane_max_m")),
    Column("steps", "Steps", "", "Accepted steps.", _of("steps"), whole),
    Column("rejected", "Rejected", "", "Rejected steps, where the solver counts them.",
           _of("rejected"), whole),
    Column("step_min", "Step min", "s", "Smallest accepted step, without the last one.", _of("step_min_s")),
    Column("step_median", "median", "s", "Median accepted step.", _of("step_median_s")),
    Column("step_max", "max", "s", "Largest accepted step.", _of("step_max_s")),
    Column("newton", "Newton", "", "Iterations of the nonlinear solver.", _of("newton_iterations"), whole),
    Column("evaluations", "Evaluations", "",
           "Evaluations of the residual or right-hand side: work that does not depend on the machine.",
           _of("evaluations"), whole),
    Column("jacobians", "Jacobians", "", "Evaluations of the Jacobian.", _of("jacobians"), whole),
    Column("factorisations", "Factorisations", "", "Matrix factorisations.", _of("factorisations"), whole),
    Column("cpu_median", "CPU", "s", "CPU time of the integration alone, median of the repeats.", _of("cpu_median_s"),
           format_cpu_time, latex="CPU [s]"),
    Column("cpu_spread", "CPU spread", "s",
           "Least and largest of the repeated timings, and how many; a dash for a single one.", _spread),
    Column("setup", "Set-up", "s",
           "CPU time of compilation and preparation before the first step, not part of that of the integration.",
           _of("setup_s")),
    Column("memory", "Memory", "MB", "Largest resident memory of the run's process.", _of("peak_memory_MB")),
)  # fmt: skip


def list_printed_columns(runs: Sequence[Run]) -> Sequence[Column]:
    """The columns of a table for a paper: one error, that of the pages."""
    measure = measure_for(runs)
    other = "position_error" if measure and measure.unit == "rad" else "orientation_error"
    return [c for c in COLUMNS if c.latex and c.key != other]


def write_tables(variants: Sequence[Variant], folder: Place, *, rounded: bool = False) -> list[Path]:
    """One CSV and one LaTeX table a problem; returns the files. A ``rounded`` CSV has the numbers of the LaTeX one."""
    out = []
    for variant in variants:
        values = rounded_csv_of(variant.runs) if rounded else csv_of(variant.runs)
        for suffix, text in ((".csv", values), (".tex", latex_of(variant.title, variant.runs))):
            place = folder / f"{variant.slug}{suffix}"
            place.write(text, durable=False)
            out.append(place.path)
    return out


def csv_of(runs: Sequence[Run]) -> str:
    """All columns, numbers in full; empty where a quantity does not exist."""
    rows = [[c.variant, c.record.solver, c.record.paper_label, *(_full(k, c) for k in COLUMNS), "; ".join(c.reasons)]
            for c in runs]  # fmt: skip
    return to_csv([["problem", "solver", "paper_label", *map(_head, COLUMNS), "reason"], *rows])


def rounded_csv_of(runs: Sequence[Run]) -> str:
    """The columns of the LaTeX table with the same digits."""
    columns = list_printed_columns(runs)
    rows = [[c.record.solver, *(_round_cell(k, c) for k in columns)] for own in by_solver(runs).values() for c in own]
    return to_csv([["solver", *map(_head, columns)], *rows])


def to_csv(rows: Sequence[Sequence[str]]) -> str:
    """Rows of cells as text."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _head(column: Column) -> str:
    return f"{column.key} [{column.unit}]" if column.unit else column.key


def latex_of(title: str, runs: Sequence[Run]) -> str:
    """The main columns, one column of a journal wide, for booktabs: each solver with its runs below it.

    A failure keeps its row and says how it ended.
    """
    columns, measure = list_printed_columns(runs), measure_for(runs)
    kinds = "".join(WRAPPED.get(c.key, "r") for c in columns)
    out = [" & ".join(c.latex for c in columns) + r" \\", r"\midrule"]
    for solver, own in by_solver(runs).items():
        out.append(rf"\multicolumn{{{len(columns)}}}{{@{{}}l}}{{{latex_text(solver)}}} \\*")
        out += [" & ".join(_latex(c, run) for c in columns) + r" \\" for run in own]
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


def _full(column: Column, run: Run) -> str:
    value = column.of(run)
    if isinstance(value, str):
        return "" if value == NONE else value
    return "" if math.isnan(value) else repr(value)


def _latex(column: Column, run: Run) -> str:
    value = column.of(run)
    return latex_text(value) if isinstance(value, str) else latex_number(value, column.show(value))


def _round_cell(column: Column, run: Run) -> str:
    value, shown = column.of(run), column.text(run)
    if isinstance(value, str) or shown == NONE:
        return "" if shown == NONE else str(value)
    mantissa, times, power = shown.replace("\u202f", "").replace("−", "-").replace("∞", "inf").partition("×10")
    return mantissa + (f"e{power.translate(DIGITS)}" if times else "")


def _one_line(text: str) -> str:
    return " ".join(text.split())
