"""``fuzz``: counts, a case that can be repeated, and one line for a wrong call."""

import json
from pathlib import Path

from mbsbench.cli.__main__ import main

PUBLISHED = Path(__file__).parents[2] / "results" / "published" / "fuzz"


def test_a_sound_solver_ends_with_0(tmp_path, capsys):
    """Two mechanisms, no deviation: the page has the counts."""
    assert main(["fuzz", "rattle", "--mechanisms", "2", "--out", str(tmp_path), "--jobs", "1", "--json"]) == 0
    counts = json.loads(capsys.readouterr().out)["counts"]["rattle"]
    assert sum(counts.values()) == 2
    assert "| rattle |" in (tmp_path / "README.md").read_text()


def test_a_published_case_is_examined_again(capsys):
    """Its deviation came from rows of rounding, which are dropped."""
    assert main(["fuzz", "dop853_joint", "--repeat", str(PUBLISHED / "dop853_joint-30.json"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kind"] == "sound"


def test_wrong_calls_are_answered_in_one_line(tmp_path, capsys):
    """Unknown names and files that are no cases."""
    (tmp_path / "x.json").write_text("{}")
    for words in (["nobody"], ["rattle", "--repeat", str(tmp_path / "x.json")], ["rattle", "--set", "colour=1"]):
        assert main(["fuzz", *words]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
