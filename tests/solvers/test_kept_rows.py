"""Redundant rows along a motion: those in use must not become dependent where all rows together do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mbsbench
from mbsbench import Status, StepControl, constraint_jacobian, make_problem
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.lab.fuzz.cases import read_case
from mbsbench.harness.lab.fuzz.oracle import Behaviour
from mbsbench.harness.lab.fuzz.presenting import Form
from mbsbench.harness.mechanics.jacobian import scale_jacobian
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.run.presenting import present_problem
from mbsbench.solvers.formulations import row_wear, rows_in_use
from mbsbench.solvers.formulations.rank import rows_to_keep
from mbsbench.solvers.formulations.row_wear import Sines
from mbsbench.solvers.formulations.start import choose_layout, pack_start
from mbsbench.tests.comparing import assert_each

FOUND = Path(mbsbench.__file__).parent / "results/published/fuzz/cvode-673.json"


def test_in_a_plane_loop_the_rows_kept_at_the_start_stay_independent_while_the_mechanism_moves():
    """Four parallel hinges on tilted axes: rank 17 of 20 rows; a choice by pivots of all rows loses it at 0.168 s."""
    problem = read_case(FOUND).oracle.problem
    system, kept = problem.system, rows_to_keep(problem.system, problem.initial)
    motion = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-9))
    assert len(kept) == 17
    for state in motion.states:
        A = constraint_jacobian(system, state).toarray()
        all_rows, those = (np.linalg.svd(rows, compute_uv=False)[16] for rows in (A, A[kept]))
        assert those > 0.1 * all_rows


@pytest.mark.parametrize(
    "solver", ["cvode", "scipy_strong_form", "ida_index1", "ida_index2", "ndf_index1", "radau_index1"]
)
def test_the_plane_loop_that_the_fuzzer_found_is_solved(solver):
    case = read_case(FOUND)
    assert case.oracle.examine(solver).kind is Behaviour.SOUND


@pytest.mark.parametrize("chart", ["quaternion", "euler313"])
@pytest.mark.parametrize("problem", ["bricard", "andrews"])
def test_the_product_of_the_sines_is_the_volume_of_the_rows(problem, chart):
    """sqrt(det E E^T) of rows E of length one, in whatever order they are taken."""
    problem = Form(0, "fixed", (0.7, -0.4, 1.1)).problem(make_problem(problem))
    layout = choose_layout(problem, chart)[0]
    E = scale_jacobian(problem.system, problem.initial).toarray()[layout.kept]
    volume = np.prod(np.linalg.svd(E, compute_uv=False))
    sines = Sines(layout).compute_sines(pack_start(layout, problem), 0.0)
    assert np.max(sines) <= 1.0 + 1e-12 and np.prod(sines) == pytest.approx(volume, rel=1e-9)


@pytest.mark.parametrize("solver", ["ida_index1", "ndf_index1", "radau_index1"])
@pytest.mark.parametrize("problem", ["bricard", "andrews"])
def test_rows_that_do_not_wear_cost_no_search(problem, solver, monkeypatch):
    """As drawn, the sines of both stay above half of those at the start; a search costs as much as fifty steps."""
    monkeypatch.setattr(row_wear, "find_better_rows", None)
    assert make_solver(solver).solve(make_problem(problem), StepControl(rtol=1e-6)).status is Status.SUCCESS


WATCHED = ("cvode", "rk45_strong_form", "scipy_strong_form", "ida_index1", "ida_index2", "ndf_index1", "radau_index1")


TURNED = [  # each solver in one of two frames, in turn; in the other one it is slow
    pytest.param(rotation, solver, marks=() if k % 2 == j else pytest.mark.slow)
    for j, rotation in enumerate([(0.7, -0.4, 1.1), (-0.3, 2.0, 0.4)])
    for k, solver in enumerate(WATCHED)
]


@pytest.mark.parametrize(("rotation", "solver"), TURNED)
def test_rows_are_changed_where_those_in_use_wear_out(solver, rotation):
    """Bricard's loop, turned: a reaction of the one self-stress crosses zero at 0.636 s, and none is safe for ever."""
    problem, form = make_problem("bricard"), Form(0, "fixed", rotation)
    true = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states[-1]
    errors = []
    for rtol in (1e-6, 1e-8):
        run = form.solve(make_solver(solver), problem, StepControl(rtol=rtol, cpu_limit=10.0))
        assert run.status is Status.SUCCESS
        errors.append(float(np.max(np.abs(run.states[-1].r - true.r))))
    assert errors[1] < 2e-4 and errors[1] < max(0.2 * errors[0], 100.0 * 1e-8)  # the first may pass near 0 by chance


def test_index_3_passes_where_rows_wear_out():
    """Its end converges with the tolerance, more slowly than on index 1."""
    problem, form = make_problem("bricard"), Form(0, "fixed", (0.7, -0.4, 1.1))
    true = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11)).states[-1]
    errors = []
    for rtol in (1e-6, 1e-8):
        run = form.solve(make_solver("ida_index3"), problem, StepControl(rtol=rtol, cpu_limit=10.0))
        assert run.status is Status.SUCCESS and any("rows chosen anew" in note for note in run.notes)
        errors.append(float(np.max(np.abs(run.states[-1].r - true.r))))
    assert errors[1] < 1e-3 and errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize("solver", ["ida_index1", "ida_index2", "ida_index3", "ndf_index1", "radau_index1"])
def test_a_start_on_other_rows_keeps_the_time_of_a_drive(solver, monkeypatch):
    """Begun anew every forty steps, a mechanism whose crank is a function of time ends where it ends without."""
    problem = replace(make_problem("driven_slider_crank", {"t_end": 0.3}), presentation=Presentation(duplicate=1))
    problem = present_problem(problem, StepControl(rtol=1e-8))[0]
    control, ends = StepControl(rtol=1e-8, cpu_limit=20.0), []
    for restarts in (False, True):
        if restarts:
            monkeypatch.setattr(rows_in_use, "RowWear", _WornAfterFortySteps)
        run = make_solver(solver).solve(problem, control)
        assert run.status is Status.SUCCESS and any("anew" in note for note in run.notes) == restarts
        assert_each(np.diff(run.t), ">", 0.0)
        ends.append(run.states[-1])
    size = 1e-3 if solver == "ida_index3" else 1e-5
    assert np.max(np.abs(ends[0].r - ends[1].r)) < size
    assert np.max(np.abs(ends[0].v - ends[1].v)) < 100.0 * size


class _WornAfterFortySteps:
    def __init__(self, layout):
        self.kept, self.steps = layout.kept, 0

    def find_better_rows(self, pu, t, every):
        self.steps += 1
        return self.kept.copy() if self.steps == 40 else None
