"""Index 1 of sparse rows is that of dense ones, where redundant rows come to depend on each other still more, too."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.judge.metrics.reactions import compute_exact_loads
from mbsbench.harness.mechanics import bordered, index1
from mbsbench.harness.mechanics.projection import project_poses, project_poses_of_each
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.reference.computation import find_reference
from mbsbench.tests.comparing import assert_same

# of the grid whose rows all turn: regular at 0.3 s, nearly dependent at 0.763 and 0.844 s (least singular value 1e-7)
INSTANTS = np.array([0.3, 0.763, 0.844, 0.95])


@pytest.fixture(scope="module")
def grid():
    problem = make_problem("four_bar_grid", {"release": "all_rows", "t_end": 1.0})
    assert not index1.is_dense(problem.system)
    return problem.system, find_reference(problem).states


@pytest.mark.sampled(0)
def test_exact_loads_are_those_that_move_the_bodies(grid):
    """Mass times the second difference of the exact positions is weight plus the joints' force on each body."""
    system, states = grid
    force = compute_exact_loads(system, states(INSTANTS))[..., :3]
    weight = system.mass[:, None] * system.gravity
    for h in (2e-4, 1e-4, 5e-5):  # [s]: above, rows between would show; below, rounding of positions over h^2
        before, now, after = (states(INSTANTS + k * h).r for k in (-1, 0, 1))
        measured = system.mass[:, None] * (before - 2.0 * now + after) / h**2 - weight
        assert np.max(np.abs(force - measured)) < 1e-5  # [N] of 22 N


@pytest.mark.parametrize(("contradiction", "bound"), [(0.0, 1e-9), (1e-3, 1e-4)])
def test_sparse_rows_give_what_dense_ones_give(grid, monkeypatch, contradiction, bound):
    """Rates that break redundant rows [rad/s] leave them contradictory right sides: they hardly enter loads."""
    system, states = grid
    s = states(INSTANTS)
    s = replace(s, Omega=s.Omega + contradiction * np.random.default_rng(3).standard_normal(s.Omega.shape))
    sparse = index1.solve_index_1(system, s)
    monkeypatch.setattr(index1, "DENSE", np.inf)
    dense = index1.solve_index_1(system, s)
    assert np.max(np.abs(sparse.load - dense.load)) < bound
    assert np.max(np.abs(sparse.a - dense.a)) < 10.0 * bound


def test_sparse_rows_of_an_instant_do_not_depend_on_the_others(grid, monkeypatch):
    """Matrices of many instants are made at once: each instant gets the same bits as alone."""
    system, states = grid
    s, n = states(INSTANTS), 6 * system.nb
    weight = sparse.random_array((n, n), density=0.01, rng=np.random.default_rng(1))
    together = [list(row) for row in index1._list_sparse_rows(system, s, weight.tocsr())]
    monkeypatch.setattr(index1, "TOGETHER", 1)
    for one, other in zip(together, index1._list_sparse_rows(system, s, weight.tocsr()), strict=True):
        for a, b in zip(one[:2], other[:2], strict=True):
            for k in ("data", "indices", "indptr"):
                assert_same(getattr(a, k), getattr(b, k), what=k)
        assert_same(one[2], other[2])


def test_the_bordered_matrix_is_that_of_scipy():
    """The factor's pivots, and so its bits, follow from the order of the entries: no entry is elsewhere."""
    S = sparse.random_array((7, 12), density=0.3, rng=np.random.default_rng(2)).tocsr()
    borders = [[sparse.eye_array(12), S.T], [S, -1e-14 * sparse.eye_array(7)]]
    expected, found = sparse.block_array(borders, format="csc"), bordered.border_rows(S, S.T.tocsr(), 1e-14)
    for k in ("data", "indices", "indptr"):
        assert_same(getattr(found, k), getattr(expected, k), what=k)


def test_a_known_order_of_unknowns_changes_no_bit():
    """The second factor of a pattern takes the order of the first: solutions are those of a factor that knows none."""
    random = np.random.default_rng(4)
    S = sparse.random_array((40, 90), density=0.06, rng=random).tocsr()
    S.data[:] = random.standard_normal(S.nnz)
    for k in range(3):
        b, regular = random.standard_normal(130), 10.0 ** (-7 * k)
        bordered._recall_pattern.cache_clear()
        fresh = bordered.factor_bordered(S, regular)[1](b)
        St, solve = bordered.factor_bordered(S, regular)
        assert_same(solve(b), fresh)
        assert_same(St.toarray(), S.T.toarray())
        S.data[:] = random.standard_normal(S.nnz)
        fresh = bordered.splu(bordered.border_rows(S, S.T.tocsr(), regular)).solve(b)
        assert_same(bordered.factor_bordered(S, regular)[1](b), fresh, what="other numbers")


def test_motions_together_are_those_of_each():
    """Projection and index 1 of a slow and a fast motion, whose differences have other steps."""
    for name in ("chain", "slider_crank", "heavy_top"):
        problem = make_problem(name)
        one = States.one(problem.initial)
        s = States(*(np.repeat(getattr(one, k), 3, axis=0) for k in ("r", "R", "v", "Omega")), np.arange(3.0))
        fast = States(s.r + 1e-6, s.R, 30.0 * s.v, 30.0 * s.Omega, s.t)
        near = project_poses_of_each(problem.system, [s, fast])
        for x, y in zip(near, (project_poses(problem.system, m) for m in (s, fast)), strict=True):
            assert_same(x.r, y.r)
            assert_same(x.R, y.R)
        found = index1.solve_index_1_of_each(problem.system, near)
        for x, m in zip(found, near, strict=True):
            for a, b in zip(x, index1.solve_index_1(problem.system, m), strict=True):
                assert_same(a, b)
