"""Driven distance: a massless link whose length is a function of time, an actuator or a winch."""

from ...declaring import Count, JointDeclaration, gap, length

KIND = JointDeclaration(
    "driven distance",
    14,
    Count(moving=1),
    leaves="all but the distance of the points: a massless link of f(t)",
    equation="|d| - f(t) = 0",
    motion="m",
    given="points, `motion` f [m], above 0 up to `t_end`",
    phi=lambda i, j, p: [length(gap(i, j, p)) - p.f],
)
