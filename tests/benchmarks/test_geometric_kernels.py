"""Kernels of ODE-GC on one body, 15 links and 55 bars: residual, Jacobian, factorisation, solution, a whole step."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.solvers.formulations.geometric import march as marching
from mbsbench.solvers.formulations.geometric.block_lu import factor, solve
from mbsbench.solvers.formulations.geometric.driver import PLAIN, Run, prepare
from mbsbench.solvers.formulations.geometric.jacobian import assemble
from mbsbench.solvers.formulations.geometric.step import Penalty, evaluate, refresh

PROXIMAL = Penalty(active=1, nested=0, xi=1e7, max_augmentations=12, accept=1e-3, correct_pose=1, soft=0.1)
CASES = {  # problem, its step [s], solver, penalty
    "pendulum": ("spherical_pendulum", 1e-2, "gc_weak_form", PLAIN),
    "chain": ("chain", 1e-3, "gc_weak_form", PLAIN),
    "grid": ("four_bar_grid", 1e-2, "gc_augmented_lagrangian", PROXIMAL),
}


@pytest.fixture(params=CASES)
def case(request) -> tuple[Run, float]:
    """A run that has taken ten steps, its matrix factored, and its step [s]."""
    name, dt, solver, penalty = CASES[request.param]
    problem = make_problem(name)
    run = prepare(problem, make_solver(solver).settings(problem), penalty)
    for _ in range(10):
        step(run, dt)
    evaluate(run.model, run.start, run.end, run.rows, dt, run.settings, run.penalty, run.work)
    assert refresh(*upto_settings(run, dt), run.penalty, run.index, run.pattern, run.factors, run.work) == 0
    return run, dt


def upto_settings(run: Run, dt: float) -> tuple:
    return run.model, run.start, run.end, run.rows, dt, run.settings


def step(run: Run, dt: float) -> None:
    """One step of the march from where the run stands."""
    clock = marching.Clock(np.zeros(3, dtype=np.int64), dt, dt, 16)
    record = marching.empty_record(1, len(run.model.mass), int(run.model.row[-1]))
    outcome, done = marching.march(
        run.model, run.start, run.end, run.rows, run.history, run.settings, run.penalty, run.index, run.pattern,
        run.factors, run.work, clock, record,
    )  # fmt: skip
    assert done == 1 and outcome != marching.UNDERFLOW


def test_residual(benchmark, case):
    """Eqs. (74), (75), the end's poses and joints included."""
    run, dt = case
    benchmark(evaluate, *upto_settings(run, dt), run.penalty, run.work)


def test_jacobian(benchmark, case):
    """Blocks of Eq. (79)."""
    run, dt = case
    benchmark(assemble, *upto_settings(run, dt), run.work.diagonal, run.index, run.work.blocks, run.work.T)


def test_factorisation(benchmark, case):
    """Block LU of the saddle on its fixed pattern."""
    run, _ = case
    assert benchmark(factor, run.pattern, run.work.blocks, run.factors) == 0


def test_solution(benchmark, case):
    """One right side."""
    run, _ = case
    right = np.random.default_rng(1).standard_normal(len(run.work.x))
    x = right.copy()

    def fresh() -> None:
        x[:] = right
        solve(run.pattern, run.factors, x)

    benchmark(fresh)
    assert np.all(np.isfinite(x))


def test_step(benchmark, case):
    """A step to convergence, with whatever it takes."""
    run, dt = case
    benchmark(step, run, dt)


def test_call(benchmark):
    """A march that has nothing to do: what a call from Python costs, to be taken off a step."""
    problem = make_problem("spherical_pendulum")
    run = prepare(problem, make_solver("gc_weak_form").settings(problem))
    clock = marching.Clock(np.zeros(3, dtype=np.int64), 1.0, 0.0, 16)
    record = marching.empty_record(1, len(run.model.mass), int(run.model.row[-1]))
    benchmark(
        marching.march, run.model, run.start, run.end, run.rows, run.history, run.settings, run.penalty, run.index,
        run.pattern, run.factors, run.work, clock, record,
    )  # fmt: skip
