"""Stored files come back; damaged ones are reported and set aside, never read as good, never deleted."""

import contextlib
import dataclasses
import json
import os

import numpy as np
import pandas as pd
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results import environment, records, store
from mbsbench.harness.results.records import COLUMNS, RunRecord, format_record, parse_record_json
from mbsbench.harness.results.series import read_series, write_series
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import make_series

RECORD = RunRecord(
    run_id="abc", case="p s dt=0.1", status="diverged", phi_max=float("inf"), steps=3, message='a "b"\n\0 é'
)
SERIES = make_series(
    np.linspace(0.0, 1.0, 5),
    obs_theta=np.linspace(0.0, 1.0, 5) ** 2,
    events=[{"t": 0.5, "what": "passage"}],
    bodies=["bar"],
    joints=["O"],
    units={"obs_theta": "rad"},
)


def stored(folder, record=RECORD) -> RunRecord:
    store.create_folder(folder)
    digest = write_series(folder / "series" / f"{record.run_id}.npz", SERIES)
    record = dataclasses.replace(record, series=f"series/{record.run_id}.npz", series_sha256=digest)
    store.write_record(folder, record)
    return record


def same(a: RunRecord, b: RunRecord) -> bool:
    return format_record(a) == format_record(b)  # NaN is equal to itself in text


def test_record_and_series_come_back(tmp_path):
    """Infinities, NaN, quotes and control characters included; arrays bit for bit."""
    record = stored(tmp_path)
    loaded = store.load(tmp_path)
    assert len(loaded.records) == 1 and not loaded.unreadable
    assert same(loaded.records[0], record)
    back = store.read_run_series(tmp_path, record)
    assert_same(back["t"], SERIES["t"])
    assert back.events == ({"t": 0.5, "what": "passage"},)
    assert list(back.select("obs_")) == ["theta"]


def test_table_reads_as_it_was(tmp_path):
    """Numbers stay numbers for pandas, NaN stays NaN, an empty run still has all columns."""
    store.create_folder(tmp_path)
    frame = pd.read_parquet(store.write_table(tmp_path, [RECORD]))
    assert list(frame.columns) == [c.name for c in COLUMNS]
    assert frame.phi_max[0] == np.inf and np.isnan(frame.dt_s[0]) and frame.steps.dtype == np.int64
    assert frame.message[0] == RECORD.message
    empty = pd.read_parquet(store.write_table(tmp_path, []))
    assert list(empty.columns) == list(frame.columns) and empty.phi_max.dtype == np.float64


@pytest.mark.parametrize("part", ["runs/abc.json", "series/abc.npz"])
@pytest.mark.parametrize("damage", ["truncate", "empty", "garbage", "flip"])
def test_damaged_files_are_set_aside(tmp_path, part, damage):
    """Cut at half, emptied, replaced or with one byte changed: not good, and still there afterwards."""
    stored(tmp_path)
    path = tmp_path / part
    content = path.read_bytes()
    middle = len(content) // 2
    new = {"truncate": content[:middle], "empty": b"", "garbage": os.urandom(200)}
    new["flip"] = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    path.write_bytes(new[damage])
    loaded = store.load(tmp_path)
    assert not loaded.records and loaded.unreadable
    assert path.exists()  # reading changes nothing
    store.set_aside(tmp_path, loaded.unreadable)
    aside = tmp_path / "set_aside" / path.name
    assert aside.read_bytes() == new[damage]
    assert f"{path.name}: " in aside.with_name("why.txt").read_text()
    assert not store.load(tmp_path).unreadable


def test_foreign_records_are_refused(tmp_path):
    """Another schema, another run's record, JSON of something else or without end, a number beyond any, a pickle."""
    stored(tmp_path)
    good = tmp_path / "runs" / "abc.json"
    (tmp_path / "runs" / "other.json").write_bytes(good.read_bytes())
    others = {"list": "[1, 2]", "deep": "[" * 100_000, "long": '{"record": 1' + "0" * 5000 + "}"}
    for name, text in others.items():
        (tmp_path / "runs" / f"{name}.json").write_text(text)
    (tmp_path / "runs" / "binary.json").write_bytes(b"\x80\x04N.")
    loaded = store.load(tmp_path)
    assert len(loaded.records) == 1
    assert {path.stem for path in loaded.unreadable} == {"other", "binary", *others}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 99}, "schema"),
        ({"phi_max": "big"}, "phi_max"),
        ({"steps": 1.5}, "steps"),
        ({"steps": None}, "steps"),
        ({"status": 3}, "status"),
        ({"counters": "[]"}, "counters"),
        ({"notes": "x"}, "notes"),
        ({"counters": json.dumps({"steps": 10**400})}, "counters"),
        ({"counters": '{"steps": 1.5}'}, "counters"),
        ({"notes": "[1]"}, "notes"),
        ({"case": "\x1b]0;owned\x07"}, "case"),
        ({"solver": "a\nb"}, "solver"),
        ({"invariant_drifts": '{"P": 3}'}, "invariant_drifts"),
        ({"observable_errors": '{"x": {"max": "big"}}'}, "observable_errors"),
    ],
)
def test_wrong_types_are_refused(change, words):
    """Numbers of 400 digits, escape sequences in names, other shapes than declared: checked before it is believed."""
    with pytest.raises(FileError, match=words):
        parse_record_json(json.dumps({**json.loads(format_record(RECORD)), **change}))


def test_series_never_unpickles(tmp_path):
    """A pickled array in a result file could run code."""
    np.savez(tmp_path / "x.npz", t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(FileError):
        read_series(tmp_path / "x.npz")


def test_one_runner_at_a_time(tmp_path):
    """Two runners on one folder would both run every run."""
    store.create_folder(tmp_path)
    with store.lock_folder(tmp_path), pytest.raises(FileError, match="another runner"):
        store.lock_folder(tmp_path)
    store.lock_folder(tmp_path).close()


def test_latest_follows_and_leaves_strangers_alone(tmp_path):
    """``latest`` is a link of ours; a real folder of that name is somebody's own."""
    for name in ("a", "b"):
        store.point_latest(store.create_folder(tmp_path / name))
        assert (tmp_path / "latest").resolve().name == name
    (tmp_path / "latest").unlink()
    (tmp_path / "latest").mkdir()
    store.point_latest(tmp_path / "a")
    assert not (tmp_path / "latest").is_symlink()


def test_unwritable_folder_is_said_in_a_line():
    with pytest.raises(FileError, match="cannot write"):
        store.create_folder(environment.ROOT / "Makefile" / "run")


@pytest.mark.parametrize(
    "line",
    [
        "report",
        "show",
        "verify",
        "judge",
        "figures",
        "diff {0}",
        "merge out",
        "gate --results",
        "history",
        "run ci --resume --out",
    ],
)
@pytest.mark.parametrize("schema", [1, 2])
def test_a_folder_of_an_older_version_is_refused_with_what_to_do(tmp_path, line, schema, capsys):
    """By every command that takes one; nothing in it is changed."""
    old = tmp_path / "old"
    if schema == 1:
        (old / "cells").mkdir(parents=True)
        (old / "cells" / "aa.json").write_bytes(b"")
    else:
        store.write_record(store.create_folder(old), dataclasses.replace(RECORD, schema=schema))
    (old / "suite.toml").write_text("")
    before = sorted(p for p in old.rglob("*"))
    with contextlib.chdir(tmp_path):
        assert main([*line.format(old).split(), str(old)]) == 2
    said = f"holds results of an older version (schema {schema}); run the suite again: mbsbench run {old}/suite.toml\n"
    assert said in capsys.readouterr().err
    assert before == sorted(p for p in old.rglob("*"))


def test_format_page_names_every_status():
    text = (environment.ROOT / "docs" / "results-format.md").read_text()
    for status in Status:
        assert f"`{status}`" in text
    assert records.SCHEMA == 3  # a new schema needs a new page
