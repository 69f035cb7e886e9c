"""CVODE on the strong form: the same equations as those of the explicit pair, another integrator."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.types import Status, StepControl

from .systems import PROBLEMS


@pytest.mark.parametrize("method", ["Adams", "BDF"])
@pytest.mark.parametrize(("name", "parameters"), [("heavy_top", {"t_end": 0.2}), ("chain", {"t_end": 0.1})])
def test_errors_follow_the_tolerance(method, name, parameters):
    """A hundredth of the tolerance: less than a tenth of the error, as of any method of order 1 or more."""
    problem, errors = make_problem(name, parameters), []
    for rtol in (1e-6, 1e-8):
        t = make_solver("cvode", {"method": method}).solve(problem, StepControl(rtol=rtol))
        assert t.status is Status.SUCCESS, t.message
        errors.append(np.max(np.abs(t.states.r - problem.reference().states(t.t).r)))
    assert errors[1] < 0.1 * errors[0] < 1e-4


def test_springs_dampers_and_loops_are_those_of_the_strong_form():
    """A loop with springs against Runge-Kutta on another formulation; reactions at the start too."""
    problem = PROBLEMS["closed_chain"]()
    ours, theirs = (make_solver(n).solve(problem, StepControl(rtol=1e-10)) for n in ("rkmk_dop853", "cvode"))
    np.testing.assert_allclose(theirs.states.r[-1], ours.states.r[-1], atol=1e-7)
    np.testing.assert_allclose(theirs.reaction[0], ours.reaction[0], rtol=1e-8, atol=1e-8)


def test_limits_stop_it():
    """Steps and time; what was done is kept."""
    problem = make_problem("heavy_top", {"t_end": 5.0})
    t = make_solver("cvode").solve(problem, StepControl(rtol=1e-8, max_steps=3))
    assert t.status is Status.STALLED and len(t.t) == 4
    t = make_solver("cvode").solve(problem, StepControl(rtol=1e-8, max_step=1e-5, cpu_limit=0.2))
    assert t.status is Status.STALLED and len(t.t) > 1 and "CPU limit" in t.message
