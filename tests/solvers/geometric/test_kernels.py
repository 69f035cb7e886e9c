"""The compiled kernels against other routes: mechanics in NumPy, central differences, dense linear algebra."""

import numpy as np
import pytest

from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, scaling_masses
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.system import Joint, RigidBody, assemble
from mbsbench.harness.types import Problem
from mbsbench.solvers.formulations.geometric.block_lu import factor, solve
from mbsbench.solvers.formulations.geometric.driver import Run, load, prepare
from mbsbench.solvers.formulations.geometric.jacobian import assemble as fill_blocks
from mbsbench.solvers.formulations.geometric.residual import Settings, complete, start_forces
from mbsbench.solvers.formulations.geometric.step import evaluate

from ..arbitrary_systems import arbitrary, linkage

DT = 0.05


def settings(**choices: float) -> Settings:
    """Exact Newton in the symmetric gauge, but for ``choices``."""
    usual = Settings(
        gauge=-1.0, keep_nu=0, direction=0, use_f_bar=1, corrective=0, carry_sigma=0, b_term=1.0, tolerance=1e-8,
        max_newton=20, refresh=0.0, couple=1,
    )  # fmt: skip
    return usual._replace(**choices)


def presented(system, chosen: Settings) -> Run:
    """A run at an arbitrary state, with an arbitrary estimate of the end."""
    random = np.random.default_rng(3)
    problem = Problem("test", system, arbitrary(system, 5), t_end=1.0, dt=DT, section="", source="")
    run = prepare(problem, chosen)
    run.rows.lam0[:], run.rows.mu0[:] = random.standard_normal((2, system.nrows))
    if chosen.gauge == 0.0:
        run.rows.nu_start[:] = random.standard_normal(system.nrows)
    start_forces(run.start, run.rows, run.settings)
    run.end.v[:] = run.start.v + 0.3 * random.standard_normal(run.start.v.shape)
    run.rows.nu1[:] = random.standard_normal(system.nrows)
    return run


def residual(run: Run, x: np.ndarray) -> np.ndarray:
    """(74), rotational rows turned back to space so that the turning itself is not differentiated, and (75)."""
    nv = run.end.v.size
    run.end.v[:] = x[:nv].reshape(run.end.v.shape)
    run.rows.nu1[:] = x[nv:]
    evaluate(run.model, run.start, run.end, run.rows, DT, run.settings, run.penalty, run.work)
    body = run.work.body.copy()
    body[:, 3:] = np.einsum("bij,bj->bi", run.end.R, body[:, 3:])
    return np.concatenate((body.ravel(), run.work.constraint))


def dense(run: Run) -> np.ndarray:
    """The block matrix, bodies first."""
    w = run.work
    fill_blocks(run.model, run.start, run.end, run.rows, DT, run.settings, w.diagonal, run.index, w.blocks, w.T)
    p = run.pattern
    out = np.zeros((p.start[-1],) * 2)
    for node in range(len(p.size)):
        for k in range(p.pair_start[node], p.pair_start[node + 1]):
            rows, at, width = slice(p.start[node], p.start[node + 1]), p.pair_column[k], p.pair_width[k]
            out[rows, at : at + width] += run.work.blocks[k, : p.size[node], :width]
    order = [np.arange(a, a + 6) for a in p.body_at]
    order += [np.arange(a, a + n) for a, n in zip(p.joint_at, np.diff(run.model.row), strict=True)]
    at = np.concatenate(order)
    return out[np.ix_(at, at)]


@pytest.mark.parametrize("springs", [False, True])
def test_kinematics_agree_with_the_batched_mechanics(springs):
    """phi, phi_dot, A v and M_bar are computed twice, from the same definitions by different code."""
    system = linkage(springs=springs)
    run = presented(system, settings())
    state = arbitrary(system, 5)
    load(run.start, state)
    complete(run.model, run.start, run.settings)
    one = States.one(state)
    assert np.allclose(run.start.phi, constraint(system, one)[0], atol=1e-13)
    assert np.allclose(run.start.phi_dot, constraint_rate(system, one)[0], atol=1e-13)
    assert np.allclose(run.start.phi_dot, constraint_jacobian(system, state) @ run.start.v.ravel(), atol=1e-13)
    assert np.allclose(run.start.m_bar, scaling_masses(system, one)[0], rtol=1e-13)


@pytest.mark.parametrize(
    "choices",
    [{}, {"gauge": 0.0, "keep_nu": 1}, {"gauge": 0.0, "direction": 1}, {"use_f_bar": 0}, {"b_term": 0.0}],
    ids=str,
)
@pytest.mark.parametrize("springs", [False, True])
def test_newton_matrix_is_the_derivative_of_the_residual(choices, springs):
    """Central differences of step 1e-6 leave about 1e-9; f_bar of springs is left out of the matrix by design."""
    chosen = settings(**(choices | ({"use_f_bar": 0} if springs else {})))
    run = presented(linkage(springs=springs), chosen)
    x = np.concatenate((run.end.v.ravel(), run.rows.nu1))
    steps = 1e-6 * np.eye(len(x))
    slopes = np.stack([(residual(run, x + h) - residual(run, x - h)) / 2e-6 for h in steps], axis=1)
    residual(run, x)
    for b, R in enumerate(run.end.R):
        rows = slice(6 * b + 3, 6 * b + 6)
        slopes[rows] = R.T @ slopes[rows]
    assert np.max(np.abs(dense(run) - slopes)) < 2e-8


def test_translation_direction_has_its_derivative_too():
    """c = (e_k, 0) for spherical joints: f_bar is constant."""
    system = assemble_spherical()
    run = presented(system, settings(direction=2))
    x = np.concatenate((run.end.v.ravel(), run.rows.nu1))
    slopes = np.stack([(residual(run, x + h) - residual(run, x - h)) / 2e-6 for h in 1e-6 * np.eye(len(x))], axis=1)
    residual(run, x)
    for b, R in enumerate(run.end.R):
        slopes[6 * b + 3 : 6 * b + 6] = R.T @ slopes[6 * b + 3 : 6 * b + 6]
    assert np.max(np.abs(dense(run) - slopes)) < 2e-8


def assemble_spherical():
    """Two bodies on spherical joints."""
    bodies = [RigidBody(1.0, np.diag([0.1, 0.2, 0.25])), RigidBody(2.0, np.diag([0.3, 0.2, 0.25]))]
    return assemble(bodies, [Joint(0, (0.1, 0.2, 0.3)), Joint(1, (0.0, 0.3, 0.1), 0, (-0.2, 0.0, 0.1))], (0, 0, -9.81))


@pytest.mark.parametrize("springs", [False, True])
def test_block_factors_solve_the_assembled_matrix(springs):
    """Against dense LU, to rounding times the condition number (about 1e3)."""
    run = presented(linkage(springs=springs), settings())
    residual(run, np.concatenate((run.end.v.ravel(), run.rows.nu1)))
    matrix = dense(run)
    assert factor(run.pattern, run.work.blocks, run.factors) == 0
    wanted = np.random.default_rng(1).standard_normal(len(matrix))
    p = run.pattern
    at = np.concatenate(
        [np.arange(a, a + 6) for a in p.body_at]
        + [np.arange(a, a + n) for a, n in zip(p.joint_at, np.diff(run.model.row), strict=True)]
    )
    x = np.empty_like(wanted)
    x[at] = matrix @ wanted
    solve(run.pattern, run.factors, x)
    assert np.allclose(x[at], wanted, atol=1e-10)
