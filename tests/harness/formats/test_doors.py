"""Files of others pass one door: a regular file, its size before its data, each kind of damage in one line."""

import io
import os
import re
from pathlib import Path

import numpy as np
import pytest

from mbsbench.harness.base.confined_paths import read_whole
from mbsbench.harness.base.files import FileError
from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.formats.motions import tables
from mbsbench.harness.formats.motions.tables import read_table
from mbsbench.harness.results.environment import ROOT

ROOMS = (
    "harness/catalogue",
    "harness/formats",
    "harness/lab/ladder",
    "harness/lab/bundle",
)
OPENS = re.compile(r"\.read_bytes\(|\.read_text\(|(?<![.\w])open\(|Path\([^)]*\)\.open\(|np\.load\(")
OWN = {
    "harness/lab/ladder/blind.py",  # what our own process wrote for another of ours
    "harness/catalogue/codes.py",  # our own code
    "harness/catalogue/column_codes.py",  # our own code
}


def test_no_reader_of_ours_opens_a_path_by_itself() -> None:
    """Where files of others are read."""
    found = [
        f"{p.relative_to(ROOT)}: {line.strip()}"
        for room in ROOMS
        for p in sorted((ROOT / room).rglob("*.py"))
        if str(p.relative_to(ROOT)) not in OWN
        for line in p.read_text(encoding="utf-8").splitlines()
        if OPENS.search(line)
    ]
    assert not found


@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".parquet", ".xml", ".sdf"])
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_pipes_and_devices_are_refused_at_once(tmp_path: Path, suffix: str, kind: str) -> None:
    """A pipe without a writer would be waited for, a device read without end."""
    path = tmp_path / f"odd{suffix}"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to("/dev/zero")
    read = mechanism_files.read_mechanism if suffix in (".xml", ".sdf") else read_table
    with pytest.raises((ValueError, OSError), match=f"it is a {kind}, not a file|there is no such file"):
        read(path)


def test_a_large_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    """A sparse one of two gigabytes costs no memory."""
    path = tmp_path / "large.csv"
    with path.open("wb") as file:
        file.truncate(2**31)
    with pytest.raises(FileError, match="more than"):
        read_table(path)
    with pytest.raises(OSError, match="it has 10 bytes, more than 9"):
        read_whole(_written(tmp_path / "ten", b"0123456789"), 9)


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _motion() -> dict[str, np.ndarray]:
    return {"t": np.linspace(0.0, 1.0, 11), "x": np.zeros(11)}


def _mat(arrays: dict[str, np.ndarray]) -> bytes:
    scipy_io = pytest.importorskip("scipy.io")
    file = io.BytesIO()
    scipy_io.savemat(file, arrays, do_compression=True)
    return file.getvalue()


def _npz(arrays: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _parquet(arrays: dict[str, np.ndarray]) -> bytes:
    pandas = pytest.importorskip("pandas")
    file = io.BytesIO()
    pandas.DataFrame(arrays).to_parquet(file)
    return file.getvalue()


@pytest.mark.parametrize(("suffix", "write"), [(".mat", _mat), (".npz", _npz), (".parquet", _parquet)])
def test_what_unpacks_to_more_than_is_read_is_refused(tmp_path: Path, monkeypatch, suffix: str, write) -> None:
    """Its sizes are in its head."""
    path = _written(tmp_path / f"x{suffix}", write(_motion()))
    assert set(read_table(path).columns) == {"t", "x"}
    monkeypatch.setattr(tables, "MOST", 100)
    with pytest.raises(FileError, match="bytes, more than"):
        read_table(path)


@pytest.mark.parametrize(("suffix", "write"), [(".mat", _mat), (".npz", _npz), (".parquet", _parquet)])
def test_every_damage_is_one_line(tmp_path: Path, suffix: str, write) -> None:
    """Cut short anywhere, or with a byte of another value: read all the same, or refused by name."""
    whole = write(_motion())
    random, said = np.random.default_rng(7), list[str]()
    for _ in range(60):
        content = bytearray(whole)
        at = int(random.integers(len(content)))
        if random.random() < 0.5:
            content = content[:at]
        else:
            content[at] ^= int(random.integers(1, 256))
        path = _written(tmp_path / f"x{suffix}", bytes(content))
        try:
            read_table(path)
        except FileError as error:
            said.append(str(error))
    assert said and all(words.startswith(str(tmp_path)) and "\n" not in words for words in said)
