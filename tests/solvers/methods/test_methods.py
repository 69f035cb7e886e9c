"""Methods on the kernel made from declarations against those on the kernel by hand: the same motion of everything."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.compiled.host import Method, integrate
from mbsbench.solvers.formulations.compiled.mechanism import make_mechanism
from mbsbench.solvers.formulations.geometric.index1 import free_body
from mbsbench.solvers.formulations.geometric.index1 import rattle as by_hand
from mbsbench.solvers.formulations.geometric.index1.integrate import above_rounding, fixed_steps, runge_kutta
from mbsbench.solvers.formulations.methods import rattle, rkmk
from mbsbench.solvers.formulations.methods.tableaux import DOPRI5, DOPRI853, Tableau

PROBLEMS = {  # name: (t_end [s], dt [s]); pins, springs and dampers, line rows, drives, rows of velocities alone
    "heavy_top": (0.3, 1e-3), "chain": (0.1, 1e-3), "flyball_governor": (0.05, 1e-4), "damped_linkage": (0.3, 1e-3),
    "slider_crank": (0.3, 1e-3),
    "driven_slider_crank": (0.5, 1e-2), "stewart_platform": (0.2, 1e-2), "rolling_disc": (0.5, 1e-2),
}  # fmt: skip
SAME = 1e-9  # [m] of step sizes that differ by rounding; fixed steps below agree to the iteration's tolerance


def problem(name: str) -> Problem:
    return dataclasses.replace(registry.problems()[name].make(), t_end=PROBLEMS[name][0])


def explicit(tableau: Tableau) -> Method:
    return dataclasses.replace(rkmk.explicit_pair(tableau), explicit=False)


def symplectic(of: Problem, *, discrete: bool = False, rate: float = 0.0) -> Method:
    tolerance = above_rounding(1e-13, of)
    return rattle.symplectic_steps(of.system, np.array([1.0]), tolerance, discrete=discrete, rate=rate)


def before(of: Problem, control: StepControl, **given: float) -> Trajectory:
    """The same steps on the kernel written by hand."""
    axes, plain, damped = free_body.principal(of.system.solved_inertia), np.array([1.0]), not of.system.is_conservative
    scheme = by_hand.Scheme(axes, plain, above_rounding(1e-13, of), int(damped), **given)
    return fixed_steps(of, control, by_hand, scheme)


@pytest.mark.parametrize("name", PROBLEMS)
def test_rkmk_is_that_on_the_kernel_by_hand(name: str) -> None:
    """DOP853: the same number of steps, the same motion and reactions to rounding."""
    of, control = problem(name), StepControl(rtol=1e-9)
    new, old = integrate(of, control, explicit(DOPRI853)), runge_kutta(of, control, DOPRI853)
    assert new.status is old.status is Status.SUCCESS
    assert len(new.t) == len(old.t)
    assert new.counters["evaluations"] == old.counters["evaluations"]
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < SAME
    assert np.max(np.abs(new.states.R[-1] - old.states.R[-1])) < SAME
    assert np.max(np.abs(new.reaction[-1] - old.reaction[-1])) < 1e3 * SAME * max(1.0, np.max(np.abs(old.reaction)))


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("steps", ["adaptive", "fixed"])
def test_code_of_a_whole_mechanism_gives_the_same_motion(name: str, steps: str) -> None:
    """Straight code instead of loops over joints: the same steps, the same motion and reactions to rounding."""
    of = problem(name)
    control = StepControl(rtol=1e-9) if steps == "adaptive" else StepControl(dt=PROBLEMS[name][1])
    method = explicit(DOPRI853) if steps == "adaptive" else symplectic(of)
    assert make_mechanism(of.system) is not None
    new, old = (integrate(of, control, dataclasses.replace(method, explicit=whole)) for whole in (True, False))
    assert len(new.t) == len(old.t)
    assert np.max(np.abs(new.states.r[-1] - old.states.r[-1])) < SAME
    assert np.max(np.abs(new.states.R[-1] - old.states.R[-1])) < SAME
    assert np.max(np.abs(new.reaction[-1] - old.reaction[-1])) < 1e3 * SAME * max(1.0, np.max(np.abs(old.reaction)))


def test_dopri5_is_that_on_the_kernel_by_hand() -> None:
    """The pair 5(4) has one estimate of the error."""
    of, control = problem("heavy_top"), StepControl(rtol=1e-6)
    new, old = integrate(of, control, explicit(DOPRI5)), runge_kutta(of, control, DOPRI5)
    assert len(new.t) == len(old.t)
    assert np.max(np.abs(new.states.r - old.states.r)) < SAME


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name != "rolling_disc"])
def test_rattle_is_that_on_the_kernel_by_hand(name: str) -> None:
    """Poses, velocities and reactions of all steps."""
    of, control = problem(name), StepControl(dt=PROBLEMS[name][1])
    new, old = integrate(of, control, symplectic(of)), before(of, control)
    assert new.status is old.status is Status.SUCCESS
    assert np.array_equal(new.t, old.t)
    assert np.max(np.abs(new.states.r - old.states.r)) < 1e-11
    assert np.max(np.abs(new.states.v - old.states.v)) < 1e-9
    assert np.max(np.abs(new.reaction - old.reaction)) < 1e-9 * np.max(np.abs(old.reaction))


def test_discrete_free_bodies_are_those_on_the_kernel_by_hand() -> None:
    """Moser and Veselov's equations instead of the exact free body."""
    of, control = problem("heavy_top"), StepControl(dt=1e-3)
    new, old = integrate(of, control, symplectic(of, discrete=True)), before(of, control, discrete=1)
    assert np.max(np.abs(new.states.r - old.states.r)) < 1e-11


def test_reversible_steps_are_those_on_the_kernel_by_hand() -> None:
    """Steps follow the angular velocities by the same law."""
    of, control = problem("heavy_top"), StepControl(dt=1e-3)
    new, old = integrate(of, control, symplectic(of, rate=40.0)), before(of, control, rate=40.0)
    assert len(new.t) == len(old.t)
    assert np.max(np.abs(new.t - old.t)) < 1e-12
    assert np.max(np.abs(new.states.r - old.states.r)) < 1e-11


def test_a_limit_of_steps_is_a_status() -> None:
    """The march stops where it stands, and says so."""
    done = integrate(problem("heavy_top"), StepControl(dt=1e-3, max_steps=7), symplectic(problem("heavy_top")))
    assert done.status is Status.STALLED
    assert len(done.t) == 8
