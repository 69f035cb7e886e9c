"""The words of a record: how far a lawful motion was compared stands beside its status, wherever that is told."""

import dataclasses
import math

import pytest

from mbsbench.cli.solve import summarize
from mbsbench.harness.judge.gate.check import _judge_status
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.words import describe_comparison, describe_status

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
    assert any(line.startswith("status") and words in line for line in summarize(record))
    if record.status == "success":
        assert _judge_status("case", record, None, "").required.why == describe_comparison(record)
