"""History: the same run over runs and commits, from folders and from small files."""

import dataclasses
import json
import math

import pytest
from msgspec.structs import fields

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError, to_json, write_text
from mbsbench.harness.results import store
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.history import find_histories, merge_rows, read_folder, read_rows, write_rows
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.rows import METRICS, Row


def load_history(folders, files=()):
    """All rows of the folders and files."""
    return merge_rows(map(read_folder, folders), map(read_rows, files))


def folder(place, name, commit, started, cpu="one", **specs: tuple[str, float, float]):
    """A run folder whose runs have these (status, drift, CPU time)."""
    run = store.create_folder(place / name)
    for n, (settings, (status, drift, seconds)) in enumerate(specs.items()):
        store.write_record(
            run,
            RunRecord(
                run_id=f"{commit}{n}",
                settings_id=settings,
                case=f"p s[{settings}]",
                problem="p",
                solver="s",
                status=status,
                commit=commit,
                energy_drift_max_J=drift,
                cpu_min_s=seconds,
            ),
        )
    write_text(run / "environment.json", json.dumps({"started": started, "cpu": cpu}))
    return run


@pytest.fixture
def three(tmp_path):
    """Two runs on one machine, the later one slower and worse, and one on another machine in between."""
    return [
        folder(tmp_path, "c-3", "ccc", "2026-03-01", a=("success", 4e-3, 2.0), b=("wrong", 9.0, 1.0)),
        folder(tmp_path, "a-1", "aaa", "2026-01-01", a=("success", 1e-3, 0.5), b=("success", 1.0, 1.0)),
        folder(tmp_path, "b-2", "bbb+dirty", "2026-02-01", cpu="two", a=("success", 1e-3, 7.0)),
    ]


def test_rows_are_in_order_of_time_with_ratios_on_the_same_processor(three):
    """4 times the CPU time of the first run; another processor starts its own line; a wrong run has no ratio."""
    rows = load_history(three)
    assert [(r.commit, r.settings_id) for r in rows] == [
        ("aaa", "a"),
        ("aaa", "b"),
        ("bbb+dirty", "a"),
        ("ccc", "a"),
        ("ccc", "b"),
    ]
    ratios = [r.cpu_ratio for r in rows]
    assert ratios[:4] == [1.0, 1.0, 1.0, 4.0] and math.isnan(ratios[4])
    assert [r.energy_drift_max_J for r in rows if r.settings_id == "a"] == [1e-3, 1e-3, 4e-3]


def test_of_two_results_of_a_run_the_newest_is_the_row(tmp_path):
    """A folder gone on with at newer code holds both."""
    run = folder(tmp_path, "run", "b", "2026-01-01", a=("success", 1e-3, 1.0))
    (record,) = store.load(run).records
    for spec, finished, status in (("a", "2026-01-02", "wrong"), ("c", "2026-01-01", "crashed")):
        store.write_record(run, dataclasses.replace(record, run_id=spec, finished=finished, status=status))
    assert [r.status for r in load_history([run])] == ["wrong"]


def test_files_of_rows_add_what_folders_no_longer_hold(three, tmp_path):
    """Written, read, and mixed with folders: each run of a run once, ratios made anew."""
    file = tmp_path / "kept" / "old.jsonl"
    write_rows(file, load_history(three[1:]))
    both, folders = ([to_json(r) for r in load_history(three, more)] for more in ([file], []))  # NaN is NaN in text
    assert both == folders
    assert [r.cpu_ratio for r in load_history(three[:1], [file])][3] == 4.0
    assert all(json.loads(line)["cpu_ratio"] is None for line in file.read_text().splitlines())


GOOD = json.loads(to_json(Row(*["x"] * 10)))
WRONG = ({"phi_max": 10**400}, {"phi_max": "1"}, {"steps": True}, {"case": 3}, {"gate": None})
NO_ROWS = ["{", "[]", "3", "{}", '{"commit": 1}', "null", *(json.dumps({**GOOD, **bad}) for bad in WRONG)]


@pytest.mark.parametrize("line", NO_ROWS, ids=range(len(NO_ROWS)))
def test_other_files_and_wrong_types_are_reported_in_one_line(tmp_path, line):
    (tmp_path / "x.jsonl").write_text(f"\n{line}\n")
    with pytest.raises(FileError, match=r"x\.jsonl:2: "):
        read_rows(tmp_path / "x.jsonl")


def test_what_stands_is_found(three, tmp_path):
    """Run folders but no links, committed files and the gate's."""
    (tmp_path / "latest").symlink_to(three[0].name)
    write_rows(tmp_path / "history" / "gate.jsonl", load_history(three[:1]))
    write_rows(tmp_path / "committed" / "old.jsonl", load_history(three[1:2]))
    folders, files = find_histories(tmp_path, tmp_path / "committed")
    assert [f.name for f in folders] == ["a-1", "b-2", "c-3"] and [f.name for f in files] == ["old.jsonl", "gate.jsonl"]


def test_the_command_prints_one_line_per_run(three, capsys, monkeypatch):
    """First, last, a sparkline; JSON for machines."""
    monkeypatch.setenv("COLUMNS", "80")
    names = [str(f) for f in three]
    assert main(["history", *names]) == 0
    out = capsys.readouterr().out
    assert all(len(line) <= 80 for line in out.splitlines())
    line = next(x for x in out.splitlines() if x.startswith("p s[a]"))
    assert "0.001" in line and "0.004" in line and "█" in line and "2 runs in 3 results folders" in out
    assert main(["history", *names, "--json"]) == 0
    rows = [json.loads(x) for x in capsys.readouterr().out.splitlines()]
    assert len(rows) == 5 and {*METRICS} < {*rows[0]} and rows[-1]["cpu_ratio"] is None


def test_the_command_goes_on_without_damaged_files(three, tmp_path, capsys, monkeypatch):
    """They are named on standard error, with exit code 1; named by the caller they are a wrong call."""
    monkeypatch.chdir(tmp_path)
    bad = tmp_path / "results" / "history" / "bad.jsonl"
    bad.parent.mkdir(parents=True)
    bad.write_text("x")
    assert main(["history"]) == 1
    assert "bad.jsonl:1: not JSON" in capsys.readouterr().err
    assert main(["history", str(bad)]) == 2


def test_a_row_is_all_that_pages_need():
    text = (ROOT / "docs" / "results-format.md").read_text()
    assert all(f"`{f.name}`" in text for f in fields(Row))
