"""Sarrus' linkage on a spring through its whole motion, by every solver, against a quadrature: 30 rows of rank 29.

Two pairs of hinged plates at right angles leave their platform one straight line. On a spring along that line and
without weight it swings between heights z0 and 2 z_rest - z0. With z = z_rest + a cos(phi) and 2 T = m(z) z_dot^2 the
period is the integral of sqrt(m / k) over a turn of phi: smooth and periodic, so that a mean of it is exact. Without
the spring, which some refuse, m z_dot^2 is constant.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

from mbsbench import Problem, SpringDamper, Status, independent_rows
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.mechanics.motion import constraint, energy
from mbsbench.tests.covering import every
from mbsbench.tests.exam.building import O, Parts, X, Y, Z

from .test_turning_loops import MOST, PARTS, REDUNDANT, control, takes_code

LOWER, UPPER, FOOT = 0.6, 0.7, 0.3  # [m] plates, and how far the hinges on the ground and the platform are out
FIRST, REST, STIFFNESS = 1.1, 0.9, 300.0  # heights z0 and z_rest [m], [N/m]
PLATES, PLATFORM = ((0.8, 0.6), (0.9, 0.7)), 2.0  # [kg] lower and upper plate of each pair
NODES = 400
OFF = {"ida_index3": 5e-3, "ida_index1": 1e-4, "rk45_strong_form": 1e-4, "scipy_strong_form": 1e-4}


def knee(z: complex) -> np.ndarray:
    """The middle hinge at a height of the platform: how far out of the other two, and its height."""
    up = 0.5 * (z + (LOWER**2 - UPPER**2) / z)
    return np.array([np.sqrt(LOWER**2 - up**2), up])


def inertia(z: float) -> float:
    """m = 2 T / z_dot^2, rates from a complex step."""
    k = knee(complex(z, 1e-30))
    top = np.array([0.0, complex(z, 1e-30)])
    m = PLATFORM
    for pair in PLATES:
        for mass, (a, b) in zip(pair, ((0.0 * k, k), (k, top)), strict=True):
            v, w = (
                0.5e30 * (a + b).imag,
                1e30 * (b - a).imag,
            )  # of its middle; of one end against the other: length omega
            m += mass * (v @ v) + mass * (w @ w) / 12.0
    return float(m)


def period() -> float:
    z = REST + (FIRST - REST) * np.cos(2.0 * np.pi * np.arange(NODES) / NODES)
    return float(2.0 * np.pi * np.mean(np.sqrt([inertia(x) / STIFFNESS for x in z])))


def linkage(height: float, rate: float | None = None) -> Parts:
    """The linkage with its platform, the last body, at a height, its first hinge turning at a rate."""
    parts, numbers, (out, up) = Parts(), [], knee(height)
    for way, axis, pair in zip((X, Y), (Y, X), PLATES, strict=True):
        ends = FOOT * way, (FOOT + out) * way + up * Z, FOOT * way + height * Z
        numbers.append((axis, ends, [parts.bar(m, ends[k], ends[k + 1], axis, 0.3) for k, m in enumerate(pair)]))
    platform = parts.body(PLATFORM, (0.05, 0.06, 0.1), height * Z)
    for axis, (foot, middle, top), (low, high) in numbers:
        parts.hinge(low, -1, foot, axis, rate if low == 0 else None)
        parts.hinge(high, low, middle, axis)
        parts.hinge(platform, high, top, axis)
    return parts


def sarrus() -> Problem:
    """Released at rest on the spring, for one period."""
    spring = SpringDamper(4, (0.0, 0.0, 0.0), -1, (0.0, 0.0, -1.0), STIFFNESS, REST + 1.0)
    still = np.zeros((5, 3)), np.zeros((5, 3))
    T = period()
    return linkage(FIRST).problem("sarrus", t_end=T, dt=T / PARTS, gravity=O, motion=still, springs=[spring])


def free() -> tuple[Problem, float]:
    """Set in motion at ``REST`` without spring, until its platform is at the height returned."""
    problem = linkage(REST, 2.0).problem("free sarrus", t_end=1.0, dt=1e-3, gravity=O)
    speed = float(problem.initial.v[4, 2])
    end = REST + math.copysign(FIRST - REST, speed)
    x, w = np.polynomial.legendre.leggauss(60)
    roots = np.sqrt([inertia(z) / inertia(REST) for z in 0.5 * (REST + end) + 0.5 * (end - REST) * x])
    T = float(0.5 * (end - REST) * (w @ roots) / speed)
    return replace(problem, t_end=T), end


def test_one_row_is_redundant():
    problem = sarrus()
    assert problem.system.nrows == 30 and len(independent_rows(problem.system, problem.initial)) == 29


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "options"),
    [
        *((name, {}) for name in REDUNDANT),
        *every([(name, {"code": "mechanism"}) for name in REDUNDANT if takes_code(name)], 3),
    ],
)
def test_the_platform_swings_along_its_line_and_is_back_after_a_period(name, options):
    """It turns where the spring says, off its line by rounding and the gap of joints alone."""
    problem, solver = sarrus(), make_solver(name, options)
    if words := solver.refuses(problem, control(name, problem.t_end)):
        assert "gravity" in words
        problem, end = free()
        out = solver.solve(problem, control(name, problem.t_end))
        assert out.status is Status.SUCCESS, out.message
        assert abs(out.states.r[-1, 4, 2] - end) < MOST
        return
    out = solver.solve(problem, control(name, problem.t_end))
    assert out.status is Status.SUCCESS, out.message
    end, start, off = out.states[-1], problem.initial, OFF.get(name, MOST)
    assert np.max(np.abs(end.r - start.r)) < off and np.max(np.abs(end.v)) < 20.0 * off
    z, across = out.states.r[:, 4, 2], out.states.r[:, 4, :2]
    assert np.min(z) == pytest.approx(2.0 * REST - FIRST, abs=max(off, 1e-3))
    assert np.max(np.abs(across)) < off and np.max(np.abs(out.states.R[:, 4] - np.eye(3))) < 2.0 * off
    E = energy(problem.system, out.states)
    assert np.max(np.abs(E - E[0])) < 10.0 * off * E[0]
    assert np.max(np.abs(constraint(problem.system, out.states))) < 3.0 * off
