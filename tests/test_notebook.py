"""``docs/running.md`` does what it says, and wrong calls of ``solve`` and ``load`` are one clear line."""

import dataclasses
import math
import re
import subprocess
import sys
from html import escape
from pathlib import Path

import numpy as np
import pytest

import mbsbench
from mbsbench import Problem, Results, Run, Status, load, make_problem, solve
from mbsbench.cli.__main__ import main
from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results.records import format_reasons
from mbsbench.harness.results.words import describe_errors, list_reasons
from mbsbench.notebook import FEW, LEFT
from mbsbench.reports.plots.spec import choose_styles
from mbsbench.tests.comparing import assert_same

DOCS = Path(mbsbench.__file__).with_name("docs")
SHORT = {"dt": 0.01, "t_end": 0.1}


@pytest.fixture(scope="module")
def run() -> Run:
    return solve("torque_free_body", "gc_weak_form", **SHORT)


def blocks_of(page: str) -> list[tuple[str, str]]:
    """Language and text of each block of code."""
    return re.findall(r"^```(\w+)\n(.*?)^```", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_page_runs_block_by_block(tmp_path, monkeypatch, capsys):
    """Each block runs in the order of the page; what is asserted here is what the page promises in its comments."""
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    blocks = blocks_of("running.md")
    assert len([kind for kind, _ in blocks if kind == "python"]) >= 5
    for kind, block in blocks:
        if kind == "toml":
            Path("small.toml").write_text(block, encoding="utf-8")
        elif kind == "sh":
            command = [sys.executable, "-m", "mbsbench.cli", *block.split()[1:]]
            subprocess.run(command, check=True, capture_output=True)
        else:
            exec(compile(block, "running.md", "exec"), names)
    assert "<Run heavy_top[t_end=0.5] gc_weak_form dt=0.001: success, 500 steps to 0.5 s" in capsys.readouterr().out
    assert Path("top.png").stat().st_size > 10_000
    assert Path("work.pdf").stat().st_size > 5_000
    assert {line.get_label() for line in names["ax"].lines} == {
        "gc_weak_form, heavy_top",
        "rk45_strong_form, heavy_top",
        "order 2",
    }
    assert len(names["results"].runs) == len(names["table"]) == 3
    assert list(names["table"].status) == ["success"] * 3


def test_problem_of_the_page_is_solved(capsys):
    ((_, block),) = blocks_of("your-own-problem.md")
    exec(compile(block, "your-own-problem.md", "exec"), {})
    assert "<Run double_pendulum gc_weak_form dt=0.001: success, 500 steps to 0.5 s" in capsys.readouterr().out


def test_numbers_are_those_of_a_run_of_the_harness(tmp_path, run):
    """One code measures all: the record of a suite's run has the same metrics, bit for bit."""
    from mbsbench.harness.catalogue.suites.spec import make_spec
    from mbsbench.harness.results import store
    from mbsbench.harness.run.job import Job
    from mbsbench.tests.factories import run_here as worker

    problem = make_problem("torque_free_body", {"t_end": 0.1})
    spec = make_spec(problem, "gc_weak_form", control={"dt": 0.01})
    theirs = worker(Job(spec, store.create_folder(tmp_path)))
    same = [
        "settings_id",
        "case",
        "status",
        "paper_label",
        "declared_order",
        "steps",
        "counters",
        "energy_drift_max_J",
        "phi_max",
        "position_error_max_m",
        "observable_errors",
        "invariant_drifts",
        "reference",
    ]
    assert {k: getattr(run.record, k) for k in same} == {k: getattr(theirs, k) for k in same}


def test_saved_run_is_read_back(tmp_path, run):
    """Trajectory and record come back as they were, and with them the series."""
    run.save(tmp_path / "free.npz")
    again = load(tmp_path / "free.npz")
    assert str(vars(again.record)) == str(vars(run.record))  # NaN is not NaN
    assert_same(again.trajectory.states.R, run.trajectory.states.R)
    assert_same(again.series["energy_error"], run.series["energy_error"])
    assert again.problem.name == "torque_free_body"


def test_file_of_the_command_is_read(tmp_path, run):
    """``mbsbench solve`` and ``Run.save`` write the same file, so ``load`` gives the same run."""
    words = ["solve", "torque_free_body", "gc_weak_form", "--set", "dt=0.01", "--t-end", "0.1", "--out"]
    assert main([*words, str(tmp_path / "free.npz")]) == 0
    run.save(tmp_path / "saved.npz")
    with np.load(tmp_path / "free.npz") as theirs, np.load(tmp_path / "saved.npz") as ours:
        assert set(theirs.files) == set(ours.files)
    again = load(tmp_path / "free.npz")
    assert_same(again.trajectory.states.R, run.trajectory.states.R)
    assert again.record.case == run.record.case and again.status is run.status


def test_what_is_printed_fits_a_line(run):
    """A record has a hundred columns, a series as many arrays."""
    for said in (repr(run.record), repr(run.series), repr(dataclasses.replace(run.record, case="", status=""))):
        assert len(said) < 250 and "\n" not in said
    assert f"{run.record.case}: success, 10 steps" in repr(run.record)
    assert repr(run.trajectory) == "<Trajectory of 1 body at 11 times to 0.1 s: success>"
    words = "1 body, 1 joint, 3 rows; 0.2 s, dt = 0.001 s"
    assert repr(make_problem("heavy_top", t_end=0.2)) == f"<Problem heavy_top[t_end=0.2]: {words}>"
    assert repr(run.series).startswith("<Series of 11 times to 0.1 s: ") and "energy_error" in repr(run.series)


def test_parameters_are_keywords_or_a_table():
    """Both, or either; unknown ones get the nearest name, others one clear line."""
    by_table, by_name = make_problem("heavy_top", {"spin": 60.0}), make_problem("heavy_top", spin=60.0)
    assert by_table.parameters == by_name.parameters == {"spin": 60.0}
    assert make_problem("heavy_top", {"spin": 60.0}, t_end=0.5).parameters == {"spin": 60.0, "t_end": 0.5}
    for given, more, words in (
        (("heavy_top",), {"spinn": 5.0}, "did you mean 'spin'"),
        (("heavy_top", 5.0), {}, "keywords or a table"),
        (("heavy_top", {"spin": 1.0}), {"spin": 2.0}, "spin is given twice"),
        ((5,), {}, "takes the name"),
    ):
        with pytest.raises(ValueError, match=words):
            make_problem(*given, **more)


def test_a_step_longer_than_the_motion_is_a_mistake(capsys):
    """Milliseconds for seconds; the problem's own step, which was not asked for, is cut without a word."""
    with pytest.raises(ValueError, match="dt = 10 s is longer than the motion, which ends at 1 s"):
        solve(*TOP, dt=10.0, t_end=1.0)
    assert main(["solve", *TOP, "--set", "dt=10", "--t-end", "1"]) == 2
    assert "longer than the motion" in capsys.readouterr().err
    assert solve(*TOP, t_end=1e-4).record.steps == solve(*TOP, dt=1e-4, t_end=1e-4).record.steps == 1


def test_a_long_solve_says_how_far_it_is_where_somebody_watches(monkeypatch, capsys):
    """One line on standard error that only goes up and is gone at the end; a script is silent, the motion the same."""
    from mbsbench.harness.run import progress_line

    silent = solve("torque_free_body", "gc_weak_form", dt=1e-4, t_end=1.0)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(progress_line, "is_watched", lambda: True)
    monkeypatch.setattr(progress_line, "QUIET", math.inf)  # however busy the machine
    solve("torque_free_body", "gc_weak_form", dt=1e-4, t_end=1.0)
    assert capsys.readouterr().err == ""  # over before anybody waits
    monkeypatch.setattr(progress_line, "QUIET", 0.0)
    monkeypatch.setattr(progress_line, "EVERY", 0.0)
    watched = solve("torque_free_body", "gc_weak_form", dt=1e-4, t_end=1.0)
    first, *lines, last, end = capsys.readouterr().err.split("\r")
    times = [float(re.fullmatch(r"torque_free_body: (\S+) of 1 s simulated *", line)[1]) for line in lines]
    assert len(times) > 1 and times == sorted(times) and times[-1] <= 1.0
    assert first == end == "" and last == " " * len(lines[-1])
    assert_same(silent.trajectory.states.R, watched.trajectory.states.R)


def find_cells(html: str) -> dict[str, str]:
    """The rows of the first table of two columns, by their heads."""
    return dict(re.findall(r"<tr><th[^>]*>([^<]*)</th><td[^>]*>([^<]*)</td></tr>", html.split("</table>")[0]))


def test_a_notebook_shows_a_table_with_the_reasons(run):
    """Status, error and CPU time as in the record; a run that is wrong says why."""
    cells = find_cells(run._repr_html_())
    assert cells["status"] == "success" and cells["error"] == describe_errors(run.record) and "because" not in cells
    assert cells["CPU time"] == f"{run.record.cpu_median_s:.3g} s"
    law = format_reasons([Reason(Law.ENERGY, 2.0, 1.0, "J")])
    bad = dataclasses.replace(run.record, status="wrong", wrong_because=law)
    assert find_cells(dataclasses.replace(run, record=bad)._repr_html_())["because"] == escape(list_reasons(bad)[0])
    refused = dataclasses.replace(run.record, status="refused", t_reached_s=math.nan)
    assert "reached" not in find_cells(dataclasses.replace(run, record=refused)._repr_html_())


def test_a_notebook_shows_problems_records_and_results(run):
    """A problem its system and source; a record its run and all columns; results a row a run, and damaged files."""
    problem = make_problem("heavy_top", spin=60.0)
    cells = find_cells(problem._repr_html_())
    assert cells["parameters"] == "spin = 60.0" and cells["system"] == "1 body, 1 joint, 3 rows of constraints"
    assert problem.source in cells["source"] and "theta" in cells["observables"]
    shown = run.record._repr_html_()
    assert shown.startswith(run._repr_html_())
    assert all(f"<td{LEFT}>{name}</td>" in shown for name in vars(run.record))
    damaged = {Path("runs/a.json"): "it is no JSON"}
    many = Results(Path("here"), (run,) * (FEW + 3), damaged)._repr_html_()
    assert many.count(f"<td{LEFT}>{run.record.case}</td>") == FEW and "and 3 more" in many
    assert f"here: {FEW + 3} runs ({FEW + 3} success)" in many and "it is no JSON" in many


def test_names_and_messages_are_text_in_a_notebook(run):
    """Files of others and plug-ins may hold markup and control characters; nothing asks for a script or a file."""
    evil = "<script>alert(1)</script>\x1b[2J\u202e"
    record = dataclasses.replace(run.record, case=evil, status="crashed", message=evil)
    problem = dataclasses.replace(make_problem("heavy_top"), source=evil, parameters={evil: evil})
    results = Results(Path(evil), (dataclasses.replace(run, record=record),), {Path(evil): evil})
    for shown in (x._repr_html_() for x in (record, results, results.runs[0], problem)):
        assert "&lt;script&gt;" in shown
        assert not re.search("<script|<img|<link|<style|src=|href=|http|\x1b|\u202e|colou?r", shown.lower())


@pytest.mark.parametrize("name", ["Problem", "make_problem", "solve"])
def test_a_problem_is_shown_whatever_is_imported_first(name):
    """Its class lies below what shows it, which comes with the names by which a user gets at problems."""
    words = f"from mbsbench import {name}; from mbsbench.harness.mechanics.types import Problem; Problem._repr_html_"
    subprocess.run([sys.executable, "-c", words], check=True)


def test_plot_has_a_panel_for_each_quantity(run):
    """Five panels, whether the reference is exact or computed."""
    assert len([ax for ax in run.plot().axes if ax.axison]) == 5
    unknown = dataclasses.replace(make_problem("torque_free_body"), name="mine", reference_from=None)
    own = solve(unknown, "gc_weak_form", **SHORT)
    assert own.record.problem == "mine" and own.record.position_error_max_m < 1e-9
    assert len([ax for ax in own.plot().axes if ax.axison]) == 5


def test_runs_of_a_problem_share_a_plot(run):
    """A line for each, named by solver and setting, in the colour that its solver has in reports."""
    finer = solve("torque_free_body", "gc_weak_form", dt=0.005, t_end=0.1)
    other = solve("torque_free_body", "rk45_strong_form", rtol=1e-6, t_end=0.1)
    figure = run.plot(finer, other)
    (legend,) = figure.legends
    said = {
        text.get_text(): line.get_color() for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }
    shown = choose_styles(["gc_weak_form", "rk45_strong_form"])
    for words, solver in (("dt = 0.01 s", "gc_weak_form"), ("dt = 0.005 s", "gc_weak_form"), ("1e-06", "rk45")):
        (name,) = [k for k in said if k.startswith(solver) and k.endswith(words)]
        assert said[name] == shown[name.split(" ")[0].rstrip(",")].colour
    assert len(run.plot(run).axes[0].lines) >= 2  # before and after a change of its solver, with equal settings
    with pytest.raises(ValueError, match=r"runs of one problem \(got torque_free_body and heavy_top\)"):
        run.plot(solve(*TOP, **SHORT))
    with pytest.raises(ValueError, match=r"plot takes runs \(got RunRecord\)"):
        run.plot(other.record)


def test_problem_outside_the_catalogue_is_given_again(tmp_path, run):
    """A file names the problem only: what is in no catalogue cannot be made anew from it."""
    unknown = dataclasses.replace(make_problem("torque_free_body"), name="mine")
    solve(unknown, "gc_weak_form", **SHORT).save(tmp_path / "own.npz")
    with pytest.raises(ValueError, match="unknown problem 'mine'"):
        load(tmp_path / "own.npz").plot()
    again = load(tmp_path / "own.npz", dataclasses.replace(unknown, t_end=0.1))
    assert again.series["t"][-1] == pytest.approx(0.1)


def test_refusal_is_a_result_without_a_motion():
    """The weak form takes no redundant joints; what it says is in the record."""
    refused = solve(make_problem("four_bar_grid", {"rows": 1, "columns": 1}), "gc_weak_form", t_end=0.1)
    assert refused.status is Status.REFUSED and refused.trajectory is None and refused.series is None
    assert "redundant" in refused.record.message
    with pytest.raises(ValueError, match=r"refused, .*redundant"):
        refused.plot()


TOP = "heavy_top", "gc_weak_form"


@pytest.mark.parametrize(
    ("given", "options", "words"),
    [
        (("heavytop", "gc_weak_form"), {}, "unknown problem 'heavytop' - did you mean 'heavy_top'"),
        (("heavy_top", "gc_weakform"), {}, "unknown solver 'gc_weakform' - did you mean 'gc_weak_form'"),
        (TOP, {"dtt": 0.1}, "no option 'dtt' - did you mean 'dt'"),
        (TOP, {"spin": 20.0}, "spin is a parameter of the problem: make_problem"),
        (TOP, {"rtol": 1e-6}, "controlled by dt, not by rtol"),
        (TOP, {"dt": -1.0}, "dt must be a finite number > 0"),
        (TOP, {"t_end": math.nan}, "t_end must be a finite number > 0"),
        (TOP, {"cpu_limit": -1.0}, "cpu_limit must be a finite number > 0"),
        ((make_problem, "gc_weak_form"), {}, "problem must be a name or a Problem"),
        (("heavy_top", Problem), {}, "solver must be a name or a dataclass marked @solver"),
    ],
)
def test_wrong_call_is_one_line(given, options, words):
    with pytest.raises(ValueError, match=re.escape(words)) as caught:
        solve(*given, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["nowhere", "absent.npz", "text.npz", "other.npz"])
def test_what_cannot_be_loaded_is_one_line(name, tmp_path):
    (tmp_path / "text.npz").write_text("no arrays")
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(ValueError, match=name) as caught:
        load(tmp_path / name)
    assert "\n" not in str(caught.value)
