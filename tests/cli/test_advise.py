"""The search for a setting ends, meets the error where a solver can, and names the cheapest."""

import json
import math
import re
import tempfile

import pytest

from mbsbench import make_problem
from mbsbench.cli import advise as command
from mbsbench.cli.__main__ import main
from mbsbench.harness.judge.cost import Candidate
from mbsbench.harness.mechanics.types import Problem
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.store import LoadedResults
from mbsbench.tests.comparing import assert_each

SWING = make_problem("spherical_pendulum", {"t_end": 1.0})


def searched(solver: str, error: float, law, rounds: int = 6) -> Candidate:
    """The search on runs whose error follows ``law`` of the setting."""
    c = Candidate(solver, SWING, error, 10.0)
    for _ in range(rounds):
        spec = c.choose_next_spec()
        if spec is None:
            break
        setting = spec.control.dt or spec.control.rtol
        status, off = law(setting)
        dt, rtol = spec.control.dt or math.nan, spec.control.rtol or math.nan
        c.runs.append(
            RunRecord(
                status=status,
                claimed=status,
                control=c.control,
                dt_s=dt,
                rtol=rtol,
                motion_error_judged_m=off,
                cpu_median_s=1.0 / setting,
                declared_order=2.0,
            )
        )
    return c


@pytest.mark.parametrize("error", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_a_solver_of_any_order_is_brought_to_the_error(error, order):
    """From the observed order, within a factor of ten of the error asked for: finer would cost for nothing."""
    c = searched("rattle", error, lambda dt: ("success", 10.0 * (0.1 * dt) ** order))
    assert c.best is None or c.best.motion_error_judged_m <= error
    if order > 1.0:
        assert c.best is not None and (c.best.motion_error_judged_m > error / 30.0 or c.best.dt_s >= 0.05)


def test_the_cheapest_run_that_meets_the_error_is_the_best():
    """Coarser steps are tried where the first meet the error by far, finer ones where they diverge."""
    c = searched("rattle", 1e-3, lambda dt: ("diverged" if dt > 0.004 else "success", 10.0 * dt**2))
    assert c.best is not None and c.best.dt_s <= 0.004
    assert c.best.cpu_median_s == min(r.cpu_median_s for r in c.runs if c.meets_error(r))


def test_a_refusal_ends_the_search():
    """No other step changes it."""
    assert len(searched("rattle", 1e-3, lambda dt: ("refused", math.nan)).runs) == 1


def test_a_run_that_takes_too_long_is_tried_with_larger_steps():
    """At the problem's own step the time is over; eight times that meets the error."""
    own = SWING.dt
    c = searched("rattle", 1e-2, lambda dt: ("stalled", math.nan) if dt < 2.0 * own else ("success", dt**2))
    assert c.best is not None and c.best.dt_s > own and c.best.motion_error_judged_m <= 1e-2
    assert len(searched("rattle", 1e-2, lambda dt: ("stalled", math.nan)).runs) < 6


def test_a_floor_above_the_error_ends_the_search():
    """An error that no tolerance makes smaller: the closest run is named."""
    c = searched("rk45_strong_form", 1e-9, lambda rtol: ("success", 1e-6 + rtol))
    assert c.best is None and c.closest.motion_error_judged_m == pytest.approx(1e-6, rel=0.5)


def test_the_first_words_come_before_any_work(capsys, monkeypatch):
    """What will be done, how long, and where something is compiled once; no reference is computed before."""
    monkeypatch.setattr(Problem, "reference", lambda self: pytest.fail("computed"))
    monkeypatch.setattr(command, "run_watched", stop)
    monkeypatch.setattr(command, "select_quick_solvers", lambda specs: set())
    with pytest.raises(Stopped):
        main(["advise", "chain", "--t-end", "0.1", "--error", "1e-3", "--solver", "rattle", "--jobs", "1"])
    out, err = capsys.readouterr()
    assert not out and re.fullmatch(r"1 solver, up to 6 settings of each, 1 at a time: about \d+ .*\n", err)


class Stopped(Exception):
    pass


def stop(*_, **__):
    raise Stopped


@pytest.mark.beyond_core
def test_solvers_that_are_there_at_once_make_the_first_table(capsys, monkeypatch):
    """Those that need no compiling are asked first; their table is on standard error, the last one alone on output."""
    asked = []

    def watched(request, **_):
        asked.append([s.solver for s in request.suite.specs])
        records = [
            RunRecord(
                settings_id=s.settings_id,
                solver=s.solver,
                case=s.case,
                status="success",
                control="dt",
                dt_s=s.control.dt,
                motion_error_judged_m=5e-4,
                cpu_median_s=0.1,
                declared_order=2.0,
            )
            if s.solver != "drake"
            else RunRecord(
                settings_id=s.settings_id,
                solver=s.solver,
                case=s.case,
                status="refused",
                control="dt",
                dt_s=s.control.dt,
                message="drake is not installed",
                missing_package="drake",
            )
            for s in request.suite.specs
        ]
        return LoadedResults(tuple(records), {}), None

    monkeypatch.setattr(command, "run_watched", watched)
    monkeypatch.setattr(command, "select_quick_solvers", lambda specs: {"mujoco"})
    names = ("rattle", "mujoco", "drake")
    line = ["advise", "chain", "--t-end", "0.1", "--error", "1e-3", *(x for n in names for x in ("--solver", n))]
    assert main(line) == 0
    out, err = capsys.readouterr()
    assert asked == [["mujoco"], ["rattle", "drake"]]
    assert "mujoco" in err and "so far 1 of 3 solvers meet it" in err and "so far" not in out
    rows = [row.split()[0] for row in out.splitlines()]
    assert {"rattle", "mujoco"} <= set(rows) and "drake" not in rows
    assert "not installed: drake; add engines: make engines" in out and out.count("drake") == 1


def test_it_says_what_share_of_the_motion_the_error_is(capsys, monkeypatch):
    """An error of a tenth of the motion and more asks for nothing."""

    def watched(request, **_):
        (s,) = request.suite.specs
        record = RunRecord(
            settings_id=s.settings_id,
            solver=s.solver,
            case=s.case,
            status="success",
            control="dt",
            dt_s=s.control.dt,
            motion_error_judged_m=5e-4,
            cpu_median_s=0.1,
            length_scale_m=1.4e-3,
        )
        return LoadedResults((record,), {}), None

    monkeypatch.setattr(command, "run_watched", watched)
    line = ["advise", "chain", "--t-end", "0.1", "--solver", "rattle", "--error"]
    assert main([*line, "1e-3"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "the farthest that a body moves is 0.0014 m, of which 0.001 m is 71 %: ask for less" in said
    assert main([*line, "6e-4", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["reach_m"] == 1.4e-3


def test_options_of_the_one_solver_are_searched_with(capsys, monkeypatch):
    """They are in all its runs and its name; without one solver, or for what is searched, they are refused."""
    asked = []

    def watched(request, **_):
        asked.extend(request.suite.specs)
        raise Stopped

    monkeypatch.setattr(command, "run_watched", watched)
    line = ["advise", "chain", "--t-end", "0.1", "--error", "1e-3"]
    with pytest.raises(Stopped):
        main([*line, "--solver", "ida_index1", "--set", "alpha=2"])
    assert [s.options for s in asked] == [{"alpha": 2.0}]
    capsys.readouterr()
    for more, words in (
        (["--set", "alpha=2"], "one --solver"),
        (["--solver", "ida_index1", "--set", "alhpa=2"], "did you mean 'alpha'"),
        (["--solver", "ida_index1", "--set", "rtol=1e-5"], "the search chooses it"),
        (["--solver", "rattle", "--solver", "ida_index1", "--set", "alpha=2"], "one --solver"),
    ):
        assert main([*line, *more]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.sampled(0)
def test_it_advises_on_a_pendulum(capsys, tmp_path, monkeypatch):
    """Runs of two solvers: both meet 1e-5 m, the table says which is cheaper, by how much, with its setting."""
    monkeypatch.chdir(tmp_path)
    two = ("--solver", "rk45_strong_form", "--solver", "ida_index1")
    arguments = ("advise", "spherical_pendulum", "--t-end", "0.3", *two, "--jobs", "1")
    assert main([*arguments, "--error", "1e-5", "--json"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {f["solver"] for f in found} == {"rk45_strong_form", "ida_index1"}
    assert_each([f["motion_error_m"] for f in found if f["meets"]], "<=", 1e-5, "errors [m]")
    assert found[0]["meets"]
    (tmp_path / "two.toml").write_text(
        'name = "two"\n[[runs]]\nproblem = "spherical_pendulum"\nparameters = { t_end = 0.3 }\n'
        'solver = ["rk45_strong_form", "ida_index1"]\nrtol = [1e-5, 1e-7]\n'
    )
    assert main(["run", str(tmp_path / "two.toml"), "--out", str(tmp_path / "two"), "--jobs", "1", "--json"]) == 0
    capsys.readouterr()
    assert main([*arguments, "--error", "1e-5", "--from", str(tmp_path / "two"), "--json"]) == 0
    read = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {f["solver"] for f in read} == {"rk45_strong_form", "ida_index1"} and read[0]["meets"]
    assert main(["advise", "chain", "--error", "1e-3", "--from", str(tmp_path / "two")]) == 2
    capsys.readouterr()
    one = [*arguments[:4], *two[:2], "--jobs", "1"]
    assert main([*one, "--error", "1e-17"]) == 2
    said = capsys.readouterr()
    assert "the reference's own" in said.err and "[1/1]" in said.err
    assert tempfile.gettempdir() not in said.out + said.err  # the folder of the runs is gone by now
