"""Order certificates: for every ladder of steps or tolerances in a run, the order of each quantity with its interval.

A ladder is all records of one variant and one solver with the same options that differ in dt alone, or in rtol alone;
those of the suite ``work`` are left out, for their few steps are wide apart and span long motions. With dt: the order
in dt, compared with the declared one. With rtol: the order achieved against the mean step, and the exponent against
rtol; solvers under error control declare no order.
"""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

from ...catalogue import registry
from ...results.judgements.runs import Note, Order, OrderVerdict
from ...results.records import RunRecord
from ...types import Status
from .fitting import FEWEST, Fit, fit_ladder, fit_scattered

CURVES = "work"  # label of runs that are points of a curve, not steps of a ladder
WITHIN = 0.1  # of the declared order, on either side
LOOSE = 0.2  # the whole interval must be within this of it
EXACT = 1e-13  # of its scale: rounding of some thousand steps; a tolerance of 1e-12 leaves more
HELD = 1e-9  # of its scale: errors no larger at any step are set by a tolerance, not by the step
KEPT = 1e-7  # the same where errors are seen not to depend on the step at all
OWN = 3.0  # times the reference's own error: smaller errors cannot be told apart
DIFFERENCED = 1e-7  # of the largest reaction: what sixth-order differences of the exact motion can be wrong by


@dataclass(frozen=True)
class Quantity:
    """An error of a record."""

    name: str
    symbol: str
    unit: str
    column: str
    scale: Callable[[RunRecord], float]  # what a large error is
    own: Callable[[RunRecord], float] = lambda r: 0.0  # what the reference cannot resolve
    most: float = math.inf  # of its scale: an error that large is no small number to fit

    def of(self, record: RunRecord) -> float:
        """The error."""
        return float(getattr(record, self.column))


def _length(r: RunRecord) -> float:
    return r.length_scale_m if r.length_scale_m > 0.0 else 1.0


def _reference_limit(r: RunRecord) -> float:
    return OWN * r.reference_own_error_m


def _rate(r: RunRecord) -> float:
    """speed / length [1/s] of the motion: what a position's error is multiplied by to be a velocity's."""
    return r.speed_scale_m_per_s / _length(r)


def _speed(r: RunRecord) -> float:
    return r.speed_scale_m_per_s


WORST: tuple[OrderVerdict, ...] = (  # of two quantities the one that comes first here is the ladder's
    "below declared", "not measured", "refused", "undecided", "above declared", "measured", "certified", "floor",
    "exact",
)  # fmt: skip
QUANTITIES = (
    Quantity("position", "r", "m", "position_error_max_m", _length, _reference_limit, 0.3),
    Quantity("orientation", "R", "rad", "orientation_error_max_rad", lambda r: 1.0,
             lambda r: _reference_limit(r) / _length(r), 0.6),
    Quantity("velocity", "v", "m/s", "velocity_error_max_m_per_s", _speed, lambda r: _reference_limit(r) * _rate(r)),
    Quantity("angular velocity", "Omega", "rad/s", "angular_velocity_error_max_rad_per_s", _rate,
             lambda r: _reference_limit(r) / _length(r) * _rate(r)),
    Quantity("energy", "E", "J", "energy_drift_max_J", lambda r: r.energy_scale_J),
    Quantity("|phi|", "|phi|", "m", "phi_max", _length),
    Quantity("|phi_dot|", "|phi_dot|", "m/s", "phi_dot_max", _speed),
    Quantity("reaction", "A^T lam", "N", "reaction_error_max_N",
             lambda r: r.reaction_size_N if r.reaction_size_N > 0.0 else 1.0,
             lambda r: DIFFERENCED * r.reaction_size_N),
)  # fmt: skip


def certify(folder: Path, records: Iterable[RunRecord]) -> tuple[Order, ...]:
    """One a ladder and quantity, in the order of problems and solvers."""
    return tuple(o for run in _find_ladders(records) for o in _certify_ladder(run))


def select_motion(orders: Iterable[Order]) -> list[Order]:
    """One a ladder of fixed steps: the worse of positions and orientations, of positions where both are alike."""
    ladders: dict[tuple[str, str], list[Order]] = {}
    for o in orders:
        if o.against == "dt" and o.quantity in ("position", "orientation"):
            ladders.setdefault((o.variant, o.case), []).append(o)
    return [min(own, key=lambda o: WORST.index(o.verdict)) for own in ladders.values()]


def _find_ladders(records: Iterable[RunRecord]) -> list[list[RunRecord]]:
    """Runs that differ in their step alone, coarsest first, each step once."""
    groups: dict[tuple, dict[float, RunRecord]] = {}
    for r in sorted(records, key=lambda r: (r.problem, r.problem_parameters, r.solver, r.solver_options, r.finished)):
        if r.label == CURVES or r.status == Status.UNFINISHED:
            continue
        key = (r.problem, r.problem_parameters, r.solver, r.solver_options, r.control, str(r.max_step_s))
        groups.setdefault(key, {})[r.dt_s if r.control == "dt" else r.rtol] = r
    runs = [[own[step] for step in sorted(own, reverse=True)] for own in groups.values()]
    return [run for run in runs if len(run) > FEWEST and not json.loads(run[0].problem_parameters).get("retrace")]


def _certify_ladder(run: Sequence[RunRecord]) -> list[Order]:
    """Orders of all quantities that can be measured; of positions also where it cannot, with the reason."""
    found = [o for q in QUANTITIES if (o := _certify_quantity(run, q)) is not None]
    return [o for k, o in enumerate(found) if k == 0 or o.is_measured]


def _certify_quantity(run: Sequence[RunRecord], q: Quantity) -> Order | None:
    done = [r for r in run if r.claimed == Status.SUCCESS and math.isfinite(q.of(r)) and r.steps > 0]
    failed = [r for r in run if r.claimed != Status.SUCCESS or not r.steps > 0]
    few = len(done) <= FEWEST
    ended = failed[-1:] if few else []  # what it said
    first, fixed = run[0], run[0].control == "dt"
    scale = max((q.scale(r) for r in done), default=math.nan)
    errors = [q.of(r) for r in done]
    steps = [r.dt_s if fixed else r.t_reached_s / r.steps for r in done]
    good = [q.own(r) < e < q.most * scale and not _has_cut_steps(r) for r, e in zip(done, errors, strict=True)]
    fit, rate = (NOTHING, NOTHING) if few else _fit(done, steps, errors, good, scale, fixed)
    if not any(errors) and not few and math.isnan(first.declared_order):
        return None  # a quantity that does not move
    notes = {Note.NO_SCALE: math.isnan(scale) and not few}
    if fit.kind != "exact":
        notes[Note.CUT] = any(_has_cut_steps(r) for r in done)
        notes[Note.UNRESOLVED] = any(errors) and any(e <= q.own(r) for r, e in zip(done, errors, strict=True))
    refused = few and all(r.claimed == Status.REFUSED for r in run)
    variant, *words = first.case.split(" ")
    of_good = iter(fit.used)
    return Order(
        first.problem, variant, first.solver, " ".join(w for w in words if not w.startswith(("dt=", "rtol="))),
        q.name, q.symbol, q.unit, against="dt" if fixed else "mean step",
        declared=first.declared_order if fixed else math.nan, order=fit.order, low=fit.low, high=fit.high,
        dt=tuple(steps), error=tuple(errors), used=tuple(g and next(of_good, False) for g in good), floor=fit.floor,
        rtol=() if fixed else tuple(r.rtol for r in done),
        exponent=rate.order, exponent_low=rate.low, exponent_high=rate.high,
        verdict=("refused" if refused else "not measured") if few else _verdict(fit, first.declared_order, fixed),
        fit=fit.kind, slopes=fit.finer_slopes if any(fit.used) else fit.slopes, unfinished=len(failed),
        unmeasured=len(run) - len(failed) - len(done),
        notes=tuple(n for n, there in notes.items() if there), t_end_s=first.t_end_s,
        settings_ids=tuple(r.settings_id for r in done), status=ended[-1].status if ended else "",
        message=ended[-1].message if ended else "",
    )  # fmt: skip


NOTHING = Fit("none")


def _fit(
    done: Sequence[RunRecord], steps: list[float], errors: list[float], good: list[bool], scale: float, fixed: bool
) -> tuple[Fit, Fit]:
    """The order, and for error control the exponent against rtol."""
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
    """Share of an error's scale that the tolerance of a step's equations [sqrt(J)] may add up to over all steps."""
    known = registry.solvers().get(r.solver)
    default = 0.0 if known is None else known.parameters.get("tolerance", (0.0,))[0]
    tolerance = json.loads(r.solver_options).get("tolerance", default)
    if not isinstance(tolerance, int | float) or not r.energy_scale_J > 0.0:
        return 0.0
    return tolerance / math.sqrt(r.energy_scale_J) * r.steps


def _has_cut_steps(r: RunRecord) -> bool:
    """Whether a fixed step was not kept: the error then belongs to other steps."""
    return r.control == "dt" and r.steps != math.ceil(r.t_reached_s / r.dt_s - 1e-6)


def _verdict(fit: Fit, declared: float, fixed: bool) -> OrderVerdict:
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
