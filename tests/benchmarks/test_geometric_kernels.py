"""Kernels of ODE-GC on one body, 15 links and 55 bars: residual, Jacobian, factorisation, solution, a whole step."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.solvers.formulations.geometric import march as marching
from mbsbench.solvers.formulations.geometric.arrays import Step
from mbsbench.solvers.formulations.geometric.block_lu import factor, solve
from mbsbench.solvers.formulations.methods.choices import Penalty
from mbsbench.solvers.formulations.geometric.driver import advance, prepare
from mbsbench.solvers.formulations.geometric.jacobian import assemble
from mbsbench.solvers.formulations.geometric.newton import Run, evaluate, refresh

PROXIMAL = Penalty(active=1, xi=1e7, max_augmentations=12, accept=1e-3, correct_pose=1, soft=0.1)
CASES = {  # problem, its step [s], solver, penalty
    "pendulum": ("spherical_pendulum", 1e-2, "gc_weak_form", Penalty()),
    "chain": ("chain", 1e-3, "gc_weak_form", Penalty()),
    "grid": ("four_bar_grid", 1e-2, "gc_augmented_lagrangian", PROXIMAL),
}


@pytest.fixture(params=CASES)
def case(request) -> tuple[Run, Step]:
    """A run that has taken ten steps, and its next step, the matrix factored."""
    name, dt, solver, penalty = CASES[request.param]
    problem = make_problem(name)
    run, step = prepare(problem, make_solver(solver).settings(problem)._replace(penalty=penalty))
    for _ in range(10):
        step = one_step(run, step, dt)
    step = step._replace(dt=dt)
    evaluate(run, step)
    assert refresh(run, step) == 0
    return run, step


def one_step(run: Run, step: Step, dt: float) -> Step:
    """One step of the march from where the run stands."""
    step, outcome, record = advance(run, step, marching.Clock(np.zeros(3, dtype=np.int64), dt, dt, 16), 1)
    assert len(record.t) == 1 and outcome != marching.UNDERFLOW
    return step


def test_residual(benchmark, case):
    """Eqs. (74), (75), the end's poses and joints included."""
    benchmark(evaluate, *case)


def test_jacobian(benchmark, case):
    """Blocks of Eq. (79)."""
    run, step = case
    benchmark(assemble, run.model, step, run.settings, run.saddle)


def test_factorisation(benchmark, case):
    """Block LU of the saddle on its fixed pattern."""
    run, _ = case
    assert benchmark(factor, run.saddle.blocks, run.lu) == 0


def test_solution(benchmark, case):
    """One right side."""
    run, _ = case
    right = np.random.default_rng(1).standard_normal(len(run.work.x))
    x = right.copy()

    def fresh() -> None:
        x[:] = right
        solve(run.lu, x)

    benchmark(fresh)
    assert np.all(np.isfinite(x))


def test_step(benchmark, case):
    """A step to convergence, with whatever it takes."""
    run, now = case
    dt = now.dt

    def on() -> None:
        nonlocal now
        now = one_step(run, now, dt)

    benchmark(on)


def test_call(benchmark):
    """A march that has nothing to do: what a call from Python costs, to be taken off a step."""
    problem = make_problem("spherical_pendulum")
    run, step = prepare(problem, make_solver("gc_weak_form").settings(problem))
    clock = marching.Clock(np.zeros(3, dtype=np.int64), 1.0, 0.0, 16)
    record = marching.empty_record(1, len(run.model.mass), int(run.model.row[-1]))
    benchmark(marching.march, run, step, clock, record)
