"""Compiled passes whose files are damaged are compiled anew: a power cut leaves halves of files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench.tests.covering import few

CODE = """
import sys
import numpy as np
from mbsbench.harness.judge.metrics import passes
R = np.tile(np.eye(3), (3, 2, 1, 1))
if sys.argv[1] == "one":
    passes._run_all = lambda: passes.are_rotations(R)
passes.load()
assert passes.are_rotations(R) and not passes.are_rotations(-R)
print(passes._are_rotations.stats.cache_hits.total())
"""


def run_with(cache: Path) -> subprocess.CompletedProcess[str]:
    """The passes in a process of their own, which prints how many of two signatures it found compiled.

    All of them in a cache called "all"; else one, as each takes a second to compile.
    """
    given = {**os.environ, "MBSBENCH_CACHE": str(cache)}
    line = [sys.executable, "-c", CODE, cache.name]
    return subprocess.run(line, env=given, capture_output=True, text=True, timeout=120, check=False)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def halve(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)


def link(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.fixture(scope="module", params=["one", pytest.param("all", marks=pytest.mark.slow)])
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache as a first run leaves it, in which a second finds all."""
    cache = tmp_path_factory.mktemp("cache") / request.param
    first, second = run_with(cache), run_with(cache)
    assert (first.returncode, second.returncode) == (0, 0), first.stderr + second.stderr
    assert int(first.stdout) == 0 < int(second.stdout)
    return cache


INDEX, CODES, SEALS = "*are_rotations*.nbi", "*are_rotations*.nbc", "seals.json"
ALL = [(which, damage) for which in (INDEX, CODES, SEALS) for damage in (empty, halve, flip, link, pipe)]
OFTEN = [(INDEX, empty), (INDEX, pipe), (CODES, flip), (CODES, link), (SEALS, halve)]  # which compiles all anew


@pytest.mark.sampled(0)
@pytest.mark.parametrize(("which", "damage"), few(ALL, OFTEN.__contains__))
def test_a_damaged_file_is_made_anew(made: Path, damage, which: str) -> None:
    """The run gives its numbers without a word, and the next finds all compiled again."""
    path = next(iter(made.rglob(which)))
    damage(path)
    done = run_with(made)
    assert (done.returncode, done.stderr) == (0, "")
    assert int(run_with(made).stdout) > 0
