"""Columns of constraints: how far joints come apart, and at which rate."""

from dataclasses import dataclass

import numpy as np

from ...mechanics.types import ALLOWED, Law
from ..declaring import column
from ..measured import MeasuredMotion
from ..numbers import find_largest


def find_limit(run: MeasuredMotion, law: Law) -> float | None:
    """Return the limit of |phi| [m] or of |phi_dot| [m/s], the norm over all rows, by ``law``.

    None where this norm is not what is judged: with axis rows, several mechanisms or a literal start.
    """
    problem = run.problem
    if problem.literal_start or len(run.series.mechanisms) > 1 or np.any(problem.system.joint_axes):
        return None
    return run.series.size.limits[law]


def find_largest_share(run: MeasuredMotion, law: Law) -> float | None:
    """Return the ratio of the largest residual of ``law`` to its limit, in the mechanism where it is largest.

    None without constraint rows, and for a literal start, which opens the joints.
    """
    if run.problem.literal_start or run.problem.system.nrows == 0:
        return None
    return max(find_largest(one.laws[law]) / one.size.limits[law] for one in run.series.mechanisms)


@dataclass(frozen=True, repr=False)
class ConstraintColumns:
    """The gaps of joints and the orthogonality of rotations in a run, with the scales of length and speed."""

    length_scale_m: float = column(
        "reach of the motion: how far a body moves from its start; |phi| and errors are compared with it",
        of=lambda run: run.series.size.length,
    )
    speed_scale_m_per_s: float = column(
        "largest speed of a body: what |phi_dot| is compared with", of=lambda run: run.series.size.speed
    )
    phi_max: float = column(
        "largest norm of the constraint residual: how far joints come apart; point rows in m, axis rows without unit",
        along=lambda run: run.series.phi_norm,
        series="phi_norm",
        head="max |φ|",
        unit="m",
        latex=r"$\max\|\phi\|$ [m]",
        order=240,
        tables={"problem": "", "runs": "", "show": "|phi| [m]"},
        rank=5,
        better="less",
        limit=lambda r: r.phi_limit_m,
    )
    phi_end: float = column("|phi| at the last step", of=lambda run: float(run.series.phi_norm[-1]))
    phi_limit_m: float = column(
        "limit of |phi|; NaN where |phi| as recorded is not what is judged: axis rows, mechanisms, literal start",
        of=lambda run: find_limit(run, Law.CONSTRAINT),
    )
    phi_dot_max: float = column(
        "largest norm of the rate of the constraint residual: m/s, axis rows 1/s",
        along=lambda run: run.series.phi_dot_norm,
        series="phi_dot_norm",
        head="max |φ̇|",
        unit="m/s",
        order=250,
        tables={"problem": "", "show": "|phi'| [m/s]"},
        rank=6,
        better="less",
        limit=lambda r: r.phi_dot_limit_m_per_s,
    )
    phi_dot_limit_m_per_s: float = column(
        "limit of |phi_dot|; NaN where that of |phi| is", of=lambda run: find_limit(run, Law.CONSTRAINT_RATE)
    )
    phi_dot_end: float = column("|phi_dot| at the last step", of=lambda run: float(run.series.phi_dot_norm[-1]))
    gap_share_max: float = column(
        "max |phi| as judged (axis rows in metres) over its limit, worst mechanism",
        of=lambda run: find_largest_share(run, Law.CONSTRAINT),
    )
    gap_rate_share_max: float = column(
        "max |phi_dot| as judged over its limit, worst mechanism",
        of=lambda run: find_largest_share(run, Law.CONSTRAINT_RATE),
    )
    eq81_max_sqrtJ: float = column(
        "the paper's norm of the constraint rates, sqrt(phi_dot^T M_bar phi_dot), Eq. (81), at its largest",
        along=lambda run: run.series.eq81_norm,
        series="eq81_norm",
        head="Eq. (81)",
        unit="√J",
        order=260,
        better="less",
    )
    eq81_end_sqrtJ: float = column("that norm at the last step", of=lambda run: float(run.series.eq81_norm[-1]))
    orthogonality_max: float = column(
        "largest deviation of a rotation matrix from orthogonality, |R^T R - 1|",
        along=lambda run: run.series.orthogonality,
        series="orthogonality",
        head="|RᵀR−1|",
        order=270,
        better="less",
        limit=lambda r: ALLOWED[Law.ORTHOGONALITY],
    )
    kinematic_defect: float = column(
        "share of its path by which a body's poses and velocities disagree",
        of=lambda run: run.series.kinematic_defect,
    )
    out_of_plane_max_m: float = column(
        "largest distance of a centre of mass from the plane that the exact motion stays in",
        along=lambda run: run.series.out_of_plane,
        series="out_of_plane",
        head="Out of plane",
        unit="m",
        key="out_of_plane",
        order=280,
        better="less",
    )
