"""``mbsbench ensemble``: rows, verdict, page."""

import json

import pytest

from mbsbench.cli.__main__ import main

ARGUMENTS = ("ensemble", "simple_pendulum", "rattle", "--starts", "12", "--at", "0.1,0.2", "--jobs", "1", "--json")


@pytest.mark.sampled(0)
def test_a_seed_gives_the_same_rows_and_a_page_has_all_of_them(capsys, tmp_path):
    """A row for truth and solver, each quantity and each time; in one page without requests."""
    page = tmp_path / "clouds.html"
    assert main([*ARGUMENTS, "--html", str(page)]) == 0
    out, err = capsys.readouterr()
    rows = [json.loads(line) for line in out.splitlines()]
    assert {r["solver"] for r in rows} == {"truth", "rattle"} and {r["t_s"] for r in rows} == {0.1, 0.2}
    assert all(r["members"] == 12 and r["missing"] == 0 for r in rows) and "CPU time each" in err
    text = page.read_text(encoding="utf-8")
    assert text.count("<tr>") == 1 + len(rows) and "data:image/svg+xml" in text and "http" not in text
    main([*ARGUMENTS])
    assert capsys.readouterr().out == out
    main([*ARGUMENTS, "--seed", "2"])
    assert capsys.readouterr().out != out


@pytest.mark.parametrize(
    ("more", "words"),
    [(("--at", "2,1"), "increase"), (("--set", "order=2"), "order"), (("--truth", "rattle"), "controlled by dt")],
)
def test_wrong_calls_are_answered_in_a_line(capsys, more, words):
    """Before anything is run."""
    assert main(["ensemble", "simple_pendulum", "rattle", *more]) == 2
    assert words in capsys.readouterr().err
