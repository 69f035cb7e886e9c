"""docs/questions.md: each answer is a number that its command prints, to the digits stated."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.results.environment import ROOT

sys.path.insert(0, str(ROOT / "docs"))
import list_questions

QUESTIONS = list_questions.read_questions()
WIDE = "1000"  # columns, so that no word of a table is wrapped


def test_the_page_is_made_of_the_data():
    (found,) = list_questions.TABLE.findall(list_questions.PAGE.read_text(encoding="utf-8"))
    assert found == list_questions.table()


def test_every_question_is_answered_or_says_what_is_missing():
    assert len(QUESTIONS) == 46
    for q in QUESTIONS:
        assert ("missing" in q) != ("command" in q) and all("#" in t for t in q["threads"])
        assert "command" not in q or (q["answer"].count("{}") == 1 and q["figure"] and q["value"])
        assert all(other["value"] in q["answer"] for other in q.get("also", []))


BEYOND_CORE = r"mbsbench(\.kit| (referee|shadow|ensemble|fuzz|bundle|submit|ladder)) "  # of rooms that can be deleted


def marks_of(question):
    given = {key for key, value in question.items() if value}
    given |= {"beyond"} if re.search(BEYOND_CORE, question["command"]) else set()
    marks = (("slow", "slow"), ("engine", "needs"), ("beyond_core", "beyond"))
    return [getattr(pytest.mark, mark) for mark, key in marks if key in given]


NUMBERS = [{**q, **number} for q in QUESTIONS if "command" in q for number in (q, *q.get("also", []))]


def run_in_a_shell(question, folder):
    """What the command prints, beside the folder of pages."""
    path = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    env = {**os.environ, "PATH": path, "COLUMNS": WIDE, "PYTHONPATH": str(folder / "modules")}
    ran = subprocess.run(question["command"], shell=True, cwd=folder, env=env, capture_output=True, text=True)  # noqa: PLW1510
    return ran.stdout + ran.stderr


@pytest.fixture
def run_here(monkeypatch, capsys, tmp_path):
    """What a command of mbsbench alone prints, which needs no process of its own."""

    def run(command):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("COLUMNS", WIDE)
        main(shlex.split(command)[1:])
        said = capsys.readouterr()
        return said.out + said.err

    return run


PRINTED: dict[str, str] = {}  # by commands that have run: some answer several questions


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "question", [pytest.param(q, id=f"{q['ask']} {q['value']}", marks=marks_of(q)) for q in NUMBERS]
)
def test_the_command_prints_the_number_of_its_answer(question, tmp_path, run_here):
    for engine in question.get("needs", []):
        if importlib.util.find_spec(engine) is None and not (Path(sys.prefix) / "engines" / engine).exists():
            pytest.skip(f"{engine} is not installed: make engines")
        if f"kit_{engine}" in question["command"]:  # its own module, from its environment: all else is ours
            (tmp_path / "modules").mkdir()
            for found in (Path(sys.prefix) / "engines" / engine).glob(f"lib/python*/site-packages/{engine}*"):
                (tmp_path / "modules" / found.name).symlink_to(found)
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    command = question["command"]
    if command not in PRINTED:
        alone = re.fullmatch(r"mbsbench (solve|check) [\w =.,-]+", command) and not question.get("needs")
        PRINTED[command] = run_here(command) if alone else run_in_a_shell(question, tmp_path)
    value, half_unit = list_questions.read_stated(question)
    found = list_questions.read_figure(question, PRINTED[command])
    assert abs(found - value) <= 1.01 * half_unit, f"{found} is not {question['value']}"
