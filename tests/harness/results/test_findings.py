"""A finding knows how much was measured: what was not measured cannot hold."""

import json
import math

import msgspec
import pytest

from mbsbench.harness.results.findings import (
    Finding,
    Verdict,
    count_holding,
    judge_value,
    leave_open,
    leave_undetermined,
    make_failure,
)


@pytest.mark.parametrize("verdict", [Verdict.MET, Verdict.XPASS])
def test_nothing_measured_meets_no_requirement(verdict):
    """Neither here nor where a finding is read from a file."""
    with pytest.raises(ValueError, match="symmetries: nothing was measured"):
        Finding("symmetries", words="0 of 0 hold", count=0, verdict=verdict)
    text = {"quantity": "symmetries", "count": 0, "verdict": str(verdict)}
    with pytest.raises(msgspec.ValidationError, match="nothing was measured"):
        msgspec.convert(json.loads(json.dumps(text)), Finding)
    assert Finding(count=0).verdict is Verdict.OPEN and not Finding(count=0, verdict=Verdict.FAILED).holds


def test_a_limit_that_nothing_was_compared_with_is_open():
    """None of no runs failed: at most 0 are allowed, and nothing is known."""
    assert judge_value(0, "of 5 runs failed", most=0, count=5).verdict is Verdict.MET
    assert judge_value(0, "of 0 runs failed", most=0, count=0).verdict is Verdict.OPEN
    assert leave_open("no runs").count == 0 and not make_failure("crashed").holds


def test_a_count_holds_where_all_do_and_is_open_where_some_do_not():
    """0 of 9 is never met; a check that fails has a finding of its own."""
    found = {(k, n): count_holding("checks", k, n, "", "all") for k, n in ((9, 9), (8, 9), (0, 9), (0, 0))}
    assert [f.verdict for f in found.values()] == [Verdict.MET, Verdict.OPEN, Verdict.OPEN, Verdict.OPEN]
    assert [f.count for f in found.values()] == [9, 9, 9, 0]
    assert found[8, 9].text == "8 of 9 hold" and found[0, 0].text.startswith("not determined")
    assert count_holding("checks", 2, 2, "1 refused", "").text == "2 of 2 hold; 1 refused"


def test_what_is_not_determined_has_its_reason():
    """And no number."""
    found = leave_undetermined("order", "no ladder", "2 declared")
    assert found.text == "not determined: no ladder" and math.isnan(found.value)
    assert found.limits == "2 declared" and found.holds and not found.is_tested
