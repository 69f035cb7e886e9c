"""Two result sets: what changed, which input may be why; a sample run again agrees bit for bit."""

import dataclasses
import json

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results import store
from mbsbench.harness.results.comparison import compare, is_repeatable
from mbsbench.harness.results.findings import Verdict
from mbsbench.harness.results.provenance import describe_differences, find_differences, is_same_platform
from mbsbench.harness.results.records import RunRecord
from mbsbench.tests.factories import PLUGIN

BASE = RunRecord(
    run_id="a",
    settings_id="a",
    case="p s dt=0.1",
    problem="p",
    solver="s",
    status="success",
    control="dt",
    steps=10,
    energy_drift_max_J=1e-3,
    energy_scale_J=1.0,
    length_scale_m=1.0,
    phi_max=1e-5,
)


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({}, None),
        ({"wall_s": 3.0}, None),
        ({"energy_drift_max_J": 1e-3 * (1 + 1e-9)}, Verdict.MET),
        ({"energy_drift_max_J": 1.01e-3}, Verdict.FAILED),
        ({"steps": 11}, Verdict.FAILED),
        ({"status": "wrong"}, Verdict.FAILED),
        ({"phi_max": float("nan")}, Verdict.FAILED),
        ({"phi_max": float("inf")}, Verdict.FAILED),
    ],
)
def test_differences_are_distinguished(change, verdict):
    """Times are not compared; a last digit is rounding; one step, a status or a lost number is a change."""
    found = compare([BASE], [dataclasses.replace(BASE, **change)])
    assert {c.verdict for c in found.changes} == ({verdict} if verdict else set())
    assert found.alike == (verdict is not Verdict.FAILED) and found.is_identical == (verdict is None)


def test_runs_that_come_and_go_are_named():
    found = compare([BASE], [dataclasses.replace(BASE, settings_id="b", case="new")])
    assert found.only_before == (BASE.case,) and found.only_after == ("new",) and not found.alike


def test_of_two_results_of_a_run_the_newest_counts():
    """A resumed folder holds those of older code too, in no order."""
    old, new = (
        dataclasses.replace(BASE, run_id=x, finished=x, phi_max=y)
        for x, y in (("2026-01-01", 9.0), ("2026-01-02", 1.0))
    )
    for folder in ([old, new], [new, old]):
        assert compare(folder, [new]).is_identical and not compare(folder, [old]).is_identical


def test_limits_make_a_run_unrepeatable():
    """Where the clock decides how far a run gets, two runs differ by right."""
    assert is_repeatable(BASE) and not is_repeatable(dataclasses.replace(BASE, status="stalled"))


def test_inputs_that_differ_are_named():
    """A package, the machine, the code with the files that changed between two commits."""
    stamp = {"code": "1", "python": "3.11.1", "packages": {"numpy": "2.1", "scipy": "1.15"}, "cpu": "x", "commit": "c"}
    other = {**stamp, "code": "2", "packages": {"numpy": "2.2"}, "dirty": True}
    words = describe_differences(find_differences(stamp, other))
    assert "code" in words and "numpy 2.1 -> 2.2" in words and "scipy" in words and "uncommitted" in words
    assert is_same_platform(stamp, {**stamp, "code": "2"}) and not is_same_platform(stamp, other)
    assert "not deterministic" in describe_differences(find_differences(stamp, stamp))
    assert "missing" in describe_differences(find_differences({}, stamp))
    one, two = ({"internal_api": name, "num_threads": 1} for name in ("openblas", "openmp"))
    there, back = {**stamp, "blas": [one, two]}, {**stamp, "blas": [two, one]}
    assert is_same_platform(there, back) and not find_differences(there, back)  # the order of imports means nothing
    assert not is_same_platform(there, {**stamp, "blas": [one]})


SUITE = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "gives_up", "refuses", "raises"]\ndt = [0.25, 0.5]\n'
WITH = ("--plugin", str(PLUGIN))


@pytest.mark.sampled(0)
def test_verify_and_diff(command, tmp_path, capsys, monkeypatch):
    """The same code: every run again bit for bit. A record that says otherwise: found, with its numbers."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(SUITE)
    assert main(["run", "small.toml", *WITH, "--out", "a"]) == 0
    older = {"code": "older", "run_id": "0" * 16, "finished": "2000", "series": ""}  # of a run that is there anew
    store.write_record(tmp_path / "a", dataclasses.replace(store.load(tmp_path / "a").records[0], **older))
    capsys.readouterr()
    assert main(["verify", "a", *WITH, "--sample", "8"]) == 0
    good = capsys.readouterr().out
    assert "verified: 8 of 8" in good and "bit for bit" in good
    damaged = tmp_path / "a" / "runs" / "damaged.json"
    damaged.write_text("{")
    assert main(["verify", "a", *WITH, "--sample", "1", "--json"]) == 1
    told = capsys.readouterr()
    assert json.loads(told.out)["same"] and "damaged.json" in told.err
    damaged.unlink()
    assert command("verify", "a").returncode == 2  # without the plugin its runs cannot be run
    folder, other = tmp_path / "a", tmp_path / "b"
    store.create_folder(other)
    for record in store.load(folder).records:
        told = dataclasses.replace(record, series="", energy_drift_max_J=record.energy_drift_max_J + 1e-3)
        store.write_record(other, told)
    stamp = json.loads((folder / "environment.json").read_text())
    (other / "environment.json").write_text(json.dumps({**stamp, "cpu": "z"}))
    assert main(["diff", "a", "b"]) == 1
    changed = capsys.readouterr().out
    assert "energy_drift_max_J" in changed and "processor" in changed
    assert main(["diff", "a", "b", "--json"]) == 1
    plain = json.loads(capsys.readouterr().out)
    assert not plain["same"] and plain["compared"] == 8 and plain["inputs"][0]["after"] == "z"
    assert main(["diff", "a", "a"]) == 0
    capsys.readouterr()
    assert main(["verify", "b", *WITH, "--sample", "3", "--json"]) == 1
    assert not json.loads(capsys.readouterr().out)["same"]
