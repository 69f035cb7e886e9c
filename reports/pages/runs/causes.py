"""Why a run stopped, as far as its record and its series tell: one cause to group by, and all the evidence."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ....harness.results.series import Series
from ....harness.types import Status
from ...model.results import Run
from ...model.words import number

LAST = 120  # rows at the end that are looked at and drawn
COLLAPSE = 1e-3  # of the usual step: a step this small is no longer a choice of accuracy
NEAR_CHART = 0.05  # of |sin theta|: the angles' rates are 20 times the body's there
ENERGY = 0.1  # of the energy there is to exchange: what a claimed success is called wrong at
APART = 0.01  # of the mechanism's size, the same for joints
SIZES = {  # of a cause: what grew, its unit, what it is measured by
    "energy": ("energy error", "J", "the energy exchanged"),
    "apart": ("|φ|", "m", "the mechanism's size"),
}
GROWTH = 100.0  # within the last rows: more than a swing


@dataclass(frozen=True)
class Cause:
    """A group of the atlas."""

    key: str
    title: str
    words: str


CAUSES = (
    Cause("killed", "The process died", "An exception, a signal or the limit on memory ended it."),
    Cause("unmoved", "No step accepted", "The start or the first step failed."),
    Cause("chart", "Singular angles", "The rates of the angles are singular where sin θ = 0: a fault of the "
          "coordinates, not of the motion."),
    Cause("dependent", "Constraints became dependent", "The solver reports a singular system: rows of the constraint "
          "matrix lost their independence, as in the mechanism's singular positions."),
    Cause("energy", "Energy blew up", "The energy error exceeded a tenth of the energy that the motion exchanges."),
    Cause("apart", "Joints came apart", "|φ| exceeded a hundredth of the mechanism's size."),
    Cause("collapse", "The step collapsed", "The last steps are shorter than a thousandth of the usual one, "
          "while errors were still small."),
    Cause("corrector", "The corrector failed", "The nonlinear solver did not converge at steps of usual size."),
    Cause("limit", "A limit was reached", "The limit on steps or time ended a run that was still advancing."),
)  # fmt: skip


@dataclass(frozen=True)
class Autopsy:
    """The facts on one run that stopped before its end."""

    run: Run
    cause: Cause
    evidence: tuple[str, ...]


def autopsy(run: Run, series: Series | None) -> Autopsy:
    """The first cause that applies, in the order of ``CAUSES``, and what each series shows."""
    r, died = run.record, run.status in (Status.CRASHED, Status.MEMORY)
    causes = {c.key: c for c in CAUSES}
    if series is None or "t" not in series or len(series["t"]) < 2:
        return Autopsy(run, causes["killed" if died else "unmoved"], ())
    signs = [s for s in (
        _chart(series), _size(series, "energy_error", "energy", r.energy_scale_J, ENERGY),
        _size(series, "phi_norm", "apart", r.length_scale_m, APART), _step(series),
    ) if s is not None]  # fmt: skip
    applies = {key for key, found, _ in signs if found} | {"limit"}
    applies |= {key for key, ended in (
        ("killed", died), ("dependent", run.status == Status.SINGULAR),
        ("corrector", run.status in (Status.DIVERGED, Status.STEP_UNDERFLOW)),
    ) if ended}  # fmt: skip
    evidence = [words for _, _, words in signs]
    if r.steps and r.series_rows and r.series_rows < r.steps + 1:
        rows = f"{r.series_rows} of {r.steps + 1} rows"
        evidence.append(f"the series is thinned to {rows}: its last rows span more steps")
    return Autopsy(run, next(c for c in CAUSES if c.key in applies), tuple(evidence))


def _step(series: Series) -> tuple[str, bool, str] | None:
    dt = series["dt"][1:] if "dt" in series else np.empty(0)
    dt = dt[np.isfinite(dt)]
    if len(dt) < 2:
        return None
    usual, last = usual_step(dt), float(np.min(dt[-3:]))
    if last < COLLAPSE * usual:
        return "collapse", True, f"the step fell from its usual {number(usual)} s to {number(last)} s"
    return "collapse", False, f"the step did not collapse: {number(last)} s at the end, usually {number(usual)} s"


def usual_step(dt: Float[np.ndarray, " n"]) -> float:
    """[s] half of the time was covered by steps at least as long: the many small ones before a stop do not count."""
    ordered = np.sort(dt)
    return float(ordered[np.searchsorted(np.cumsum(ordered), 0.5 * np.sum(ordered))])


def _size(series: Series, name: str, cause: str, scale: float, limit: float) -> tuple[str, bool, str] | None:
    """The size of an error at the end, as a part of its scale."""
    if name not in series or not len(series[name]) or not scale > 0.0:
        return None
    size = np.abs(series[name])
    last = float(size[-1])
    what, unit, whole = SIZES[cause]
    share = f"{number(100.0 * last / scale)} %" if not last / scale < 1e-5 else "less than 0.001 %"
    words = f"{what} {number(last)} {unit} at the end, {share} of {whole}{_describe_growth(size)}"
    return cause, not last <= limit * scale, words


def _chart(series: Series) -> tuple[str, bool, str] | None:
    """Solvers in angles record how far they are from their chart's singularity."""
    if "diag_chart_margin" not in series:
        return None
    margin = np.abs(series["diag_chart_margin"][-LAST:])
    least = float(np.fmin.reduce(margin, initial=np.inf))  # NaN is left out
    if least >= NEAR_CHART:
        return None
    return "chart", True, f"|sin θ| came down to {number(least)} within the last {len(margin)} steps"


def _describe_growth(size: np.ndarray) -> str:
    """How much the last rows grew, where that is more than a swing."""
    tail = size[-LAST:]
    before = tail[: len(tail) // 2]
    before = before[np.isfinite(before) & (before > 0.0)]
    if len(before) == 0 or not math.isfinite(float(size[-1])):
        return ""
    factor = float(size[-1]) / float(np.median(before))
    words = f", {number(factor)} times its median {len(tail) // 2} to {len(tail)} steps before"
    return words if factor > GROWTH else ""
