"""``clean`` removes what is old, and nothing that is in use, the user's own or published."""

import os
import time

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base import cache
from mbsbench.harness.results import store

DAY = 86400.0


@pytest.fixture(autouse=True)
def local(tmp_path, monkeypatch):
    """Two suites, three and one times; results with a name of the user's own; published ones; caches."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(cache.CHOSEN, str(tmp_path / "caches"))
    for age, name in enumerate(
        [
            "ci-20260103-000000",
            "ci-20260102-000000",
            "ci-20260101-000000-77",
            "bench-20260101-000000",
            "mine",
            "machine",
        ]
    ):
        folder = tmp_path / "results" / "local" / name
        (folder / "runs").mkdir(parents=True) if name != "machine" else folder.mkdir()
        (folder / "runs.parquet").write_bytes(b"x" * 1_500_000)
        set_age(folder, (age + 1) * DAY)
    published = tmp_path / "results" / "published" / "ci-20250101-000000"
    (published / "runs").mkdir(parents=True)
    set_age(published, 400 * DAY)
    for name, age in (("old", 40.0), ("new", 2.0)):
        place = tmp_path / "caches" / "references" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(b"x" * 200_000)
        os.utime(place, (time.time() - age * DAY,) * 2)
    return tmp_path / "results" / "local"


def set_age(folder, seconds):
    for path in (*folder.rglob("*"), folder):
        os.utime(path, (time.time() - seconds,) * 2)


def names(local):
    return {p.name for p in local.iterdir()}


ALL = {"ci-20260103-000000", "ci-20260102-000000", "ci-20260101-000000-77", "bench-20260101-000000", "mine", "machine"}


def test_of_each_suite_the_newest_stays(local, capsys):
    """Also results that the user named, other folders and published ones; it says what went and how much."""
    assert main(["clean"]) == 0
    assert names(local) == ALL - {"ci-20260102-000000", "ci-20260101-000000-77"}
    assert (local.parent / "published" / "ci-20250101-000000" / "runs").is_dir()
    said = capsys.readouterr().out.split("\n")
    assert said[0] == "removed results/local/ci-20260101-000000-77, 1.5 MB"
    assert said[2] == "removed 2 results folders, 3.0 MB, and 1 file of caches, 0.2 MB"
    assert not (local.parents[1] / "caches" / "references" / "old").exists()
    assert (local.parents[1] / "caches" / "references" / "new").exists()


def test_keep_and_older_than_both_hold(local):
    """What is young stays however many there are; the newest stay however old they are."""
    assert main(["clean", "--keep", "2"]) == 0
    assert names(local) == ALL - {"ci-20260101-000000-77"}
    assert main(["clean", "--older-than", "7d"]) == 0
    assert names(local) == ALL - {"ci-20260101-000000-77"}
    assert main(["clean", "--older-than", "36h"]) == 0
    assert names(local) == ALL - {"ci-20260101-000000-77", "ci-20260102-000000"}
    assert not (local.parents[1] / "caches" / "references" / "new").exists()


def test_a_dry_run_removes_nothing(local, capsys):
    """It says the same as the run that removes."""
    before = sorted(local.parents[1].rglob("*"))
    assert main(["clean", "--dry-run"]) == 0
    dry = capsys.readouterr().out
    assert sorted(local.parents[1].rglob("*")) == before
    assert main(["clean"]) == 0
    assert dry.replace("would remove", "removed") == capsys.readouterr().out


@pytest.mark.parametrize("dry", [False, True])
@pytest.mark.parametrize("how", ["a run", "a report"])
def test_what_a_command_is_writing_stays(local, capsys, how, dry):
    """A runner holds the lock of its folder, a report or a judgement marks it as in use."""
    folder = local / "ci-20260101-000000-77"
    held = store.lock_folder(folder) if how == "a run" else store.hold_folder(folder)
    set_age(folder, 9 * DAY)
    with held:
        assert main(["clean", *["--dry-run"] * dry]) == 0
    assert folder.exists() and (folder / "runs.parquet").exists()
    assert "left results/local/ci-20260101-000000-77: it is being written" in capsys.readouterr().out
    set_age(folder, 9 * DAY)
    assert main(["clean"]) == 0 and not folder.exists()


def test_latest_stays_and_no_link_is_followed(local, tmp_path):
    """What commands without RESULTS take is needed; a link to results elsewhere is the user's."""
    elsewhere = tmp_path / "elsewhere"
    (elsewhere / "runs").mkdir(parents=True)
    (local / "ci-20250101-000000").symlink_to(elsewhere)
    (local / "latest").symlink_to("ci-20260101-000000-77")
    assert main(["clean"]) == 0
    assert names(local) == (ALL | {"latest", "ci-20250101-000000"}) - {"ci-20260102-000000"}
    assert (elsewhere / "runs").is_dir()


@pytest.mark.parametrize("given", ["7", "d", "-1d", "7.5d", "1e3d", "7 days", ""])
def test_bad_durations_are_refused_in_one_line(local, capsys, given):
    """Nothing is removed for a word that is not understood."""
    assert main(["clean", f"--older-than={given}"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "must be a whole number of hours, days or weeks" in error
    assert names(local) == ALL


def test_without_results_nothing_is_done(local, tmp_path, monkeypatch, capsys):
    """A folder without results/local/ has nothing old."""
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert main(["clean", "--dry-run"]) == 0
    assert "would remove 0 results folders, 0.0 MB" in capsys.readouterr().out
