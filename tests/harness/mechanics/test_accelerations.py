"""Accelerations and reactions of index 1: by dense and by sparse algebra, and where rows are redundant."""

import numpy as np
import pytest

import mbsbench
from mbsbench import States, StepControl, equations, moved
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import dynamics, index1
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.motion import applied, constraint_rate, drift

LARGE = {"four_bar_grid": {"columns": 20, "rows": 20}, "chain": {"links": 399}}
both_routes = pytest.mark.parametrize(
    "accelerations", [dynamics.accelerations, mbsbench.accelerations], ids=["numpy", "public"]
)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("bricard", {}), ("slider_crank", {}), ("heavy_top", {}), ("driven_slider_crank", {}),
     ("four_bar_grid", {"columns": 4, "rows": 3}), ("chain", {"links": 30})],
)  # fmt: skip
def test_sparse_and_dense_algebra_agree(name, parameters, monkeypatch):
    """Also with redundant rows, where reactions are not unique and what they do to bodies is."""
    problem = make_problem(name, {"t_end": 0.2, **parameters})
    run = make_solver("gc_augmented_lagrangian").solve(problem, StepControl(dt=0.01))
    found = []
    for most in (np.inf, -1.0):
        monkeypatch.setattr(index1, "DENSE", most)
        found.append(index1.index_1(problem.system, run.states.at(slice(0, None, 5))))
    for dense, sparse in ((found[0].a, found[1].a), (found[0].load, found[1].load)):
        np.testing.assert_allclose(sparse, dense, rtol=0, atol=1e-8 * np.max(np.abs(dense)))


@pytest.mark.parametrize("name", LARGE)
def test_large_systems_are_solved_to_rounding(name):
    """M a = f + A^T reaction and A a = -A_dot v, with thousands of rows."""
    problem = make_problem(name, LARGE[name])
    system, one = problem.system, problem.initial
    s = States(one.r[None], one.R[None], one.v[None], one.Omega[None])
    found = index1.index_1(system, s)
    f = applied(system, s)
    f[..., 3:] -= np.cross(one.Omega, np.einsum("bij,bj->bi", system.inertia, one.Omega))
    Ma = np.concatenate((system.mass[:, None] * found.a[..., :3],
                         np.einsum("bij,tbj->tbi", system.inertia, found.a[..., 3:])), axis=-1)  # fmt: skip
    np.testing.assert_allclose(Ma, f + found.load, rtol=0, atol=1e-9 * np.max(np.abs(f)))
    faster = States(s.r, s.R, found.a[..., :3], found.a[..., 3:])  # A a, where no row moves by itself
    opening = constraint_rate(system, faster) + drift(system, s)
    np.testing.assert_allclose(opening, 0.0, atol=1e-8 * np.max(np.abs(found.a)))


@both_routes
def test_redundant_rows_stay_redundant_in_a_stage_off_the_constraints(accelerations):
    """Bricard's redundant row is one where phi = 0; in a stage phi is O(h^2), and so is what its accelerations are off.

    Counted as independent there, it asks for a load of any size.
    """
    problem = make_problem("bricard")
    system, s = problem.system, problem.initial
    for _ in range(40):
        s = project(system, moved(s, accelerations(system, moved(s, accelerations(system, s), 1.25e-3)), 2.5e-3))
    off = []
    for h in (0.02, 0.01):
        stage = moved(s, accelerations(system, s), h)
        there, on = accelerations(system, stage), accelerations(system, project(system, stage))
        off.append(np.max(np.abs(there.v_dot - on.v_dot)))
    assert 3.0 < off[0] / off[1] < 5.0 and off[0] < 1.0


@pytest.mark.parametrize(
    "drawn", [{"size": 1e5, "mechanism_seed": 31}, {"size": 1e5, "mechanism_seed": 5},
              {"size": 1e-5, "contrast": 10.0, "mechanism_seed": 31}],
)  # fmt: skip
@both_routes
def test_rows_of_small_or_heavy_bodies_are_no_redundant_ones(drawn, accelerations):
    """A a + A_dot v = 0 in every row, whatever the sizes and masses: none is taken for redundant."""
    problem = make_problem("random_mechanism", drawn)
    e, rates = equations(problem.system, problem.initial), accelerations(problem.system, problem.initial)
    a = np.concatenate((rates.v_dot, rates.Omega_dot), axis=1).ravel()
    assert np.max(np.abs(e.A @ a + e.A_dot_v)) < 1e-9 * np.max(np.abs(a))
