"""``fuzz``: counts, a case that can be repeated, and one line for a wrong call."""

import json
from pathlib import Path

import numpy as np
import pytest

from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue.registry import make_solver
from mbsbench.harness.lab.fuzz.campaign import CampaignSettings
from mbsbench.harness.lab.fuzz.cases import format_page, read_case, write_cases
from mbsbench.harness.lab.fuzz.log import SUMMARY, Trial, append_trial, count_trials, read_trials
from mbsbench.harness.lab.fuzz.oracle import Behaviour, OracleOutcome
from mbsbench.tests.comparing import assert_close

PUBLISHED = Path(__file__).parents[3] / "results" / "published" / "fuzz"


def test_a_sound_solver_ends_with_0(tmp_path, capsys):
    """Two mechanisms, no deviation: the page has the counts."""
    assert main(["fuzz", "rattle", "--mechanisms", "2", "--out", str(tmp_path), "--jobs", "1", "--json"]) == 0
    counts = json.loads(capsys.readouterr().out)["counts"]["rattle"]
    assert counts["trials"] == 2 and counts["deviations"] == 0
    assert "| rattle |" in (tmp_path / "README.md").read_text()


def test_a_campaign_is_continued(tmp_path, capsys):
    """Trials that are in the folder are not made again; a line that was cut off is."""
    words = ["fuzz", "rattle", "rkmk_dopri5", "--in-turns", "--out", str(tmp_path), "--jobs", "1", "--json"]
    main([*words, "--mechanisms", "2"])
    log = tmp_path / "trials.jsonl"
    lines = log.read_text().splitlines()
    assert [json.loads(line)["outcome"]["solver"] for line in lines] == ["rattle", "rkmk_dopri5"]
    log.write_text(lines[0].replace('"sound"', '"refused"') + "\n" + lines[1][:40])
    capsys.readouterr()
    main([*words, "--mechanisms", "3"])
    counts = json.loads(capsys.readouterr().out)["counts"]
    assert counts["all"]["trials"] == 3 and counts["rattle"]["refused"] == 1 and counts["rkmk_dopri5"]["trials"] == 1


def test_a_deviation_beyond_all_numbers_is_read_again(tmp_path):
    """JSON has neither infinity nor NaN, and a code may give both."""
    outcome = OracleOutcome("rattle", Behaviour.TRUTH, deviation=(np.inf, np.nan), own=np.inf, limit=1.0, number=3)
    append_trial(tmp_path, Trial(CampaignSettings(1), "", outcome))
    (trial,) = read_trials(tmp_path)
    assert trial.outcome == outcome and min(trial.outcome.deviation) > 1e308 and trial.outcome.strength > 1.0


@pytest.mark.published
def test_the_published_page_is_that_of_its_summary_and_cases():
    """A sentence and a table of the counts, the causes as they are kept with the cases."""
    assert json.loads((PUBLISHED / SUMMARY).read_text())["counts"] == count_trials(read_trials(PUBLISHED))
    assert (PUBLISHED / "README.md").read_text() == format_page(PUBLISHED)


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


def test_a_finding_says_where_the_bodies_should_be(tmp_path):
    """Files of both forms, exact places, and an answer that is none; the version is among the notes."""
    case = read_case(PUBLISHED / "mujoco-74.json")
    write_cases(tmp_path, [case])
    (tmp_path / SUMMARY).write_text((PUBLISHED / SUMMARY).read_text())
    text = " ".join(format_page(tmp_path).split())
    assert {p.name for p in tmp_path.glob("*.xml")} == {"mujoco-74.xml", "mujoco-74-form.xml"}
    assert "exact (-2.10815, 0.557382, -0.713332)" in text and "unit_time=0.001: it does not reach it" in text
    assert "mujoco 4.0.0" in text


def test_answers_of_a_sound_code_end_where_the_exact_motion_does():
    """In both forms, by name."""
    oracle = read_case(PUBLISHED / "mujoco-74.json").oracle
    ends, _ = oracle.collect_answers(make_solver("rkmk_dop853"))
    assert list(ends) == ["exact", "as drawn", "unit_time=0.001"]
    for name, at in ends.items():
        assert_close(at, ends["exact"], atol=1e-5, what=name)
