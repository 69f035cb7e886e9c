"""Loops in Exudyn, Pinocchio and CVODE: redundant rows left out or kept, gaps closed by a corrector, springs."""

import dataclasses
import importlib.util

import numpy as np
import pytest

from mbsbench import Status, StepControl, constraint
from mbsbench.harness.catalogue.registry import make_problem, make_solver

from .systems import PROBLEMS

exudyn = pytest.mark.skipif(
    importlib.util.find_spec("exudyn") is None, reason="exudyn is an optional extra: make test-engines"
)
pinocchio = pytest.mark.skipif(
    importlib.util.find_spec("pinocchio") is None, reason="pin is an optional extra: make test-engines"
)


@exudyn
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


@exudyn
def test_a_singular_chart_is_refused_in_words():
    """Kept rows need Tait-Bryan angles; bars along X put them at their singularity."""
    problem = make_problem("four_bar_grid", {"rows": 1, "columns": 1})
    said = make_solver("exudyn", {"redundant_rows": "keep"}).refuses(problem, StepControl(dt=1e-2))
    assert said is not None and said.startswith("Tait-Bryan angles are singular at the start of v1,0")


@pinocchio
def test_gain_closes_the_gaps():
    """Cut joints hold through accelerations: errors open them as time goes on, unless the corrector is on."""
    problem, gaps = dataclasses.replace(PROBLEMS["slider_crank"](), t_end=4.0), {}
    for gain in (0.0, 10.0):
        t = make_solver("pinocchio", {"gain": gain}).solve(problem, StepControl(dt=1e-2))
        assert t.status is Status.SUCCESS, t.message
        gaps[gain] = np.max(np.abs(constraint(problem.system, t.states)))
    assert gaps[10.0] < 0.1 * gaps[0.0]


def test_a_loop_with_springs_is_that_of_the_strong_form_in_cvode():
    """A loop with springs against Runge-Kutta on another formulation; reactions at the start too."""
    problem = PROBLEMS["closed_chain"]()
    ours, theirs = (make_solver(n).solve(problem, StepControl(rtol=1e-10)) for n in ("rkmk_dop853", "cvode"))
    np.testing.assert_allclose(theirs.states.r[-1], ours.states.r[-1], atol=1e-7)
    np.testing.assert_allclose(theirs.reaction[0], ours.reaction[0], rtol=1e-8, atol=1e-8)
