"""Engines beside our solver: in turns, in one process, and without an engine the command says so."""

import importlib.util
import json
import sys

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.registry import engines, make_problem, make_solver
from mbsbench.harness.races.in_turns import race
from mbsbench.harness.types import StepControl


def test_without_an_engine_one_line_and_exit_code_2(monkeypatch, capsys):
    """An optional extra that is missing is a wrong call, with the remedy."""
    monkeypatch.setitem(sys.modules, "exudyn", None)
    assert main(["peers", "heavy_top", "--problem-set", "t_end=0.01", "--solver", "rattle", "--engine", "exudyn"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install 'mbsbench[engines]'" in said


@pytest.mark.parametrize("asked", ["exudin", "exudyn:spectral_radius=2", "exudyn:integrator"])
def test_a_wrong_engine_is_one_line_and_exit_code_2(asked, capsys):
    """Before anything runs, with what is known."""
    assert main(["peers", "heavy_top", "--engine", asked]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.skipif(importlib.util.find_spec("exudyn") is None, reason="exudyn is an optional extra: make test-engines")
def test_an_engine_is_raced(capsys):
    """CPU of the engine over ours, with what each left of the laws."""
    asked = ["--solver", "rattle", "--engine", "exudyn:integrator=GeneralizedAlpha", "--repeats", "2", "--json"]
    assert main(["peers", "heavy_top", "--problem-set", "t_end=0.1", *asked]) == 0
    results = json.loads(capsys.readouterr().out)["results"]
    assert [r["name"] for r in results] == ["rattle", "exudyn[integrator=GeneralizedAlpha]"]
    ours, theirs = (r["cpu_median_s"] for r in results)
    assert results[1]["ratio"] == (theirs / ours if ours else None)  # the process clock may have ticks of 10 ms
    assert all(r["position_error_m"] < 1e-3 for r in results)


def test_turns_are_taken_and_a_slow_one_is_not_repeated():
    """A B A B, each timed ``repeats`` times unless its CPU time would pass the budget."""
    problem, control, order = make_problem("heavy_top", {"t_end": 0.01}), StepControl(dt=1e-3), []

    class Counted:
        def __init__(self, name):
            self.name = name

        def solve(self, problem, control):
            order.append(self.name)
            return make_solver("rattle").solve(problem, control)

    results = race(problem, control, {n: Counted(n) for n in "AB"}, 3, budget=60.0)
    assert order == ["A", "B"] * 4  # one to warm
    assert [len(r.cpu_s) for r in results] == [3, 3]
    assert [len(r.cpu_s) for r in race(problem, control, {"A": Counted("A")}, 3, budget=-1.0)] == [1]


def test_engines_are_solvers_of_the_catalogue():
    """One file each."""
    assert {"mujoco", "exudyn"} <= set(engines())
