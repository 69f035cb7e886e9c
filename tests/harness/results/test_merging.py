"""Shards are disjoint and whole; merged they are the run that one machine would have made."""

import dataclasses
import json

import pytest

from mbsbench.harness.base.files import FileError
from mbsbench.harness.results import environment, stamps, store
from mbsbench.harness.results.merging import find_mixed_codes, merge
from mbsbench.tests.factories import run_suite_text

from ..conftest import TIMED

TEXT = '[[runs]]\nproblem = "free_fall"\nsolver = ["exact", "gives_up", "raises"]\ndt = [0.1, 0.5]'


def run_shard(folder, shard=(1, 1), **more):
    return run_suite_text(folder, TEXT, shard=shard, **more)[0]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of one machine's run."""
    folder = tmp_path_factory.mktemp("merging") / "whole"
    run_shard(folder)
    return folder


def numbers(folder):
    return store.table(store.load(folder).records).drop(columns=TIMED)


def test_each_run_names_its_own_environment(tmp_path, monkeypatch):
    """Begun here and resumed on another processor, or merged from both: a folder has as many as its runs."""
    here = environment.describe_environment
    run_shard(tmp_path / "1", (1, 2))
    monkeypatch.setattr(environment, "describe_environment", lambda *given: {**here(*given), "cpu": "another"})
    run_shard(tmp_path / "1", resume=True)
    run_shard(tmp_path / "2", (2, 2))
    merge(tmp_path / "merged", [tmp_path / "2", tmp_path / "1"])
    for folder in (tmp_path / "1", tmp_path / "merged"):
        names = [r.environment for r in store.load(folder).records]
        cpus = [json.loads((folder / f"environment.{name}.json").read_text())["cpu"] for name in names]
        assert len(set(names)) == 2 and 0 < cpus.count("another") < len(cpus) == 6


def test_merged_shards_are_the_whole_run(tmp_path, whole):
    """Same rows, same numbers, same files; the sources stay; merging again adds nothing."""
    shards = [tmp_path / str(k) for k in (1, 2)]
    sizes = [len(run_shard(folder, (k, 2)).records) for k, folder in enumerate(shards, 1)]
    assert sizes == [3, 3]
    before = {p: p.read_bytes() for s in shards for p in s.rglob("*.json")}
    done = merge(tmp_path / "merged", shards)
    assert done.added == 6 and not done.conflicts and not done.codes
    assert numbers(tmp_path / "merged").equals(numbers(whole))
    assert all(p.read_bytes() == content for p, content in before.items())
    assert merge(tmp_path / "merged", shards).added == 0
    assert (tmp_path / "merged" / "environment.json").exists() and (tmp_path / "merged" / "environment.2.json").exists()


def test_contradictions_and_damage_are_reported(tmp_path, whole):
    """Two folders with other numbers for one run: the first stays, the cause is named; no damaged record is copied."""
    first, *others = store.load(whole).records
    other = store.create_folder(tmp_path / "b")
    stamp = json.loads((whole / "environment.json").read_text(encoding="utf-8"))
    stamp["blas"][0]["architecture"] = "Nehalem"  # that no test runs with
    (other / "environment.json").write_text(json.dumps(stamps.seal_stamp(stamp, {})))
    store.write_record(other, dataclasses.replace(first, series="", phi_max=9.0))
    (other / "runs" / f"{others[0].run_id}.json").write_text("{")
    done = merge(tmp_path / "out", [whole, other])
    assert len(done.conflicts) == 1 and first.case in done.conflicts[0] and len(done.unreadable) == 1
    assert "kernels" in done.conflicts[0] and "Nehalem" in done.conflicts[0]
    assert len(done.records) == 6 and [r.phi_max for r in done.records if r.run_id == first.run_id] == [first.phi_max]


def test_a_folder_is_not_merged_into_itself(tmp_path):
    """It would be read and written at once."""
    folder = store.create_folder(tmp_path / "a")
    with pytest.raises(FileError, match="one of the folders"):
        merge(folder, [folder])


def test_code_is_compared_for_each_problem_and_solver(whole):
    """Shards of one suite with several solvers are of one code, though each solver has a digest of its own."""
    records = store.load(whole).records
    other = dataclasses.replace(records[0], solver="another", code="f" * 16)
    assert find_mixed_codes([*records, other]) == ()
    newer = dataclasses.replace(records[0], code="0" * 16)
    assert find_mixed_codes([*records, newer]) == ("0" * 16, records[0].code)
