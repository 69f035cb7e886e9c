"""Half-explicit, alpha, mean-value and Radau steps on the kernel's entries have their orders."""

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.types import Problem, StepControl
from mbsbench.solvers.formulations.compiled.host import Method, integrate, tolerance_of
from mbsbench.solvers.formulations.methods.alpha import alpha_steps
from mbsbench.solvers.formulations.methods.energy_momentum import mean_value_steps
from mbsbench.solvers.formulations.methods.half_explicit import half_explicit_steps
from mbsbench.solvers.formulations.methods.radau import radau_steps
from mbsbench.solvers.formulations.rows.means import mean_row_loop

FIXED = 1e6  # a tolerance that accepts every step of Radau: max_step alone sets it


def alphas(of: Problem, **scheme: float) -> Method:
    return alpha_steps(**scheme, tolerance=tolerance_of(1e-12, of)[0])


def damped(of: Problem, *, stabilised: int) -> Method:
    alpha_m, alpha_f = 0.8 / 1.9, 0.9 / 1.9
    gamma = 0.5 + alpha_f - alpha_m
    beta = 0.25 * (gamma + 0.5) ** 2
    return alphas(of, alpha_m=alpha_m, alpha_f=alpha_f, beta=beta, gamma=gamma, stabilised=stabilised)


METHODS: dict[str, tuple[Callable[[Problem], Method], str]] = {
    "hem": (lambda of: half_explicit_steps(1e-11), "half_explicit"),
    "alpha": (partial(damped, stabilised=1), "generalized_alpha"),
    "alpha_index3": (partial(damped, stabilised=0), "generalized_alpha"),
    "al": (partial(alphas, beta=0.25, gamma=0.5, shift=1e-7, projected=1), "al_index3"),
    "em": (lambda of: mean_value_steps(of.system, tolerance_of(1e-12, of)[0]), "energy_momentum"),
    "radau": (lambda of: radau_steps(of.system, FIXED), "radau_ggl"),
}


def steps_of(which: str, dt: float) -> StepControl:
    return StepControl(rtol=FIXED, max_step=dt) if which == "radau" else StepControl(dt=dt)


@pytest.mark.parametrize("which", METHODS)
def test_the_order_is_the_declared_one(which: str) -> None:
    """Three halvings on a system with springs, dampers and skew inertias, the last slope within 0.2."""
    method, solver = METHODS[which]
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
