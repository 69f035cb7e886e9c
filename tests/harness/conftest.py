"""Runs of the misbehaving solvers, the command line as a process, and records to judge."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.results.store import LoadedResults
from mbsbench.tests.factories import PLUGIN, Silent, run_suite_text

HOSTILE = Path(__file__).parent / "hostile.py"
TIMED = [  # columns that differ between two runs of the same code
    "cpu_min_s",
    "cpu_q1_s",
    "cpu_median_s",
    "cpu_q3_s",
    "cpu_max_s",
    "cpu_call_s",
    "cpu_import_s",
    "cpu_refuses_s",
    "cpu_process_s",
    "setup_s",
    "code_s",
    "wall_s",
    "measure_s",
    "peak_memory_MB",
    "finished",
    "commit",  # somebody may commit meanwhile
]


@pytest.fixture(scope="module", autouse=True)
def catalogue():
    """Our solvers are in the catalogues for the tests of this folder only: other tests are generated from them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_plugin_files", set())
        patch.setattr(registry, "_plugin_problems", {})
        patch.setattr(registry, "_plugin_solvers", {})
        registry.load_plugin(PLUGIN)
        registry.load_plugin(HOSTILE)
        yield


@pytest.fixture
def begun_here(own_supervisor):
    """The processes that run and were started in this test: the browser of other tests is not among them."""
    before = psutil.Process().children()
    return lambda: [p for p in psutil.Process().children() if p not in before and p.status() != psutil.STATUS_ZOMBIE]


@pytest.fixture
def run_text(tmp_path: Path) -> Callable[..., tuple[LoadedResults, Silent]]:
    """Run the text of a suite in a folder of its own."""

    def run(text: str, *, folder: Path = tmp_path / "run", **more):
        return run_suite_text(folder, text, **more)

    return run


@pytest.fixture
def command(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess]:
    """``mbsbench ...`` in an empty folder."""

    def call(*arguments: str, timeout: float = 60.0) -> subprocess.CompletedProcess:
        line = (sys.executable, "-m", "mbsbench.cli", *arguments)
        return subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, timeout=timeout, check=False)

    return call
