"""Exudyn as a contestant: redundant rows left out or kept."""

import importlib.util

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.types import Status, StepControl

from .systems import PROBLEMS

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("exudyn") is None, reason="exudyn is an optional extra: make test-engines"
)


def test_rows_left_out_still_hold():
    """Of the grid's 70 rows 58 are stated; the others follow from them. Kept, they give the same motion."""
    problem, ends = PROBLEMS["grid"](), []
    for rows, words in (("drop", "58 of 70 constraint rows"), ("keep", "70 of 70 constraint rows")):
        t = make_solver("exudyn", {"redundant_rows": rows}).solve(problem, StepControl(dt=5e-3))
        assert t.status is Status.SUCCESS, t.message
        assert t.notes[0] == words
        assert np.max(np.abs(constraint(problem.system, t.states))) < 1e-3
        ends.append(t.states.r[-1])
    np.testing.assert_allclose(*ends, atol=1e-4)


def test_a_singular_chart_is_refused_in_words():
    """Kept rows need Tait-Bryan angles; bars along X put them at their singularity."""
    problem = make_problem("four_bar_grid", {"rows": 1, "columns": 1})
    said = make_solver("exudyn", {"redundant_rows": "keep"}).refuses(problem, StepControl(dt=1e-2))
    assert said is not None and said.startswith("Tait-Bryan angles are singular at the start of v1,0")


@pytest.mark.parametrize("options", [{}, {"spectral_radius": 0.5}])
def test_generalised_alpha_is_of_second_order(options):
    """The last of two halvings on a spinning top."""
    problem, errors = make_problem("heavy_top", {"t_end": 0.2}), []
    for dt in (1e-3, 5e-4, 2.5e-4):
        solver = make_solver("exudyn", {"integrator": "GeneralizedAlpha", **options})
        t = solver.solve(problem, StepControl(dt=dt))
        assert t.status is Status.SUCCESS, t.message
        errors.append(np.max(np.abs(t.states.r - problem.reference().states(t.t).r)))
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(2.0, abs=0.25)
