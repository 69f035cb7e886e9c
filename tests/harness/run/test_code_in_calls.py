"""On empty caches, what a call of a solver makes or loads is metered, and is in none of its times.

What is made is told by the compilers themselves (LLVM for all machine code, CasADi for expressions) and by Python for
what it imports, not by the meter that is tested.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench import StepControl, solvers
from mbsbench.harness.base.code_meter import code_seconds_of_tree
from mbsbench.harness.catalogue import registry
from mbsbench.harness.run import worker

CLOCK = 0.03  # [s] by which sums of clock readings of a call may differ: refuses, call and checks are read apart
MODULE = "mbsbench.tests.harness.run.cold_calls"
OURS = sorted(path.stem for path in Path(solvers.__file__).parent.glob("[!_]*.py"))  # not engines
SECOND_ROUTES = (
    "gc_weak_form:chain:1:0.01",  # steps that the simplified method does not solve: the full one takes over
    "gauss_joint:heavy_top:1!",
    "dop853_joint:spherical_pendulum:0.1!",  # other pivots
)


def calls_in_cold_process(folder, *chosen):
    """The calls of a process that keeps its code in the empty ``folder``."""
    done = subprocess.run(
        (sys.executable, "-m", MODULE, *chosen),
        env={**os.environ, "MBSBENCH_CACHE": str(folder)},
        text=True,
        stdout=subprocess.PIPE,
        check=True,
    )
    return [json.loads(line) for line in done.stdout.splitlines()]


def check_call(call):
    """Nothing is made in the open; times are those of all else."""
    words = f"{call['solver']} on {call['problem']} {call['options']}"
    assert not call["unmetered"], f"{words}: {call['unmetered']}"
    assert call["status"] != "stalled", f"{words}: code counts towards the limit on CPU time"
    if call["status"] == "refused":
        return
    cost = call["cost"]
    assert cost["code_s"] == pytest.approx(call["made"], abs=CLOCK), words
    assert cost["setup_s"] >= cost["code_s"], words
    assert cost["cpu_min_s"] <= cost["cpu_call_s"] <= call["spent"] - call["made"] + CLOCK, words
    assert call["own"] <= cost["cpu_call_s"] + CLOCK, f"{words}: the solver's own clock counts code"
    assert cost["cpu_refuses_s"] <= call["spent"] - call["made"] + CLOCK, words


@pytest.fixture(scope="module")
def calls(tmp_path_factory):
    """Of each solver on the top, with all options of the suites, and of second routes."""
    chosen = [f"{name}:heavy_top" for name in OURS if name != "scipy_strong_form"] + ["scipy_strong_form"]
    return calls_in_cold_process(tmp_path_factory.mktemp("cold"), *chosen, *SECOND_ROUTES)


SOME = ("rattle", "ida_index1")  # a method of our kernel, and one whose equations CasADi writes


@pytest.fixture(scope="module")
def few_calls(tmp_path_factory):
    """Of a solver of each road to code, and of a second route on the third road, code in joint coordinates."""
    return calls_in_cold_process(
        tmp_path_factory.mktemp("cold"), *(f"{name}:heavy_top" for name in SOME), *SECOND_ROUTES[-1:]
    )


def check_solver(calls, solver):
    """A solver has calls, some reach their end, and none makes code in the open."""
    own = [call for call in calls if call["solver"] == solver]
    assert own and any(call["status"] == "success" for call in own)
    for call in own:
        check_call(call)


@pytest.mark.sampled(0)
@pytest.mark.parametrize("solver", SOME)
def test_no_code_is_made_in_the_time_of_some_solvers(few_calls, solver):
    """Of one that is compiled here and one of SUNDIALS, with every option of the suites."""
    check_solver(few_calls, solver)


def test_other_pivots_make_code_on_the_way(few_calls):
    """Code at other pivots is metered where it is entered."""
    (call,) = (call for call in few_calls if call["t_end"])
    assert sum("pivots chosen anew" in note for note in call["notes"]) == 1
    check_call(call)


@pytest.mark.slow
@pytest.mark.parametrize("solver", OURS)
def test_no_code_is_made_in_the_time_of_a_solver(calls, solver):
    """Of every solver, with every option of the suites."""
    check_solver(calls, solver)


@pytest.mark.slow
def test_second_routes_make_code_on_the_way(calls):
    """A full Newton method behind the simplified one, code at other pivots: metered where they are entered."""
    of_routes = [call for call in calls if call["t_end"]]
    notes = [note for call in of_routes for note in call["notes"] if "pivots chosen anew" in note]
    assert {call["solver"] for call in of_routes} == {"gc_weak_form", "gauss_joint", "dop853_joint"}
    assert len(notes) == 2 and any(call["marchers"] > 1 for call in of_routes)
    for call in of_routes:
        check_call(call)


@pytest.mark.parametrize("given", ["few_calls", pytest.param("calls", marks=pytest.mark.slow)])
def test_the_process_was_cold(request, given):
    """All was made here, in plain sight of LLVM and CasADi, and its time is the far larger part."""
    calls = request.getfixturevalue(given)
    made = sum(call["made"] for call in calls)
    assert made > 50.0 * sum(call["cost"].get("cpu_min_s", 0.0) for call in calls)
    seen = {name for call in calls for name in call["metered"]}
    assert {"TargetMachine.emit_object", "ExecutionEngine.finalize_object", "Function.__init__", "SX.sym"} <= seen


def free_fall():
    """A call without code of its own."""
    return registry.make_problem("free_fall", {}), registry.make_solver("exact", {}), StepControl(dt=0.1)


def test_calls_listen_to_numba_before_their_clocks_start(monkeypatch):
    """Of a run, of ``mbsbench.solve`` and of races alike."""
    order = []
    monkeypatch.setattr(worker, "listen_to_numba", lambda: order.append("listens"))
    monkeypatch.setattr(worker, "cpu_seconds_of_tree", lambda: order.append("reads its clock") or 0.0)
    problem, solver, control = free_fall()
    worker.solve_repeatedly(solver, problem, control, 1)
    assert order[0] == "listens"
    order.clear()
    worker.solve(problem, solver, control)
    assert order[0] == "listens"


def test_code_made_at_import_before_the_fork_is_no_code_of_the_process(monkeypatch):
    """It is set-up; the process has not used the CPU time that it took."""
    monkeypatch.setattr(worker.registry, "import_seconds", lambda name: (1.0, 1e4))
    cost = worker.solve(*free_fall()).report.cost
    assert float(cost["setup_s"]) > 1e4 and float(cost["code_s"]) <= code_seconds_of_tree() < 1e4


def test_no_cost_is_below_zero_where_the_meter_of_code_counts_more_than_the_clock(monkeypatch):
    """/proc counts processes below this one by ticks, and the meter the code that they make."""
    made = iter(float(k) for k in range(100))
    monkeypatch.setattr(worker, "code_seconds_of_tree", lambda: next(made))
    cost = {name: float(value) for name, value in worker.solve(*free_fall()).report.cost.items()}
    assert cost["cpu_refuses_s"] == 0.0
    assert min(cost.values()) >= 0.0


@pytest.mark.slow
@pytest.mark.parametrize("solver", OURS)
def test_no_code_is_made_in_the_time_of_a_solver_on_any_problem(tmp_path, solver):
    """On every problem of the suites, in a process that has made nothing for others."""
    found = calls_in_cold_process(tmp_path, solver)
    assert found
    for call in found:
        check_call(call)
