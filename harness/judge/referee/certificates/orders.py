"""Certify orders: for every ladder of steps or tolerances, the order of each quantity with its interval.

A ladder consists of all records of one variant and one solver with the same options that differ in dt only, or in rtol
only; those of the suite ``work`` are left out, since their few steps are wide apart and span long motions. With dt, the
order in dt is compared with the declared one. With rtol, the order against the mean step and the exponent against rtol
are measured; solvers under error control declare no order.
"""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

from ....catalogue import registry
from ....mechanics.types import Status
from ....results.judgements.runs import Note, Order, OrderVerdict
from ....results.records import RunRecord
from .fitting import FEWEST, Fit, fit_ladder, fit_scattered

CURVES = "work"  # label of runs that are points of a curve, not steps of a ladder
WITHIN = 0.1  # largest distance from the declared order
LOOSE = 0.2  # largest distance of the interval's ends from it
EXACT = 1e-13  # fraction of the scale: rounding of some thousand steps; a tolerance of 1e-12 leaves more
HELD = 1e-9  # fraction of the scale: errors below at every step are set by a tolerance, not by the step
KEPT = 1e-7  # as HELD, if errors do not depend on the step at all
OWN = 3.0  # multiple of the reference's stated error below which errors are not resolved
DIFFERENCED = 1e-7  # fraction of the largest reaction: error of sixth-order differences of the exact motion


@dataclass(frozen=True)
class ErrorQuantity:
    """A kind of error in records, with its scale, the part that the reference resolves, and a limit for fits."""

    name: str
    symbol: str  # as in tables
    unit: str
    column: str  # column of the record that holds it
    scale: Callable[[RunRecord], float]  # size of a large error
    own: Callable[[RunRecord], float] = lambda r: 0.0  # error that the reference cannot resolve
    most: float = math.inf  # fraction of its scale above which an error is too large to fit

    def read_error(self, record: RunRecord) -> float:
        """Return this error of a run, from its record, in ``unit``."""
        return float(getattr(record, self.column))


def _length(r: RunRecord) -> float:
    """Return the reach of the run's motion [m], or 1 if it does not move."""
    return r.length_scale_m if r.length_scale_m > 0.0 else 1.0


def _reference_limit(r: RunRecord) -> float:
    """Return the position error below which the reference resolves nothing [m]."""
    return OWN * r.reference_own_error_m


def _rate(r: RunRecord) -> float:
    """Return speed over length of the motion [1/s], which converts a position error to a velocity error."""
    return r.speed_scale_m_per_s / _length(r)


def _speed(r: RunRecord) -> float:
    """Return the largest speed of a body in the run [m/s]."""
    return r.speed_scale_m_per_s


WORST: tuple[OrderVerdict, ...] = (  # the verdict that comes first is that of the ladder
    "below declared",
    "not measured",
    "refused",
    "undecided",
    "above declared",
    "measured",
    "certified",
    "floor",
    "exact",
)
QUANTITIES = (
    ErrorQuantity("position", "r", "m", "position_error_max_m", _length, _reference_limit, 0.3),
    ErrorQuantity(
        "orientation",
        "R",
        "rad",
        "orientation_error_max_rad",
        lambda r: 1.0,
        lambda r: _reference_limit(r) / _length(r),
        0.6,
    ),
    ErrorQuantity(
        "velocity", "v", "m/s", "velocity_error_max_m_per_s", _speed, lambda r: _reference_limit(r) * _rate(r)
    ),
    ErrorQuantity(
        "angular velocity",
        "Omega",
        "rad/s",
        "angular_velocity_error_max_rad_per_s",
        _rate,
        lambda r: _reference_limit(r) / _length(r) * _rate(r),
    ),
    ErrorQuantity("energy", "E", "J", "energy_drift_max_J", lambda r: r.energy_scale_J),
    ErrorQuantity("|phi|", "|phi|", "m", "phi_max", _length),
    ErrorQuantity("|phi_dot|", "|phi_dot|", "m/s", "phi_dot_max", _speed),
    ErrorQuantity(
        "reaction",
        "A^T lam",
        "N",
        "reaction_error_max_N",
        lambda r: r.reaction_size_N if r.reaction_size_N > 0.0 else 1.0,
        lambda r: DIFFERENCED * r.reaction_size_N,
    ),
)


def certify(folder: Path, records: Iterable[RunRecord]) -> tuple[Order, ...]:
    """Return the observed order of each error quantity for each ladder of runs, sorted by problem and solver.

    ``folder`` is not read; the signature is that of all judgements.
    """
    return tuple(o for run in _find_ladders(records) for o in _certify_ladder(run))


def select_motion(orders: Iterable[Order]) -> list[Order]:
    """Return one order per ladder of fixed steps: the worse of position and orientation, position if both are equal."""
    ladders: dict[tuple[str, str], list[Order]] = {}
    for o in orders:
        if o.against == "dt" and o.quantity in ("position", "orientation"):
            ladders.setdefault((o.variant, o.case), []).append(o)
    return [min(own, key=lambda o: WORST.index(o.verdict)) for own in ladders.values()]


def _find_ladders(records: Iterable[RunRecord]) -> list[list[RunRecord]]:
    """Group runs into ladders: those that differ only in their step or tolerance, coarsest first, each value once.

    Ladders of too few runs, and of runs that are integrated back to the start, are left out.
    """
    groups: dict[tuple, dict[float, RunRecord]] = {}
    for r in sorted(records, key=lambda r: (r.problem, r.problem_parameters, r.solver, r.solver_options, r.finished)):
        if r.label == CURVES or r.status == Status.UNFINISHED:
            continue
        key = (r.problem, r.problem_parameters, r.solver, r.solver_options, r.control, str(r.max_step_s))
        groups.setdefault(key, {})[r.dt_s if r.control == "dt" else r.rtol] = r
    runs = [[own[step] for step in sorted(own, reverse=True)] for own in groups.values()]
    return [run for run in runs if len(run) > FEWEST and not json.loads(run[0].problem_parameters).get("retrace")]


def _certify_ladder(run: Sequence[RunRecord]) -> list[Order]:
    """Return the orders of all quantities of one ladder that can be measured.

    The first, of positions, is returned also if it cannot be measured; it then states the reason.
    """
    found = [o for q in QUANTITIES if (o := _certify_quantity(run, q)) is not None]
    return [o for k, o in enumerate(found) if k == 0 or o.is_measured]


def _certify_quantity(run: Sequence[RunRecord], q: ErrorQuantity) -> Order | None:
    """Return the order of one quantity over the runs of a ladder, coarsest first; None if the quantity is constant.

    With too few successful runs the order is NaN and the verdict ``refused`` or ``not measured``.
    """
    done = [r for r in run if r.claimed == Status.SUCCESS and math.isfinite(q.read_error(r)) and r.steps > 0]
    failed = [r for r in run if r.claimed != Status.SUCCESS or not r.steps > 0]
    few = len(done) <= FEWEST
    ended = failed[-1:] if few else []  # its message
    first, fixed = run[0], run[0].control == "dt"
    scale = max((q.scale(r) for r in done), default=math.nan)
    errors = [q.read_error(r) for r in done]
    steps = [r.dt_s if fixed else r.t_reached_s / r.steps for r in done]
    good = [q.own(r) < e < q.most * scale and not _has_cut_steps(r) for r, e in zip(done, errors, strict=True)]
    fit, rate = (NOTHING, NOTHING) if few else _fit(done, steps, errors, good, scale, fixed)
    if not any(errors) and not few and math.isnan(first.declared_order):
        return None  # the quantity is constant
    notes = {Note.NO_SCALE: math.isnan(scale) and not few}
    if fit.kind != "exact":
        notes[Note.CUT] = any(_has_cut_steps(r) for r in done)
        notes[Note.UNRESOLVED] = any(errors) and any(e <= q.own(r) for r, e in zip(done, errors, strict=True))
    refused = few and all(r.claimed == Status.REFUSED for r in run)
    variant, *words = first.case.split(" ")
    of_good = iter(fit.used)
    return Order(
        first.problem,
        variant,
        first.solver,
        " ".join(w for w in words if not w.startswith(("dt=", "rtol="))),
        q.name,
        q.symbol,
        q.unit,
        against="dt" if fixed else "mean step",
        declared=first.declared_order if fixed else math.nan,
        order=fit.order,
        low=fit.low,
        high=fit.high,
        dt=tuple(steps),
        error=tuple(errors),
        used=tuple(g and next(of_good, False) for g in good),
        floor=fit.floor,
        rtol=() if fixed else tuple(r.rtol for r in done),
        exponent=rate.order,
        exponent_low=rate.low,
        exponent_high=rate.high,
        verdict=("refused" if refused else "not measured")
        if few
        else _choose_verdict(fit, first.declared_order, fixed),
        fit=fit.kind,
        slopes=fit.finer_slopes if any(fit.used) else fit.slopes,
        unfinished=len(failed),
        unmeasured=len(run) - len(failed) - len(done),
        notes=tuple(n for n, there in notes.items() if there),
        t_end_s=first.t_end_s,
        settings_ids=tuple(r.settings_id for r in done),
        status=ended[-1].status if ended else "",
        message=ended[-1].message if ended else "",
    )


NOTHING = Fit("none")


def _fit(
    done: Sequence[RunRecord], steps: list[float], errors: list[float], good: list[bool], scale: float, fixed: bool
) -> tuple[Fit, Fit]:
    """Return the fit of errors against steps, and under error control the fit against rtol (else ``NOTHING``).

    ``done`` are the successful runs, ``steps`` their steps [s], ``good`` whether each error can be fitted,
    ``scale`` the size of a large error, ``fixed`` whether the ladder is of fixed steps.
    """
    if max(errors) <= EXACT * scale:
        return Fit("exact"), NOTHING
    if max(errors) <= HELD * scale:
        return Fit("flat", floor=max(errors)), NOTHING
    x, y, rtol = (list(compress(v, good)) for v in (steps, errors, (r.rtol for r in done)))
    if fixed:
        fit = fit_ladder(x, y, max(HELD, *(_tolerance_share(r) for r in done)) * scale)
        held = fit.kind == "flat" and max(y) <= KEPT * scale
        return (replace(fit, floor=max(y)) if held else fit), NOTHING
    if len(y) <= FEWEST:
        return NOTHING, NOTHING
    return fit_scattered(x, y), fit_scattered(rtol, y)


def _tolerance_share(r: RunRecord) -> float:
    """Return the tolerance of the step equations [sqrt(J)], summed over all steps, as a fraction of an error's scale.

    It is 0 for a solver without such a tolerance.
    """
    known = registry.solvers().get(r.solver)
    default = 0.0 if known is None else known.parameters.get("tolerance", (0.0,))[0]
    tolerance = json.loads(r.solver_options).get("tolerance", default)
    if not isinstance(tolerance, int | float) or not r.energy_scale_J > 0.0:
        return 0.0
    return tolerance / math.sqrt(r.energy_scale_J) * r.steps


def _has_cut_steps(r: RunRecord) -> bool:
    """Return whether a run asked for a fixed step took other steps: the error then belongs to those."""
    return r.control == "dt" and r.steps != math.ceil(r.t_reached_s / r.dt_s - 1e-6)


def _choose_verdict(fit: Fit, declared: float, fixed: bool) -> OrderVerdict:
    """Return the verdict on a fitted order against the declared one (NaN if none); ``fixed`` means fixed steps."""
    if fit.kind == "exact":
        return "exact"
    if fit.kind == "flat" and math.isfinite(fit.floor):
        return "floor"
    if fit.kind == "flat" and not math.isnan(declared):
        return "below declared"
    if fit.kind != "power":
        return "undecided"
    if not fixed or math.isnan(declared):
        return "measured"
    if abs(fit.order - declared) <= WITHIN and fit.low >= declared - LOOSE and fit.high <= declared + LOOSE:
        return "certified"
    if fit.low > declared + WITHIN:
        return "above declared"
    return "below declared" if fit.high < declared - WITHIN else "undecided"
