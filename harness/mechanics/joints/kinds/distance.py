"""Distance: a rigid massless link between two points."""

from ...declaring import Count, JointDeclaration, gap


def phi(i, j, p):  # type: ignore[no-untyped-def]
    """Return the row of a distance, (d . d - L^2) / (2 L) [m]."""
    d = gap(i, j, p)
    return [(d @ d - p.length * p.length) / (2.0 * p.length)]


KIND = JointDeclaration(
    "distance",
    8,
    Count(line=1),
    leaves="all but the distance of the points: a rigid massless link",
    equation="(d . d - L^2) / (2 L) = 0",
    length="of the link",
    phi=phi,
)
