"""The columns of every table, HTML, CSV and LaTeX alike: what each number is, in one sentence."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .accuracy import energy_kind
from .results import Run
from .words import NONE, clocked, mark, number, signed, time, whole

Value = float | str


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


def _spread(c: Run) -> Value:
    r = c.record
    return f"{clocked(r.cpu_min_s)} to {clocked(r.cpu_max_s)} ({r.repeats})" if r.repeats > 1 else NONE


COLUMNS: Sequence[Column] = (
    Column("label", "Group", "", "Label of the run in its suite.", _of("label"), latex="Group"),
    Column("settings", "Settings", "", "Step or tolerance, and options that differ from the defaults.",
           lambda c: c.settings(), latex="Settings"),
    Column("status", "Status", "", "How the run ended; wrong: success was claimed, but a law is broken.",
           lambda c: mark(c.status).word, latex="Status"),
    Column("t_reached", "t reached", "s", "Time of the last accepted step.", _of("t_reached_s"), time),
    Column("energy_drift_max", "max |E−E₀|", "J",
           "Largest energy error over all accepted steps, without the work of dampers.", _of("energy_drift_max_J"),
           latex=r"$\max|E-E_0|$ [J]"),
    Column("energy_drift_end", "E−E₀ at end", "J", "Energy error at the last step, with its sign.",
           _of("energy_drift_end_J"), signed, latex=r"$E-E_0$ at end [J]"),
    Column("energy_trend", "Energy trend", "J/s", "Least-squares slope of the energy error over time.",
           _of("energy_trend_W"), signed),
    Column("energy_kind", "Energy error", "", "Drifts if its mean shifts from the first to the last quarter of the "
           "run by over a third of its largest value, else bounded; this says nothing of its size.", energy_kind),
    Column("position_error", "Position error", "m", "Largest distance of a centre of mass from its exact position.",
           _of("position_error_max_m"), latex="Position error [m]"),
    Column("orientation_error", "Orientation error", "rad", "Largest angle between a body and its exact orientation.",
           _of("orientation_error_max_rad"), latex="Orientation error [rad]"),
    Column("judged_to", "judged to", "s", "Errors are judged up to this time: beyond it the motion is chaotic and no "
           "solver can track it, so only energy and constraints count.", _of("judged_to_s"), time),
    Column("position_error_judged", "Position error judged", "m", "The position error up to there.",
           _of("position_error_judged_m")),
    Column("reference_own_error", "Stated error", "m",
           "Certified error of the reference itself: smaller errors cannot be distinguished.",
           _of("reference_own_error_m")),
    Column("phi_max", "max |φ|", "m", "Largest norm of the constraint residual: how far joints come apart.",
           _of("phi_max"), latex=r"$\max\|\phi\|$ [m]"),
    Column("phi_dot_max", "max |φ̇|", "m/s", "Largest norm of its rate.", _of("phi_dot_max"),
           latex=r"$\max\|\dot\phi\|$ [m/s]"),
    Column("eq81_max", "Eq. (81)", "√J",
           "The paper's norm of the constraint rates, √(φ̇ᵀ M̄ φ̇), at its largest.", _of("eq81_max_sqrtJ")),
    Column("orthogonality_max", "|RᵀR−1|", "",
           "Largest deviation of a rotation matrix from orthogonality.", _of("orthogonality_max")),
    Column("out_of_plane", "Out of plane", "m", "Largest distance from the plane that the exact motion stays in.",
           _of("out_of_plane_max_m")),
    Column("steps", "Steps", "", "Accepted steps.", _of("steps"), whole, latex="Steps"),
    Column("rejected", "Rejected", "", "Rejected steps, where the solver counts them.",
           _of("rejected"), whole),
    Column("step_min", "Step min", "s", "Smallest accepted step, without the last one.", _of("step_min_s")),
    Column("step_median", "median", "s", "Median accepted step.", _of("step_median_s")),
    Column("step_max", "max", "s", "Largest accepted step.", _of("step_max_s")),
    Column("newton", "Newton", "", "Iterations of the nonlinear solver.", _of("newton_iterations"), whole),
    Column("evaluations", "Evaluations", "",
           "Evaluations of the residual or right-hand side: work that does not depend on the machine.",
           _of("evaluations"), whole, latex="Evaluations"),
    Column("jacobians", "Jacobians", "", "Evaluations of the Jacobian.", _of("jacobians"), whole),
    Column("factorisations", "Factorisations", "", "Matrix factorisations.", _of("factorisations"), whole),
    Column("cpu_median", "CPU", "s", "CPU time of the integration alone, median of the repeats.", _of("cpu_median_s"),
           clocked, latex="CPU [s]"),
    Column("cpu_spread", "CPU spread", "s",
           "Least and largest of the repeated timings, and how many; a dash for a single one.", _spread),
    Column("setup", "Set-up", "s",
           "Compilation and preparation before the first step, not part of the CPU time.", _of("setup_s")),
    Column("memory", "Memory", "MB", "Largest resident memory of the run's process.", _of("peak_memory_MB")),
)  # fmt: skip
