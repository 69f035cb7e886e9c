"""Half-explicit, alpha, mean-value and Radau steps on the kernel's entries against those on the kernel by hand."""

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.compiled.host import Method, integrate, tolerance_of
from mbsbench.solvers.formulations.geometric.index1 import alpha, energy_momentum, half_explicit
from mbsbench.solvers.formulations.geometric.index1 import integrate as index1
from mbsbench.solvers.formulations.methods.alpha import alpha_steps
from mbsbench.solvers.formulations.methods.energy_momentum import mean_value_steps
from mbsbench.solvers.formulations.methods.half_explicit import half_explicit_steps
from mbsbench.solvers.formulations.methods.radau import radau_steps
from mbsbench.solvers.formulations.rows.means import mean_row_loop

PROBLEMS = {  # name: (t_end [s], dt [s]); pins, springs and dampers, line rows, loads, drives, rows of velocities alone
    "heavy_top": (0.3, 1e-3), "chain": (0.1, 1e-3), "flyball_governor": (0.05, 1e-4), "damped_linkage": (0.3, 1e-3),
    "slider_crank": (0.3, 1e-3), "driven_slider_crank": (0.5, 1e-2), "stewart_platform": (0.2, 1e-2),
    "rolling_disc": (0.5, 1e-2),
}  # fmt: skip
FIXED = 1e6  # a tolerance that accepts every step of Radau: max_step alone sets it


def alphas(of: Problem, **scheme: float) -> Method:
    return alpha_steps(**scheme, tolerance=tolerance_of(1e-12, of)[0])


def damped(of: Problem, *, stabilised: int) -> Method:
    alpha_m, alpha_f = 0.8 / 1.9, 0.9 / 1.9
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    return alphas(of, alpha_m=alpha_m, alpha_f=alpha_f, beta=beta, gamma=gamma, stabilised=stabilised)


METHODS: dict[str, tuple[Callable[[Problem], Method], str, float]] = {  # ..., solver, tolerance of poses [m]
    "hem": (lambda of: half_explicit_steps(1e-11), "half_explicit", 1e-13),
    "alpha": (partial(damped, stabilised=1), "generalized_alpha", 1e-12),
    "alpha_index3": (partial(damped, stabilised=0), "generalized_alpha", 1e-12),
    "al": (partial(alphas, beta=0.25, gamma=0.5, shift=1e-7, projected=1), "al_index3", 1e-12),
    "em": (lambda of: mean_value_steps(of.system, tolerance_of(1e-12, of)[0]), "energy_momentum", 1e-12),
    "radau": (lambda of: radau_steps(of.system, FIXED), "radau_ggl", 1e-10),
}


def by_hand(which: str, of: Problem, control: StepControl) -> Trajectory:
    """The same on the kernel by hand."""
    tolerance = tolerance_of(1e-12, of)[0]
    if which == "radau":
        return index1.radau_steps(of, control)
    if which == "hem":
        tableau = half_explicit.Scheme(half_explicit.A, half_explicit.C, 1e-11)
        return index1.fixed_steps(of, control, half_explicit, tableau)
    if which == "em":
        return index1.fixed_steps(of, control, energy_momentum, energy_momentum.Scheme(tolerance))
    if which == "al":
        scheme = alpha.Scheme(0.0, 0.0, 0.25, 0.5, tolerance, shift=1e-7, projected=1)
    else:
        alpha_m, alpha_f = 0.8 / 1.9, 0.9 / 1.9
        gamma = 0.5 + alpha_f - alpha_m
        beta = 0.25 * (gamma + 0.5) ** 2
        scheme = alpha.Scheme(alpha_m, alpha_f, beta, gamma, tolerance, stabilised=int(which == "alpha"))
    return index1.fixed_steps(of, control, alpha, scheme)


def steps_of(which: str, dt: float) -> StepControl:
    return StepControl(rtol=FIXED, max_step=dt) if which == "radau" else StepControl(dt=dt)


def both(which: str, name: str) -> tuple[Trajectory, Trajectory]:
    method, solver, _ = METHODS[which]
    t_end, dt = PROBLEMS[name]
    of = dataclasses.replace(make_problem(name), t_end=t_end)
    control = steps_of(which, dt)
    if make_solver(solver).refuses(of, control):
        pytest.skip("refused")
    return integrate(of, control, method(of)), by_hand(which, of, control)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("which", METHODS)
def test_the_motion_is_that_of_the_kernel_by_hand(which: str, name: str) -> None:
    """Poses within the tolerance of the iteration (ten of it: errors of steps add up), velocities that over a step."""
    new, old = both(which, name)
    tolerance, dt = 10.0 * METHODS[which][2], PROBLEMS[name][1]
    assert new.status is old.status is Status.SUCCESS
    assert np.max(np.abs(new.t - old.t)) < 1e-15
    assert np.max(np.abs(new.states.r - old.states.r)) < tolerance
    assert np.max(np.abs(new.states.R - old.states.R)) < tolerance
    assert np.max(np.abs(new.states.v - old.states.v)) < tolerance / dt
    assert np.max(np.abs(new.reaction - old.reaction)) < 1e-5 * np.max(np.abs(old.reaction))
    assert new.counters["factorisations"] == old.counters["factorisations"]
    ratio = new.counters["newton_iterations"] / old.counters["newton_iterations"]
    assert abs(ratio - 1.0) < 0.15, "iterations end where rounding does, one earlier or later"


@pytest.mark.parametrize("which", METHODS)
def test_the_order_is_the_declared_one(which: str) -> None:
    """Three halvings on a system with springs, dampers and skew inertias, the last slope within 0.2."""
    method, solver, _ = METHODS[which]
    of = dataclasses.replace(make_problem("damped_linkage"), t_end=0.4, reference_from=None)
    exact = make_solver("rkmk_dop853").solve(of, StepControl(rtol=1e-12)).states.r[-1]
    dt = {"hem": 0.02, "radau": 0.05}.get(which, 4e-3)
    ends = [integrate(of, steps_of(which, dt / 2**n), method(of)).states.r[-1] for n in range(4)]
    errors = [float(np.max(np.abs(r - exact))) for r in ends]
    order = 5.0 if which == "radau" else make_solver(solver).order
    assert abs(np.log2(errors[-2] / errors[-1]) - order) < 0.2, errors


def test_a_row_that_is_not_quadratic_has_no_mean() -> None:
    """The length of a driven link is a root."""
    with pytest.raises(ValueError, match="no mean rows"):
        mean_row_loop("driven distance", (0,), True)
