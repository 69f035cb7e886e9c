"""What a cell costs beyond its own work: measured and printed, not judged, for machines are shared."""

import time

import pytest

from harness.runner import Request, run_suite
from harness.suites import parse_suite
from tests.harness.conftest import PLUGIN, Silent

CELLS = 100


@pytest.mark.slow
def test_what_the_runner_adds_to_a_cell(tmp_path, capsys):
    """A hundred cells that take no time, one after the other: the whole run over their number (wanted: < 0.15 s)."""
    steps = ", ".join(f"{0.1 + k / 1000:.3f}" for k in range(CELLS))
    text = f'[[cells]]\nproblem = "free_fall"\nsolver = "exact"\ndt = [{steps}]\n'
    suite = parse_suite(text, "t", "t", plugins=(str(PLUGIN),))
    began = time.monotonic()
    loaded = run_suite(Request(suite, tmp_path / "run", 1), Silent())
    spent = time.monotonic() - began
    own = sum(r.wall_s for r in loaded.records)
    assert len(loaded.records) == CELLS and {r.status for r in loaded.records} == {"success"}
    with capsys.disabled():
        print(f"\nrunner: {spent / CELLS:.3f} s a cell, start-up included; {own / CELLS:.3f} s of it in the cell")  # noqa: T201
