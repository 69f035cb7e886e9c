"""Six mechanisms on which right motions were once called wrong: a plug-in of the exam."""

import numpy as np

from mbsbench import Joint, Load, Problem, SpringDamper, TimeFunction, problem
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.exam.building import EARTH, O, Parts, X, Y, Z, turn

TABLE = 100.0  # [rad/s]
A, B, ALPHA = 1.0, 1.6, 0.6  # sides and twist of Bennett's linkage
BETA = float(np.arcsin(B / A * np.sin(ALPHA)))


@problem("exam_gyroscope")
def gyroscope() -> Problem:
    """A frame of 1 ng on a spring in a turntable that is driven, a mass of 2 ng on a spring across it: 3 kHz."""
    parts, w = Parts(), TABLE * Z
    out = np.array([2e-6, 0.0, 0.0])
    for mass, place in ((1e-8, O), (1e-9, out), (2e-9, out)):
        parts.body(mass, 3 * [1e-7 * mass], place)
    parts.hinge(0, -1, O, Z)
    parts.joints.append(Joint(0, O, -1, O, Z, Z, "drive", "driven angle", X, X, motion=TimeFunction((0.0, TABLE))))
    for i, axis, across in ((1, X, Y), (2, Y, X)):
        parts.joints.append(Joint(i, O, i - 1, O, axis, axis, "slide", "prismatic", across, across))
    springs = [SpringDamper(1, O, 0, -1e-3 * X, 1.2, 1e-3), SpringDamper(2, O, 1, -1e-3 * Y, 0.8, 1e-3)]
    push = Load(1, (1e-6, 0.0, 0.0), follows=True, factor=TimeFunction((), 1.0, 2e4))
    motion = np.array([O, np.cross(w, out), np.cross(w, out)]), np.array([w, w, w])
    return parts.problem("exam_gyroscope", t_end=4e-3, dt=1e-6, gravity=O, motion=motion, springs=springs, loads=[push])


def bennett_frames(angle: float) -> list[np.ndarray]:
    """The four frames (4, 4) behind the hinges of Bennett's linkage; the last one is the first again."""
    ratio = np.sin(0.5 * (BETA + ALPHA)) / np.sin(0.5 * (BETA - ALPHA))
    other = 2.0 * np.arctan(ratio / np.tan(0.5 * angle))
    out, here = [], np.eye(4)
    for side, twist, by in ((A, ALPHA, angle), (B, BETA, other), (A, ALPHA, -angle), (B, BETA, -other)):
        step = np.eye(4)
        step[:3, :3] = turn(Z, by) @ turn(X, twist)
        step[:3, 3] = side * np.array([np.cos(by), np.sin(by), 0.0])
        here = here @ step
        out.append(here)
    return out


@problem("exam_bennett")
def bennett() -> Problem:
    """Bennett's linkage of 1 m and 1.6 m in full turns, gravity skew: 20 rows, rank 17 on the constraints alone."""
    parts, frames = Parts(), bennett_frames(0.9)
    ends = [O, *(f[:3, 3] for f in frames)]
    axes = [Z, *(f[:3, 2] for f in frames)]
    assert_close(frames[-1], np.eye(4), atol=1e-12)
    for k, mass in enumerate((1.0, 2.0, 1.5)):
        parts.body(mass, mass * np.array([0.02, 0.11, 0.12]), 0.5 * (ends[k] + ends[k + 1]), frames[k][:3, :3])
    for k in range(4):
        parts.hinge(min(k, 2), -1 if k == 3 else k - 1, ends[k], axes[k], 6.0 if k == 0 else None)
    return parts.problem("exam_bennett", t_end=3.0, dt=1e-3, gravity=(3.0, -2.0, -9.0))


@problem("exam_stiff_pendulum")
def stiff_pendulum() -> Problem:
    """A bob on a spring of 1e8 N/m with 1e4 N s/m, another one on a ball joint below."""
    parts = Parts()
    parts.body(1.0, 3 * [1e-2], X)
    parts.body(0.5, (1e-2, 2e-2, 1.5e-2), 1.4 * X)
    parts.joints.append(Joint(1, (-0.3, 0.0, 0.0), 0, (0.1, 0.0, 0.0)))
    spring = SpringDamper(0, (-0.1, 0.0, 0.0), -1, O, 1e8, 0.9, 1e4)
    motion = np.array([0.5 * Y, 0.7 * Y]), np.array([0.5 * Z, 0.5 * Z])
    return parts.problem("exam_stiff_pendulum", t_end=1.0, dt=1e-3, motion=motion, springs=[spring])


@problem("exam_rack")
def rack() -> Problem:
    """A rack of 2 kg on a spring turns a pinion of 20 mm by 15 rad each way."""
    radius, out = 0.02, 0.3
    parts = Parts()
    parts.body(0.5, (3e-4, 3e-4, 4e-4), O, turn(Z, -out / radius))
    parts.body(2.0, 3 * [0.01], (out, -radius, 0.0))
    parts.joints += [
        Joint(0, O, -1, O, Z, Z, "pin"),
        Joint(1, O, -1, (0.0, -radius, 0.0), X, X, "guide", "prismatic", Y, Y),
        Joint(0, O, 1, O, Z, Z, "teeth", "rack and pinion", X, X, length=radius),
    ]
    spring = SpringDamper(1, O, -1, (-1.0, -radius, 0.0), 300.0, 1.0)
    still = np.zeros((2, 3)), np.zeros((2, 3))
    return parts.problem("exam_rack", t_end=2.0, dt=5e-4, gravity=(0.0, -9.81, 0.0), motion=still, springs=[spring])


@problem("exam_five_bar")
def five_bar() -> Problem:
    """A planar five-bar in a tilted plane, gravity skew to it: 25 rows, rank 22 on the constraints alone."""
    parts, frame = Parts(), turn((1.0, 2.0, -0.5), 0.8)
    p = [frame @ np.array([x, y, 0.0]) for x, y in ((0.0, 0.0), (-0.3, 0.5), (0.4, 0.9), (1.1, 0.5), (0.8, 0.0))]
    n = frame[:, 2]
    for mass, (a, b) in zip((1.0, 2.0, 0.5, 1.5), ((0, 1), (1, 2), (3, 2), (4, 3)), strict=True):
        parts.bar(mass, p[a], p[b], n)
    parts.hinge(0, -1, p[0], n, 2.0)
    parts.hinge(1, 0, p[1], n)
    parts.hinge(2, 1, p[2], n)
    parts.hinge(2, 3, p[3], n)
    parts.hinge(3, -1, p[4], n, -1.0)
    return parts.problem("exam_five_bar", t_end=2.0, dt=5e-4, gravity=(1.0, 2.0, -9.0))


@problem("exam_thin_bars")
def thin_bars() -> Problem:
    """Two bars on ball joints whose moment about their own axis is 1e-10 kg m2."""
    parts = Parts()
    for k in range(2):
        parts.body(1.0, (1e-10, 0.1, 0.1), (0.5 + k, 0.0, 0.0))
        parts.joints.append(Joint(k, (-0.5, 0.0, 0.0), k - 1, (0.5 * k, 0.0, 0.0)))
    still = np.zeros((2, 3)), np.zeros((2, 3))
    return parts.problem("exam_thin_bars", t_end=1.0, dt=1e-3, gravity=EARTH, motion=still)
