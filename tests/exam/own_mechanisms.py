"""Ten mechanisms of our own: loops whose rows are redundant on the constraints alone, and motions at every extreme.

Their numbers were chosen before any of their results was looked at. A plug-in of the exam.
"""

import numpy as np

from mbsbench import Joint, Problem, SpringDamper, TimeFunction, TorsionSpring, problem
from mbsbench.tests.exam.building import O, Parts, X, Y, Z, crank_and_rocker, meet, turn

SKEW = np.array([2.0, -3.0, -9.0])  # [m/s2]
TILTED = turn((1.0, -2.0, 0.7), 0.9)


@problem("exam_sarrus")
def sarrus() -> Problem:
    """Sarrus' linkage: two pairs of hinged plates at right angles carry a platform on a spring: 30 rows, rank 29."""
    parts, height = Parts(), 0.9
    points = []
    for out in (X, Y):
        foot, top = 0.3 * out, 0.3 * out + height * Z
        _, up = knee = meet((0.0, 0.0), (height, 0.0), 0.6, 0.7)
        points.append((foot, foot + up * out + knee[0] * Z, top))
    (a, b, c), (d, e, f) = points
    parts.bar(0.8, a, b, Y, 0.3)
    parts.bar(0.6, b, c, Y, 0.3)
    parts.body(2.0, (0.05, 0.06, 0.1), height * Z + 0.05 * Z)
    parts.bar(0.9, e, f, X, 0.3)
    parts.bar(0.7, d, e, X, 0.3)
    parts.hinge(0, -1, a, Y, 1.0)
    parts.hinge(1, 0, b, Y)
    parts.hinge(2, 1, c, Y)
    parts.hinge(3, 2, f, X)
    parts.hinge(4, 3, e, X)
    parts.hinge(4, -1, d, X)
    spring = SpringDamper(2, (0.0, 0.0, -0.05), -1, (0.0, 0.0, -0.5), 300.0, 1.5, 2.0)
    return parts.problem("exam_sarrus", t_end=2.0, dt=1e-3, springs=[spring])


@problem("exam_tiny_four_bar")
def tiny_four_bar() -> Problem:
    """A four-bar linkage of 10 micrometres and 1e-12 kg in a tilted plane, its crank at 3,000 rad/s."""
    parts, s = Parts(), 1e-5
    crank_and_rocker(
        parts, 1.0 * s, 0.4 * s, 1.1 * s, 0.8 * s, 0.8, 3000.0, frame=TILTED, masses=(1e-12, 2e-12, 1.5e-12)
    )
    return parts.problem("exam_tiny_four_bar", t_end=8e-3, dt=4e-6, gravity=SKEW)


@problem("exam_huge_slider_crank")
def huge_slider_crank() -> Problem:
    """A slider-crank of 30 and 80 km and 1e6 kg in a tilted plane: 20 rows, rank 17 on the constraints alone."""
    parts, crank, rod, angle = Parts(), 3e4, 8e4, 0.6
    knee = crank * np.array([np.cos(angle), np.sin(angle), 0.0])
    end = np.array([knee[0] + np.sqrt(rod**2 - knee[1] ** 2), 0.0, 0.0])
    n, knee, end = TILTED[:, 2], TILTED @ knee, TILTED @ end
    parts.bar(1e6, O, knee, n)
    parts.bar(2e6, knee, end, n)
    parts.body(3e6, (1e13, 1.2e13, 1.1e13), end, TILTED)
    parts.hinge(0, -1, O, n, 0.05)
    parts.hinge(1, 0, knee, n)
    parts.hinge(2, 1, end, n)
    parts.guide(2, -1, end, TILTED[:, 0], TILTED[:, 1])
    return parts.problem("exam_huge_slider_crank", t_end=300.0, dt=0.1, gravity=SKEW)


@problem("exam_far_four_bar")
def far_four_bar() -> Problem:
    """A four-bar linkage of 1 m, 100 km from the origin, its coupler on a spring with a damper."""
    parts, foot = Parts(), 1e5 * np.array([0.6, -0.5, 0.62])
    p = crank_and_rocker(parts, 1.2, 0.4, 1.3, 0.9, 1.1, 9.0, frame=TILTED, foot=foot)
    held = p[0] + TILTED @ np.array([0.5, 2.0, 0.4])
    spring = SpringDamper(1, (0.1, 0.0, 0.0), -1, held, 40.0, 1.0, 0.5)
    return parts.problem("exam_far_four_bar", t_end=2.0, dt=1e-3, gravity=SKEW, springs=[spring])


@problem("exam_long_gate")
def long_gate() -> Problem:
    """A gate on two hinges of one skew axis swings widely for 150 s: ten rows of rank five on the constraints alone."""
    parts = Parts()
    axis, way = np.array([0.3, 1.0, 0.2]), np.array([1.0, 0.0, 0.0])
    axis /= np.linalg.norm(axis)
    out = way - axis * (way @ axis)
    out /= np.linalg.norm(out)
    parts.body(3.0, (0.2, 0.5, 0.4), 0.7 * out + 0.1 * axis, np.stack((out, axis, np.cross(out, axis)), 1))
    parts.hinge(0, -1, -0.4 * axis, axis, 1.5)
    parts.hinge(0, -1, 0.6 * axis, axis)
    return parts.problem("exam_long_gate", t_end=150.0, dt=1e-2)


@problem("exam_stiff_five_bar")
def stiff_five_bar() -> Problem:
    """A planar five-bar in space whose cranks' ends a spring of 1e7 N/m with a damper holds apart."""
    parts = Parts()
    p = [TILTED @ np.array([x, y, 0.0]) for x, y in ((0.0, 0.0), (0.1, 0.6), (0.5, 1.1), (1.0, 0.7), (0.9, 0.0))]
    n = TILTED[:, 2]
    for mass, (a, b) in zip((1.0, 0.8, 0.6, 1.2), ((0, 1), (1, 2), (3, 2), (4, 3)), strict=True):
        parts.bar(mass, p[a], p[b], n)
    parts.hinge(0, -1, p[0], n, 1.5)
    parts.hinge(1, 0, p[1], n)
    parts.hinge(2, 1, p[2], n)
    parts.hinge(2, 3, p[3], n)
    parts.hinge(3, -1, p[4], n, 1.5)
    apart = float(np.linalg.norm(p[3] - p[1]))
    spring = SpringDamper(0, parts.seen(0, p[1]), 3, parts.seen(3, p[3]), 1e7, apart, 1e3)
    return parts.problem("exam_stiff_five_bar", t_end=0.5, dt=5e-4, gravity=SKEW, springs=[spring])


@problem("exam_gimbal_rotor")
def gimbal_rotor() -> Problem:
    """A rotor of 1,500 rad/s in two gimbals, the inner one heavy on one side: about a turn in a step."""
    parts = Parts()
    parts.body(0.5, (0.02, 0.02, 0.03), O)
    parts.body(0.4, (0.01, 0.012, 0.01), 0.05 * Y)
    parts.body(1.0, (0.004, 0.006, 0.004), O)
    parts.hinge(0, -1, O, Z, 0.5)
    parts.hinge(1, 0, O, X, 0.2)
    parts.hinge(2, 1, O, Y, 1500.0)
    return parts.problem("exam_gimbal_rotor", t_end=1.0, dt=4e-3)


@problem("exam_driven_four_bar")
def driven_four_bar() -> Problem:
    """A four-bar linkage in space whose crank follows a ramp and a sine; the coupler on a spring with a damper."""
    parts, start, slope, swing, beat = Parts(), 0.7, 3.0, 0.4, 5.0
    p = crank_and_rocker(parts, 1.2, 0.4, 1.3, 0.9, start, slope + swing * beat, frame=TILTED)
    drive = Joint(
        0,
        parts.seen(0, O),
        -1,
        O,
        Z,
        TILTED[:, 2],
        "drive",
        "driven angle",
        X,
        TILTED[:, 0],
        motion=TimeFunction((start, slope), swing, beat),
    )
    held = p[3] + TILTED @ np.array([0.3, 1.5, -0.3])
    spring = SpringDamper(1, O, -1, held, 60.0, 1.2, 1.0)
    return parts.problem("exam_driven_four_bar", t_end=3.0, dt=1e-3, gravity=SKEW, joints=[drive], springs=[spring])


@problem("exam_watt")
def watt() -> Problem:
    """A six-bar linkage in space, a four-bar whose coupler drives two more bars: 35 rows, rank 29."""
    parts = Parts()
    p = crank_and_rocker(parts, 1.2, 0.4, 1.3, 0.9, 2.0, 8.0, frame=TILTED, masses=(3.0, 1.0, 1.5))
    tip = parts.r[1] + parts.R[1] @ np.array([0.1, 0.4, 0.0])
    flat, foot = (TILTED.T @ tip)[:2], np.array([2.2, 1.2])
    elbow = TILTED @ np.array([*meet(flat, foot, 1.5, 1.4), 0.0])
    n, ground = TILTED[:, 2], TILTED @ np.array([*foot, 0.0])
    parts.bar(0.8, tip, elbow, n)
    parts.bar(0.9, elbow, ground, n)
    parts.hinge(3, 1, tip, n)
    parts.hinge(4, 3, elbow, n)
    parts.hinge(4, -1, ground, n)
    assert len(p) == 4
    return parts.problem("exam_watt", t_end=2.0, dt=1e-3, gravity=SKEW)


@problem("exam_spherical_four_bar")
def spherical_four_bar() -> Problem:
    """A four-bar linkage on a sphere, a torsion spring wound by turns on its crank: 20 rows, rank 17."""
    parts = Parts()
    ground, across = 1.4, turn(Z, 0.6)
    axes = [Z, across @ turn(Y, 0.5) @ Z, O, turn(Y, ground) @ Z]
    cosines = np.array([np.cos(1.3), np.cos(1.2)])  # of the coupler's and of the rocker's arc
    both = np.array([axes[1], axes[3]])
    least = np.linalg.lstsq(both, cosines, rcond=None)[0]
    side = np.cross(axes[1], axes[3])
    axes[2] = least + side / np.linalg.norm(side) * np.sqrt(1.0 - least @ least)
    for k, mass in enumerate((1.0, 0.8, 1.2)):
        parts.bar(mass, 0.8 * axes[k], 0.8 * axes[k + 1], axes[k] + axes[k + 1], 0.2)
    for k in range(4):
        parts.hinge(min(k, 2), -1 if k == 3 else k - 1, 0.8 * axes[k], axes[k], 14.0 if k == 0 else None)
    u = X
    spring = TorsionSpring(0, parts.along(0, u), -1, Z, u, 0.4, 0.5, 0.01)
    return parts.problem("exam_spherical_four_bar", t_end=2.0, dt=1e-3, gravity=SKEW, torsions=[spring])
