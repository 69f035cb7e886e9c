"""Systems without joints: no row, no multiplier, nothing to factorise."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import engines, make_problem, make_solver, solvers
from mbsbench.harness.types import Status, StepControl


@pytest.mark.parametrize("name", [n for n in solvers() if n not in engines()])
def test_a_thrown_brick_needs_no_joint(name: str) -> None:
    """Every solver follows it for ten steps, and has reactions of no row."""
    p = make_problem("free_body", {"t_end": 0.1})
    solver = make_solver(name)
    control = StepControl(dt=1e-2) if solver.control == "dt" else StepControl(rtol=1e-8)
    out = solver.solve(p, control)
    assert out.status == Status.SUCCESS, out.message
    assert np.max(np.abs(out.states.r[-1] - p.reference().states(out.t[-1:]).r[0])) < 1e-6
    assert out.reaction is None or out.reaction.shape == (len(out.t), 0)
