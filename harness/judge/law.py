"""Judge whether laws are kept: all limits on this are here, or where pages read them, in ``mechanics.types.verdicts``.

A run that claims success and breaks a law is wrong. Its limits scale with what the motion reaches (``metrics.scales``),
and are wide on purpose; the benchmark's own limit (``energy_allowed_J``) is not judged here. Narrower ones hold for
motions that are said to be exact, for the motion of an engine whose roundings are known, and for what an energy error
may gather over a long run.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

from ..columns.measured import MeasuredSeries
from ..columns.numbers import find_largest
from ..mechanics.types import Law, Problem, Reason, Trajectory
from ..results.findings import Finding, judge_value, leave_open
from ..results.judgements.runs import DriftVerdict
from .distance import find_first_time, find_inaccuracy
from .metrics.measure import JOINTS

# of a claimed success
# The numbers of runs in these comments are of the 813 claimed successes of the suites ``first`` and ``paper``: those
# above the limit, those above half of it, and those above twice as much.
# share of its scale by unit (momentum: m v L), or of its initial value if that is larger; twice: 332 of the 1,744
# drifts for which published runs are wrong are below it
INVARIANT = 0.10
UNITS = {Law.ENERGY: "J", Law.CONSTRAINT: "m", Law.CONSTRAINT_RATE: "m/s", Law.ORTHOGONALITY: ""}
# share of the path beyond the exact motion's: three steps a turn give 0.3, reversed velocities 2. Above it, and above
# half of it: none.
KINEMATIC = 0.5
# multiple of the largest exact joint force or moment: another order of magnitude. Above it: 2 forces, no moment; half:
# 2 moments more; twice: none.
REACTION = 10.0
START = 1e-9  # [m], [m/s], relative to 1 + size: what the consistency check of problems allows
# of a solver's records
TORQUE = 0.01  # of Omega x J Omega: a hundred times the error of the integral over steps
STEP = 1e-6  # of dt or max_step: a step is a difference of rounded times
# shares of the problem's scales, for motions that are said to be exact, besides the error that they state
SMALL = 1e-8  # of the laws of poses and velocities
DIFFERENCED = 1e-8  # of derivatives from differences: (step x rate)^6 is below 1e-12
ROUNDED = 1e-12  # rounding of a smooth motion, before division by a step
STATED = 100.0  # multiple of the stated error of poses, which velocities exceed by their rate
PRODUCTS = 10.0  # multiple for what is computed from several quantities, such as a momentum
# of the motion of an engine
PRECISIONS = {"float32": 2.0**-24, "float64": 2.0**-53}  # half a unit of the last digit
DEVIATIONS = 3.0  # standard deviations of random roundings of all numbers given (``lab.kit.conditioning``)
EVALUATION = 32.0  # roundings in the evaluation of laws from poses and velocities
STARTS = 16.0, 1e-12  # roundings of a start that is converted, and what they leave in its largest number, absolutely
# of energy errors over long runs
# fraction of the oscillation below which a trend over the whole span does not matter. Of 42 published drifts half makes
# a trend of one that is bounded; twice changes none.
MATTERS = 0.1
ROUNDING = 1e-12  # fraction of the energy scale below which changes over a whole run are rounding


def list_broken_laws(
    problem: Problem, trajectory: Trajectory, m: MeasuredSeries, columns: Mapping[str, Any]
) -> list[Reason]:
    """Return a reason for each law that a run which claims success breaks, so that it is wrong; empty if it keeps all.

    A motion with numbers that are not finite has that one reason. Laws of joints are not judged for a literal start,
    nor truncation errors for a run that is inaccurate. ``m`` are the measured series, ``columns`` the columns of the
    run's record by name.
    """
    size = m.size
    s, t = trajectory.states, m.t
    finite = np.all([np.isfinite(a).reshape(len(t), -1).all(axis=1) for a in (t, s.r, s.R, s.v, s.Omega)], axis=0)
    if not np.all(finite):
        return [Reason(Law.FINITE, time_s=find_first_time(t, ~finite))]
    out = []
    if not abs(t[-1] - problem.t_end) <= 1e-9 * max(problem.t_end, 1.0):
        out.append(Reason(Law.END, float(t[-1]), problem.t_end, "s", float(t[-1])))
    start_error = max(
        float(np.max(np.abs(getattr(s, k)[0] - getattr(problem.initial, k)))) for k in ("r", "R", "v", "Omega")
    )
    allowed = START * (1.0 + size.length + size.speed)
    if not start_error <= allowed or t[0] != 0.0:
        out.append(Reason(Law.START, start_error, allowed, time_s=float(t[0])))

    def require_at_most(
        law: Law, most: float, allowed: float, unit: str, series: np.ndarray | None, name: str = ""
    ) -> None:
        """Append a reason to ``out`` if ``most``, a quantity's largest size, exceeds what is ``allowed``.

        The reason has the first time at which |series| exceeds it. NaN, for what was not measured, is no reason.
        """
        if not math.isnan(most) and not most <= allowed:
            when = math.nan if series is None else find_first_time(t, ~(np.abs(series) <= allowed))
            out.append(Reason(law, most, allowed, unit, when, name))

    for mechanism in m.mechanisms:
        for law, series in mechanism.laws.items():
            if not (problem.literal_start and law in JOINTS):
                require_at_most(law, find_largest(series), mechanism.size.limits[law], UNITS[law], series)
    require_at_most(Law.KINEMATIC, m.kinematic_defect - m.kinematic_exact, KINEMATIC, "", None)
    require_at_most(Law.REACTION, m.reaction_error, REACTION * (m.reaction_size + size.energy / size.length), "N", None)
    require_at_most(Law.MOMENT, m.moment_error, REACTION * (m.moment_size + size.energy), "N m", None)
    accurate = not find_inaccuracy(m, columns)  # an inaccurate run's errors are known and reported as such
    for name, ratio in m.truncation.shares.items() if accurate else ():
        words = f"the error of {name}, beside what steps of this length leave open,"
        require_at_most(Law.TRUNCATION, ratio, 1.0, "", None, words)
    for invariant in problem.invariants:
        name, unit, values = invariant.name, invariant.unit, m.invariants[invariant.name]
        change, start, scale = values - values[0], abs(float(values[0])), size.of_unit(unit)
        allowed = INVARIANT * (start if math.isnan(scale) else max(scale, start))
        if allowed == 0.0:  # a unit without a scale, starting at zero: nothing to compare with
            continue
        require_at_most(Law.INVARIANT, find_largest(change), allowed, unit, change, name)
    return out


def compute_law_tolerance(stated: float) -> float:
    """Return the tolerance on the laws of a motion that is said to be exact, as a fraction of each law's scale.

    ``stated`` is the error that the motion states, as a fraction of its length. Laws on derivatives that are computed
    by finite differences have ``compute_derivative_tolerance``.
    """
    return SMALL + STATED * stated


def compute_derivative_tolerance(stated: float, change: float) -> float:
    """Return the relative tolerance on derivatives of an exact motion that are computed by finite differences.

    ``stated`` is the error that the motion states, as a fraction of its length; ``change`` is the change of the poses
    over one step of the differences [rad], by which that error and rounding are divided.
    """
    return DIFFERENCED + (ROUNDED + STATED * stated) / change


def estimate_relative_rounding(unit: float, steps: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
    """Return the relative rounding error of a motion after each of these numbers of ``steps``.

    ``unit`` is the unit roundoff of the arithmetic (``PRECISIONS``). The numbers given are rounded once, and the state
    once per step; the errors are taken to add up along the motion, with those of evaluating the laws.
    """
    return unit * (DEVIATIONS + steps) + EVALUATION * PRECISIONS["float64"]


def compute_start_tolerance(unit: float, largest: float) -> float:
    """Return the absolute tolerance on the numbers of a start that was converted to another arithmetic.

    ``unit`` is the unit roundoff of that arithmetic, ``largest`` the largest magnitude among the numbers.
    """
    roundings, least = STARTS
    return roundings * unit * (1.0 + largest) + least


def judge_largest_error(found: Mapping[str, tuple[float, str]], most: float) -> Finding:
    """Return the finding on the largest of several relative errors, which must be at most ``most``.

    ``found`` has by the name of each law its error, as a fraction of the law's scale, and words on it. NaN counts as
    the largest. The finding names the law; it is left open if ``found`` is empty.
    """
    if not found:
        return leave_open("there are none")
    name = max(found, key=lambda k: (math.isnan(found[k][0]), found[k][0]))
    share, words = found[name]
    return judge_value(share, "of its scale", most=most, words=f"{name} {words}".strip(), count=len(found))


def judge_trend(low: float, high: float, walk: float, oscillation: float, scale: float) -> DriftVerdict:
    """Return whether an energy error stays bounded over a run, has a trend, or wanders; else that it is undecided.

    This is a test of equivalence, not of significance. ``low`` and ``high`` are the ends of the confidence interval of
    the change by the trend over the whole run [J], ``oscillation`` is half the range within a period [J], ``scale`` is
    the energy scale [J], and ``walk`` is the size of the random walk, 0 if none was found.
    """
    if max(abs(low), abs(high)) <= max(MATTERS * oscillation, ROUNDING * scale):
        return "bounded"
    if low > 0.0 or high < 0.0:
        return "trend"
    return "wanders" if walk > 0.0 else "undecided"
