"""An iteration without the slopes of springs says from which step on it converges, and then does."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbsbench import Joint, RigidBody, SpringDamper, State, Status, StepControl, assemble
from mbsbench.harness.catalogue import registry
from mbsbench.solvers.formulations.methods.stiff_springs import compute_fastest_rate

EXAM = Path(__file__).parents[2] / "exam" / "own_mechanisms.py"


def state(*r: tuple[float, float, float]) -> State:
    return State(np.array(r), np.tile(np.eye(3), (len(r), 1, 1)), np.zeros((len(r), 3)), np.zeros((len(r), 3)))


def test_rates_of_a_spring_and_of_a_damper_are_those_of_their_formulas():
    """On a free body sqrt(k/m) and c/m; on a bar at a hinge, across it at its end, sqrt(k a^2 / J_O)."""
    body = RigidBody(2.0, np.diag([0.1, 0.2, 0.3]))
    free = assemble([body], [], (0.0, 0.0, 0.0), [SpringDamper(0, (0, 0, 0), -1, (0, 0, 0), 800.0, 1.0, 1e-3)])
    assert compute_fastest_rate(free, state((1.0, 0.0, 0.0))) == pytest.approx(20.0, rel=1e-4)
    damped = assemble([body], [], (0.0, 0.0, 0.0), [SpringDamper(0, (0, 0, 0), -1, (0, 0, 0), 1.0, 1.0, 600.0)])
    assert compute_fastest_rate(damped, state((1.0, 0.0, 0.0))) == pytest.approx(300.0, rel=1e-4)
    hinge = Joint(0, (-0.5, 0.0, 0.0), -1, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    across = SpringDamper(0, (0.5, 0.0, 0.0), -1, (1.0, 3.0, 0.0), 1e4, 3.0)
    bar = assemble([body], [hinge], (0.0, 0.0, 0.0), [across])
    assert compute_fastest_rate(bar, state((0.5, 0.0, 0.0))) == pytest.approx(
        np.sqrt(1e4 / (0.3 + 2.0 * 0.25)), rel=1e-4
    )


@pytest.mark.parametrize("name", ["generalized_alpha", "al_index3", "energy_momentum", "rattle", "lie_variational"])
def test_a_stiff_linkage_ends_with_the_step_that_it_needs_and_moves_with_that(name):
    registry.load_plugin(EXAM)
    problem = replace(registry.make_problem("exam_stiff_five_bar"), t_end=0.02)
    solver = registry.make_solver(name)
    long = solver.solve(problem, StepControl(dt=5e-4))
    found = re.search(r"its matrix leaves out springs and dampers: take dt below (\S+) s", long.message)
    assert long.status is Status.STEP_UNDERFLOW and found
    short = solver.solve(problem, StepControl(dt=0.95 * float(found[1])))
    assert short.status is Status.SUCCESS, short.message
