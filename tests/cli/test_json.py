"""Machines get JSON from every command that prints results: each line one object, nothing else on standard output."""

import json

import pytest

from mbsbench.cli.__main__ import main

from ..harness.conftest import PLUGIN

SUITE = """
name = "small"
[[runs]]
problem = "free_fall"
solver = ["exact", "raises"]
dt = [0.1, 0.2]
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    where = tmp_path_factory.mktemp("json")
    (where / "small.toml").write_text(f'plugins = ["{PLUGIN}"]\n' + SUITE)
    for name in ("a", "b"):
        assert main(["run", str(where / "small.toml"), "--out", str(where / name), "--json"]) == 0
    return where


@pytest.fixture
def objects(place, capsys, monkeypatch):
    """The lines of a command with ``--json``, in the folder of the runs."""

    def call(*arguments, code=0):
        monkeypatch.chdir(place)
        capsys.readouterr()
        assert main([*arguments, "--json"]) == code
        out, err = capsys.readouterr()
        assert not err
        return [json.loads(line, parse_constant=pytest.fail) for line in out.splitlines()]

    return call


def test_run(objects):
    """One object at its end: where, how many, how they ended."""
    (said,) = objects("run", "small.toml", "--out", "c")
    assert said["runs"] == 4 and said["statuses"] == {"success": 2, "crashed": 2}
    assert said["folder"] == "c" and said["not_begun"] == 0


def test_list(objects):
    (said,) = objects("list")
    top = next(p for p in said["problems"] if p["name"] == "heavy_top")
    assert {"t_end", "yaw"} <= {o["name"] for o in top["parameters"]} and all(o["doc"] for o in top["parameters"])
    assert {s["control"] for s in said["solvers"]} == {"dt", "rtol"} and "ci" in said["suites"]


@pytest.mark.parametrize(
    ("arguments", "code", "key"),
    [(("show", "a"), 0, "settings_id"), (("diff", "a", "b"), 0, "same"),
     (("history", "a", "b"), 0, "energy_drift_max_J"),
     (("merge", "d", "a", "b"), 0, "conflicts"),
     (("verify", "a", "--sample", "1", "--plugin", str(PLUGIN)), 0, "alike"),
     (("solve", "free_fall", "exact", "--out", "x.npz"), 0, "status"),
     (("solve", "free_fall", "raises", "--out", "x.npz"), 1, "status")],
)  # fmt: skip
def test_others(objects, arguments, code, key):
    """Numbers that do not exist are null or words, never NaN."""
    said = objects(*arguments, code=code)
    assert said and all(key in x for x in said)
