"""Knife edge: the point of i has no velocity along the normal of its blade (nonholonomic)."""

from ...declaring import Count, JointDeclaration
from ..frames import make_blade_frame


def rates(i, j, p):  # type: ignore[no-untyped-def]
    """Return the row u . (v_i(x) - v_j(x)) - f(t) [m/s]: the velocity across the blade at the point x of i."""
    x = i.at(p.s_i)
    return [i.turn(p.u) @ (i.velocity(x) - j.velocity(x)) - p.f]


KIND = JointDeclaration(
    "knife edge",
    11,
    Count(moving=1),
    leaves="all but the velocity of the point of i along axis_i, seen from j",
    equation="u . (v_i - v_j) - f(t) = 0",
    axes="i",
    motion="m/s",
    needs_motion=False,
    frame=make_blade_frame,
    rates=rates,
    note="the normal of its blade",
)
