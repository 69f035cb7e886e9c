"""Stiff springs in the iteration of Radau IIA: the matrix by differences, the solution without it, and its limits."""

from dataclasses import replace

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import RigidBody, SpringDamper, assemble
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.compiled.kernel import Kernel, make_kernel
from mbsbench.solvers.formulations.compiled.soft_rows import without_springs
from mbsbench.solvers.formulations.methods import radau
from mbsbench.solvers.formulations.methods.springs import Springs, make_soft_rows

FIXED = 1e6  # a tolerance that accepts every step: max_step alone sets it


def solve(problem: Problem, rtol: float, **limits: float) -> Trajectory:
    t = make_solver("radau_ggl").solve(problem, StepControl(rtol=rtol, **limits))
    assert t.status is Status.SUCCESS, t.message
    return t


def iterate_without_springs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Springs as forces of each iterate, none in the matrix."""
    monkeypatch.setattr(radau, "without_springs", lambda system: system)
    monkeypatch.setattr(radau, "make_soft_rows", lambda system, *rest: make_soft_rows(without_springs(system), *rest))


def on_a_spring(stiffness: float, damping: float, speed: float = 0.0, stretch: float = 0.1) -> Problem:
    """A ball of 1 kg on a spring of 1 m from O, at rest along OX but for ``speed`` along OY [m/s]."""
    system = assemble(
        [RigidBody(1.0, np.eye(3), "ball")], (), np.zeros(3),
        [SpringDamper(0, np.zeros(3), stiffness=stiffness, rest_length=1.0, damping=damping)],
    )  # fmt: skip
    start = State(
        np.array([[1.0 + stretch, 0.0, 0.0]]), np.eye(3)[None], np.array([[0.0, speed, 0.0]]), np.zeros((1, 3))
    )
    return Problem("ball", system, start, t_end=1.0, dt=0.1, section="", source="")


@pytest.mark.parametrize("stiffness", [0.0, 1e2, 1e6])
@pytest.mark.parametrize("damping", [0.0, 1e4])
def test_a_linear_motion_takes_one_correction(stiffness, damping):
    """Along its spring a ball is linear: Newton's method ends with the first correction, the second shows it."""
    t = solve(on_a_spring(stiffness, damping), FIXED, max_step=0.05)
    assert t.counters["rejected"] == 0 and t.counters["newton_iterations"] <= 2 * t.counters["steps"]


def test_an_endlessly_stiff_spring_is_a_rod():
    """The ball runs on a circle, with as many steps at 1e9 as at 1e12 N/m (critical damping, stretched by v^2 / k)."""
    steps = []
    for stiffness in (1e9, 1e12):
        t = solve(on_a_spring(stiffness, 2.0 * stiffness**0.5, 3.0, 9.0 / stiffness), 1e-6)
        circle = np.stack((np.cos(3.0 * t.t), np.sin(3.0 * t.t), 0.0 * t.t), axis=1)
        assert np.max(np.abs(t.states.r[:, 0] - circle)) < 1e-6 + 30.0 / stiffness
        steps.append(t.counters["steps"])
    assert max(steps) <= 1.1 * min(steps), steps


def test_the_solution_does_not_depend_on_the_matrix(monkeypatch):
    """Two bars, two spring-dampers: the same steps by both iterations, to their tolerance."""
    p = make_problem("damped_linkage", {"t_end": 0.5})
    new = solve(p, FIXED, max_step=0.01)
    iterate_without_springs(monkeypatch)
    old = solve(p, FIXED, max_step=0.01)
    assert np.array_equal(new.t, old.t)
    assert np.max(np.abs(new.states.r - old.states.r)) < 1e-9
    assert np.max(np.abs(new.states.v - old.states.v)) < 1e-7
    assert new.counters["newton_iterations"] <= old.counters["newton_iterations"]


def test_stiffness_no_longer_cuts_the_step(monkeypatch):
    """The governor's springs and dampers are fast, 8117 1/s, and its motion slow."""
    p = make_problem("flyball_governor", {"t_end": 0.5})
    exact = make_solver("rkmk_dop853").solve(p, StepControl(rtol=1e-9))
    new = solve(p, 1e-6)
    assert np.linalg.norm(new.states.r[-1] - exact.states.r[-1], axis=1).max() < 1e-6
    assert np.max(np.abs(constraint(p.system, new.states))) < 1e-10
    iterate_without_springs(monkeypatch)
    assert solve(p, 1e-6).counters["steps"] > 3 * new.counters["steps"]


def test_order_is_five_with_springs_and_dampers():
    p = make_problem("damped_linkage", {"t_end": 1.0})
    exact = make_solver("rkmk_dop853").solve(p, StepControl(rtol=1e-12)).states.r[-1]
    errors = np.array([np.max(np.abs(solve(p, FIXED, max_step=0.1 / 2**k).states.r[-1] - exact)) for k in range(4)])
    slopes = np.log2(errors[:-1] / errors[1:])
    assert abs(slopes[-1] - 5.0) < 0.2, (errors, slopes)


@pytest.mark.parametrize("problem", ["damped_linkage", "flyball_governor", "stewart_platform"])
def test_the_matrix_is_that_of_finite_differences(monkeypatch, problem):
    """G: a longer free length changes the tension, and so all accelerations of index 1, exactly linearly.

    A step of 1e-9 s, so that its stages stand where G belongs.
    """
    seen: list[Springs] = []

    def keep(*given) -> Springs:
        seen.append(make_soft_rows(*given))
        return seen[-1]

    monkeypatch.setattr(radau, "make_soft_rows", keep)
    p = make_problem(problem, {"t_end": 1e-9})
    solve(p, FIXED, max_step=1e-9)
    system, rows, changes = p.system, seen[0].stages, []
    order = [int(np.flatnonzero(seen[0].law[1] == d)[n]) for n, d in numbered(system.spring_d0)]
    for s in range(len(system.spring_k)):
        found = []
        for sign in (1.0, -1.0):
            free = system.spring_d0.copy()
            free[s] += 0.01 * sign
            made = make_kernel(replace(system, spring_d0=free), ("accelerate",))
            for name in ("r", "R", "v"):
                getattr(made.kernel, name)[:] = getattr(rows, name)[1]
            made.entry("accelerate")()
            found.append(rates(p, made.kernel))
        changes.append((found[0] - found[1]) / (0.02 * system.spring_k[s]))
    G = seen[0].G[np.ix_(order, order)]
    assert np.allclose(G, np.array(changes), rtol=1e-6, atol=1e-9 * np.max(np.abs(G)))


def numbered(values: np.ndarray) -> list[tuple[int, float]]:
    """Each value with how many like it come before."""
    return [(int(np.sum(values[:n] == x)), x) for n, x in enumerate(values)]


def rates(p: Problem, k: Kernel) -> np.ndarray:
    """Part of length_ddot of the springs that is linear in the accelerations."""
    s, out = p.system, []
    for i in range(len(s.spring_i)):
        a = np.zeros(3)
        arm = np.zeros(3)
        for sign, b, point in ((1.0, s.spring_i[i], s.spring_p_i[i]), (-1.0, s.spring_j[i], s.spring_p_j[i])):
            if b < 0:
                arm += sign * point
                continue
            arm += sign * (k.r[b] + k.R[b] @ point)
            a += sign * (k.v_dot[b, :3] + k.R[b] @ np.cross(k.v_dot[b, 3:], point))
        out.append(arm @ a / np.linalg.norm(arm))
    return np.array(out)
