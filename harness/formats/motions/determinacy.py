"""Find the laws that the columns of a file determine, and how accurately, given its digits and spacing.

A quantity that is neither in the file nor follows from it is NaN here: a law whose value is then NaN is not determined.
The influence of digits and spacing on a law is found by reading the file in another way that it allows: with rates from
splines of degree 3 instead of 5, and with every number changed by half a unit of its last digit.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...columns.measured import MeasuredSeries
from ...columns.numbers import find_largest
from ...judge.distance import find_inaccuracy
from ...judge.metrics.measure import measure
from ...mechanics import so3
from ...mechanics.motion import constraint, constraint_rate, energy
from ...mechanics.state import States
from ...mechanics.types import Law, Problem, Reason, Status, Trajectory
from ...results.records import COLUMNS, RunRecord, format_reasons

ROUNDINGS = 3.0  # factor on the effect of one draw of roundings, to cover the largest: three standard deviations
OF_LAW = {  # beginnings of the names of a record's columns that depend on a law
    Law.ENERGY: ("energy_",),
    Law.CONSTRAINT: ("phi_max", "phi_end", "phi_limit", "gap_share"),
    Law.CONSTRAINT_RATE: ("phi_dot", "eq81", "gap_rate"),
    Law.ORTHOGONALITY: ("orthogonality",),
    Law.KINEMATIC: ("kinematic_defect",),
    Law.VELOCITY: ("velocity_error", "rate_error"),
}
# beginnings of the names of columns that depend on a quantity
OF_QUANTITY = {"R": ("orientation_",), "v": ("velocity_error",), "Omega": ("angular_velocity",)}
SERIES = {  # fields of ``MeasuredSeries`` that depend on a law
    Law.ENERGY: ("energy", "energy_error"),
    Law.CONSTRAINT: ("phi_norm",),
    Law.CONSTRAINT_RATE: ("phi_dot_norm", "eq81_norm"),
    Law.ORTHOGONALITY: ("orthogonality",),
}
SERIES_OF_QUANTITY = {"R": ("orientation_error",), "v": ("velocity_error",), "Omega": ("angular_velocity_error",)}
Key = tuple[Law, str]  # a law and, for an invariant, its name


@dataclass(frozen=True)
class UndeterminedQuantities:
    """The quantities, laws, observables and invariants that the columns of a file leave undetermined."""

    missing: tuple[str, ...]  # of r, R, v, Omega
    open_laws: frozenset[Law]  # laws not determined
    open_names: frozenset[str]  # observables and invariants not determined

    @property
    def open_columns(self) -> tuple[str, ...]:
        """The beginnings of the names of all columns of a record that the file does not determine."""
        of_laws = (OF_LAW.get(law, ()) for law in self.open_laws)
        return tuple(c for group in (*of_laws, *(OF_QUANTITY[k] for k in self.missing)) for c in group)

    def may_judge(self, r: Reason) -> bool:
        """Return whether the file determines the law that reason ``r`` says is broken."""
        return r.law not in self.open_laws and r.name not in self.open_names

    def blank_undetermined(self, m: MeasuredSeries) -> MeasuredSeries:
        """Return the measured series with NaN for those that are not determined."""
        none = np.full(len(m.t), math.nan)
        series = [s for law in self.open_laws for s in SERIES.get(law, ())]
        series += [s for k in self.missing for s in SERIES_OF_QUANTITY[k]]
        kept: dict[str, Any] = {
            name: {k: none if k in self.open_names else a for k, a in getattr(m, name).items()}
            for name in ("observables", "invariants")
        }
        blank: dict[str, Any] = {s: none for s in series if getattr(m, s) is not None}
        return dataclasses.replace(m, **blank, **kept)


def find_undetermined(problem: Problem, start: States, missing: Sequence[str]) -> UndeterminedQuantities:
    """Return what a file without the quantities ``missing`` (of r, R, v, Omega) leaves undetermined.

    Laws, observables and invariants are evaluated at ``start``, one state of the motion, with NaN for what is missing:
    those that become NaN are not determined.
    """
    system, parts = problem.system, {k: getattr(start, k) for k in ("r", "R", "v", "Omega")}
    s = States(**{k: np.full(a.shape, math.nan) if k in missing else a for k, a in parts.items()})
    with np.errstate(all="ignore"):
        values = {
            Law.ENERGY: energy(system, s),
            Law.CONSTRAINT: constraint(system, s),
            Law.CONSTRAINT_RATE: constraint_rate(system, s),
            Law.ORTHOGONALITY: so3.orthogonality_defect(s.R),
            Law.KINEMATIC: s.Omega + s.v + s.r + s.R[..., 0],  # needs all four
            Law.VELOCITY: s.v,
        }
        at_home = problem.home(s)
        scalars = {x.name: np.asarray(x.of(at_home)) for x in problem.observables}
        scalars |= {x.name: np.asarray(x.of(at_home)) for x in problem.invariants}
    open_laws = {k for k, a in values.items() if not np.all(np.isfinite(a))}
    return UndeterminedQuantities(
        tuple(missing),
        frozenset({*open_laws, Law.TRUNCATION}),  # truncation compares differences over a step, below the digits
        frozenset(k for k, a in scalars.items() if not np.all(np.isfinite(a))),
    )


def measure_uncertainty(
    problem: Problem, given: Trajectory, spacing: Iterable[Trajectory], digits: Iterable[Trajectory]
) -> Mapping[Key, float]:
    """Return how far the measured value of each law moves, in its unit, when the file is read in other ways.

    ``given`` is the motion as read, ``spacing`` are readings with other rates, ``digits`` readings with other last
    digits, whose effect counts ``ROUNDINGS`` times. The effects of all are added.
    """
    base = _evaluate_laws(measure(problem, given))
    out = dict.fromkeys(base, 0.0)
    for factor, others in ((1.0, spacing), (ROUNDINGS, digits)):
        for other in others:
            for key, series in _evaluate_laws(measure(problem, other)).items():
                off = np.atleast_1d(series - base[key])
                out[key] += factor * find_largest(off[np.isfinite(off)]) if np.any(np.isfinite(off)) else 0.0
    return out


def _evaluate_laws(m: MeasuredSeries) -> dict[Key, np.ndarray]:
    """Return the residuals of each law in its unit: along the motion, or one number for the kinematic defect.

    The key of an invariant has its name.
    """
    out: dict[Key, np.ndarray] = {(Law.KINEMATIC, ""): np.array(m.kinematic_defect)}
    for law in m.mechanisms[0].laws:
        out[law, ""] = np.max([np.abs(one.laws[law]) for one in m.mechanisms], axis=0)
    out |= {(Law.INVARIANT, k): a - a[0] for k, a in m.invariants.items()}
    if m.rate_error is not None:
        out[Law.VELOCITY, ""] = m.rate_error
    return out


def judge_by_determined(
    record: RunRecord, m: MeasuredSeries, known: UndeterminedQuantities, unsure: Mapping[Key, float]
) -> RunRecord:
    """Return the record judged only by what the file determines; columns that it leaves open get their defaults.

    A law is broken, and the motion inaccurate, only if a value exceeds its limit by more than its uncertainty
    ``unsure``.
    """
    blank: dict[str, Any] = {c.name: c.default for c in COLUMNS if c.name.startswith(known.open_columns)}
    status, claimed = Status(record.status), Status(record.claimed)
    reasons: list[Reason] = []
    if claimed is Status.SUCCESS:
        found = list(record.reasons)
        broken = found if status is Status.WRONG else []
        reasons = [r for r in broken if known.may_judge(r) and r.value - unsure.get((r.law, r.name), 0.0) > r.limit]
        # laws without a limit, or independent of the uncertainty
        lost = [r for r in broken if r.law in (Law.FINITE, Law.START, Law.END)]
        reasons += [r for r in lost if r not in reasons]
        status = Status.WRONG if reasons else Status.SUCCESS
    if status is Status.SUCCESS:
        away = find_inaccuracy(m, vars(record))
        reasons = [r for r in away if known.may_judge(r) and r.value - unsure.get((r.law, r.name), 0.0) > r.limit]
        status = Status.INACCURATE if reasons else status
    return dataclasses.replace(record, status=str(status), wrong_because=format_reasons(reasons), **blank)
