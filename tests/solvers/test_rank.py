"""The sparse choice of independent rows against dense linear algebra."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.jacobian import constraint_jacobian, independent_rows
from mbsbench.solvers.formulations.rank import DEPENDENT, INDEPENDENT, rows_to_keep, squared_distances

from .arbitrary_systems import consistent, linkage


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 3), (5, 5)])
def test_kept_rows_are_as_many_as_the_rank_and_as_well_conditioned(rows, columns):
    """Rank by pivoted QR; the smallest singular value of the kept rows is at least a quarter of that of QR's.

    QR looks for the best row each time, the band takes rows as they come.
    """
    p = make_problem("four_bar_grid", {"rows": rows, "columns": columns, "release": "all_rows"})
    kept, by_qr = rows_to_keep(p.system, p.initial), independent_rows(p.system, p.initial)
    assert len(kept) == len(by_qr) == 6 * p.system.nb - rows
    A = constraint_jacobian(p.system, p.initial).toarray()
    smallest = [np.linalg.svd(A[choice], compute_uv=False)[-1] for choice in (kept, by_qr)]
    assert smallest[0] > 0.25 * smallest[1]


def test_no_pivot_is_in_doubt_on_a_grid_of_820_bodies():
    """6100 rows of rank 4900, found sparsely: one freedom a row of cells."""
    p = make_problem("four_bar_grid", {"rows": 20, "columns": 20})
    distance = squared_distances(p.system, p.initial)
    assert not np.any((distance > DEPENDENT) & (distance < INDEPENDENT))
    assert len(rows_to_keep(p.system, p.initial)) == 6 * p.system.nb - 20


def test_a_system_of_full_rank_keeps_every_row():
    """Joints without redundancy lose nothing."""
    system = linkage(springs=False)
    assert np.array_equal(rows_to_keep(system, consistent(system, 3)), np.arange(system.nrows))
