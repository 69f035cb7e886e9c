"""Records that a solver writes: of runs that never began, of its own run, in place of another. None is a result."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.results import environment, store
from mbsbench.harness.results.records import format_record
from mbsbench.harness.run.runner import Request, _make_jobs
from mbsbench.harness.run.started_runs import StartedRuns
from mbsbench.tests.factories import PLUGIN, run_suite_text

from .record_forger import FORGED

FORGER = Path(__file__).with_name("record_forger.py")
LIMITED = """
total_limit = 2.0
[[runs]]
problem = "free_fall"
solver = ["forges_records", "exact", "sleeps", "gives_up"]
"""
PLUGINS = (PLUGIN, FORGER)


@pytest.fixture(scope="module")
def true_record(tmp_path_factory):
    """The record of a run that did succeed."""
    text = '[[runs]]\nproblem = "free_fall"\nsolver = "exact"'
    return run_suite_text(tmp_path_factory.mktemp("forged") / "true", text, 1, plugins=PLUGINS)[0].records[0]


def forge(true, folder, text):
    """The files of successes of all runs of the suite, made of a ``true`` one: by path."""
    suite = parse_suite(text, "test", "test", plugins=tuple(map(str, PLUGINS)))
    jobs = _make_jobs(Request(suite, folder, 1), folder, "")
    out = {}
    for job in jobs:
        record = dataclasses.replace(
            true,
            run_id=job.id,
            settings_id=job.spec.settings_id,
            case=job.spec.case,
            code=job.code,
            solver=job.spec.solver,
            series="",
            series_sha256="",
        )
        body = format_record(record)
        plain = {"sha256": store._digest(body), "record": body}
        out[str(store.locate_record(folder, job.id).path)] = json.dumps(plain)
    return out, jobs


@pytest.mark.sampled(0)
def test_records_of_runs_that_never_began_are_set_aside(true_record, tmp_path, monkeypatch):
    """The suite meets its limit while the first solver works: the successes that it wrote are none, nor later."""
    folder = tmp_path / "run"
    files, jobs = forge(true_record, folder, LIMITED)
    monkeypatch.setenv(FORGED, json.dumps(files))
    loaded, watcher = run_suite_text(folder, LIMITED, 1, plugins=PLUGINS)
    assert [r.status for r in loaded.records] == ["unfinished"] and len(watcher.left) == len(jobs) - 1
    assert len(list((folder / "set_aside").glob("*.json"))) == len(jobs) - 1
    assert "something else wrote its record" in (folder / "set_aside" / "why.txt").read_text()
    monkeypatch.setenv(FORGED, "{}")
    again, watcher = run_suite_text(folder, LIMITED, 1, plugins=PLUGINS, resume=True)
    assert len(watcher.ran) == 1 and [r.status for r in again.records] == ["unfinished"]


@pytest.mark.sampled(0)
@pytest.mark.parametrize("how", ["interrupted", "killed"])
def test_records_of_runs_that_never_began_are_none_after_ctrl_c_or_a_kill(true_record, tmp_path, monkeypatch, how):
    """The command itself ends, by Ctrl-C or SIGKILL; --resume begins these runs, and counts none as done."""
    folder, suite = tmp_path / "run", tmp_path / "s.toml"
    text = 'name = "test"\n' + LIMITED.replace("2.0", "60.0")
    suite.write_text(text)
    files, jobs = forge(true_record, folder, text)
    line = [sys.executable, "-m", "mbsbench.cli", "run", str(suite), "--out", str(folder), "--jobs", "1"]
    line += [word for plugin in PLUGINS for word in ("--plugin", str(plugin))]
    process = subprocess.Popen(
        line,
        cwd=environment.ROOT,
        env={**os.environ, FORGED: json.dumps(files)},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
    )
    until = time.monotonic() + 60.0
    while len(list(folder.glob("runs/*.json"))) < len(files) and time.monotonic() < until:
        time.sleep(0.05)
    while any(p.stat().st_size < 1000 for p in folder.glob("runs/*.json")):  # until the last one is whole
        time.sleep(0.05)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT if how == "interrupted" else signal.SIGKILL)
    out, _ = process.communicate(timeout=60)
    assert process.returncode != 0 and "4 success" not in out
    monkeypatch.setenv(FORGED, "{}")
    _, watcher = run_suite_text(folder, text.replace("60.0", "2.0"), 1, plugins=PLUGINS, resume=True)
    own = [job.id for job in jobs if job.spec.solver == "forges_records"]
    begun = how == "killed"  # of the one that had begun nobody can tell, once its runner is killed
    assert len(watcher.set_aside) == (len(jobs) - len(own) if begun else 0), watcher.set_aside
    assert len(watcher.ran) == (len(jobs) - len(own) if begun else 1)


def test_a_record_that_the_supervisor_did_not_store_is_no_result(tmp_path, monkeypatch):
    """Its digest is its own, but not that of which the supervisor told: what stands there was put in its place."""
    written = store.read_record

    def other(place):
        return dataclasses.replace(written(place), cpu_median_s=1e-9)

    monkeypatch.setattr(store, "read_record", other)
    with pytest.raises(RuntimeError, match="not as they were written"):
        run_suite_text(tmp_path / "run", '[[runs]]\nproblem = "free_fall"\nsolver = "exact"', 1)


def test_results_without_a_list_of_begun_runs_are_read_as_they_are(tmp_path):
    """Published ones and those of older versions have none; an orderly end leaves none."""
    text = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "sleeps"]'
    run_suite_text(tmp_path / "run", text, 1)
    assert StartedRuns(tmp_path / "run").read() is None
    _, watcher = run_suite_text(tmp_path / "run", text, 1, resume=True)
    assert watcher.ran == [] and watcher.set_aside == []


@pytest.mark.sampled(0)
def test_a_record_that_another_solver_changes_is_no_result(true_record, tmp_path, monkeypatch):
    """Of a run that is over, with a digest that fits: it is set aside, counted, and done again."""
    text = LIMITED.replace('["forges_records", "exact", "sleeps", "gives_up"]', '["exact", "forges_records"]')
    folder = tmp_path / "run"
    files, _ = forge(true_record, folder, text)
    monkeypatch.setenv(FORGED, json.dumps({path: files[path] for path in list(files)[:1]}))
    with pytest.raises(RuntimeError, match=r"1 of 2 results .* not as they were written"):
        run_suite_text(folder, text, 1, plugins=PLUGINS)
    assert [r.solver for r in store.load(folder).records] == ["forges_records"]
    monkeypatch.setenv(FORGED, "{}")
    again, watcher = run_suite_text(folder, text, 1, plugins=PLUGINS, resume=True)
    assert len(watcher.ran) == 2 and "success" in {r.status for r in again.records}


@pytest.mark.sampled(0)
def test_a_record_of_an_earlier_command_that_changes_is_no_result(true_record, tmp_path, monkeypatch):
    """It was there when the command began; what stands there at its end is another."""
    text = LIMITED.replace('["forges_records", "exact", "sleeps", "gives_up"]', '["exact", "forges_records"]')
    folder = tmp_path / "run"
    run_suite_text(folder, text.replace(', "forges_records"', ""), 1, plugins=PLUGINS)
    files, _ = forge(true_record, folder, text)
    monkeypatch.setenv(FORGED, json.dumps({path: files[path] for path in list(files)[:1]}))
    with pytest.raises(RuntimeError, match="not as they were written"):
        run_suite_text(folder, text, 1, plugins=PLUGINS, resume=True)


@pytest.mark.sampled(0)
def test_records_of_other_runs_are_said_at_the_end(true_record, tmp_path, monkeypatch, capsys):
    """Of the rest of a suite, which this command did not ask for: set aside, named, exit code 1."""
    monkeypatch.chdir(tmp_path)
    text = LIMITED.replace('["forges_records", "exact", "sleeps", "gives_up"]', '["forges_records", "exact"]')
    (tmp_path / "suite.toml").write_text(text)
    files, _ = forge(true_record, tmp_path / "run", text)
    monkeypatch.setenv(FORGED, json.dumps({path: files[path] for path in list(files)[1:]}))
    plugins = [word for path in PLUGINS for word in ("--plugin", str(path))]
    assert main(["run", "suite.toml", "--limit", "1", "--jobs", "1", "--out", "run", *plugins]) == 1
    assert "something else wrote its record" in " ".join(capsys.readouterr().err.split())
    assert len(list((tmp_path / "run" / "runs").glob("*.json"))) == 1
