"""What grows with the system grows in proportion: four-bar cells in a row, up to 8,001 bodies (docs/library.md)."""

import dataclasses
import tracemalloc

import numpy as np

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.metrics import scales
from mbsbench.harness.metrics.measure import measure
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.compiled.kernel import empty_kernel
from mbsbench.solvers.formulations.compiled.saddle_pattern import analyse

SOLVERS = ("gc_augmented_lagrangian", "rkmk_dopri5", "rattle")
STEP = 1e-3  # [s]


def row_of_cells(windows: int) -> Problem:
    """Three steps, without a reference."""
    made = make_problem("n_four_bar", {"windows": windows, "t_end": 3 * STEP})
    return dataclasses.replace(made, reference_from=None, t_end=3 * STEP)


def steps(name: str, p: Problem) -> Trajectory:
    control = StepControl(rtol=1e-6) if name == "rkmk_dopri5" else StepControl(dt=STEP)
    out = make_solver(name).solve(p, control)
    assert out.status == Status.SUCCESS, out.message
    return out


def test_factors_grow_in_proportion() -> None:
    """Numbers of both factors and of their products, by cell: cells of a row fill in no more than their neighbours."""
    each = []
    for windows in (100, 200, 400):
        k, _ = empty_kernel(row_of_cells(windows).system)
        _, lu = analyse(k.body, k.row, k.pair, np.arange(len(k.mass), len(k.pair)))
        numbers = [a.size for part in (lu, k, k.blocks) for a in part if isinstance(a, np.ndarray)]
        each.append(np.array([sum(numbers), len(k.blocks.update), len(lu.low), len(lu.blocks)]) / windows)
    assert np.all(np.abs(each[2] / each[0] - 1.0) < 0.02), each


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
        parts = list(scales.blocks(nt, nb))
        assert [k for part in parts for k in range(part.start, part.stop)] == list(range(nt))
        assert all((part.stop - part.start) * nb <= max(scales.STATES, nb) for part in parts)
