"""``shadow``: findings and a page for a motion from ``solve``, from a table, and from a results folder."""

import json

import numpy as np
import pytest

from mbsbench.cli.__main__ import main


@pytest.fixture
def solved(tmp_path, capsys):
    """A file of ``solve``."""
    path = tmp_path / "pendulum.npz"
    assert main(["solve", "simple_pendulum", "rattle", "--set", "dt=0.01", "--t-end", "1", "--out", str(path)]) == 0
    capsys.readouterr()
    return path


def test_findings_and_page(solved, tmp_path, capsys):
    """A true motion is near a good one; the page shows it; the verdict on the modified energy is beside it."""
    page = tmp_path / "shadow.html"
    assert main(["shadow", str(solved), "--html", str(page), "--json"]) == 0
    found = {f["quantity"]: f for f in map(json.loads, capsys.readouterr().out.splitlines())}
    assert found["true motion nearby"]["verdict"] == "met"
    assert 0.0 < found["largest distance of C"]["value"] < 1e-3
    assert found["largest gap left"]["value"] < 1e-8
    assert any(name.startswith("swing of the modified energy") for name in found)
    assert page.read_text(encoding="utf-8").count("data:image/svg") == 2


def test_table_of_another_code_has_the_same_shadow(solved, tmp_path, capsys):
    """The numbers in the file are those of the run, to their last digit."""
    with np.load(solved) as run:
        columns = {f"{k}{i}": a for k in ("r", "v") for i, a in zip("xyz", run[k][:, 0].T, strict=True)}
        columns |= {f"R{i + 1}{j + 1}": run["R"][:, 0, i, j] for i in range(3) for j in range(3)}
        columns |= {f"omega{i}": a for i, a in zip("xyz", run["Omega"][:, 0].T, strict=True)}
        table = np.column_stack((run["t"], *columns.values()))
    file = tmp_path / "motion.csv"
    np.savetxt(file, table, "%.17g", delimiter=",", header=",".join(["t", *columns]), comments="")
    values = []
    for words in ([str(solved)], [str(file), "--problem", "simple_pendulum", "--t-end", "1"]):
        assert main(["shadow", *words, "--json"]) == 0
        found = {f["quantity"]: f for f in map(json.loads, capsys.readouterr().out.splitlines())}
        values.append(found["rms distance of C"]["value"])
    assert values[1] == pytest.approx(values[0], rel=1e-6)


def test_wrong_calls_are_one_line(tmp_path, capsys):
    """A table needs its problem, and a name a results folder that has it."""
    file = tmp_path / "motion.csv"
    file.write_text("t\n0\n")
    assert main(["shadow", str(file)]) == 2
    assert "--problem" in capsys.readouterr().err


@pytest.mark.sampled(0)
def test_solve_names_the_nearest_true_motion(tmp_path, monkeypatch, capsys):
    """The distances of ``shadow``, where asked; where a motion is inaccurate, how to ask."""
    monkeypatch.chdir(tmp_path)
    words = ["solve", "chain", "rattle", "--problem-set", "links=6", "--t-end", "0.4", "--shadow"]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert main([*words, "--json"]) == 0
    nearest = json.loads(capsys.readouterr().out)["nearest"]
    assert f"true motion        {nearest['words']}" in printed
    assert main(["shadow", "chain-rattle.npz", "--json"]) == 0
    found = {f["quantity"]: f for f in map(json.loads, capsys.readouterr().out.splitlines())}
    assert nearest["rms_m"] == pytest.approx(found["rms distance of C"]["value"], rel=1e-6)
    assert 0.0 < nearest["largest_m"] < 1e-3 and nearest["glitch_s"] is None
    assert main(["solve", "cart_pendulum", "mujoco", "--set", "dt=0.02", "--out", "far.npz"]) in (0, 1)
