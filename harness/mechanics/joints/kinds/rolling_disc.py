"""Rolling disc: a thin disc rolls on a plane of j without slipping (nonholonomic)."""

from ...declaring import Count, JointDeclaration, length
from ..frames import make_disc_frame


def find_lowest_point(i, j, p):  # type: ignore[no-untyped-def]
    """Return the point of the disc that is lowest above the plane of j, in space [m]."""
    n, axis = j.turn(p.n[0]), i.turn(p.u)
    down = n - (n @ axis) * axis
    return i.at(p.s_i) - (p.length / length(down)) * down


def phi(i, j, p):  # type: ignore[no-untyped-def]
    """Return the row n_1 . (x - x_j) [m]: the height of the lowest point x above the plane."""
    return [j.turn(p.n[0]) @ (find_lowest_point(i, j, p) - j.at(p.s_j))]


def rates(i, j, p):  # type: ignore[no-untyped-def]
    """Return the rows n_k . (v_i(x) - v_j(x)) [m/s]: the slip at the lowest point x along two tangents of the plane."""
    x = find_lowest_point(i, j, p)
    slip = i.velocity(x) - j.velocity(x)
    return [j.turn(p.n[1]) @ slip, j.turn(p.n[2]) @ slip]


KIND = JointDeclaration(
    "rolling disc",
    12,
    Count(moving=3),
    leaves="tilting, rolling and spinning, with the lowest point at rest",
    equation="n_1 . (x - x_j) = 0, n_2 . v = n_3 . v = 0 at the lowest point x",
    axes="ij",
    length="radius of the disc",
    given="centre `s_i`, `axis_i`, a point and the normal `axis_j` of the plane, `length`, the radius",
    frame=make_disc_frame,
    phi=phi,
    rates=rates,
)
