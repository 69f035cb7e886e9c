"""Accelerations and reactions of index 1 by dense and by sparse algebra."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import index1
from mbsbench.harness.mechanics.motion import applied, constraint_rate, drift
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.types import StepControl

LARGE = {"four_bar_grid": {"columns": 20, "rows": 20}, "chain": {"links": 399}}


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
