"""An iteration without gyroscopic torques says from which step on it converges, and then does."""

import re

import pytest

from mbsbench import Status, StepControl
from mbsbench.harness.catalogue import registry


@pytest.mark.parametrize("least", [1e-4, 1e-6])
@pytest.mark.parametrize("composition", ["suzuki4", "kahan_li6", "kahan_li8", "plain"])
def test_a_slender_body_ends_with_the_step_that_it_needs_and_turns_with_that(least, composition):
    problem = registry.make_problem("torque_free_body", {"inertia_factors": (least, 1.0, 1.0), "t_end": 0.02})
    solver = registry.make_solver("gc_composed", {"composition": composition})
    long = solver.solve(problem, StepControl(dt=0.02))
    found = re.search(r"slender bodies: take gc_weak_form, or dt below (\S+) s", long.message)
    assert long.status is Status.STEP_UNDERFLOW and found, long.message
    short = solver.solve(problem, StepControl(dt=0.95 * float(found[1])))
    assert short.status is Status.SUCCESS, short.message
