"""Results folders made by somebody else: nothing is read or written outside them, and a bad file costs itself only."""

import dataclasses
import io
import json
import os
import zipfile

import numpy as np
import pytest

from mbsbench.harness.base.confined_paths import UnsafeFile
from mbsbench.harness.base.files import FileError
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.mechanics.types import EndCause
from mbsbench.harness.results import npz, store
from mbsbench.harness.results.merging import merge
from mbsbench.harness.results.npz import read_npz
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.series import read_series, write_series
from mbsbench.harness.results.words import list_reasons
from mbsbench.harness.run import run_file
from mbsbench.harness.run.handover import Handover, SolverReport, read_handover, write_handover
from mbsbench.harness.run.remaining_time import read_durations
from mbsbench.tests.factories import change_series, make_series

RECORD = RunRecord(run_id="abc", case="p s dt=0.1", problem="p", solver="s", status="diverged", message="stopped")
TIMES = np.linspace(0.0, 1.0, 5)
OUT = ["../../outside/x.npz", "/etc/passwd", "series/../../outside/x.npz", "series/", "series/.hidden", "runs/abc.json"]


def folder_with(folder, **columns):
    """Results with one record, whose digest is right whatever it says."""
    store.create_folder(folder)
    (folder.parent / "outside").mkdir(exist_ok=True)
    digest = write_series(folder.parent / "outside" / "x.npz", make_series(TIMES))
    store.write_record(folder, dataclasses.replace(RECORD, series_sha256=digest, **columns))
    return folder


@pytest.mark.parametrize("column", ["series", "stderr"])
@pytest.mark.parametrize("place", OUT)
def test_a_path_out_of_the_folder_is_no_file_of_a_run(tmp_path, column, place):
    """It is not read, not copied by merge, not moved by resume: the record that names it is set aside."""
    place = place.replace("series", column) if "passwd" not in place else place
    folder = folder_with(tmp_path / "a", **{column: place})
    before = {p: p.read_bytes() for p in (tmp_path / "outside").iterdir()}
    loaded = store.load(folder)
    assert not loaded.records and f"column {column}" in next(iter(loaded.unreadable.values()))
    store.set_aside(folder, loaded.unreadable)
    assert merge(tmp_path / "deep" / "out", [folder]).added == 0
    assert {p: p.read_bytes() for p in (tmp_path / "outside").iterdir()} == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a", "deep", "outside"]
    assert sorted(p.name for p in (tmp_path / "deep").iterdir()) in (["latest", "out"], ["out"])


def test_links_are_not_followed(tmp_path):
    """A link in place of a file or of a part of the folder: what it points to is neither shown nor copied."""
    secret = tmp_path / "secret.txt"
    secret.write_text("secret words")
    folder = folder_with(tmp_path / "a", stderr="stderr/abc.txt")
    (folder / "stderr" / "abc.txt").symlink_to(secret)
    (record,) = store.load(folder).records
    assert "secret" not in store.read_stderr(folder, record)
    merge(tmp_path / "out", [folder])
    assert not (tmp_path / "out" / "stderr" / "abc.txt").exists()
    (folder / "stderr" / "abc.txt").unlink()
    (folder / "stderr").rmdir()
    (folder / "stderr").symlink_to(tmp_path)
    with pytest.raises(UnsafeFile, match="is a link"):
        store.load(folder)


def test_a_linked_lock_leaves_its_target_as_it_is(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("thesis")
    folder = store.create_folder(tmp_path / "a")
    (folder / ".lock").symlink_to(precious)
    with pytest.raises(FileError, match=r"cannot lock .*"):
        store.lock_folder(folder)
    assert precious.read_text() == "thesis"


def test_pipes_and_devices_are_no_files_of_a_run(tmp_path):
    """Reading one would wait, or never end."""
    folder = folder_with(tmp_path / "a", series="series/abc.npz")
    os.mkfifo(folder / "series" / "abc.npz")
    os.mkfifo(folder / "runs" / "pipe.json")
    (folder / "runs" / "zero.json").symlink_to("/dev/zero")
    loaded = store.load(folder)
    assert not loaded.records and len(loaded.unreadable) == 4  # the record, its series, the pipe and the device
    store.set_aside(folder, loaded.unreadable)
    assert not store.load(folder).unreadable


def npy(shape, data=b"\0" * 8, dtype="<f8"):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": dtype, "fortran_order": False, "shape": shape})
    return head.getvalue() + data


def archive(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


@pytest.mark.parametrize("shape", [(10**12,), (2**40, 2**40), (-1,), (0,), (3,)])
def test_an_array_holds_what_its_shape_says(tmp_path, shape):
    """A header of a few bytes may promise terabytes: nothing is allocated for it."""
    with pytest.raises(ValueError, match="shape"):
        read_npz(archive(tmp_path / "x.npz", t=npy(shape)), 2**20)


def test_a_bomb_is_not_unpacked(tmp_path, monkeypatch):
    """A thousand times smaller packed: its sizes are added up before anything is unpacked, in all three readers."""
    bomb = archive(tmp_path / "x.npz", t=npy((2**17,), b"\0" * 2**20), meta=npy((), b"\0" * 8))
    assert bomb.stat().st_size < 2**12
    monkeypatch.setattr(npz, "_parse_array", lambda content: pytest.fail("unpacked"))
    for module, call, error in (
        ("results.series", lambda: read_series(bomb), FileError),
        ("run.run_file", lambda: run_file.read_run(bomb), ValueError),
        ("run.handover", lambda: read_handover(bomb, assemble([RigidBody(1.0, np.eye(3))])), FileError),
    ):
        monkeypatch.setattr(f"mbsbench.harness.{module}.LARGEST", 2**14)
        with pytest.raises(error, match="bytes"):
            call()


@pytest.mark.parametrize("name", ["energy", "obs_x", "frame_r", "dt"])
def test_series_of_other_lengths_are_refused(tmp_path, name):
    """A page would index past the end."""
    write_series(tmp_path / "x.npz", make_series(TIMES, frame_t=np.zeros(2), **{name: np.zeros(3)}))
    with pytest.raises(FileError, match=name):
        read_series(tmp_path / "x.npz")


def test_a_message_moves_no_cursor():
    """It is the solver's: kept as it is, shown without what a terminal obeys."""
    said = "\x1b[2J\x1b]0;owned\x07 done\r\x9b1m"
    for by in (EndCause.SOLVER, EndCause.EXCEPTION, EndCause.MEMORY_LIMIT):
        (words,) = list_reasons(dataclasses.replace(RECORD, message=said, ended_by=str(by)))
        assert "done" in words and words.isprintable()


def test_a_bad_folder_beside_ours_ends_no_run(tmp_path):
    """Earlier results are only read for the time left."""
    (tmp_path / "old" / "runs").mkdir(parents=True)
    store.write_record(tmp_path / "old", dataclasses.replace(RECORD, schema=1))
    (tmp_path / "linked" / "runs").mkdir(parents=True)
    (tmp_path / "linked" / "series").symlink_to("/")
    store.write_record(store.create_folder(tmp_path / "ours"), dataclasses.replace(RECORD, settings_id="x", wall_s=2.0))
    assert read_durations(tmp_path) == {"x": 2.0}


@pytest.mark.parametrize(
    "arrays",
    [{"t": np.zeros(3)}, {"t": np.zeros((2, 2))}, {"t": np.zeros(1), "r": np.zeros((1, 5, 3))}, {"evil": np.zeros(1)}],
)
def test_what_a_solver_hands_over_is_of_its_problem(tmp_path, arrays):
    """The solver's process writes the file: its contents are untrusted and validated."""
    system = assemble([RigidBody(1.0, np.eye(3))])
    said = np.asarray(json.dumps({"claimed": "success"}))
    np.savez(tmp_path / "x.npz", said=said, **({"t": np.zeros(1)} | arrays))
    with pytest.raises(FileError, match="cannot be used"):
        read_handover(tmp_path / "x.npz", system)
    write_handover(tmp_path / "x.npz", Handover(SolverReport(message="refused"), None))
    assert read_handover(tmp_path / "x.npz", system).trajectory is None  # type: ignore[union-attr]


def test_a_series_that_is_missing_is_named():
    """A file without it, whose digest is right, ends no page with a traceback."""
    for ask in (lambda: make_series(TIMES)["energy_error"], lambda: make_series(TIMES).points("energy_error")):
        with pytest.raises(FileError, match="a series file lacks energy_error"):
            ask()


WHOLE = {name: np.zeros(5) for name in ("energy", "energy_error", "phi_norm", "phi_dot_norm", "dt")}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, ""),
        ({"energy": np.full(5, np.nan), "phi_norm": np.array([0.0, np.inf, -np.inf, 5e-324, 1e308])}, ""),
        ({"t": np.array(list("01234"))}, "t holds <U1, not numbers"),
        ({"energy_error": np.array(list("01234"))}, "energy_error holds <U1, not numbers"),
        ({"t": np.array([0.0, 1.0, np.nan, 2.0, 3.0])}, "t must be finite and must not decrease"),
        ({"t": np.array([0.0, 1.0, 2.0, 3.0, np.inf])}, "t must be finite and must not decrease"),
        ({"t": np.arange(5.0)[::-1]}, "t must be finite and must not decrease"),
        ({"frame_t": np.zeros(2), "frame_r": np.zeros((2, 1, 3))}, "frame_q: missing, although frame_r is there"),
    ],
)
def test_series_that_no_run_writes_are_set_aside(tmp_path, changed, words):
    """With a right digest: a page would end on them. Motions that diverge have any numbers."""
    arrays = {k: a for k, a in ({**WHOLE, **changed}).items() if a is not None}
    write_series(tmp_path / "x.npz", change_series(make_series(TIMES), **arrays))
    if not words:
        read_series(tmp_path / "x.npz")
        return
    with pytest.raises(FileError, match=words):
        read_series(tmp_path / "x.npz")
