"""Solvers that lie or break the contract: what they hand over is judged by a process they never were in."""

import dataclasses
import json
import math

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import registry
from mbsbench.harness.results import store
from mbsbench.harness.results.words import list_reasons
from mbsbench.harness.run import solve_file
from mbsbench.tests.factories import PLUGIN, run_suite_text

from ..conftest import HOSTILE
from ..misbehaving import free_fall

SUITE = """
[defaults]
problem = "free_fall"
[[runs]]
solver = ["exact", "raises"]
[[runs]]
solver = "forges"
options = { how = ["record", "verdict", "less_time", "more_time"] }
[[runs]]
solver = "obstructs"
options = { what = ["stderr", "handed", "spool", "record"] }
[[runs]]
solver = "breaks_the_contract"
options = { what = ["refuses", "counters", "status", "reaction", "notes"] }
[[runs]]
solver = "claims_time"
options = { cpu = [-5.0, 1e-30, 1e9] }
[[runs]]
solver = "lazy"
options = { how = ["reversed", "turned"] }
[[runs]]
problem = "torque_free_body"
parameters = { t_end = 10.0, inertia_factors = [1.0, 1.5, 2.0] }
solver = "lazy"
[[runs]]
problem = "spherical_pendulum"
parameters = { omega_z = [0.0, 3.0], t_end = 5.0 }
solver = "lazy"
[[runs]]  # what "pulls" uses is compiled before any clock runs
problem = "spherical_pendulum"
parameters = { omega_z = 0.1, t_end = 1.0 }
solver = "rkmk_dop853"
rtol = 1e-8
[[runs]]
problem = "spherical_pendulum"
parameters = { omega_z = 0.1, t_end = 1.0 }
solver = "pulls"
options = { force = [1e9, 1e300] }
"""


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """All of them in one run; none ends it."""
    loaded, watcher = run_suite_text(tmp_path_factory.mktemp("hostile") / "run", SUITE, plugins=(PLUGIN, HOSTILE))
    assert len(loaded.records) == watcher.total and not loaded.unreadable
    return loaded.records


def of(records, solver, **options):
    return [r for r in records if r.solver == solver and options.items() <= json.loads(r.solver_options).items()]


def test_a_breach_of_the_contract_costs_one_run_and_names_its_line(outcome):
    """``refuses`` that answers True, counters of 400 digits, a status of its own, reactions of another shape."""
    assert {r.status for r in of(outcome, "exact")} == {"success"}
    broken = of(outcome, "breaks_the_contract")
    assert len(broken) == 5
    for r in (*broken, *of(outcome, "raises")):
        assert r.status == "crashed" and r.ended_by == "exception"
        assert "hostile.py:" in list_reasons(r)[0] or "misbehaving.py:" in list_reasons(r)[0]


def test_a_folder_in_place_of_a_file_costs_its_run_at_most(outcome):
    """Standard error, what is handed over, kept steps and record: the supervisor goes on."""
    found = {json.loads(r.solver_options).get("what", "stderr"): r for r in of(outcome, "obstructs")}
    assert len(found) == 4 and {r.status for r in found.values()} <= {"success", "crashed"}
    assert found["stderr"].status == found["record"].status == "success"


def test_a_file_in_place_of_the_folder_of_errors_ends_the_suite_in_a_line(tmp_path):
    """The run that put it there fails; no later one can be started, and none is blamed."""
    text = '[[runs]]\nproblem = "free_fall"\nsolver = "obstructs"\noptions = { what = ["errors", "record"] }'
    with pytest.raises(Exception, match=r"stderr: it is a file"):
        run_suite_text(tmp_path / "run", text, 1, plugins=(PLUGIN, HOSTILE))
    (record,) = store.load(tmp_path / "run").records
    assert record.status == "crashed" and "stderr" in record.message


def test_a_claimed_time_has_to_fit_the_clock(outcome):
    """Minus five seconds and 31 years are breaches; for next to nothing, what was measured around the call counts."""
    claims = {json.loads(r.solver_options)["cpu"]: r for r in of(outcome, "claims_time")}
    for impossible in (-5.0, 1e9):
        r = claims[impossible]
        assert r.status == "crashed" and "do not fit" in r.message and r.cpu_median_s != r.cpu_median_s
    assert claims[1e-30].status == "success" and claims[1e-30].cpu_min_s == claims[1e-30].cpu_call_s > 0.01


def test_a_verdict_is_not_the_solvers_to_patch(outcome):
    """A record of its own is overwritten; a patched judge is that of a process that judges nothing."""
    (verdict,) = of(outcome, "forges", how="verdict")
    (record,) = [r for r in of(outcome, "forges") if "how" not in r.solver_options]
    assert record.case.startswith("free_fall forges") and record.status == "crashed" and record.exit_code == 0
    assert verdict.status == "wrong"


def test_a_patched_clock_is_held_against_the_system_s(outcome):
    """The solver's process measures itself; what it cannot have taken is no time of it."""
    for how in ("less_time", "more_time"):
        (r,) = of(outcome, "forges", how=how)
        assert r.status == "crashed" and "does not fit" in r.message and math.isnan(r.cpu_median_s)


@pytest.mark.parametrize("how", ["stays", "reversed", "turned"])
def test_a_motion_that_is_none_is_no_success(outcome, how):
    """Two rows that are the start, velocities negated after it, rotations that ignore Omega: all keep the laws."""
    found = [r for r in of(outcome, "lazy") if json.loads(r.solver_options).get("how", "stays") == how]
    assert len(found) == {"stays": 3}.get(how, 1)
    assert not {r.status for r in found} & {"success"}, found
    if how == "reversed":
        assert "kinematic" in found[0].wrong_because


def test_forces_without_measure_are_wrong(outcome):
    """1e9 N where the exact motion needs 20 N; and more than can be squared."""
    found = of(outcome, "pulls")
    assert len(found) == 2 and all(r.status == "wrong" and "reaction" in r.wrong_because for r in found)


@pytest.mark.parametrize("how", ["exits", "raises", "no_bound", "no_horizon"])
def test_a_reference_that_judges_nothing_takes_no_command_along(how, tmp_path, capsys, monkeypatch):
    """It leaves, raises, or states NaN for its error or horizon: the run has crashed, in a file, with exit code 1."""
    monkeypatch.setattr(solve_file, "PATIENCE", math.inf)  # however busy the machine, no word on the wait
    out, plugins = tmp_path / "x.npz", ("--plugin", str(PLUGIN), "--plugin", str(HOSTILE))
    line = ("solve", "badly_known", "exact", "--problem-set", f"how={how}", *plugins, "--out", str(out))
    assert main([*line]) == 1
    said = capsys.readouterr()
    assert "crashed" in said.out and not said.err
    with np.load(out, allow_pickle=False) as file:
        assert str(file["status"]) == "crashed"


def test_a_reference_that_hangs_costs_its_run_alone(tmp_path, capsys, monkeypatch):
    """With a limit on the run, what measures it has one too."""
    monkeypatch.setattr(solve_file, "MEASURE_LIMIT", 0.5)
    out, plugins = tmp_path / "x.npz", ("--plugin", str(PLUGIN), "--plugin", str(HOSTILE))
    line = ("solve", "badly_known", "exact", "--problem-set", "how=hangs", "--set", "cpu_limit=30", *plugins)
    assert main([*line, "--out", str(out)]) == 1
    assert "measuring its motion took too long" in capsys.readouterr().out and out.exists()


def test_a_time_that_is_none_is_refused(monkeypatch):
    """NaN compares with nothing: no run would end too early."""
    made = dataclasses.replace(registry.problems()["free_fall"], make=lambda mass: free_fall_until(math.nan, mass))
    monkeypatch.setitem(registry._plugin_problems, "free_fall", made)
    with pytest.raises(ValueError, match="t_end must be a finite number"):
        registry.make_problem("free_fall")


def free_fall_until(t_end, mass):
    return dataclasses.replace(free_fall(mass=mass), t_end=t_end)


def test_numbers_that_overflow_are_a_result(tmp_path, capsys):
    """g = 1e200: a crash or a failure of the run, in words."""
    line = ("solve", "heavy_top", "gc_weak_form", "--problem-set", "gravity=1e200", "--out", str(tmp_path / "x.npz"))
    assert main([*line]) in (1, 2)
    assert "Traceback" not in "".join(capsys.readouterr())
