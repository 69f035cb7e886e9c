"""False verdicts are found in both directions, nothing else is called false, and contradictory records are found."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from mbsbench import StepControl
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.mechanics.types import Law, Reason, Status
from mbsbench.harness.results.records import RunRecord, format_reasons
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.exam import falsified, misleading
from mbsbench.tests.exam.__main__ import PLUGINS, SUITE, print_counts
from mbsbench.tests.exam.building import DECLARED
from mbsbench.tests.exam.judging import Finding, Sizes, errors, judge_run
from mbsbench.tests.exam.motion import integrate
from mbsbench.tests.factories import make_record


@pytest.fixture(scope="module")
def bennett():
    for plugin in PLUGINS:
        registry.load_plugin(plugin)
    problem = registry.make_problem("exam_bennett")
    return problem, Sizes(integrate(DECLARED["exam_bennett"]), DECLARED["exam_bennett"])


def told(bennett, status, change=None, judged_to=3.0):
    problem, sizes = bennett
    t = np.linspace(0.0, problem.t_end, 301)
    s = falsified.exact(sizes, t)
    r = s.r + (0.0 if change is None else change(t)[:, None, None] * np.array([0.0, 0.0, sizes.reach]))
    arrays = {"state_t": t, "state_r": r, "state_R": s.R, "state_v": s.v, "state_Omega": s.Omega}
    record = RunRecord(case="a run", status=status, judged_to_s=judged_to)
    return judge_run(sizes, problem, record, SimpleNamespace(arrays=arrays))


def test_a_right_motion_that_is_called_wrong_is_a_false_alarm(bennett):
    assert told(bennett, Status.SUCCESS).fault == ""
    assert told(bennett, Status.WRONG).fault == told(bennett, Status.INACCURATE).fault == "false alarm"
    assert told(bennett, Status.WRONG, lambda t: 0.02 * t).fault == ""


def test_a_success_that_is_far_off_is_false_as_far_as_it_was_compared(bennett):
    late = np.vectorize(lambda t: 0.0 if t < 2.0 else 0.2)
    assert told(bennett, Status.SUCCESS, late).fault == "false success"
    assert told(bennett, Status.SUCCESS, late, judged_to=1.9).fault == ""
    assert told(bennett, Status.SUCCESS, lambda t: 1e-3 * t).fault == ""


@pytest.mark.sampled(0)
def test_energy_beside_the_true_one_decides_where_energy_is_kept_alone(bennett):
    """A driven motion that is late by a hundredth of its size has the energy of another instant; a free one has not."""
    problem, sizes = bennett
    assert sizes.keeps_energy
    t = np.linspace(0.0, problem.t_end, 301)
    s = falsified.exact(sizes, t)
    arrays = {"state_t": t, "state_r": s.r, "state_R": s.R, "state_v": 1.2 * s.v, "state_Omega": 1.2 * s.Omega}
    faster = RunRecord(case="a run", status=Status.SUCCESS, judged_to_s=3.0)
    assert judge_run(sizes, problem, faster, SimpleNamespace(arrays=arrays)).fault == "false success"
    registry.make_problem("exam_driven_four_bar")  # declares it
    driven = Sizes(integrate(DECLARED["exam_driven_four_bar"]), DECLARED["exam_driven_four_bar"])
    assert not driven.keeps_energy


def test_loads_of_a_drive_are_read_at_their_time(bennett):
    """Hinges and a drive of a loop with no freedom: forces and moments of an accurate solver are those of the truth."""
    problem = registry.make_problem("exam_driven_four_bar")
    d = dataclasses.replace(DECLARED["exam_driven_four_bar"], t_end=0.5)
    run = make_solver("rkmk_dop853").solve(dataclasses.replace(problem, t_end=0.5), StepControl(rtol=1e-9))
    found = errors(Sizes(integrate(d), d), problem, run.t, run.states, run.reaction)
    assert_each(list(found.values()), "<", 1e-6, f"shares of {list(found)}")


@pytest.mark.sampled(0)
def test_falsified_motions_of_a_loop_with_redundant_rows_are_caught(bennett, monkeypatch):
    problem, sizes = bennett
    found = falsified.falsify(sizes, problem)
    assert found.pop("exact") == "right" and set(found.values()) == {"caught"} and len(found) == 8
    monkeypatch.setattr(falsified, "is_accused", lambda *motion: [])
    assert set(falsified.falsify(sizes, problem).values()) == {"right", "missed"}


def test_the_sweep_has_every_solver_at_two_settings():
    specs = load_suite(str(SUITE)).specs
    problems = {s.problem for s in specs}
    own = {name for name in registry.solvers() if registry.is_own_solver(name)} - set(registry.engines()) - {"cvode"}
    assert len(problems) == 16 and {s.solver for s in specs} == own
    assert len(specs) == 2 * len(problems) * len(own)


def make_right(**columns):
    """The record of a run of which nothing is wrong."""
    known = {
        "length_scale_m": 1.0,
        "speed_scale_m_per_s": 1.0,
        "reaction_size_N": 1.0,
        "motion_error_judged_m": 1e-5,
        "rate_error_judged_m_per_s": 1e-5,
        "reaction_error_max_N": 1e-3,
        "reference_own_error_judged_m": 1e-9,
        "t_end_s": 1.0,
        "judged_to_s": 1.0,
        "case": "a run",
        "status": Status.SUCCESS,
    }
    return make_record(**(known | columns))


def test_records_that_contradict_themselves():
    """Wrong by rates and right by comparison; a success that is far off: each way only then."""
    rates, energy = (format_reasons([Reason(law)]) for law in (Law.TRUNCATION, Law.ENERGY))
    wrong = make_right(status=Status.WRONG, wrong_because=rates)
    assert misleading.is_accused(wrong)
    for other in (
        make_right(),
        make_right(status=Status.WRONG, wrong_because=energy),
        dataclasses.replace(wrong, judged_to_s=0.5),
        dataclasses.replace(wrong, reaction_error_max_N=0.02),
        dataclasses.replace(wrong, motion_error_judged_m=0.02),
    ):
        assert not misleading.is_accused(other)
    assert misleading.is_believed(make_right(motion_error_judged_m=0.11))
    assert misleading.is_believed(make_right(rate_error_judged_m_per_s=1.1))
    assert not misleading.is_believed(make_right(motion_error_judged_m=0.09)) and not misleading.is_believed(wrong)


def test_counts_are_a_table_with_a_row_for_each_mechanism(capsys):
    found = {
        "a": [Finding("a rattle", "wrong", {}, "false alarm"), Finding("a radau_ggl", "success", {})],
        "b": [Finding("b rattle", "success", {}, "false success")],
    }
    told = {
        "a": {"exact": "right", "frozen": "caught", "sinking": "missed"},
        "b": {"exact": "false alarm: end", "frozen": "caught", "transposed R": "no other motion"},
    }
    print_counts(found, told)
    assert capsys.readouterr().out.splitlines()[3:] == [
        "| a | 2 | 1 | 0 | 1 of 2 | yes |",
        "| b | 1 | 0 | 1 | 1 of 1 | no |",
        "| all | 3 | 1 | 1 | 2 of 3 | 1 of 2 |",
    ]
