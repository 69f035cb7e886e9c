"""Singular poses passed are noted, at the time of the closed form; regular motions have no such note."""

import json

import numpy as np
import pytest

from mbsbench import StepControl, solve
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.judge.metrics.passages import find_passage_times, list_passages
from mbsbench.harness.results.words import describe_status
from mbsbench.tests.comparing import assert_each

from ....solvers.singular_linkages import LINKAGES, folding_crank, parallel_bars
from ....solvers.turning_loops import bennett, skew_crank_rocker

REGULAR = ("andrews", "bricard", "slider_crank", "driven_slider_crank", "chain", "stewart_platform", "cart_pendulum")


def crossings(problem, out) -> np.ndarray:
    """Times at which the first bar is in line with the ground, or of a folding crank across it."""
    angle = np.unwrap(np.arctan2(out.states.R[:, 0, 1, 0], out.states.R[:, 0, 0, 0]))
    level = angle / np.pi - (0.5 if "folding" in problem.name else 0.0)
    k = np.flatnonzero(np.diff(np.floor(level)))
    share = np.where(level[k + 1] > level[k], np.ceil(level[k]), np.floor(level[k])) - level[k]
    return out.t[k] + share / (level[k + 1] - level[k]) * np.diff(out.t)[k]


@pytest.mark.parametrize("of", LINKAGES, ids=lambda of: of.problem.name)
def test_each_flat_pose_is_found_at_the_time_of_the_angle(of):
    out = make_solver("half_explicit").solve(of.problem, StepControl(dt=1e-3))
    found, true = np.array(find_passage_times(of.problem.system, out.t, out.states)), crossings(of.problem, out)
    inside = true[(true > 0.05) & (true < of.problem.t_end - 0.05)]  # at either end no rows lie behind them
    assert len(inside) > 2
    assert_each(np.min(np.abs(inside[:, None] - found), axis=1), "<", 1e-4)
    assert_each(np.min(np.abs(found[:, None] - true), axis=1), "<", 1e-4)


@pytest.mark.sampled(0)
@pytest.mark.parametrize(
    "of", [parallel_bars(1.0, [0.25], -3.0), folding_crank(0.4, 8.0)], ids=lambda of: of.problem.name
)
def test_the_note_stands_beside_the_status(of):
    run = solve(of.problem, "half_explicit", t_end=0.6)
    note = [n for n in json.loads(run.record.notes) if n.startswith("passes a singular pose at t = ")]
    assert len(note) == 1 and note[0].endswith("where branches meet: its motion after that is one of several")
    assert "passes a singular pose at t = " in describe_status(run.record)


@pytest.mark.parametrize("solver", ["rkmk_dop853", "half_explicit"])
@pytest.mark.parametrize("name", REGULAR)
def test_regular_motions_of_the_catalogue_have_no_note(name, solver):
    problem = make_problem(name, {"t_end": 1.0} if name == "chain" else None)
    step = StepControl(rtol=1e-6) if solver == "rkmk_dop853" else StepControl(dt=problem.t_end / 1000)
    out = make_solver(solver).solve(problem, step)
    assert list_passages(problem.system, out.t, out.states) == []


@pytest.mark.parametrize("loop", [bennett(), skew_crank_rocker()], ids=["bennett", "crank and rocker"])
def test_turning_loops_that_keep_their_rank_have_no_note(loop):
    problem = loop.problem("loop", turns=3.0)
    for parts in (60, 600, 6000):
        t = np.linspace(0.0, problem.t_end, parts)
        out = make_solver("lie_variational").solve(problem, StepControl(dt=float(t[1])))
        assert find_passage_times(problem.system, out.t, out.states) == []
