"""Certify orders: for every ladder of steps or tolerances, the order of each quantity with its interval.

A ladder consists of all records of one variant and one solver with the same options that differ in dt only, or in rtol
only; those of the suite ``work`` are left out, since their few steps are wide apart and span long motions. With dt, the
order in dt is compared with the declared one. With rtol, the order against the mean step and the exponent against rtol
are measured; solvers under error control declare no order.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from ....catalogue import registry
from ....mechanics.types import Status
from ....results.judgements.runs import Order, OrderVerdict, Unjudged
from ....results.records import RunRecord
from ...distance import RESOLVED
from ...order import DIFFERENCED, FEWEST, NOTHING, fit_errors, judge_fit

CURVES = "work"  # label of runs that are points of a curve, not steps of a ladder


@dataclass(frozen=True)
class ErrorQuantity:
    """A kind of error in records; ``is_compared`` with a reference, it is not known below what that resolves."""

    name: str
    symbol: str  # as in tables
    unit: str
    column: str  # column of the record that holds it
    is_compared: bool = True
    most: float = math.inf  # fraction of its scale above which an error is too large to fit

    def read_error(self, record: RunRecord) -> float:
        """Return this error of a run, from its record, in ``unit``."""
        return float(getattr(record, self.column))

    def scale(self, r: RunRecord) -> float:
        """Return the size of a large error of a run, in ``unit``: that of its motion, its energy or its reactions.

        It is 1 m for a motion of no length, 1 rad for angles, and 1 N without reactions.
        """
        length = r.length_scale_m if r.length_scale_m > 0.0 else 1.0
        speed, force = r.speed_scale_m_per_s, r.reaction_size_N if r.reaction_size_N > 0.0 else 1.0
        sizes = {"m": length, "rad": 1.0, "m/s": speed, "rad/s": speed / length, "J": r.energy_scale_J, "N": force}
        return sizes[self.unit]

    def find_resolution(self, r: RunRecord) -> float:
        """Return the error, in ``unit``, below which the reference of a run cannot resolve errors; 0 without one."""
        if self.unit == "N":
            return DIFFERENCED * r.reaction_size_N
        length = r.length_scale_m if r.length_scale_m > 0.0 else 1.0
        return RESOLVED * r.reference_own_error_m / length * self.scale(r) if self.is_compared else 0.0


WORST: tuple[OrderVerdict, ...] = get_args(OrderVerdict)  # the verdict that comes first is that of the ladder
QUANTITIES = (
    ErrorQuantity("position", "r", "m", "position_error_max_m", most=0.3),
    ErrorQuantity("orientation", "R", "rad", "orientation_error_max_rad", most=0.6),
    ErrorQuantity("velocity", "v", "m/s", "velocity_error_max_m_per_s"),
    ErrorQuantity("angular velocity", "Omega", "rad/s", "angular_velocity_error_max_rad_per_s"),
    ErrorQuantity("energy", "E", "J", "energy_drift_max_J", is_compared=False),
    ErrorQuantity("|phi|", "|phi|", "m", "phi_max", is_compared=False),
    ErrorQuantity("|phi_dot|", "|phi_dot|", "m/s", "phi_dot_max", is_compared=False),
    ErrorQuantity("reaction", "A^T lam", "N", "reaction_error_max_N"),
)


def certify_orders(folder: Path, records: Iterable[RunRecord]) -> tuple[Order, ...]:
    """Return the observed order of each error quantity for each ladder of runs, sorted by problem and solver.

    ``folder`` is not read; the signature is that of all judgements.
    """
    return tuple(o for run in _find_ladders(records) for o in _certify_ladder(run))


def select_motion(orders: Iterable[Order]) -> list[Order]:
    """Return one order per ladder of fixed steps: that of position or orientation, whichever has the worse verdict.

    Of equal verdicts it is the first in ``orders``, that of position.
    """
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
    return [run for run in runs if len(run) > FEWEST and not run[0].parameters.get("retrace")]


def _certify_ladder(run: Sequence[RunRecord]) -> list[Order]:
    """Return the orders of all quantities of one ladder, ``run``, that can be measured.

    The first, of positions, is returned also if it cannot be measured; it then states the reason.
    """
    found = [o for q in QUANTITIES if (o := _certify_quantity(run, q)) is not None]
    return [o for k, o in enumerate(found) if k == 0 or o.is_measured]


def _certify_quantity(run: Sequence[RunRecord], q: ErrorQuantity) -> Order | None:
    """Return the order of one quantity ``q`` over the runs of a ladder, coarsest first; None if it has no error at all.

    Errors that the reference does not resolve, that are too large, or whose run cut steps are not fitted. With too few
    successful runs the order is NaN and the verdict ``refused`` or ``not measured``.
    """
    done = [r for r in run if r.claimed == Status.SUCCESS and math.isfinite(q.read_error(r)) and r.steps > 0]
    failed = [r for r in run if r.claimed != Status.SUCCESS or not r.steps > 0]
    few = len(done) <= FEWEST
    ended = failed[-1:] if few else []  # its message
    first, fixed = run[0], run[0].control == "dt"
    scale = max((q.scale(r) for r in done), default=math.nan)
    errors = [q.read_error(r) for r in done]
    steps = [r.dt_s if fixed else r.t_reached_s / r.steps for r in done]
    good = [
        q.find_resolution(r) < e < q.most * scale and not _has_cut_steps(r) for r, e in zip(done, errors, strict=True)
    ]
    tolerance = max(map(_sum_step_tolerances, done), default=0.0) if fixed else [r.rtol for r in done]
    fit, rate = (NOTHING, NOTHING) if few else fit_errors(steps, errors, good, scale, tolerance)
    if not any(errors) and not few and math.isnan(first.declared_order):
        return None  # the quantity is constant
    notes = {Unjudged.NO_SCALE: math.isnan(scale) and not few}
    if fit.kind != "exact":
        notes[Unjudged.CUT] = any(_has_cut_steps(r) for r in done)
        notes[Unjudged.UNRESOLVED] = any(errors) and any(
            e <= q.find_resolution(r) for r, e in zip(done, errors, strict=True)
        )
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
        else judge_fit(fit, first.declared_order, fixed=fixed),
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


def read_tolerance(r: RunRecord) -> float:
    """Return rtol of a run under error control or, for fixed steps, the tolerance of the step equations; NaN without.

    The latter is the solver's option ``tolerance``, or its default.
    """
    if r.control != "dt":
        return r.rtol
    known = registry.solvers().get(r.solver)
    default = math.nan if known is None else known.parameters.get("tolerance", (math.nan,))[0]
    tolerance = r.options.get("tolerance", default)
    return float(tolerance) if isinstance(tolerance, int | float) else math.nan


def _sum_step_tolerances(r: RunRecord) -> float:
    """Return the fraction of an error's scale that the step equations of a run may leave over all its steps.

    It is their tolerance [sqrt(J)] times the number of steps, over the square root of the energy scale; 0 for a solver
    without such a tolerance.
    """
    share = read_tolerance(r) / math.sqrt(r.energy_scale_J) * r.steps if r.energy_scale_J > 0.0 else 0.0
    return 0.0 if math.isnan(share) else share


def _has_cut_steps(r: RunRecord) -> bool:
    """Return whether a run with a fixed step took another number of steps than that gives, so that some were cut."""
    return r.control == "dt" and r.steps != math.ceil(r.t_reached_s / r.dt_s - 1e-6)
