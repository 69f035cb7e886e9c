"""The compiled kernels against other routes: mechanics in NumPy, central differences, dense linear algebra."""

import sys

import numpy as np
import pytest

from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.motion import applied, constraint, constraint_rate, scaling_masses
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.system import Joint, RigidBody, assemble
from mbsbench.harness.types import Problem
from mbsbench.solvers.formulations.geometric.arrays import Step
from mbsbench.solvers.formulations.geometric.block_lu import factor, solve
from mbsbench.solvers.formulations.methods.choices import Settings
from mbsbench.solvers.formulations.geometric.driver import load, prepare
from mbsbench.solvers.formulations.geometric.jacobian import assemble as fill_blocks
from mbsbench.solvers.formulations.geometric.newton import Run, evaluate
from mbsbench.solvers.formulations.geometric.residual import complete, start_forces

from ..arbitrary_joints import all_joints
from ..arbitrary_systems import arbitrary, linkage

DT = 0.05
SYSTEMS = {"pins": linkage(springs=False), "springs": linkage(springs=True), "all joints": all_joints()}
each_system = pytest.mark.parametrize("system", SYSTEMS.values(), ids=SYSTEMS)


def settings(**choices: float) -> Settings:
    """Exact Newton in the symmetric gauge, but for ``choices``."""
    usual = Settings(
        gauge=-1.0, keep_nu=0, direction=0, use_f_bar=1, corrective=0, carry_sigma=0, b_term=1.0, tolerance=1e-8,
        max_newton=20, refresh=0.0, couple=1, by_forces=0, c_bar=0.0, k_bar=0.0,
    )  # fmt: skip
    return usual._replace(**choices)


def arbitrary_step(system, chosen: Settings) -> tuple[Run, Step]:
    """A step from an arbitrary state, with an arbitrary estimate of its end."""
    random = np.random.default_rng(3)
    problem = Problem("test", system, arbitrary(system, 5), t_end=1.0, dt=DT, section="", source="")
    run, step = prepare(problem, chosen)
    step = step._replace(dt=DT)
    step.rows.lam0[:], step.rows.mu0[:] = random.standard_normal((2, system.nrows))
    if chosen.gauge == 0.0:
        step.rows.nu_start[:] = random.standard_normal(system.nrows)
    start_forces(step, chosen)
    step.end.v[:] = step.start.v + 0.3 * random.standard_normal(step.start.v.shape)
    step.rows.nu1[:] = random.standard_normal(system.nrows)
    return run, step


def unknown(step: Step) -> np.ndarray:
    """x = (v1, nu1), Eq. (77)."""
    return np.concatenate((step.end.v.ravel(), step.rows.nu1))


def residual(run: Run, step: Step, x: np.ndarray) -> np.ndarray:
    """(74), rotational rows turned back to space so that the turning itself is not differentiated, and (75)."""
    nv = step.end.v.size
    step.end.v[:] = x[:nv].reshape(step.end.v.shape)
    step.rows.nu1[:] = x[nv:]
    evaluate(run, step)
    R_v = run.work.R_v.copy()
    R_v[:, 3:] = np.einsum("bij,bj->bi", step.end.R, R_v[:, 3:])
    return np.concatenate((R_v.ravel(), run.work.R_mu))


def slopes(run: Run, step: Step) -> np.ndarray:
    """Central differences of the residual, rotational rows in the body frame; leaves the residual of the step."""
    x = unknown(step)
    h = 1e-6
    out = np.stack(
        [(residual(run, step, x + d) - residual(run, step, x - d)) / (2 * h) for d in h * np.eye(len(x))], axis=1
    )
    residual(run, step, x)
    for b, R in enumerate(step.end.R):
        out[6 * b + 3 : 6 * b + 6] = R.T @ out[6 * b + 3 : 6 * b + 6]
    return out


def places(run: Run) -> np.ndarray:
    """Where the unknowns, bodies first, stand in elimination order."""
    nodes = [np.arange(a, a + 6) for a in run.lu.body_at]
    nodes += [np.arange(a, a + n) for a, n in zip(run.lu.joint_at, np.diff(run.model.row), strict=True)]
    return np.concatenate(nodes)


def dense(run: Run, step: Step) -> np.ndarray:
    """The block matrix, bodies first."""
    fill_blocks(run.model, step, run.settings, run.saddle)
    lu = run.lu
    out = np.zeros((lu.start[-1],) * 2)
    for node in range(len(lu.size)):
        for k in range(lu.pair_start[node], lu.pair_start[node + 1]):
            rows, at, width = slice(lu.start[node], lu.start[node + 1]), lu.pair_column[k], lu.pair_width[k]
            out[rows, at : at + width] += run.saddle.blocks[k, : lu.size[node], :width]
    return out[np.ix_(places(run), places(run))]


@each_system
def test_kinematics_agree_with_the_batched_mechanics(system):
    """phi, phi_dot, A v, M_bar and the wrench are computed twice, from the same definitions by different code."""
    run, step = arbitrary_step(system, settings())
    state, start = arbitrary(system, 5), step.start
    load(start, state)
    complete(run.model, start, run.settings)
    one = States.one(state)
    assert np.allclose(start.phi, constraint(system, one)[0], atol=1e-13)
    assert np.allclose(start.phi_dot, constraint_rate(system, one)[0], atol=1e-13)
    assert np.allclose(start.phi_dot, constraint_jacobian(system, state) @ start.v.ravel(), atol=1e-13)
    assert np.allclose(start.m_bar, scaling_masses(system, one)[0], rtol=1e-12)
    wanted = applied(system, one)[0]
    assert np.allclose(start.wrench[:, :3], wanted[:, :3], rtol=1e-12)
    assert np.allclose(np.einsum("bij,bi->bj", state.R, start.wrench[:, 3:]), wanted[:, 3:], atol=1e-11)


@pytest.mark.parametrize(
    "choices",
    [{}, {"gauge": 0.0, "keep_nu": 1}, {"gauge": 0.0, "direction": 1}, {"use_f_bar": 0}, {"b_term": 0.0}],
    ids=str,
)
@each_system
def test_newton_matrix_is_the_derivative_of_the_residual(choices, system):
    """Central differences of step 1e-6 leave about 1e-9; f_bar of other forces and joints is left out by design."""
    pins_alone = system.is_pinned and not len(system.spring_k)
    run, step = arbitrary_step(system, settings(**(choices if pins_alone else choices | {"use_f_bar": 0})))
    wanted = slopes(run, step)
    assert np.max(np.abs(dense(run, step) - wanted)) < 2e-8


def test_translation_direction_has_its_derivative_too():
    """c = (e_k, 0) for spherical joints: f_bar is constant."""
    run, step = arbitrary_step(assemble_spherical(), settings(direction=2))
    wanted = slopes(run, step)
    assert np.max(np.abs(dense(run, step) - wanted)) < 2e-8


def assemble_spherical():
    """Two bodies on spherical joints."""
    bodies = [RigidBody(1.0, np.diag([0.1, 0.2, 0.25])), RigidBody(2.0, np.diag([0.3, 0.2, 0.25]))]
    return assemble(bodies, [Joint(0, (0.1, 0.2, 0.3)), Joint(1, (0.0, 0.3, 0.1), 0, (-0.2, 0.0, 0.1))], (0, 0, -9.81))


@each_system
def test_block_factors_solve_the_assembled_matrix(system):
    """Against dense LU, to rounding times the condition number (about 1e3)."""
    run, step = arbitrary_step(system, settings())
    residual(run, step, unknown(step))
    matrix, at = dense(run, step), places(run)
    assert factor(run.saddle.blocks, run.lu) == 0
    wanted = np.random.default_rng(1).standard_normal(len(matrix))
    x = np.empty_like(wanted)
    x[at] = matrix @ wanted
    solve(run.lu, x)
    assert np.allclose(x[at], wanted, atol=1e-10)


def test_kernels_leave_the_reference_counts_of_arrays_alone():
    """Kernels are compiled without reference counts (``vectors.JIT``): a call neither keeps an array nor frees one."""
    run, step = arbitrary_step(all_joints(), settings())
    arrays = [*step.start, *step.end, *step.rows, *run.model, *run.saddle, *run.lu, *run.work]
    before = [sys.getrefcount(a) for a in arrays]
    for _ in range(3):
        evaluate(run, step)
        fill_blocks(run.model, step, run.settings, run.saddle)
        factor(run.saddle.blocks, run.lu)
        solve(run.lu, run.work.x)
    assert [sys.getrefcount(a) for a in arrays] == before
