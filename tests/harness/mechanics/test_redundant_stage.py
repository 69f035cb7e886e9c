"""Accelerations of a system where rows are redundant."""

import numpy as np
import pytest

import mbsbench
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.dynamics import accelerations, equations, moved


@pytest.mark.parametrize("accelerations", [accelerations, mbsbench.accelerations], ids=["numpy", "public"])
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
@pytest.mark.parametrize("accelerations", [accelerations, mbsbench.accelerations], ids=["numpy", "public"])
def test_rows_of_small_or_heavy_bodies_are_no_redundant_ones(drawn, accelerations):
    """A a + A_dot v = 0 in every row, whatever the sizes and masses: none is taken for redundant."""
    problem = make_problem("random_mechanism", drawn)
    e, rates = equations(problem.system, problem.initial), accelerations(problem.system, problem.initial)
    a = np.concatenate((rates.v_dot, rates.Omega_dot), axis=1).ravel()
    assert np.max(np.abs(e.A @ a + e.A_dot_v)) < 1e-9 * np.max(np.abs(a))
