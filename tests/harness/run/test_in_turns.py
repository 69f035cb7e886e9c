"""Paired timing: runs of one problem take turns, and the records hold the times of the turns."""

import json
import math

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results import store
from mbsbench.harness.results.records import RunRecord, format_record
from mbsbench.harness.run import in_turns
from mbsbench.tests.factories import PLUGIN

SUITE = f"""
name = "pair"
plugins = ["{PLUGIN}"]
[[runs]]
problem = "free_fall"
solver = ["exact", "raises"]
dt = [0.1, 0.2]
"""


def test_each_run_is_timed_once_a_turn_and_a_slow_one_is_not_repeated(monkeypatch):
    """A B A B; with no budget A B."""
    runs = [RunRecord(problem="free_fall", solver="exact", dt_s=dt) for dt in (0.1, 0.2)]
    order = []

    def timed(solver, problem, control, repeats):
        order.append(control.dt)
        return None, {"cpu_min_s": 1.0}

    monkeypatch.setattr(in_turns, "solve_repeatedly", timed)
    assert in_turns.take_turns(runs, 3) == [[1.0] * 3] * 2
    assert order == [0.1, 0.2] * 3
    assert in_turns.take_turns(runs, 3, budget=-1.0) == [[1.0]] * 2


@pytest.mark.sampled(0)
def test_records_hold_the_times_of_the_turns_and_nothing_else_changes(tmp_path, capsys):
    """Runs that crashed are not timed; timing again replaces the note."""
    (tmp_path / "pair.toml").write_text(SUITE)
    line = ["run", str(tmp_path / "pair.toml"), "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert main(line) == 0
    before = {r.run_id: r for r in store.load(tmp_path / "out").records}
    for turns in ("2", "3"):
        assert main([*line, "--resume", "--in-turns", turns]) == 0
    after = {r.run_id: r for r in store.load(tmp_path / "out").records}
    assert before.keys() == after.keys()
    for run_id, old in before.items():
        new = after[run_id]
        if old.solver == "raises":
            assert format_record(new) == format_record(old)
            continue
        assert (new.repeats, new.energy_drift_max_J, new.series_sha256) == (
            3,
            old.energy_drift_max_J,
            old.series_sha256,
        )
        assert 0.0 <= new.cpu_min_s <= new.cpu_median_s <= new.cpu_max_s < math.inf
        assert [n for n in json.loads(new.notes) if "turns" in n] == [
            "CPU times: 3 turns in one process, 2 runs of the problem in turns"
        ]
