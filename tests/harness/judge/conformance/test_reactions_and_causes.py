"""Reactions of solvers from one function, and one line for one cause."""

import re

import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.conformance import problem, solver, trials
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.run.job import Job
from mbsbench.tests.factories import run_here

PAGE = (ROOT / "docs" / "your-own-solver.md").read_text(encoding="utf-8")
MIDPOINT = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)[0]
PROBLEM = (ROOT / "docs" / "examples" / "gyroscope.py").read_text(encoding="utf-8")
RETURN = "    return end, accelerations(system, end).reaction"
LATE = "    return end, accelerations(system, state).reaction"
AXES = """    reaction = accelerations(system, end).reaction
    reaction[system.axis_rows().row] *= -100.0
    return end, reaction"""
HOLES = """    reaction = accelerations(system, end).reaction
    return end, reaction * (float("nan") if 0.011 < state.t < 0.1 else 1.0)"""
ORDER = "errors of reactions fall with the steps, or with rtol"
MOMENTS = "moments of its reactions are those of the exact motion"
COLUMNS = "reactions have one column per constraint row"


@pytest.fixture(autouse=True)
def own_catalogue(monkeypatch):
    """Plugins of one test are none of the next."""
    for known in ("_plugin_files", "_plugin_problems", "_plugin_solvers"):
        monkeypatch.setattr(registry, known, type(getattr(registry, known))())


def judged(text: str, folder, monkeypatch, *roles: str):
    """The findings by name; runs of other ``roles`` are those of the first."""
    path = folder / "midpoint.py"
    path.write_text(text, encoding="utf-8")
    hinge, swept = solver.EASY["easy hinge"]
    monkeypatch.setattr(solver, "EASY", {**solver.EASY, "easy hinge": (hinge, {**swept, "t_end": 0.03})})
    monkeypatch.setattr(solver, "MOVING", {**solver.MOVING, "t_end": 0.3})
    registry.load_plugin(path)
    store.create_folder(folder / "run")
    specs = {role: s for role, s in solver.group_runs("midpoint").items() if role.startswith(roles)}
    records = {role: run_here(Job(spec, folder / "run")) for role, spec in specs.items()}
    series = {role: store.read_run_series(folder / "run", r) for role, r in records.items()}
    evidence = trials.Evidence("dt", 2.0, records, series)
    return {r.name: r.measure(evidence) for r in solver.REQUIREMENTS if r.name in (ORDER, MOMENTS, COLUMNS)}


@pytest.mark.parametrize(("last", "value"), [(RETURN, 2.0), (LATE, 1.0)])
def test_reactions_of_the_step_before_are_of_first_order(last, value, tmp_path, monkeypatch):
    """Late by dt: at the finest step within a twentieth of the largest, so that only their order shows it."""
    found = judged(MIDPOINT.replace(RETURN, last), tmp_path, monkeypatch, "finer", "easy hinge")
    assert found[ORDER].value == pytest.approx(value, abs=0.2) and found[ORDER].holds == (value == 2.0)


@pytest.mark.parametrize(("last", "fails"), [(AXES, MOMENTS), (HOLES, COLUMNS)])
def test_reactions_of_a_step_are_tested_from_the_second_row_on(last, fails, tmp_path, monkeypatch):
    """At the start a step has none, which is no reason to leave its moments untested."""
    found = judged(MIDPOINT.replace(RETURN, last), tmp_path, monkeypatch, "finer", "easy hinge")
    assert not found[fails].holds and found[fails].is_tested
    others = {MOMENTS, COLUMNS} - {fails}
    assert all(found[k].holds for k in others)


def test_one_error_is_one_failure(tmp_path):
    """Fourteen runs that crash alike: one line, a remedy for that, and no requirement is met by them."""
    path = tmp_path / "midpoint.py"
    path.write_text(MIDPOINT.replace("dt / 2", "dt / None"), encoding="utf-8")
    registry.load_plugin(path)
    store.create_folder(tmp_path / "run")
    records = tuple(run_here(Job(s, tmp_path / "run")) for s in solver.group_runs("midpoint").values())
    found = solver.check_solver("midpoint", tmp_path / "run", records)
    (failed,) = [f for f in found if not f.holds]
    assert "TypeError" in failed.words and "midpoint.py:" in failed.words
    assert failed.remedy == trials.CRASHED
    assert not [f for f in found if f.is_tested and f.holds]


def test_runs_that_a_limit_cut_are_not_compared(tmp_path):
    """How many steps fit into a limit is no property of the solver."""
    cut = trials.RunRecord(status="stalled", claimed="stalled", message="the limit was reached", steps=7)
    evidence = trials.Evidence("dt", 2.0, {"finer 1": cut, "again": cut}, {"finer 1": None, "again": None})
    assert not trials.check_repeatability(evidence).is_tested


def test_a_problem_that_cannot_be_made_is_said_once(tmp_path):
    """With file, line and the joint's name."""
    path = tmp_path / "gyroscope.py"
    changed = PROBLEM.replace("[Joint(0,", "[Joint(7,")
    assert changed != PROBLEM
    path.write_text(changed, encoding="utf-8")
    registry.load_plugin(path)
    (name,) = [n for n in registry.problems() if not registry.is_own_problem(n)]
    found = problem.check_problem(name, (str(path),))
    failed = [f for f in found if not f.holds]
    assert len(failed) == 1 and re.search(r"joint 'O': .*\(gyroscope.py:\d+\)", failed[0].words)
    assert not [f for f in found if f.is_tested and f.holds]


def test_a_start_says_rows_rank_and_degrees_of_freedom():
    """A spherical joint leaves three of six; Bricard's linkage has a redundant row."""
    assert "3 rows of rank 3: 3 degrees of freedom" in laws_of_start("heavy_top")
    found = re.match(r"(\d+) rows of rank (\d+): (\d+) degrees of freedom", laws_of_start("bricard"))
    rows, rank, free = map(int, found.groups())
    assert rank < rows and free == 1


def laws_of_start(name: str) -> str:
    from mbsbench.harness.judge.conformance.laws import Subject, check_initial_state

    return check_initial_state(Subject(name)).words
