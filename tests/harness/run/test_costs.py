"""The time that runs will take is known before they begin: to a third for a suite, and cold or warm."""

import json
import math
import os
from dataclasses import replace
from types import SimpleNamespace

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.suite import load_suite, parse_suite
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.store import create_folder, write_record
from mbsbench.harness.run import costs
from mbsbench.harness.run.costs import (
    SIZES,
    WarmCaches,
    describe_command,
    interpolate_by_size,
    predict_run_cost,
    predict_times,
    read_costs,
)
from mbsbench.harness.run.remaining_time import format_duration
from mbsbench.harness.run.runner import Request, list_waiting
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import PLUGIN, run_suite_text, specify_run

TEXT = """[[runs]]
problem = "spherical_pendulum"
parameters = { t_end = 1.0 }
solver = "rk45_strong_form"
rtol = [1e-4, 1e-6]
"""


@pytest.fixture
def cold(tmp_path, monkeypatch):
    """No cache holds anything, and this machine is as fast as that of the table."""
    monkeypatch.setattr(costs, "make_cache_folder", lambda *_: tmp_path / "caches")
    monkeypatch.setattr(costs, "measure_slowness", lambda jobs: costs.TABLE_MACHINE)
    return tmp_path


@pytest.mark.beyond_core
def test_cost_follows_steps_and_size(cold):
    """Twice the steps cost twice as much beyond the start of the processes; the grid costs more than the chain."""
    facts = {
        n: costs._find_factors_of_problem(registry.make_problem(n)) for n in ("heavy_top", "chain", "four_bar_grid")
    }
    assert [costs.find_nearest_size(f.size) for f in facts.values()] == [0, 1, 2]
    for solver in ("rattle", "mujoco"):
        one, two, four = (
            predict_run_cost(specify_run("chain", solver, dt=dt), facts["chain"], read_costs())
            for dt in (4e-4, 2e-4, 1e-4)
        )
        assert four - two == pytest.approx(2.0 * (two - one))
    step = [interpolate_by_size(read_costs().solvers["rattle"].step_us, f.size) for f in facts.values()]
    assert step == sorted(step) and step[2] > 50.0 * step[0]


@pytest.mark.parametrize("solver", ["rkmk_dop853", "ida_index1", "dop853_joint"])
def test_a_finer_tolerance_costs_more(cold, solver):
    facts = costs._find_factors_of_problem(registry.make_problem("chain"))
    times = [
        predict_run_cost(specify_run("chain", solver, rtol=rtol), facts, read_costs()) for rtol in (1e-4, 1e-8, 1e-12)
    ]
    assert times == sorted(times)


def test_sizes_are_interpolated_and_go_on_in_proportion():
    """At the sizes of the table its numbers; between them powers; beyond the last that was run in proportion."""
    values = (1.0, 30.0, 300.0)
    assert [interpolate_by_size(values, s) for s in SIZES] == pytest.approx(list(values))
    assert interpolate_by_size(values, math.sqrt(SIZES[0] * SIZES[1])) == pytest.approx(math.sqrt(30.0))
    assert interpolate_by_size(values, 2.0 * SIZES[2]) == pytest.approx(600.0)
    assert (
        interpolate_by_size((1.0, 30.0, -1.0), 2.0 * SIZES[1]) == pytest.approx(60.0)
        and interpolate_by_size((-1.0, -1.0, -1.0), 9.0) == 0.0
    )


@pytest.mark.beyond_core
def test_every_solver_has_a_cost(cold):
    """Those that the table does not know, a plugin's too, have that of the middle; none costs nothing."""
    facts = costs._find_factors_of_problem(registry.make_problem("heavy_top"))
    for name, entry in registry.solvers().items():
        control = {"dt": 0.01} if entry.control == "dt" else {"rtol": 1e-6}
        assert predict_run_cost(specify_run("heavy_top", name, **control), facts, read_costs()) > 0.05
    assert {n for n in registry.solvers() if registry.is_own_solver(n)} >= {*read_costs().solvers}


def test_a_loop_is_part_of_the_cost_of_a_run(cold):
    """A short solve takes the time of its loop; one that takes longer, and one in no loop, what they took."""
    facts, table = costs._find_factors_of_problem(registry.make_problem("heavy_top")), read_costs()
    for dt, looped in ((0.05, True), (1e-5, False)):
        spec = specify_run("heavy_top", "rattle", dt=dt)
        once, in_loop = (predict_run_cost(replace(spec, min_time=seconds), facts, table) for seconds in (0.0, 0.2))
        set_up = interpolate_by_size(table.solvers["rattle"].setup_s, facts.size)
        solve = costs.predict_solve_cost(spec, facts, table)
        assert in_loop == pytest.approx(once - set_up - solve + 0.2 if looped else once) and (solve < 0.02) is looped


def test_what_a_run_took_here_counts_more_than_the_table(cold):
    """The record of the same settings in a results folder of this place."""
    specs = parse_suite(TEXT, "t", "t").specs
    record = RunRecord(
        run_id="x", case="c", problem="p", solver="s", status="success", wall_s=123.0, settings_id=specs[0].settings_id
    )
    write_record(create_folder(cold / "local" / "t-1"), record)
    runs = predict_times(specs, 1, "t", cold / "local").runs
    assert runs[specs[0].settings_id] == pytest.approx(123.0 + read_costs().store_s)
    assert 0.0 < runs[specs[1].settings_id] < 5.0


def test_what_is_cold_counts_once(cold):
    """Kernels, laws and a computed reference; remembered, they count no more; for other code again."""
    specs = [specify_run("chain", "gc_weak_form", dt=0.01)]
    first = predict_times(specs, 1, "", cold)
    assert first.is_cold and 10.0 < first.once < 40.0 and "this once" in first.words
    WarmCaches().add(["laws", "gc_weak_form", "reference of chain"])
    warm = predict_times(specs, 1, "", cold)
    assert not warm.is_cold and warm.once == 0.0 and "once" not in warm.words
    assert first.seconds - warm.seconds == pytest.approx(first.once)
    (file,) = (cold / "caches").iterdir()
    file.write_text(file.read_text().replace(costs._digest_for("laws")[2:10], "elsewhere"))
    assert predict_times(specs, 1, "", cold).once > 5.0
    file.write_text("no JSON")
    assert predict_times(specs, 1, "", cold).once == first.once


def test_a_pool_remembers_what_it_prepared(cold):
    """After a run of the suite its estimate is a warm one."""
    suite = parse_suite(TEXT, "t", "t")
    assert predict_times(suite.specs, 1, "", cold / "none").is_cold
    run_suite_text(cold / "out", TEXT, plugins=())
    assert not predict_times(suite.specs, 1, "", cold / "none").is_cold


def test_a_slower_machine_takes_longer(cold, monkeypatch):
    """In proportion, cold and warm."""
    specs = parse_suite(TEXT, "t", "t").specs
    before = predict_times(specs, 2, "", cold / "none")
    monkeypatch.setattr(costs, "measure_slowness", lambda jobs: costs.Slowness(3.0, 3.0))
    after = predict_times(specs, 2, "", cold / "none")
    assert after.seconds == pytest.approx(3.0 * before.seconds) and after.once == pytest.approx(3.0 * before.once)


def test_a_core_that_others_want_is_slower(monkeypatch):
    """Two cores: idle, with one job of ours and five of others, with four of ours; each core half as fast."""
    monkeypatch.setattr(costs, "measure_loop", lambda: 2.0 * read_costs().loop_s)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    for others, jobs, factor in ((0.0, 2, 1.0), (5.0, 1, 3.0), (0.0, 4, 2.0), (4.0, 4, 4.0), (1.0, 1, 1.0)):
        monkeypatch.setattr(costs, "count_running_processes", lambda others=others: others)
        slow = costs.measure_slowness.__wrapped__(jobs)
        assert slow.solving == slow.other == pytest.approx(2.0 * factor)


def test_a_faster_core_starts_no_process_faster(monkeypatch):
    """It solves in half the time; starting, storing and measuring, the work of the system, take as long."""
    monkeypatch.setattr(costs, "measure_loop", lambda: 0.5 * read_costs().loop_s)
    monkeypatch.setattr(costs, "count_running_processes", lambda: 0.0)
    fast = costs.measure_slowness.__wrapped__(1)
    assert (fast.solving, fast.other) == (0.5, 1.0)
    facts, spec = (
        costs._find_factors_of_problem(registry.make_problem("chain")),
        specify_run("chain", "rattle", dt=1e-3),
    )
    solve = costs.predict_solve_cost(spec, facts, read_costs())
    slower, faster = (predict_run_cost(spec, facts, read_costs(), slow) for slow in (costs.TABLE_MACHINE, fast))
    assert slower - faster == pytest.approx(0.5 * spec.repeats * solve) and solve > 0.0


def test_rivals_are_the_other_processes_that_run_now(monkeypatch):
    """Not this one, none that it started or that sleeps, and not a burst in one of five looks."""
    looks = iter([2, 2, 9, 2, 0])

    def make(pid, status="running", parent=0):
        return SimpleNamespace(pid=pid, info={"status": status, "ppid": parent})

    def process_iter(attributes):
        assert attributes == ["status", "ppid"]
        running = [make(-k) for k in range(1, 1 + next(looks))]
        return [make(os.getpid()), make(-100, "sleeping"), make(-200, parent=os.getpid()), *running]

    monkeypatch.setattr("psutil.process_iter", process_iter)
    assert costs.count_running_processes() == 2


def test_a_problem_of_a_plugin_is_not_made(cold):
    """It might hang or crash; its runs have a cost all the same."""
    specs = parse_suite('[[runs]]\nproblem = "free_fall"\nsolver = "exact"\n', "t", "t", plugins=(str(PLUGIN),)).specs
    assert_each(list(predict_times(specs, 1, "", cold).runs.values()), ">", 0.0, "predicted seconds")


def test_the_runs_that_wait_are_listed(cold):
    """Of a folder that is resumed those without a record of this code; the folder stays as it is."""
    folder = cold / "out"
    run_suite_text(folder, TEXT, plugins=(), limit=1)
    before = sorted(p.name for p in folder.rglob("*"))
    request = Request(parse_suite(TEXT, "test", "test"), folder, 1, resume=True)
    assert [s.control.rtol for s in list_waiting(request)] == [1e-6]
    assert len(list_waiting(replace(request, resume=False))) == 2
    assert sorted(p.name for p in folder.rglob("*")) == before


def test_a_dry_run_says_what_would_be_run(cold, capsys, monkeypatch):
    """A line a run, their number and time; nothing is written; JSON has seconds."""
    monkeypatch.chdir(cold)
    (cold / "s.toml").write_text(TEXT)
    assert main(["run", "s.toml", "--dry-run", "--jobs", "2"]) == 0
    out, err = capsys.readouterr()
    *runs, last = out.splitlines()
    assert [x.split(" s  ")[1] for x in runs] == [s.case for s in parse_suite(TEXT, "s", "s").specs] and not err
    assert last.startswith("2 runs, 2 at a time: about ") and "this once" in last
    assert main(["run", "s.toml", "--dry-run", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["once_s"] > 1.0 and said["seconds"] > said["once_s"] and len(said["runs"]) == 2
    assert not (cold / "results").exists()


def test_members_of_a_cloud_need_no_process_each(cold):
    """A thousand solves cost a thousand times one, at so many at a time, and one start."""
    spec = specify_run("heavy_top", "rattle", dt=0.001)
    one, many = (costs.expect_solves([(spec, n)], 2) for n in (1, 1000))
    each = predict_run_cost(spec, costs._find_factors_of_problem(registry.make_problem("heavy_top")), read_costs())
    assert many.runs[spec.settings_id] == pytest.approx(1000.0 * one.runs[spec.settings_id]) and many.once == one.once
    assert 0.0 < one.runs[spec.settings_id] < each


@pytest.mark.beyond_core
def test_those_at_once_are_known_not_to_take_long(cold):
    """Neither one that is to be compiled, nor one whose cost nobody knows, nor a long run; compiled, it is."""
    fixed = [specify_run("chain", name, dt=dt) for name, dt in (("mujoco", 0.01), ("rattle", 0.01), ("exudyn", 1e-5))]
    specs = [*fixed, specify_run("chain", "dart", dt=0.01), specify_run("chain", "ida_index1", rtol=1e-4)]
    assert costs.select_quick_solvers(specs) == {"mujoco", "ida_index1"}
    WarmCaches().add(["rattle"])
    assert costs.select_quick_solvers(specs) == {"mujoco", "ida_index1", "rattle"}


@pytest.mark.parametrize("command", ["judge", "report", "judged_report", "fuzz", "shadow"])
def test_a_command_takes_longer_for_more(cold, command):
    """Its start once, and as much for each run, trial or step of a body, shared by those at a time."""
    start, each = read_costs().commands[command]
    many = math.ceil(100.0 / each)
    assert describe_command(command, many) == f"about {format_duration(start + each * many)}"
    assert describe_command(command, 2 * many, 2) == describe_command(command, many)


@pytest.mark.sampled(0)
def test_judging_and_reports_say_what_they_will_take(cold, tmp_path, capsys):
    """On standard error, before they begin."""
    suite, out = tmp_path / "few.toml", tmp_path / "few"
    suite.write_text(TEXT)
    assert main(["run", str(suite), "--out", str(out)]) == 0
    assert "; to judge and report takes about 7 s more; results in" in capsys.readouterr().err
    for command, words in (
        (["judge", str(out), "--partial"], "2 runs to be judged: about 3 s"),
        (["report", str(out)], "pages of 2 runs: about 4 s"),
        (["report", "--judge", str(out)], "pages of 2 runs: about 7 s"),
    ):
        capsys.readouterr()
        main(command)
        assert words in capsys.readouterr().err


@pytest.mark.sampled(0)
def test_the_first_part_of_a_suite_announces_the_whole(cold, tmp_path, capsys):
    """Its runs, and judging and a report after this part and after the rest, as ``make bench`` does."""
    (tmp_path / "part.toml").write_text(TEXT)
    suite = tmp_path / "whole.toml"
    suite.write_text('include = ["part.toml"]\n' + TEXT.replace("1e-4, 1e-6", "1e-5"))
    assert main(["run", str(suite), "--only", "part", "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    told = " ".join(capsys.readouterr().err.split())
    whole = predict_times(load_suite(str(suite)).specs, 1, "", tmp_path / "none")
    pages = sum(costs.predict_command("judged_report", count) for count in (2, 3))
    assert pages == pytest.approx(13.2, abs=0.2) and costs.predict_pages(2) + costs.predict_pages(3) == pages
    assert "whole: 3 runs, 1 at a time: about " in told and ", judging and reports included" in told
    assert replace(whole, pages=pages).words.startswith(f"about {format_duration(whole.seconds + pages)}, judging")


def test_code_for_a_mechanism_counts_once(cold, monkeypatch):
    """What a solver compiles for a chain at its first run there; at a second step of the same chain, none."""
    monkeypatch.setattr(costs, "ABREAST", 1)  # side by side, the longest of all that is compiled may hide it
    WarmCaches().add(["laws", "reference of chain"])

    def predict(problem, *steps):
        return predict_times([specify_run(problem, "rattle_joint", dt=dt) for dt in steps], 1, "", cold).once

    assert predict("chain", 0.01) == predict("chain", 0.01, 0.02) > predict("heavy_top", 0.01) + 1.0
