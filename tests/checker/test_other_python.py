"""Bundles of two Pythons verify each other, and state the same numbers."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench.harness.results.environment import ROOT

from .test_check_bundle import PROGRAM, SUITE, read

OTHERS = [  # environments of `make test-python`
    path
    for path in sorted((ROOT / ".venv").glob("python-3.*/bin/mbsbench"))
    if path.parent != Path(sys.executable).parent
]
SAME = ("status", "energy_scale_J", "length_scale_m", "steps")


def call(*line):
    subprocess.run([str(word) for word in line], check=True, capture_output=True)


@pytest.mark.skipif(not OTHERS, reason="no environment of another Python: make test-python PYTHON=python3.13")
def test_bundles_of_two_pythons_verify_each_other(tmp_path):
    """Run and bundled by one, checked by the other: no disagreement, and equal numbers."""
    (tmp_path / "suite.toml").write_text(SUITE)
    commands = [Path(sys.executable).parent / "mbsbench", OTHERS[-1]]
    records = []
    for k, command in enumerate(commands):
        call(command, "run", tmp_path / "suite.toml", "--out", tmp_path / f"{k}", "--jobs", "1", "--lossless")
        call(command, "bundle", tmp_path / f"{k}", "-o", tmp_path / f"{k}.zip")
        call(command, "bundle", tmp_path / f"{k}", "-o", tmp_path / f"{k}_lossless.zip", "--lossless")
        records.append({r["settings_id"]: r for r in json.loads(read(tmp_path / f"{k}.zip")["records.json"])})
    for k, command in enumerate(commands):
        call(command.parent / "python", PROGRAM, tmp_path / f"{1 - k}.zip", tmp_path / f"{1 - k}_lossless.zip")
    assert records[0].keys() == records[1].keys()
    for key, record in records[0].items():
        for name in SAME:
            mine, theirs = record[name], records[1][key][name]
            assert mine == theirs or math.isclose(mine, theirs, rel_tol=1e-6), (key, name)
