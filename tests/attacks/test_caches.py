"""Caches hold machine code and pickles: each is a folder of this user alone, in a checkout as well as installed."""

import hashlib
import os
import pickle
import stat
import struct
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
import pytest

from mbsbench.cli import list as catalogue
from mbsbench.harness.base import cache
from mbsbench.harness.base.private_interfaces import CallbackCache
from mbsbench.harness.catalogue import codes
from mbsbench.harness.mechanics import kept_code
from mbsbench.harness.reference import orbit

PLACES = ("checkout", "chosen", "installed")
OTHER = 65534  # nobody
FORCE = """
import numba
from mbsbench.harness.mechanics.kept_code import compile_callback
def law(x):
    return 2.0 * x
compile_callback(law, numba.float64, numba.float64)
"""


@pytest.fixture
def wanted(tmp_path, monkeypatch):
    """The folder that a cache should have in a place, whose parents are there."""

    def place(where):
        monkeypatch.setenv(cache.CHOSEN, str(tmp_path / "chosen") if where == "chosen" else "")
        monkeypatch.setattr(cache.tempfile, "tempdir", str(tmp_path / "tmp"))
        (tmp_path / "tmp").mkdir()
        if where == "installed":
            monkeypatch.setattr(cache, "ROOT", tmp_path / "site-packages" / "mbsbench")
            monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
        above = {"checkout": "local", "chosen": "chosen", "installed": "home/mbsbench"}[where]
        return tmp_path / above / "user_forces"

    return lambda where: (place(where), lambda: cache.make_cache_folder("user_forces", tmp_path / "local"))


def mode_of(path):
    return stat.S_IMODE(path.lstat().st_mode)


@pytest.mark.parametrize("where", PLACES)
def test_what_is_made_is_for_this_user_alone(wanted, where):
    """Whatever the mask of new files is."""
    folder, ask = wanted(where)
    before = os.umask(0)
    try:
        assert ask() == folder
    finally:
        os.umask(before)
    assert mode_of(folder) == 0o700
    assert where == "checkout" or mode_of(folder.parent) == 0o700


def open_to_all(folder):
    folder.chmod(0o777)


def open_to_the_group(folder):
    folder.chmod(0o770)


def lead_elsewhere(folder):
    folder.rename(folder.with_name("elsewhere"))
    folder.symlink_to(folder.with_name("elsewhere"))


def give_away(folder):
    if os.getuid():
        pytest.skip("only root can give a folder to another user")
    os.chown(folder, OTHER, OTHER)


@pytest.mark.parametrize("where", PLACES)
@pytest.mark.parametrize(
    ("harm", "why"),
    [
        (open_to_all, "written to by others (mode 777)"),
        (open_to_the_group, "written to by others (mode 770)"),
        (lead_elsewhere, "is a link"),
        (give_away, "belongs to another user"),
    ],
)
def test_one_that_others_could_write_to_is_not_used(wanted, capsys, where, harm, why):
    """One line says so; a private folder is used, by all that is started from here, too, which say it no more."""
    folder, ask = wanted(where)
    folder.mkdir(parents=True, mode=0o700)
    folder.parent.chmod(0o700)
    harm(folder)
    found = ask()
    said = capsys.readouterr().err
    assert why in said and str(folder) in said and said.count("\n") == 1
    assert found != folder and mode_of(found) == 0o700 == mode_of(found.parent) and not list(found.iterdir())
    assert (
        cache.make_cache_folder("references", Path("beside")).parent == found.parent == Path(os.environ[cache.CHOSEN])
    )
    assert not capsys.readouterr().err


@pytest.mark.parametrize("where", ["chosen", "installed"])
@pytest.mark.parametrize("harm", [open_to_all, open_to_the_group, give_away])
def test_nor_one_in_a_folder_that_others_could_write_to(wanted, capsys, where, harm):
    """They could put another in its place."""
    folder, ask = wanted(where)
    folder.mkdir(parents=True, mode=0o700)
    harm(folder.parent)
    assert ask() != folder and str(folder.parent) in capsys.readouterr().err


def test_a_private_folder_that_somebody_made_before_us_is_not_used(wanted, tmp_path):
    """Its name can be guessed."""
    folder, ask = wanted("checkout")
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    guessed = tmp_path / "tmp" / f"mbsbench-{os.getuid()}"
    guessed.symlink_to(tmp_path)
    found = ask()
    assert not found.is_relative_to(guessed) and mode_of(found.parent) == 0o700


class Planted:
    """A pickle that leaves a mark when it is read."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


def seal(content):
    """The bytes of a file with this content: an attacker knows how to make the digest in front."""
    return hashlib.sha256(content).digest() + content


class Context:
    """Of numba: what a callback is loaded into."""

    def refresh(self):
        """Nothing to do."""


@pytest.mark.parametrize("kind", ["another user's", "a link", "a pipe", "a device", "its own"])
def test_a_planted_pickle_is_not_read(tmp_path, kind):
    """Not one of another user, nor what a link leads to; a pipe is not waited for. The control: its own is read."""
    mark, path = tmp_path / "mark", tmp_path / "0.pickle"
    content = seal(pickle.dumps(Planted(mark)))
    if kind == "a pipe":
        os.mkfifo(path)
    elif kind in ("a link", "a device"):
        target = Path("/dev/zero") if kind == "a device" else tmp_path / "elsewhere"
        path.symlink_to(target)
        if kind == "a link":
            target.write_bytes(content)
    else:
        path.write_bytes(content)
    if kind == "another user's":
        give_away(path)
    assert CallbackCache(path).load_overload("", Context()) is None
    assert mark.exists() == (kind == "its own")
    assert kind == "its own" or orbit._read_orbit(path) is None


@pytest.mark.sampled(0)
def test_a_shared_cache_does_not_run_planted_code(tmp_path):
    """The whole way: a callback is compiled where others can write to the cache, and what they put there is left."""
    mark = tmp_path / "mark"
    given = {**os.environ, cache.CHOSEN: str(tmp_path / "kept"), "TMPDIR": str(tmp_path)}

    def run():
        line = (sys.executable, "-c", FORCE)
        return subprocess.run(line, env=given, capture_output=True, text=True, timeout=120, check=False)

    assert run().returncode == 0
    (kept,) = (tmp_path / "kept" / "user_forces").glob("*.pickle")
    kept.write_bytes(seal(pickle.dumps(Planted(mark))))
    kept.parent.chmod(0o777)
    done = run()
    assert done.returncode == 0 and not mark.exists()
    assert done.stderr.count("may be written to by others") == 1
    kept.parent.chmod(0o700)
    assert run().returncode == 0 and mark.exists()  # the control: this is where it would have been read


def test_a_chosen_folder_may_be_as_tmp_is(wanted):
    """Open to all and sticky: nobody can put another folder in the place of ours."""
    folder, ask = wanted("chosen")
    folder.parent.mkdir(parents=True, exist_ok=True)
    folder.parent.chmod(0o1777)
    assert ask() == folder and mode_of(folder) == 0o700


def flip(path, found, change):
    """Flip the bits ``change`` of the byte ``found`` of a file."""
    content = bytearray(path.read_bytes())
    content[found] ^= change
    path.write_bytes(content)


def test_no_byte_of_a_sealed_file_may_be_another(tmp_path):
    """Neither of the digest nor of what follows it; nor may one be missing, or the whole."""
    path = tmp_path / "kept"
    cache.write_sealed_file(path, b"a wrong number")
    assert cache.read_sealed_file(path, 100) == b"a wrong number" and list(tmp_path.iterdir()) == [path]
    whole = path.read_bytes()
    for k in range(len(whole)):
        flip(path, k, 0x01)
        with pytest.raises(OSError, match="damaged"):
            cache.read_sealed_file(path, 100)
        path.write_bytes(whole[:k])
        with pytest.raises(OSError, match="damaged"):
            cache.read_sealed_file(path, 100)
        path.write_bytes(whole)


def test_a_flipped_bit_of_a_compiled_force_is_no_other_force(tmp_path, monkeypatch):
    """The sign of a constant: the stored code would push where the law pulls, without a word."""
    monkeypatch.setattr(kept_code, "make_cache_folder", lambda *_: tmp_path)

    def law(x):
        return -4.0 * x

    def pull():
        return kept_code.compile_callback(law, numba.float64, numba.float64).ctypes(1.0)

    assert pull() == -4.0
    (path,) = tmp_path.iterdir()
    flip(path, path.read_bytes().index(struct.pack("<d", -4.0)) + 7, 0x80)
    assert pull() == -4.0
    assert pull() == -4.0 and struct.pack("<d", -4.0) in path.read_bytes()  # made anew and stored


@pytest.mark.parametrize("name", ["stiff", "ends", "beyond_t"])
def test_a_flipped_bit_of_a_stored_reference_loses_nothing_of_it(tmp_path, name):
    """An archive checks its arrays, not its list of names: without one of these, another motion would be read."""
    one, path = np.ones(1), tmp_path / "0.npz"
    part = orbit.Orbit(one, np.ones((1, 1)), np.ones((1, 7, 1)), one, one)
    orbit._write_orbit(path, replace(part, stiff=True, ends="chaos", beyond=part))
    found = orbit._read_orbit(path)
    assert found.stiff and found.ends == "chaos" and found.beyond is not None
    flip(path, path.read_bytes().rindex(f"{name}.npy".encode()), 0x01)
    assert orbit._read_orbit(path) is None


def test_a_flipped_bit_of_the_stored_catalogue_is_no_other_default(tmp_path, monkeypatch):
    """``list`` prints what the code says."""
    monkeypatch.setattr(catalogue, "make_cache_folder", lambda *_: tmp_path)
    made = catalogue.load_catalogue()
    (path,) = tmp_path.iterdir()
    flip(path, path.read_bytes().index(b'"default":0.0') + len(b'"default":0.'), 0x01)
    assert catalogue.load_catalogue() == made


def test_a_flipped_bit_of_the_parsed_sources_is_no_other_code(tmp_path):
    """Results would be told from those of the same code."""
    path = tmp_path / "parsed.json"
    made = codes.Sources(keep=path).digest_modules("harness/base/naming")
    flip(path, path.read_bytes().index(b'": ["') + 5, 0x01)
    assert codes.Sources(keep=path).digest_modules("harness/base/naming") == made
