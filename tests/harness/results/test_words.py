"""The words of a record: how far a lawful motion was compared stands beside its status, wherever that is told."""

import dataclasses
import json
import math
import types

import pytest
from rich.console import Console

from mbsbench.cli import show
from mbsbench.cli.progress import ProgressDisplay
from mbsbench.cli.solve import summarize_record
from mbsbench.harness.base.cache import ROOT
from mbsbench.harness.judge.conformance import trials
from mbsbench.harness.judge.gate.check import _judge_status
from mbsbench.harness.judge.gate.thresholds import ExpectedStatus
from mbsbench.harness.mechanics.types import Status
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.words import describe_comparison, describe_status, qualify_status
from mbsbench.notebook import show_results, show_run
from mbsbench.reports.model.results import StoredRun

LAWFUL = RunRecord(
    run_id="a",
    case="a bar",
    problem="p",
    solver="s",
    status="success",
    claimed="success",
    ended_by="solver",
    t_reached_s=2000.0,
    t_end_s=2000.0,
    reference_horizon_s=58.8,
    compared_to_s=58.8,
    judged_to_s=58.8,
    position_error_max_m=1e-6,
    position_error_judged_m=1e-6,
)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, "success, compared to 58.8 of 2000 s"),
        ({"judged_to_s": 2000.0}, "success"),
        ({"judged_to_s": 1999.5}, "success"),  # the last step before a horizon
        ({"status": "inaccurate"}, "inaccurate, compared to 58.8 of 2000 s"),
        ({"status": "wrong"}, "wrong"),  # it breaks a law: no comparison is needed
        ({"status": "diverged"}, "diverged"),
        (
            {"position_error_judged_m": math.nan, "reference_horizon_s": math.nan},
            "success, compared with no exact motion",
        ),
    ],
)
def test_a_status_says_until_when_its_motion_was_compared(changed, words):
    """On the terminal, in the gate, and, from the same function, on pages."""
    record = dataclasses.replace(LAWFUL, **changed)
    assert describe_status(record) == words
    assert any(line.startswith("status") and words in line for line in summarize_record(record))
    if record.status == "success":
        assert _judge_status("case", record, None, "").why == describe_comparison(record)


QUALIFIED = dataclasses.replace(
    LAWFUL,
    run_id="aa",
    motion_error_max_m=1e-6,
    notes=json.dumps(["passes a singular pose at t = 0.73 s, where branches meet"]),
    reaction_error_max_N=17.6,
    reaction_size_N=10.0,
    energy_scale_J=1.0,
    length_scale_m=1.0,
)
BESIDE = "compared to 58.8 of 2000 s, passes a singular pose at t = 0.73 s, reactions off by 176 %"


def show_progress(record, monkeypatch):
    """The line of ``mbsbench run`` on the end of a run."""
    lines = []
    display = ProgressDisplay(Console(), None)
    monkeypatch.setattr(display, "_print_line", lambda words, style="": lines.append(words))
    display.on_end(types.SimpleNamespace(id="a", spec=types.SimpleNamespace(case="a bar")), record)
    return lines[0]


@pytest.mark.parametrize("status", ["success", "inaccurate"])
def test_what_is_said_beside_a_status_is_said_wherever_it_is_shown(status, monkeypatch, tmp_path, capsys):
    """How far it was compared, a singular pose, wrong reactions: one function, whoever shows the status."""
    r = dataclasses.replace(QUALIFIED, status=status)
    assert qualify_status(r) == BESIDE and describe_status(r) == f"{status}, {BESIDE}"
    expected = ExpectedStatus("a bar", Status(status), "as known")
    shown = {
        "solve": "\n".join(summarize_record(r)),
        "run": show_progress(r, monkeypatch),
        "gate": _judge_status("a bar", r, expected, "").why,
        "closed gate": _judge_status("a bar", r, ExpectedStatus("a bar", Status.REFUSED, ""), "").why,
        "page": StoredRun(r).qualifiers,
        "check": trials._describe_qualified([r]),
        "notebook": show_run(r),
        "results in a notebook": show_results("x", [r], {}),
    }
    show._print_runs([r], [""])
    shown["show"] = " ".join(capsys.readouterr().out.split())
    assert [where for where, words in shown.items() if BESIDE not in words] == []


@pytest.mark.parametrize("name", ["run", "problem", "marks"])
def test_pages_show_what_is_said_beside_a_status(name):
    """A page without it would call a motion right of which half was seen."""
    text = (ROOT / "reports" / "templates" / f"{name}.html").read_text(encoding="utf-8")
    assert text.count(".qualifiers %}") == 1 and text.count(".qualifiers }}") == 1


def test_check_says_how_far_a_success_was_compared():
    """Its requirements are met by what was compared alone."""
    evidence = trials.Evidence("dt", 2.0, {"easy motion": QUALIFIED, "driven": QUALIFIED}, {})
    for requirement in (trials.check_endings, trials.check_drives):
        found = requirement(evidence)
        assert found.holds and BESIDE in found.words
