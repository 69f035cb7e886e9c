"""Where computed things are kept: in the checkout, else where the user may write, never beside installed modules."""

import os
import re
from pathlib import Path

import pytest

from mbsbench.harness.base import cache
from mbsbench.harness.base.cache import ROOT


@pytest.fixture
def installed(tmp_path, monkeypatch) -> Path:
    """A package without ``pyproject.toml`` beside it; its user has a cache folder."""
    monkeypatch.setenv(cache.CHOSEN, "")  # put back, whatever is chosen meanwhile
    monkeypatch.setattr(cache, "ROOT", tmp_path / "site-packages" / "mbsbench")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "tmp"))
    return tmp_path


def test_checkout_keeps_its_own(tmp_path, monkeypatch):
    """These tests run in one: what it computes stays in it, for ``make clean`` to remove."""
    monkeypatch.setenv(cache.CHOSEN, "")  # put back, whatever is chosen meanwhile
    assert cache.is_checkout()
    assert cache.make_cache_folder("references", tmp_path) == tmp_path / "references"


def test_installed_it_is_the_users_cache(installed):
    """The folder named by XDG_CACHE_HOME, made for this user alone."""
    found = cache.make_cache_folder("references", Path("beside"))
    assert found == installed / "cache" / "mbsbench" / "references"
    assert found.stat().st_mode & 0o077 == 0


def test_the_folder_above_is_for_this_user_alone(installed):
    """Who may write to it may put another folder in place of the one that machine code is loaded from."""
    before = os.umask(0)
    try:
        above = cache.make_cache_folder("kernels", Path()).parent
    finally:
        os.umask(before)
    assert above.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777])
@pytest.mark.parametrize("which", ["mbsbench", "mbsbench/kernels"])
def test_a_folder_that_others_may_write_to_is_not_used(installed, mode, which):
    place = installed / "cache" / which
    place.mkdir(parents=True)
    place.chmod(mode)
    assert not cache.make_cache_folder("kernels", Path()).is_relative_to(installed / "cache")


def test_without_a_cache_folder_it_is_a_temporary_one(installed, monkeypatch):
    """No home, or one that cannot be written to: a file stands where the folder would be."""
    (installed / "cache").write_text("")
    assert cache.make_cache_folder("kernels", Path()) == installed / "tmp" / f"mbsbench-{os.getuid()}" / "kernels"


def test_folder_of_another_user_is_not_used(installed, monkeypatch):
    """Machine code is loaded from it, so it has to be ours."""
    monkeypatch.setattr(cache.os, "getuid", lambda: 4711)
    found = cache.make_cache_folder("kernels", Path())
    assert "4711" not in str(found) and found.is_dir()


def test_every_cache_is_listed_with_its_place():
    """``clean`` and ``--version --verbose`` know the caches that modules ask for, where these have them."""
    call = re.compile(r"make_cache_folder\(\s*\"(\w+)\"")
    asked = {
        name
        for p in ROOT.rglob("*.py")
        if {"tests", ".venv"}.isdisjoint(p.relative_to(ROOT).parts)
        for name in call.findall(p.read_text(encoding="utf-8"))
    }
    assert asked == set(cache.IN_CHECKOUT)
    from mbsbench.harness.base.generated import code
    from mbsbench.harness.reference import orbit

    found = {c.name: c.folder.resolve() for c in cache.list_caches()}
    assert found["references"] == orbit.FOLDER.resolve() and found["generated"] == code.FOLDER.resolve()


def test_caches_are_listed_with_their_sizes(tmp_path, monkeypatch):
    """All in the folder that the environment names."""
    monkeypatch.setenv(cache.CHOSEN, str(tmp_path))
    (tmp_path / "laws" / "deep").mkdir(parents=True)
    (tmp_path / "laws" / "deep" / "kernel").write_bytes(b"12345")
    found = {c.name: c for c in cache.list_caches()}
    assert (found["laws"].folder, found["laws"].bytes, found["sources"].bytes) == (tmp_path / "laws", 5, 0)
