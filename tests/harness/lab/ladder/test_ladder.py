"""Submissions are run on what nobody could prepare for, and ranked by what they solve, then by cost."""

import dataclasses
import itertools
import json
import tomllib
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.cli.lab import submit
from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.base.forked_process import ProcessEnd
from mbsbench.harness.catalogue import registry
from mbsbench.harness.lab.ladder import blind, bundling, submission
from mbsbench.harness.lab.ladder.bundling import Entry, read_entry
from mbsbench.harness.lab.ladder.instances import KINDS, WITHIN, digest_submission, draw_instances
from mbsbench.harness.lab.ladder.ranking import OURS, average_geometrically, rank_entries
from mbsbench.harness.lab.ladder.submission import RefusedSubmission, read_submission, run_submission
from mbsbench.reports.lab.ladder import write_page
from mbsbench.tests.factories import make_record

from .forgeries.test_submissions import SHORT, TEXT

ENDED = ProcessEnd(0, killed=False, sent="", peak=1.0, cpu=1.0)


def test_instances_follow_from_submission_and_seed_alone():
    """Drawn again they are the same; for another submission or seed every number is another, within a percent."""
    first = draw_instances("a", "1")
    assert first == draw_instances("a", "1")
    for other in (draw_instances("b", "1"), draw_instances("a", "2")):
        for x, y, kind in zip(first, other, KINDS, strict=True):
            assert all(x.parameters[name] != y.parameters[name] for name in (*kind.changed, "rotation", "unit_mass"))
    for x, kind in zip(first, KINDS, strict=True):
        for name, value in kind.changed.items():
            assert abs(x.parameters[name] / value - 1.0) <= WITHIN, name
        assert registry.make_problem(x.problem, x.parameters).presentation.renumber


def make_solved(problem="p", status="success", error=1e-6, cpu=1.0, dt=0.1):
    """The record of a run of an entry, with its error and CPU time."""
    settings = {"run_id": "a", "case": "c", "problem": problem, "solver": "s", "control": "dt", "dt_s": dt}
    return make_record(**settings, status=status, motion_error_max_m=error, length_scale_m=1.0, cpu_median_s=cpu)


def entry(name, *records):
    return Entry(f"{name}.zip", name, name, "1", records)


def test_a_false_success_ranks_below_no_answer():
    """And a forgery has no rank."""
    rows = rank_entries(
        [
            (entry("false", make_solved(), make_solved("q", "wrong")), OURS),
            (entry("silent", make_solved(), make_solved("q", "refused")), OURS),
            (entry("all", make_solved(), make_solved("q")), OURS),
            (dataclasses.replace(entry("forged", make_solved(), make_solved("q")), forged=("changed",)), OURS),
        ]
    )
    assert [(r.solver, r.rank, r.points) for r in rows] == [
        ("all", 1, 2),
        ("silent", 2, 1),
        ("false", 3, 0),
        ("forged", 0, 0),
    ]


def test_cost_decides_between_equal_points_and_the_frontier_needs_a_sure_difference():
    """Of two that solve all, the cheaper is first; one within its interval still leads."""

    def of(name, cpu, error):
        return entry(name, *(make_solved(f"p{k}", cpu=cpu * (1.0 + 0.01 * k), error=error) for k in range(5)))

    rows = rank_entries([(of("dear", 2.0, 1e-6), OURS), (of("cheap", 1.0, 1e-6), OURS), (of("exact", 3.0, 1e-9), OURS)])
    assert [(r.solver, r.leads) for r in rows] == [("cheap", True), ("dear", False), ("exact", True)]


def test_the_interval_of_equal_costs_is_a_point_and_holds_the_mean():
    """No spread, no doubt; with spread the mean lies inside."""
    same, spread = average_geometrically(np.full(5, 2.0)), average_geometrically(np.array([1.0, 2.0, 4.0]))
    assert same.low == pytest.approx(2.0) == same.high
    assert spread.low < spread.value < spread.high and spread.value == pytest.approx(2.0)


def test_what_cannot_be_a_submission_is_refused_in_a_line(tmp_path):
    """No file; a file without a solver; one that leaves at import."""
    with pytest.raises(RefusedSubmission, match="no file"):
        read_submission(str(tmp_path / "none.py"))
    for k, text in enumerate(("x = 1", "import os\nos._exit(0)", "raise SystemExit")):
        file = tmp_path / f"bad{k}.py"
        file.write_text(text)
        with pytest.raises(RefusedSubmission, match="one solver"):
            read_submission(str(file))


@pytest.mark.sampled(0)
def test_submit_and_ladder_from_the_command_line(tmp_path, monkeypatch, capsys):
    """A bundle of an honest and of a false solver; the page names both, escaped, and the label of each."""
    monkeypatch.setattr(submit, "run_submission", partial(run_submission, kinds=SHORT, repeats=1))
    monkeypatch.setattr(submit, "read_entry", partial(read_entry, kinds=SHORT))
    monkeypatch.setattr(submit, "name_new_folder", lambda name: tmp_path / f"{name}{len(list(tmp_path.iterdir()))}")
    for name, how, code in (("good", "nothing", 0), ("bad", "gravity too small", 1)):
        (tmp_path / f"{name}.py").write_text(TEXT.format(how))
        line = ["submit", str(tmp_path / f"{name}.py"), "-o", str(tmp_path / f"{name}.zip"), "--json"]
        assert main(line) == code
        out = capsys.readouterr()
        plain = json.loads(out.out)
        assert plain["solved"] == (code == 0) and plain["trial"] is True and "trial: " in out.err
        assert plain["fenced"] is ("not fenced" not in out.err)
        assert plain["digest"] == digest_submission((tmp_path / f"{name}.py").read_bytes())
        assert main(["submit", str(tmp_path / f"{name}.py"), "--digest"]) == 0
        assert capsys.readouterr().out.split() == [plain["digest"]]
    rows = rank_entries([(read_entry(tmp_path / f"{name}.zip", SHORT), "<ours>") for name in ("bad", "good")])
    assert [(r.file, r.points) for r in rows] == [("good.zip", 1), ("bad.zip", -1)]
    write_page(tmp_path / "index.html", rows)
    page = (tmp_path / "index.html").read_text()
    assert "&lt;ours&gt;" in page and "good.zip" in page and "<ours>" not in page
    assert main(["ladder", str(tmp_path)]) == 1  # neither holds all instances of the ladder
    said = capsys.readouterr().out
    assert "removed" in said and "trial: " in said
    assert main(["ladder", str(tmp_path), "--json"]) == 1
    plain = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(p["rank"], p["trial"]) for p in plain] == [(None, True)] * 2
    assert main(["ladder", str(tmp_path / "runs")]) == 2


def test_all_is_solved_before_any_reference_is_computed(tmp_path, monkeypatch):
    """Else a later run could read what an earlier one's measure left."""
    order = []
    monkeypatch.setattr(submission, "_solve_blind", lambda *_: order.append("solve") or SimpleNamespace(sent=""))
    monkeypatch.setattr(submission, "_measure_in_process", lambda run: order.append("measure"))
    made = submission.Submission("s", "dt", "", "a")
    run_submission(made, "1", tmp_path / "run", kinds=SHORT, repeats=1, blind=object())
    assert len(order) > 2 and order == sorted(order, reverse=True)


def test_solved_is_a_thousandth_of_the_length():
    """As trust.md says."""
    rows = rank_entries(
        [(entry("near", make_solved(error=0.9e-3)), OURS), (entry("far", make_solved(error=1.1e-3)), OURS)]
    )
    assert [(r.solver, r.points) for r in rows] == [("near", 1), ("far", 0)]


def test_what_is_called_compilation_is_limited_for_submissions(tmp_path, monkeypatch):
    """Of solvers of the catalogue it is left out."""
    seen = []
    monkeypatch.setattr(
        blind, "WatchedProcess", lambda work, **k: seen.append(k["code"]) or SimpleNamespace(wait=lambda: ENDED)
    )
    for plugin in ("a.py", ""):
        blind._run_task(blind.BlindTask(None, None, "s", plugin, tmp_path, ConfinedPath(tmp_path) / "e", 20.0, 500.0))
    assert seen == [0.0, blind.CODE_LIMIT]


@pytest.mark.parametrize("first", [[blind.FENCED] * 3, [blind.FENCED, "", blind.FENCED]])
def test_one_run_without_a_fence_marks_the_entry(tmp_path, monkeypatch, first):
    """Each run's process says whether it is shut in, not the one that looked at the file."""
    said = itertools.cycle(first)
    monkeypatch.setattr(submission, "_solve_blind", lambda *_: replace(ENDED, sent=next(said)))
    monkeypatch.setattr(submission, "_measure_in_process", lambda run: None)
    made = submission.Submission("s", "dt", "", "a", fenced=True)
    run_submission(made, "1", tmp_path / "run", kinds=SHORT, repeats=1, blind=object())
    about = tomllib.loads((tmp_path / "run" / "suite.toml").read_text())
    assert about["fenced"] is ("" not in first)


def test_what_a_submission_sends_says_nothing_of_its_fence(tmp_path, monkeypatch):
    """Its lines come after the one that its process sent before there was a submission."""
    loaded = []
    monkeypatch.setattr(blind, "confine_process", lambda folder: loaded.append("shut in") or False)
    send = lambda word: loaded.append(word)  # noqa: E731
    task = blind.BlindTask(
        None, None, "s", str(tmp_path / "none.py"), tmp_path, ConfinedPath(tmp_path) / "e", 20.0, 5000.0
    )
    monkeypatch.setattr(blind.registry, "load_plugin", lambda file: send(blind.FENCED))
    blind.attempt_solve(task, send)
    assert loaded == ["shut in", "", blind.FENCED]
    assert blind._run_task(task).sent == ""


def test_the_checker_has_cpu_time_and_no_other_clock(tmp_path, monkeypatch):
    """A checker that waits is given all the time that a busy machine takes; one that works without end is ended."""
    program = tmp_path / "checker.py"
    monkeypatch.setattr(bundling, "CHECKER", program)
    monkeypatch.setattr(bundling, "CHECK_LIMIT", 1.0)
    program.write_text("import time\ntime.sleep(3.0)\nprint('0 of 9 disagree')\n")
    assert bundling.check_bundle(tmp_path / "b.zip") == []
    program.write_text("while True: pass\n")
    assert bundling.check_bundle(tmp_path / "b.zip") == ["the checker timed out after 1 s"]
    program.write_text("print('1 of 9 disagrees')\nprint('a line')\nraise SystemExit(1)\n")
    assert bundling.check_bundle(tmp_path / "b.zip") == ["a line"]
