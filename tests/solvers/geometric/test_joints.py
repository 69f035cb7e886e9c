"""Solvers of both routes on a system with a joint of each kind, a spring-damper and loads."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.mechanics import motion, work
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.joints import JointKind
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.reference.newton_euler import NewtonEuler
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

from ..arbitrary_joints import all_joints, one_joint
from ..arbitrary_systems import arbitrary

T_END = 0.1  # [s]
SHORT = 0.016  # [s]
FIXED = (
    "gc_weak_form", "gc_augmented_lagrangian", "rattle", "lie_variational", "generalized_alpha", "al_index3",
    "energy_momentum", "half_explicit",
)  # fmt: skip
CONTROLLED = ("radau_ggl", "rkmk_dopri5", "ida_index2", "ndf_index1", "rk45_strong_form")


@cache
def problem() -> Problem:
    system = all_joints()
    return Problem("all joints", system, project(system, arbitrary(system, 3), 100), T_END, 1e-3, "", "made up")


@cache
def exact() -> Trajectory:
    return run("rkmk_dop853", rtol=1e-12)


@cache
def run(name: str, **control: float) -> Trajectory:
    out = make_solver(name).solve(problem(), StepControl(**control))
    assert out.status == Status.SUCCESS, out.message
    return out


def error(out: Trajectory) -> float:
    return float(np.max(np.abs(out.states.r[-1] - exact().states.r[-1])))


@cache
def swing(kind: JointKind) -> tuple[Problem, State]:
    """Two bodies, so that normals turn, and where Newton's and Euler's equations in NumPy take them."""
    system, start = one_joint(kind, ground=False)
    route = NewtonEuler(system)
    y = route.restarted(route.start(start))
    end = solve_ivp(lambda t, y: route.rate(y), (0.0, SHORT), y, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return Problem("one joint", system, start, SHORT, 1e-3, "", "made up"), route.states(end[None])[0]


@pytest.mark.parametrize("name", FIXED)
@pytest.mark.parametrize("kind", JointKind)
def test_fixed_steps_converge_with_their_order(kind: JointKind, name: str) -> None:
    """Halved steps, in positions and rotations, at 10 rad/s and more; order 4 needs the shorter ones to show."""
    p, end = swing(kind)
    solver, off = make_solver(name), []
    coarse = 4e-3 if solver.order < 3.0 else 2e-3
    for dt in (coarse, 0.5 * coarse):
        out = solver.solve(p, StepControl(dt=dt))
        assert out.status == Status.SUCCESS, out.message
        off.append(np.max(np.abs(out.states.r[-1] - end.r)) + np.max(np.abs(out.states.R[-1] - end.R)))
    assert np.log2(off[0] / off[1]) == pytest.approx(solver.order, abs=0.2)


def test_energy_less_the_work_of_loads_and_dampers_is_kept() -> None:
    """E - E(0) - W along DOP853: the work is a quadrature of fourth order over its long steps."""
    t, s = exact().t, exact().states
    E = motion.energy(problem().system, s)
    drift = E - E[0]
    assert np.max(np.abs(drift)) > 0.01
    assert np.max(np.abs(drift - work.work(problem().system, t, s, E)[0])) < 1e-6 * np.max(np.abs(drift))
    assert np.max(np.abs(motion.constraint(problem().system, s))) < 1e-11


@pytest.mark.parametrize("name", CONTROLLED)
def test_error_control_holds_its_tolerance(name: str) -> None:
    """A local tolerance of 1e-8 over a tenth of a second of a motion at 10 rad/s: a thousand of them at most."""
    assert error(run(name, rtol=1e-8)) < 1e-5


@pytest.mark.parametrize("name", ["gc_composed", "gc_extrapolated"])
def test_what_the_simplified_step_has_no_rows_for_is_refused(name: str) -> None:
    """With the reason, before the first step."""
    control = StepControl(dt=1e-3) if name == "gc_composed" else StepControl(rtol=1e-8)
    assert "gravity as the only applied force" in (make_solver(name).refuses(problem(), control) or "")


def test_reactions_of_the_routes_agree() -> None:
    """Of every row, point, line and axis: DOP853 on the kernel and IDA on CasADi."""
    ours, theirs = exact().reaction[-1], run("ida_index2", rtol=1e-10).reaction[-1]
    assert np.max(np.abs(ours - theirs)) < 1e-4 * np.max(np.abs(ours))
