"""Stiff springs in the iteration of Radau IIA: linear motions, the solution without the matrix, and its limits."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import GROUND, Joint, RigidBody, SpringDamper, assemble
from mbsbench.harness.mechanics.types import Problem, Trajectory
from mbsbench.solvers.formulations.compiled.soft_rows import remove_springs
from mbsbench.solvers.formulations.methods import radau
from mbsbench.solvers.formulations.methods.springs import make_soft_rows
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import solve_run

from ..runs import ACCEPTED


def solve_radau(problem: Problem, rtol: float = ACCEPTED, **limits: float) -> Trajectory:
    return solve_run(problem, rtol, "radau_ggl", limits)


def iterate_without_springs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Springs as forces of each iterate, none in the matrix."""
    monkeypatch.setattr(radau, "remove_springs", lambda system: system)
    monkeypatch.setattr(radau, "make_soft_rows", lambda system, *rest: make_soft_rows(remove_springs(system), *rest))


def on_a_spring(
    stiffness: float, damping: float, speed: float = 0.0, stretch: float = 0.1, *, guided: bool = False
) -> Problem:
    """A ball of 1 kg on a spring of 1 m from O, at rest along OX but for ``speed`` along OY [m/s].

    Guided, it slides along OX between two springs that pull beside its centre, so that the guide is loaded.
    """
    X, Y, _ = np.eye(3)
    O = np.zeros(3)
    law = {"stiffness": stiffness, "rest_length": 1.0, "damping": damping}
    beside = [SpringDamper(0, 0.2 * Y, GROUND, 0.2 * Y + end * X, **law) for end in (0.0, 3.0)]
    guide = [Joint(0, O, GROUND, O, X, X, "guide", "prismatic", Y, Y)]
    system = assemble(
        [RigidBody(1.0, np.eye(3), "ball")],
        guide if guided else (),
        O,
        beside if guided else [SpringDamper(0, O, **law)],
    )
    start = State((1.0 + stretch) * X[None], np.eye(3)[None], speed * Y[None], np.zeros((1, 3)))
    return Problem("ball", system, start, t_end=1.0, dt=0.1, section="", source="")


@pytest.mark.parametrize(("stiffness", "guided"), [(0.0, False), (1e2, False), (1e6, False), (1e2, True)])
@pytest.mark.parametrize("damping", [0.0, 1e4])
def test_a_linear_motion_takes_one_correction(stiffness, damping, guided):
    """Along its springs a ball is linear: Newton's method ends with the first correction, the second shows it.

    Two springs and a guide are coupled in its matrix.
    """
    t = solve_radau(on_a_spring(stiffness, damping, guided=guided), max_step=0.05)
    assert t.counters["rejected"] == 0 and t.counters["newton_iterations"] <= 2 * t.counters["steps"]


def test_an_endlessly_stiff_spring_is_a_rod():
    """The ball runs on a circle, with as many steps at 1e9 as at 1e12 N/m (critical damping, stretched by v^2 / k)."""
    steps = []
    for stiffness in (1e9, 1e12):
        t = solve_radau(on_a_spring(stiffness, 2.0 * stiffness**0.5, 3.0, 9.0 / stiffness), 1e-6)
        circle = np.stack((np.cos(3.0 * t.t), np.sin(3.0 * t.t), 0.0 * t.t), axis=1)
        assert np.max(np.abs(t.states.r[:, 0] - circle)) < 1e-6 + 30.0 / stiffness
        steps.append(t.counters["steps"])
    assert max(steps) <= 1.1 * min(steps), steps


def test_the_solution_does_not_depend_on_the_matrix(monkeypatch):
    """Two bars, two spring-dampers: the same steps by both iterations, to their tolerance."""
    p = make_problem("damped_linkage", {"t_end": 0.5})
    new = solve_radau(p, max_step=0.01)
    iterate_without_springs(monkeypatch)
    old = solve_radau(p, max_step=0.01)
    assert_same(new.t, old.t)
    assert np.max(np.abs(new.states.r - old.states.r)) < 1e-9
    assert np.max(np.abs(new.states.v - old.states.v)) < 1e-7
    assert new.counters["newton_iterations"] <= old.counters["newton_iterations"]


def test_stiffness_no_longer_cuts_the_step(monkeypatch):
    """The governor's springs and dampers are fast, 8117 1/s, and its motion slow."""
    p = make_problem("flyball_governor", {"t_end": 0.5})
    exact = solve_run(p, 1e-9, "rkmk_dop853")
    new = solve_radau(p, 1e-6)
    assert np.linalg.norm(new.states.r[-1] - exact.states.r[-1], axis=1).max() < 1e-6
    assert np.max(np.abs(constraint(p.system, new.states))) < 1e-10
    iterate_without_springs(monkeypatch)
    assert solve_radau(p, 1e-6).counters["steps"] > 3 * new.counters["steps"]
