"""History: a line a run over the runs, what changed first, and a word when there is nothing to compare."""

import json
import math

import pytest

from mbsbench.reports.model.results import read_results
from mbsbench.reports.pages.change import history
from mbsbench.reports.pages.change.history import gather, has_moved, lines, moments
from mbsbench.reports.pages.svg import sparkline

from ..conftest import HOSTILE, put, record, series
from ..outline import Outline
from .conftest import render


def run_folder(parent, name, commit, runs):
    folder = parent / name
    for run in runs:
        put(folder, run, series(40))
    stamp = {"run": name, "started": f"2026-01-0{name[-1]}T00:00:00Z", "commit": commit, "cpu": "a processor"}
    (folder / "environment.json").write_text(json.dumps(stamp))
    return folder


@pytest.fixture
def three_runs(tmp_path, monkeypatch):
    """aa01 stays, aa02 drifts more, aa03 becomes wrong, aa05 drifts less, aa04 is new in the last."""
    monkeypatch.setattr(history, "COMMITTED", tmp_path / "none")
    for k in (1, 2, 3):
        commit = str(k) * 40
        runs = [record("aa01", commit=commit), record("aa02", commit=commit, energy_drift_max_J=1e-3 * 10.0**k),
                 record("aa03", commit=commit, status="wrong" if k == 3 else "success", case=HOSTILE),
                record("aa05", commit=commit, energy_drift_max_J=10.0 ** (3 - 3 * k))]  # fmt: skip
        runs += [record("aa04", commit=commit)] if k == 3 else []
        run_folder(tmp_path, f"run-{k}", commit, runs)
    return read_results(tmp_path / "run-3")


def test_a_worse_ending_comes_first_then_the_digits_lost_then_what_got_better(three_runs, tmp_path):
    rows, bad = gather(three_runs, tmp_path / "none")
    found = lines(three_runs, rows)
    assert bad == []
    assert [line.settings for line in found][:3] == ["aa03", "aa02", "aa05"]
    assert [line.changed for line in found] == [True, True, True, False, False]
    assert found[1].values("energy_drift_max_J") == pytest.approx((0.01, 0.1, 1.0))
    assert [m.kind for m in found[0].marks] == ["good", "good", "wrong"]
    assert len(found[4].rows) == 1 and found[2].lost == pytest.approx(-6.0)


def test_runs_are_listed_in_their_order_with_their_endings(three_runs, tmp_path):
    found = moments(gather(three_runs, tmp_path / "none")[0])
    assert [m["results"] for m in found] == ["run-1", "run-2", "run-3"]
    assert [(m.word, n) for m, n in found[2]["counts"]] == [("success", 4), ("wrong", 1)]


def test_page_of_three_commits(three_runs):
    html = render(three_runs, [history])["history.html"]
    assert "<script>alert" not in html and HOSTILE in Outline(html).plain
    assert "3 folders, 3 commits" in Outline(html).plain and "no history yet" not in html


def test_one_commit_has_no_page(tmp_path, monkeypatch):
    monkeypatch.setattr(history, "COMMITTED", tmp_path / "none")
    results = read_results(run_folder(tmp_path, "run-1", "1" * 40, [record("aa01", commit="1" * 40)]))
    assert "history.html" not in render(results, [history])


def test_a_file_of_rows_that_cannot_be_read_is_named(three_runs, tmp_path):
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / "odd.jsonl").write_text("{")
    rows, bad = gather(three_runs, tmp_path / "rows")
    assert len(rows) == 13 and len(bad) == 1 and "odd.jsonl" in bad[0]


def test_less_than_a_hundredth_is_no_move():
    assert not has_moved([1.0, 1.005, math.nan], 0.0)
    assert has_moved([1.0, 1.02], 0.0) and not has_moved([1e-12, 1e-11], 1e-9) and not has_moved([1.0], 0.0)


def test_a_hair_is_drawn_flat_and_a_decade_is_not():
    def heights(svg) -> set[str]:
        return {p.split(",")[1] for p in svg.split('points="')[1].split('"')[0].split()}

    assert len(heights(sparkline([1.0, 1.0001, 0.9999], "x"))) == 1
    assert len(heights(sparkline([1.0, 10.0, 100.0], "x"))) == 3
    assert len(heights(sparkline([0.0, 0.0], "x"))) == 1
