"""A limit on the whole run: what runs is ended with its reason, what has not begun is left and can be resumed."""

import time

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.suites.suite import parse_suite
from mbsbench.harness.judge.gate.check import is_open, judge_runs
from mbsbench.harness.judge.gate.thresholds import Thresholds
from mbsbench.harness.mechanics.types import EndCause
from mbsbench.harness.results import store
from mbsbench.harness.results.findings import Verdict
from mbsbench.harness.results.provisional import is_provisional, list_record_files
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.words import describe_ending
from mbsbench.harness.run.pool import LocalPool
from mbsbench.harness.run.runner import Request, run_suite
from mbsbench.tests.factories import PLUGIN, Silent, run_suite_text

GRACE = 15.0  # [s] over the limit until everything is stored: 10 of them to measure what was kept
TEXT = """
total_limit = 600
[defaults]
cpu_limit = 60
[[runs]]
problem = "free_fall"
solver = "exact"
[[runs]]
problem = "free_fall"
solver = "hangs_later"
[[runs]]
problem = "free_fall"
solver = "spins"
[[runs]]
problem = "free_fall"
solver = ["sleeps", "raises"]
dt = [0.1, 0.2]
"""


class Over(LocalPool):
    """A pool whose time is up once two runs run and one of them has kept steps: no matter how busy the machine is."""

    def _is_over(self) -> bool:
        if self._stopped:
            return True
        kept = [job.spool for job in self._flying.values() if job.spool.is_there() and job.spool.size() > 0]
        return {j.spec.solver for j in self._flying.values()} == {"hangs_later", "spins"} and bool(kept)


def stopped_run(folder):
    watcher = Silent()
    suite = parse_suite(TEXT, "test", "test", plugins=(str(PLUGIN),))
    return suite, run_suite(Request(suite, folder, 2, pool=Over), watcher), watcher


def test_running_runs_are_ended_and_the_rest_is_left(tmp_path):
    """The first run is done; two that never return are killed, the steps one handed over kept; four are left."""
    suite, loaded, watcher = stopped_run(tmp_path / "run")
    ended = {r.solver: r for r in loaded.records}
    assert {s: r.status for s, r in ended.items()} == {
        "exact": "success",
        "hangs_later": "unfinished",
        "spins": "unfinished",
    }
    assert all("limit of 600 s" in describe_ending(ended[s]) for s in ("hangs_later", "spins"))
    assert ended["hangs_later"].steps > 0 and ended["hangs_later"].series and ended["spins"].steps == 0
    assert len(watcher.left) == 4 and all("sleeps" in case or "raises" in case for case in watcher.left)
    verdict = judge_runs(suite.specs, loaded.records, Thresholds("test"))
    words = [f.why for f in verdict if f.quantity == "status" and f.verdict is Verdict.FAILED]
    assert not is_open(verdict) and sum("run is missing" in w for w in words) == 4
    assert sum("limit of 600 s" in w for w in words) == 2


class OverAtOnce(LocalPool):
    """Its time is up as soon as a run runs."""

    def _is_over(self) -> bool:
        return self._stopped or bool(self._flying)


@pytest.mark.sampled(0)
def test_what_the_limit_ended_is_run_again_on_resume(tmp_path):
    """A sound run that had no time is no failure: its record goes aside, and with time enough it succeeds."""
    text = 'total_limit = 600\n[defaults]\nproblem = "free_fall"\n'
    text += '[[runs]]\nsolver = "sleeps"\noptions = { seconds = 1.5 }\n[[runs]]\nsolver = "raises"\n'
    done, first = run_suite_text(tmp_path / "run", text, 1, pool=OverAtOnce)
    (ended,) = done.records
    assert ended.status == "unfinished" and len(first.left) == 1
    loaded, second = run_suite_text(tmp_path / "run", text, 1, resume=True)
    assert {r.solver: r.status for r in loaded.records} == {"sleeps": "success", "raises": "crashed"}
    assert second.set_aside == [f"{ended.run_id}.json"] and len(second.ran) == 2
    assert store.read_record(tmp_path / "run" / "set_aside" / f"{ended.run_id}.json").status == "unfinished"


def test_what_a_run_did_itself_is_no_matter_of_the_run():
    """Its own limit on time, its own crash and what its solver returned stay."""
    lost = {EndCause.SUPERVISOR_LOST, EndCause.WORKERS_LOST}
    passing = {EndCause.TOTAL_LIMIT, EndCause.KILLED, EndCause.SUSPENDED, *lost}
    assert all(is_provisional(RunRecord(ended_by=str(by))) is (by in passing) for by in EndCause)


def test_the_series_of_such_a_record_goes_aside_too(tmp_path):
    """Nothing is deleted, nothing is written over."""
    folder = store.create_folder(tmp_path / "run")
    record = RunRecord(run_id="abc", status="stalled", ended_by="total_limit", series="series/abc.npz", stderr="")
    store.write_record(folder, record)
    (folder / record.series).write_bytes(b"x")
    assert [path.name for path in list_record_files(folder, record)] == ["abc.json", "abc.npz"]


@pytest.mark.sampled(0)
def test_the_run_says_what_is_left(tmp_path, capsys):
    """How many and which, exit code 1; resumed with time enough, it ends in order."""
    suite = tmp_path / "s.toml"
    text = f'plugins = ["{PLUGIN}"]\n[[runs]]\nproblem = "free_fall"\nsolver = "exact"\ndt = [0.1, 0.2, 0.25]\n'
    suite.write_text("total_limit = 1e-3\n" + text)
    line = ["run", str(suite), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert main(line) == 1
    out = capsys.readouterr().err
    left = [x for x in out.splitlines() if x.startswith("not started: ")]
    assert f"{len(left)} runs not started" in out and "--resume runs them" in out
    assert left in [[f"not started: free_fall exact dt={dt}" for dt in (0.1, 0.2, 0.25)][k:] for k in (0, 1)]
    suite.write_text("total_limit = 600\n" + text)
    assert main([*line, "--resume"]) == 0
    assert len(store.load(tmp_path / "out").records) == 3 and "not started" not in capsys.readouterr().err


@pytest.mark.sampled(0)
def test_the_limit_holds_by_cpu_time(tmp_path, begun_here):
    """Deaf solvers included; from the first run on, for what is compiled before has limits of its own."""
    text = TEXT.replace("600", "1.5").replace('["sleeps", "raises"]', '"spins"')
    watcher, begun = Silent(), []
    watcher.on_start = lambda job: begun.append(time.monotonic())
    loaded = run_suite(Request(parse_suite(text, "t", "t", plugins=(str(PLUGIN),)), tmp_path / "run", 2), watcher)
    assert time.monotonic() - begun[0] > 1.0  # at least the time of two processors
    assert sum(r.cpu_process_s for r in loaded.records) < 2 * 1.5 + GRACE
    assert {r.status for r in loaded.records} <= {"success", "unfinished"}
    assert not begun_here()
