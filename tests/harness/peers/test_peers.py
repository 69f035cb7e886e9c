"""The comparison with another engine: its model is our system, and without the engine the command says so."""

import importlib.util
import sys

import numpy as np
import pytest

from mbsbench.harness.__main__ import main
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.peers import exudyn_engine
from mbsbench.harness.peers.race import Runner, race
from mbsbench.harness.types import Status, StepControl

needs_exudyn = pytest.mark.skipif(importlib.util.find_spec("exudyn") is None, reason="exudyn is an optional extra")


def test_without_the_engine_one_line_and_exit_code_2(monkeypatch, capsys):
    """An optional extra that is missing is a wrong call, with the remedy."""
    monkeypatch.setitem(sys.modules, "exudyn", None)
    assert main(["peers"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "requirements-engines.lock" in said


@needs_exudyn
@pytest.mark.parametrize(
    ("name", "parameters", "dt", "allowed"),
    [
        ("spherical_pendulum", {"omega_z": 3.0, "t_end": 1.0}, 2e-3, 1e-3),
        ("heavy_top", {"t_end": 0.2}, 1e-3, 1e-3),
        ("chain", {"t_end": 0.4}, 1e-3, 1e-4),
    ],
)
def test_engine_moves_like_the_exact_motion(name, parameters, dt, allowed):
    """The same bodies, joints, gravity and start: its second-order steps stay within C dt^2 of the reference."""
    problem = make_problem(name, parameters)
    t = exudyn_engine.solve(problem, dt, exudyn_engine.INDEPENDENT, record=True)
    reference = problem.reference()
    assert t.status is Status.SUCCESS, t.message
    assert reference is not None
    assert np.max(np.abs(t.states.r - reference.states(t.t).r)) < allowed


@needs_exudyn
def test_rows_left_out_still_hold():
    """Of the grid's 400 rows 325 are stated; the 75 others follow from them."""
    problem = make_problem("four_bar_grid", {"t_end": 0.2})
    t = exudyn_engine.solve(problem, 1e-2, exudyn_engine.DROPPED, record=True)
    assert t.status is Status.SUCCESS, t.message
    assert t.notes == ("325 of 400 rows",)
    assert np.max(np.abs(constraint(problem.system, t.states))) < 1e-3


@needs_exudyn
def test_step_that_does_not_divide_the_time_is_refused():
    """The engine would take another step than ours."""
    with pytest.raises(ValueError, match="whole number of steps"):
        exudyn_engine.solve(make_problem("heavy_top", {"t_end": 1.0}), 0.3, exudyn_engine.INDEPENDENT, record=False)


def test_turns_are_taken_and_a_slow_one_is_not_repeated():
    """A B A B, each timed ``repeats`` times unless its CPU time would pass the budget."""
    problem, control, order = make_problem("heavy_top", {"t_end": 0.01}), StepControl(dt=1e-3), []

    def runner(name: str) -> Runner:
        def solve():
            order.append(name)
            return make_solver("gc_weak_form").solve(problem, control)

        return Runner(name, solve, solve, None)

    results = race(problem, [runner("A"), runner("B")], 3, budget=60.0)
    assert order == ["A", "B"] * 4  # one to warm
    assert [len(r.cpu_s) for r in results] == [3, 3]
    assert [len(r.cpu_s) for r in race(problem, [runner("A")], 3, budget=-1.0)] == [1]
