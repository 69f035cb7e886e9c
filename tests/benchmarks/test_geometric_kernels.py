"""ODE-GC's full Newton method on one body, 15 links and 55 bars: residual, Jacobian, factorisation, solution."""

from typing import Any

import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.solvers.formulations.compiled.entries import Program
from mbsbench.solvers.formulations.compiled.kernel import Kernel, make_kernel, set_state
from mbsbench.solvers.formulations.compiled.marching import make_control
from mbsbench.solvers.formulations.methods.gc_newton import NEEDED, make_newton_method

CASES = {"pendulum": ("spherical_pendulum", 1e-2), "chain": ("chain", 1e-3), "grid": ("four_bar_grid", 1e-2)}


@pytest.fixture(params=CASES)
def case(request) -> tuple[Any, Kernel]:
    """The first estimate of a step, its matrix factored, and what keeps its entries alive."""
    name, dt = CASES[request.param]
    problem = make_problem(name)
    settings = make_solver("gc_augmented_lagrangian", {"newton": "exact"}).make_settings(problem)
    settings = settings._replace(active=1, penalty=1e7)
    made = make_kernel(problem.system, NEEDED)
    set_state(made, problem.initial)
    step = make_newton_method(problem.system, settings).prepare(made, make_control(h=dt, dt=dt))
    step.r0[:], step.R0[:], step.v0[:] = made.r, made.R, made.v
    for entry in (step.complete, step.keep_end, step.begin_step, step.estimate, step.evaluate, step.refresh):
        Program.run(entry)
    assert step.lu.state["singular"] == 0
    return step, made


@pytest.mark.parametrize("entry", ["evaluate", "assemble", "factor_saddle", "solve_saddle"])
def test_entry(benchmark, case, entry):
    """Eqs. (74), (75), poses and joints included; blocks of Eq. (79); their block LU; one right side."""
    benchmark(Program.run, getattr(case[0], entry))
