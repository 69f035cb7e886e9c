"""A folder says which code measured its runs; what is damaged there costs itself alone, and is never overwritten."""

import json

import pytest

from mbsbench.harness.columns.digests import ColumnDigests
from mbsbench.harness.results import store
from mbsbench.harness.results.column_digests import FILE, add_column_digests, find_faults, read_stored_digests
from mbsbench.harness.results.merging import merge

OLD, LATER, NEW = (ColumnDigests("law", {"phi_max": text}) for text in ("a", "b", "c"))
PLAIN = {s.digest: {"measuring": s.measuring, "columns": s.columns} for s in (OLD, LATER)}
# entries that are none: of another type, incomplete, with a digest that is no text, with a key too many, of another key
MALFORMED = (
    5,
    None,
    {"measuring": "law"},
    {"measuring": "law", "columns": {"phi_max": 3}},
    {"measuring": "law", "columns": {}, "more": 1},
    {"measuring": "another law", "columns": {}},
)
NO_TABLE = ("", "{", "[]", "5", '{"a": NaN}', "[" * 100_000, "\udcff")


@pytest.fixture
def folder(tmp_path):
    return store.create_folder(tmp_path / "run")


@pytest.mark.parametrize("entry", MALFORMED, ids=range(len(MALFORMED)))
def test_a_malformed_entry_loses_itself_alone(folder, entry):
    """The others are read and stay when the file is written anew, and what was there is set aside with its reason."""
    add_column_digests(folder, OLD, LATER)
    before = json.dumps({"0123": entry} | PLAIN)
    (folder / FILE).write_text(before)
    assert read_stored_digests(folder) == {OLD.digest: OLD, LATER.digest: LATER}
    faults = find_faults(folder)
    (why,) = faults.values()
    assert list(faults) == [folder / FILE] and "0123" in why and "\n" not in why
    assert add_column_digests(folder, OLD) == {} and (folder / FILE).read_text() == before  # nothing to write
    assert add_column_digests(folder, NEW) == faults
    assert read_stored_digests(folder) == {s.digest: s for s in (OLD, LATER, NEW)} and not find_faults(folder)
    assert (folder / "set_aside" / FILE).read_text() == before
    assert why in (folder / "set_aside" / "why.txt").read_text()


@pytest.mark.parametrize("text", NO_TABLE, ids=range(len(NO_TABLE)))
def test_a_file_that_is_no_table_is_set_aside_before_one_is_written(folder, text):
    """It is read as a folder of unknown code, and kept with the reason when a state is added."""
    before = text.encode(errors="surrogateescape")
    (folder / FILE).write_bytes(before)
    assert read_stored_digests(folder) == {}
    faults = find_faults(folder)
    (why,) = faults.values()
    assert add_column_digests(folder, NEW) == faults and "\n" not in why
    assert read_stored_digests(folder) == {NEW.digest: NEW}
    assert (folder / "set_aside" / FILE).read_bytes() == before


def test_a_valid_file_is_added_to(folder):
    """Nothing is set aside, and a state that is there is not written again."""
    assert read_stored_digests(folder) == {} and add_column_digests(folder, OLD) == {}
    assert add_column_digests(folder, LATER, NEW) == {}
    assert read_stored_digests(folder) == {s.digest: s for s in (OLD, LATER, NEW)}
    assert not (folder / "set_aside").exists()


def test_merging_reports_what_a_source_and_the_merged_folder_have_lost(tmp_path):
    """The valid entries of a damaged source arrive; both damaged files are named, the source's stays as it is."""
    source, out = (store.create_folder(tmp_path / name) for name in ("source", "out"))
    damaged = json.dumps({"0123": 5} | PLAIN)
    (source / FILE).write_text(damaged)
    (out / FILE).write_text("{")
    done = merge(out, [source])
    assert set(done.unreadable) == {source / FILE, out / FILE}
    assert read_stored_digests(out) == {OLD.digest: OLD, LATER.digest: LATER}
    assert (source / FILE).read_text() == damaged and (out / "set_aside" / FILE).read_text() == "{"
