"""Costs grow in proportion to the system (docs/library.md); rows are chosen sparsely as by dense algebra."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from mbsbench import Problem, Trajectory, constraint_jacobian, independent_rows, make_problem
from mbsbench.harness.judge.metrics import scales
from mbsbench.harness.judge.metrics.measure import measure
from mbsbench.solvers.formulations.compiled.kernel import allocate_kernel
from mbsbench.solvers.formulations.compiled.saddle_pattern import analyse_saddle
from mbsbench.solvers.formulations.rank import DEPENDENT, INDEPENDENT, rows_to_keep, squared_distances
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.factories import solve_run

from .arbitrary_systems import consistent, linkage

SOLVERS = ("gc_augmented_lagrangian", "rkmk_dopri5", "rattle")
STEP = 1e-3  # [s]


def row_of_cells(windows: int) -> Problem:
    """Three steps, without a reference."""
    made = make_problem("n_four_bar", {"windows": windows, "t_end": 3 * STEP})
    return dataclasses.replace(made, reference_from=None, t_end=3 * STEP)


def steps(name: str, p: Problem) -> Trajectory:
    return solve_run(p, 1e-6 if name == "rkmk_dopri5" else STEP, name)


def test_factors_grow_in_proportion() -> None:
    """Numbers of both factors and of their products, by cell: cells of a row fill in no more than their neighbours."""
    each = []
    for windows in (100, 200, 400):
        k = allocate_kernel(row_of_cells(windows).system)
        _, lu = analyse_saddle(k.body, k.row, k.pair, np.arange(len(k.mass), len(k.pair)))
        numbers = [a.size for part in (lu, k, k.blocks) for a in part if isinstance(a, np.ndarray)]
        each.append(np.array([sum(numbers), len(k.blocks.update), len(lu.low), len(lu.blocks)]) / windows)
    assert_each(np.abs(each[2] / each[0] - 1.0), "<", 0.02, each)


def test_nothing_is_dense() -> None:
    """Problem, rank, analysis, steps, metrics of 1,001 bodies hold less than a byte an entry of rows x velocities."""
    for name in SOLVERS:  # compiled
        steps(name, row_of_cells(2))
    tracemalloc.start()
    p = row_of_cells(500)
    for name in SOLVERS:
        measure(p, steps(name, p))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    entries = p.system.nrows * 6 * p.system.nb
    assert peak < entries, f"{peak / 1e6:.0f} MB"


def test_blocks_cover_all_rows() -> None:
    """Once each, and never more poses at a time than ``STATES``."""
    for nt, nb in ((0, 3), (7, 10**7), (10**6, 55)):
        parts = list(scales.split_into_blocks(nt, nb))
        assert [k for part in parts for k in range(part.start, part.stop)] == list(range(nt))
        assert_each([(part.stop - part.start) * nb for part in parts], "<=", max(scales.STATES, nb), "bodies of a part")


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 3), (5, 5)])
def test_kept_rows_are_as_many_as_the_rank_and_as_well_conditioned(rows, columns):
    """Rank by pivoted QR; the smallest singular value of the kept rows is at least a quarter of that of QR's.

    QR looks for the best row each time, the band takes rows as they come.
    """
    p = make_problem("four_bar_grid", {"rows": rows, "columns": columns, "release": "all_rows"})
    kept, by_qr = rows_to_keep(p.system, p.initial), independent_rows(p.system, p.initial)
    assert len(kept) == len(by_qr) == 6 * p.system.nb - rows
    A = constraint_jacobian(p.system, p.initial).toarray()
    full = linkage(springs=False)
    assert_same(rows_to_keep(full, consistent(full, 3)), np.arange(full.nrows))
    smallest = [np.linalg.svd(A[choice], compute_uv=False)[-1] for choice in (kept, by_qr)]
    assert smallest[0] > 0.25 * smallest[1]


def test_no_pivot_is_in_doubt_on_a_grid_of_820_bodies():
    """6100 rows of rank 4900, found sparsely: one freedom a row of cells."""
    p = make_problem("four_bar_grid", {"rows": 20, "columns": 20})
    distance = squared_distances(p.system, p.initial)
    between = distance[distance > DEPENDENT]
    assert_each(between, ">=", INDEPENDENT, "distance of a row from those before it")
    assert len(rows_to_keep(p.system, p.initial)) == 6 * p.system.nb - 20
