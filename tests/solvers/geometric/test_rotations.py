"""Rotation matrices stay rotations: rounding of products must not pile up over steps."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.types import Status, StepControl

SOLVERS = (
    "rattle", "lie_variational", "generalized_alpha", "half_explicit", "energy_momentum", "al_index3", "gc_weak_form",
    "gc_augmented_lagrangian", "gc_composed", "gc_extrapolated", "rkmk_dop853", "radau_ggl",
)  # fmt: skip
STEPS = 4000


@pytest.mark.parametrize("name", SOLVERS)
def test_rotations_stay_orthogonal(name):
    """A tumbling body: left alone, R leaves SO(3) by 2e-16 a step, the more the more steps; kept, by rounding alone."""
    problem = make_problem("torque_free_body", {"inertia_factors": (1.0, 1.5, 2.0), "t_end": STEPS * 1e-3})
    solver = make_solver(name)
    control = StepControl(dt=1e-3) if solver.control == "dt" else StepControl(rtol=1e-6, max_step=1e-3)
    if reason := solver.refuses(problem, control):
        pytest.skip(reason)
    run = solver.solve(problem, control)
    assert run.status is Status.SUCCESS and len(run.t) >= STEPS
    assert np.max(so3.orthogonality_defect(run.states.R)) < 8.0 * np.finfo(float).eps


def test_redundant_rows_of_a_turned_loop_stay_closed():
    """Bricard's loop has a redundant row, which nothing closes when R is no rotation: 2e-16 a step open it."""
    problem = make_problem("bricard", {"rotation": (0.3, -0.5, 0.7), "t_end": 4.0})
    run = make_solver("rattle", {"tolerance": 1e-14}).solve(problem, StepControl(dt=2e-3))
    assert run.status is Status.SUCCESS, run.message
