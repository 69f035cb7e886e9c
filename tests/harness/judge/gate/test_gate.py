"""The gate closes on a breach, a missing or unjudged run and an empty run, and opens only otherwise."""

import dataclasses
import math
import random
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from mbsbench.cli import gate as gate_command
from mbsbench.cli.__main__ import main
from mbsbench.harness.base.files import FileError
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.columns.identity import compute_fingerprint
from mbsbench.harness.judge.gate.baseline import FOLDER, format_thresholds, read_thresholds
from mbsbench.harness.judge.gate.check import (
    count_cases,
    count_states,
    describe_counts,
    describe_gate,
    find_worst_verdict,
    is_open,
    judge_runs,
    list_missing_packages,
    select_consequences,
    select_judged,
    select_notable,
    tighten_bounds,
)
from mbsbench.harness.judge.gate.files import format_annotations, format_junit, format_markdown
from mbsbench.harness.judge.gate.thresholds import (
    ERROR_CONTROL,
    FIXED_STEP,
    LEFT_OVER,
    ROUNDING,
    SAME_PROBLEM,
    SAME_STEPS,
    ExpectedStatus,
    Threshold,
    Thresholds,
    propose_bounds,
)
from mbsbench.harness.mechanics.state import State as Pose
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.mechanics.types import Problem, Status, StepControl
from mbsbench.harness.results import environment
from mbsbench.harness.results.findings import Verdict
from mbsbench.harness.results.provisional import select_latest
from mbsbench.harness.results.records import RunRecord

RUNS = tuple(RunSpec("free_fall", "exact", StepControl(dt=dt)) for dt in (0.1, 0.5))
CASE, OTHER = (c.case for c in RUNS)
RECORDS = [
    RunRecord(run_id=c.settings_id, settings_id=c.settings_id, case=c.case, status="success", phi_max=1.0) for c in RUNS
]


def threshold(case: str, **change) -> Threshold:
    given = {"metric": "phi_max", "value": 1.0, "upper": 1.2, "reason": "a reason", **change}
    return Threshold(case=case, **given)


BOUNDS = Thresholds("t", (threshold(CASE), threshold(OTHER)))


def state(records=RECORDS, bounds=BOUNDS, specs=RUNS):
    return judge_runs(specs, records, bounds)


def with_bound(**change) -> Thresholds:
    return Thresholds("t", (threshold(CASE, **change), threshold(OTHER)))


def changed(**change) -> list[RunRecord]:
    return [dataclasses.replace(RECORDS[0], **change), RECORDS[1]]


def test_all_within_bounds_is_open():
    """The plain case."""
    assert find_worst_verdict(state()) is Verdict.MET and is_open(state())


@pytest.mark.parametrize(
    "verdict",
    [
        lambda: state(changed(phi_max=1.3)),
        lambda: state(changed(phi_max=math.nan)),
        lambda: state(changed(phi_max=math.inf)),
        lambda: state(changed(status="wrong")),
        lambda: state(changed(status="refused")),
        lambda: state(changed(status="stalled")),
        lambda: state(RECORDS[:1]),
        lambda: state([]),
        lambda: state([], Thresholds("t"), ()),
        lambda: state(bounds=Thresholds("t")),
        lambda: state(bounds=Thresholds("t", (threshold(CASE),))),
        lambda: state(bounds=Thresholds("t", (*BOUNDS.bounds, threshold("gone")))),
        lambda: state(bounds=with_bound(lower=1.1)),
    ],
)
def test_the_gate_closes(verdict):
    """Breach, NaN, wrong, refused, timed out, missing, empty, unjudged, or a bound on a run that is gone."""
    assert find_worst_verdict(verdict()) is Verdict.FAILED and not is_open(verdict())


def test_a_value_below_its_lower_bound_is_said_to_be_better():
    """Of errors; the scale of a problem's energy is neither better nor worse."""
    errors = state(changed(phi_max=0.5), with_bound(lower=0.9))[0]
    assert errors.verdict is Verdict.FAILED and "better than it was" in errors.why
    above = state(changed(phi_max=1.3), with_bound(lower=0.9))[0]
    assert "better" not in above.why
    scale = with_bound(metric="energy_scale_J", lower=0.9)
    assert "better" not in state(changed(energy_scale_J=0.5), scale)[0].why


def test_a_run_without_a_step_passes_nothing():
    """Its zeros are within their bounds; one that reached its end keeps what it has."""
    passed = count_states(state())["PASS"]
    assert count_states(state(changed(status="diverged", phi_max=0.0)))["PASS"] == passed - 2
    assert count_states(state(changed(status="wrong")))["PASS"] == passed - 1


def test_an_error_that_goes_away_closes_the_gate():
    """Nothing computes better for no reason: a drift that is zeroed, or errors that are no longer measured."""
    record = RunRecord(
        case=CASE,
        status="success",
        control="dt",
        energy_drift_max_J=2e-3,
        energy_scale_J=5.0,
        steps=100,
        position_error_max_m=1e-4,
        length_scale_m=1.0,
    )
    bounds = {b.metric: b for b in propose_bounds([record])}
    for metric in ("energy_drift_max_J", "position_error_max_m", "energy_scale_J"):
        value = getattr(record, metric)
        assert bounds[metric].holds(value) and not bounds[metric].holds(0.0) and not bounds[metric].holds(value / 4.0)


@pytest.mark.parametrize("change", [{"gravity": (0.0, 0.0, -9.80)}, {"mass": 1.001}, {"t_end": 5.01}, {"v": 1e-3}])
def test_another_problem_is_not_the_one_of_the_baseline(change):
    """g = 9.80 where 9.81 was: every solver agrees with its reference, on another problem."""

    def problem(gravity=(0.0, 0.0, -9.81), mass=1.0, t_end=5.0, v=0.0):
        start = Pose(np.zeros((1, 3)), np.eye(3)[None], np.full((1, 3), v), np.zeros((1, 3)))
        return Problem("p", assemble([RigidBody(mass, np.eye(3))], (), gravity), start, t_end, 0.01, "", "")

    same, other = compute_fingerprint(problem()), compute_fingerprint(problem(**change))
    (bound,) = [
        b
        for b in propose_bounds([RunRecord(case=CASE, status="success", problem_fingerprint=same)])
        if b.tolerance is not None
    ]
    assert bound.holds(same * (1.0 + 1e-13)) and not bound.holds(other) and not bound.holds(math.nan)


def test_a_single_leftover_threshold_judges_no_run():
    """Of all that was measured each number has its bound, or the gate says which has none."""
    records = changed(energy_drift_max_J=1e-3, energy_scale_J=1.0)
    verdict = state(records)
    assert not is_open(verdict)
    assert {f.quantity for f in verdict if f.verdict is Verdict.FAILED} == {
        "energy_drift_max_J",
        "energy_scale_J",
    }


def test_two_runs_of_one_name_are_not_judged_as_one():
    """Settings that differ in the 13th digit have names of their own; where two have one name, the gate is closed."""
    near = [RunSpec("free_fall", "exact", StepControl(dt=dt)) for dt in (0.1, 0.1 + 1e-14)]
    assert near[0].case != near[1].case
    limits = (RUNS[0], dataclasses.replace(RUNS[0], problem="free_fall"), RUNS[1])
    assert not is_open(state(specs=limits))


def test_thresholds_of_another_suite_are_refused(tmp_path, capsys):
    """Those of a short suite would leave the runs of a long one unjudged."""
    path = tmp_path / "t.toml"
    path.write_text(format_thresholds(BOUNDS))
    assert main(["gate", "--suite", "ci", "--thresholds", str(path)]) == 2
    assert "suite 't', not of 'ci'" in capsys.readouterr().err


def test_a_result_of_other_code_counts_as_missing():
    """It says nothing about the code of today; asked for by name (no code) the newest is judged."""
    old, new = (
        dataclasses.replace(RECORDS[0], code=code, finished=when, phi_max=value)
        for code, when, value in (("then", "2026-01-02", 9.0), ("now", "2026-01-01", 1.0))
    )
    here = dataclasses.replace(RECORDS[1], code="now")
    for records in ([old, new, here], [here, new, old]):
        assert is_open(judge_runs(RUNS, records, BOUNDS, lambda *_: "now"))
        assert (
            find_worst_verdict(judge_runs(RUNS, records, BOUNDS)) is Verdict.FAILED
        )  # the newest of all is the one of other code
    closed = judge_runs(RUNS, [old, here], BOUNDS, lambda *_: "now")
    assert not is_open(closed) and all("other code" in f.why for f in closed if f.subject == CASE)
    assert not is_open(judge_runs(RUNS, [old, here], BOUNDS, lambda *_: "later"))


@pytest.mark.parametrize("status", ["diverged", "wrong", "crashed"])
def test_a_success_does_not_hide_a_failure(status):
    """The newest counts whatever its status; of two of one time the failure, in whatever order they are read."""
    early, late = "2026-01-01T00:00:00.000001Z", "2026-01-01T00:00:00.000002Z"
    for was, now in ((early, late), (early, early)):
        good = dataclasses.replace(RECORDS[0], run_id="a", finished=was)
        bad = dataclasses.replace(RECORDS[0], run_id="0", finished=now, status=status)
        for records in ([good, bad, RECORDS[1]], [RECORDS[1], bad, good]):
            assert find_worst_verdict(state(records)) is Verdict.FAILED
            assert status in {r.status for r in select_judged(records, None)}
    mended = dataclasses.replace(good, finished=late)
    assert is_open(state([mended, bad, RECORDS[1]])) and is_open(state([bad, mended, RECORDS[1]]))


def test_of_two_results_of_one_time_all_readers_take_the_failure():
    """Certificates and pictures as well."""
    good, bad = RECORDS[0], dataclasses.replace(RECORDS[0], run_id="0", status="diverged")
    for records in ([good, bad], [bad, good]):
        assert select_latest(records) == (bad,)


def test_a_missing_figure_closes_the_gate():
    """Whatever was expected of it, and also where the status is a success."""
    for expect in ("pass", "fail"):
        found = state(changed(phi_max=math.nan), with_bound(expect=expect))
        assert [f.quantity for f in found if f.verdict is Verdict.FAILED] == ["phi_max"]
        assert "not measured" in found[0].why


def test_causes_come_before_what_follows_from_them():
    """A run without a step has zeros for all that was measured: its status is why, and stands first."""
    zeros = [
        dataclasses.replace(RECORDS[0], phi_max=9.0),
        dataclasses.replace(RECORDS[1], status="diverged", phi_max=0.0),
    ]
    bounds = Thresholds("t", (threshold(CASE), threshold(OTHER, lower=0.5)))
    found = state(zeros, bounds)
    failed = [(f.subject, f.quantity) for f in found if f.verdict is Verdict.FAILED]
    assert failed == [(OTHER, "status"), (CASE, "phi_max"), (OTHER, "phi_max")]
    assert [(f.subject, f.quantity) for f in select_consequences(found)] == failed[2:]
    assert not select_consequences(state(changed(phi_max=9.0))) and not select_consequences(state())


def test_the_worst_is_printed_last(capsys, monkeypatch):
    """CI shows the end of a log: what moved, what failed, the verdict; what only follows is counted."""
    monkeypatch.setenv("COLUMNS", "160")
    runs = [RunSpec("free_fall", "exact", StepControl(dt=dt)) for dt in (0.1, 0.5, 0.25)]
    cases = [r.case for r in runs]
    good = [RunRecord(settings_id=r.settings_id, case=r.case, status="success", phi_max=1.0) for r in runs]
    records = [
        dataclasses.replace(good[0], phi_max=1.1),
        dataclasses.replace(good[1], status="diverged", phi_max=0.0),
        dataclasses.replace(good[2], phi_max=7.0),
    ]
    result = judge_runs(runs, records, Thresholds("t", tuple(threshold(c, lower=0.5) for c in cases)))
    gate_command._print_findings(result, everything=False)
    lines = capsys.readouterr().out.splitlines()
    first = {word: next(k for k, x in enumerate(lines) if word in x) for word in ("x 1.1", "diverged", "x 7")}
    assert [*first] == sorted(first, key=lambda word: first[word])
    assert "CLOSED" in lines[-1] and not any("x 0" in x for x in lines)
    assert any(x.startswith("1 bound more of runs that did not end as expected") for x in lines)
    gate_command._print_findings(result, everything=True)
    assert "x 0" in capsys.readouterr().out


def test_github_gets_an_annotation_a_case():
    """Workflow commands with the first cause; characters that would end one are written as GitHub reads them."""
    assert format_annotations(state(), "ci") == []
    bad = dataclasses.replace(RECORDS[0], status="diverged", message="50 %\nof: all, at once", phi_max=0.0)
    (line,) = format_annotations(state([bad, RECORDS[1]], with_bound(lower=0.5)), "ci")
    head, _, words = line.removeprefix("::error title=").partition("::")
    assert line.startswith("::error title=") and head == "gate ci%3A " + CASE.replace(",", "%2C")
    assert words.startswith("FAIL: diverged, expected success") and "50 %25" in words and "\n" not in line
    assert words.endswith("(and 1 more of this run)")


def test_the_end_of_a_run_is_known_to_the_microsecond():
    """Two files judged within a second are told apart."""
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z", environment.read_utc_time(fine=True))


def test_expected_failures_are_distinguished():
    """XFAIL keeps the gate open; XPASS closes it, for the expectation is out of date."""
    bounds = with_bound(expect="fail", upper=0.5)
    assert find_worst_verdict(state(bounds=bounds)) is Verdict.XFAIL and is_open(state(bounds=bounds))
    bounds = with_bound(expect="fail")
    assert find_worst_verdict(state(bounds=bounds)) is Verdict.XPASS and not is_open(state(bounds=bounds))
    expects = Thresholds("t", BOUNDS.bounds[1:], (ExpectedStatus(CASE, Status.REFUSED, "redundant rows"),))
    assert find_worst_verdict(state(changed(status="refused"), expects)) is Verdict.XFAIL
    assert find_worst_verdict(state(RECORDS, expects)) is Verdict.XPASS
    assert find_worst_verdict(state(changed(status="crashed"), expects)) is Verdict.FAILED


def test_update_only_tightens_unless_asked():
    """A worse number must be asked for by name."""
    better, worse = threshold(CASE, upper=0.6, value=0.5), threshold(OTHER, upper=9.0, value=7.5)
    new = tighten_bounds(BOUNDS, RECORDS, [better, worse], loosen=False)
    assert {b.case: b.upper for b in new.bounds} == {CASE: 0.6, OTHER: 1.2}
    new = tighten_bounds(BOUNDS, RECORDS, [better, worse], loosen=True)
    assert {b.case: b.upper for b in new.bounds} == {CASE: 0.6, OTHER: 9.0}


def test_update_keeps_a_width_that_has_its_reason():
    """The value has not moved: a bound set five times above it by hand is not narrowed; half the value halves it."""
    wide = Thresholds("t", (threshold(CASE, upper=5.0),))
    same, better = threshold(CASE, upper=1.2), threshold(CASE, value=0.5, upper=0.6)
    assert tighten_bounds(wide, RECORDS, [same], loosen=False) == wide
    (new,) = tighten_bounds(wide, RECORDS, [better], loosen=False).bounds
    assert new.upper == 2.5 and new.value == 0.5


@pytest.mark.parametrize("loosen", [False, True])
@pytest.mark.parametrize("value", [0.1, 1.0, 3.0, 9.0])
@pytest.mark.parametrize(("lower", "upper"), [(1.0, math.inf), (1.0, 5.0), (-math.inf, 5.0)])
def test_what_update_writes_can_be_read_and_goes_the_same_way(tmp_path, lower, upper, value, loosen):
    """Bounds below, above or on both sides, a value within or outside: no bound comes or goes, none crosses another."""
    was = threshold(CASE, value=2.0, lower=lower, upper=upper)
    new = threshold(CASE, value=value, upper=1.2 * value)
    (after,) = tighten_bounds(Thresholds("t", (was,)), RECORDS, [new], loosen=loosen).bounds
    path = tmp_path / "t.toml"
    path.write_text(format_thresholds(Thresholds("t", (after,))))
    (read,) = read_thresholds(path).bounds
    assert read == after and (read.upper < math.inf, read.lower > -math.inf) == (upper < math.inf, lower > 0.0)
    assert loosen or (after.lower >= was.lower and after.upper <= was.upper)
    assert after.holds(value) or not (loosen or was.holds(value))


def test_any_words_come_back_as_written(tmp_path):
    """Characters beyond the basic plane, DEL, quotes: the file is TOML whatever a case is called."""
    odd = 'a "b" \\ \x7f \x00 \U0001f600 é #'
    bounds = Thresholds(odd, (threshold(odd, reason=odd),), (ExpectedStatus(odd, Status.REFUSED, odd),))
    path = tmp_path / "t.toml"
    path.write_text(format_thresholds(bounds), encoding="utf-8")
    assert read_thresholds(path) == bounds


def equal(value: float, tolerance: float) -> Threshold:
    return threshold(CASE, value=value, upper=math.inf, tolerance=tolerance)


def test_equal_is_exact_unless_a_tolerance_is_stated(tmp_path):
    """One step more is a breach; of a float that a machine may round, so is more than the stated tolerance."""
    for tolerance, passes, fails in ((0.0, 100.0, 101.0), (1e-6, 100.00009, 100.0002)):
        bounds = Thresholds("t", (equal(100.0, tolerance), threshold(OTHER)))
        assert find_worst_verdict(state(changed(phi_max=passes), bounds)) is Verdict.MET
        assert find_worst_verdict(state(changed(phi_max=fails), bounds)) is Verdict.FAILED
        path = tmp_path / "t.toml"
        path.write_text(format_thresholds(bounds))
        assert read_thresholds(path) == bounds
    record = RunRecord(case=CASE, status="success", control="dt", steps=100, rejected=0.0)
    (steps,) = propose_bounds([record])
    assert steps.tolerance == 0.0 and steps.holds(100.0) and not steps.holds(99.0)
    old, new = Thresholds("t", (steps,)), replace(steps, value=50.0)
    assert tighten_bounds(old, [record], [new], loosen=False).bounds == (steps,)
    assert tighten_bounds(old, [record], [new], loosen=True).bounds == (new,)


def test_verdicts_are_written_for_ci():
    """JUnit that parses, whatever a solver's message holds; Markdown with the same counts."""
    verdict = state(changed(phi_max=1.3, status="crashed", message="a | b\0<c> ]]> \ud800"))
    root = ElementTree.fromstring(format_junit(verdict, "t"))
    assert root.get("tests") == "4" and root.get("failures") == "2" and len(root.findall(".//failure")) == 2
    text = format_markdown(verdict, "t")
    assert "CLOSED" in text and "2 FAIL, 2 PASS" in text and r"a \| b" in text
    empty = state([], Thresholds("t"), ())
    assert ElementTree.fromstring(format_junit(empty, "t")).get(
        "failures"
    ) == "1" and "nothing was judged" in format_markdown(empty, "t")
    expected = ElementTree.fromstring(format_junit(state(bounds=with_bound(expect="fail", upper=0.5)), "t"))
    assert expected.get("skipped") == "1" and expected.get("failures") == "0"


def test_proposals_catch_a_doubled_step():
    """Second order: twice the step is 4 times the drift, over any proposed bound."""
    record = RunRecord(
        case=CASE, status="success", control="dt", energy_drift_max_J=2e-3, energy_scale_J=5.0, steps=100
    )
    (bound,) = [b for b in propose_bounds([record]) if b.metric == "energy_drift_max_J"]
    assert bound.holds(2e-3) and not bound.holds(4e-3)
    rounding = dataclasses.replace(record, energy_drift_max_J=3e-16)
    (bound,) = [b for b in propose_bounds([rounding]) if b.metric == "energy_drift_max_J"]
    assert bound.holds(1e-14) and not bound.holds(1e-8)


METRICS = ("energy_drift_max_J", "phi_max", "steps", "problem_fingerprint", "cpu_median_s")
KINDS = [
    None,
    *({"value": 2.0, "upper": 2.4, "lower": 1.667, "reason": r} for r in (FIXED_STEP.reason, "mine")),
    {"value": 2.0, "upper": 5.0, "lower": 0.8, "reason": ERROR_CONTROL.reason},
    *({"value": 2.0, "upper": 10.0, "reason": r} for r in (LEFT_OVER.reason, ROUNDING.reason)),
    {"lower": 1.0, "reason": "no less", "expect": "fail"},
    *({"value": v, "tolerance": t, "reason": SAME_PROBLEM} for v in (0.0, 0.1 + 0.2) for t in (0.0, 1e-9)),
    {"value": 100.0, "tolerance": 0.0, "reason": SAME_STEPS},
    {"value": 2.0, "upper": 3.0, "lower": 1.0, "samples": 5, "reason": FIXED_STEP.reason},
]
CASES = ("p", "p a dt=1", "p b dt=1", "q a dt=1")


@pytest.mark.parametrize("seed", range(40))
def test_thresholds_come_back_as_written(tmp_path, seed):
    """Whether in a cell, shared by a problem or in a line of its own: none is lost, none is changed."""
    draw = random.Random(seed)
    chosen = {(case, metric): draw.choice(KINDS) for case in CASES for metric in sorted(METRICS)}
    bounds = [Threshold(case=case, metric=metric, **b) for (case, metric), b in chosen.items() if b]
    wanted = Thresholds("t", tuple(bounds), (ExpectedStatus("x", Status.REFUSED, 'so "it" is'),))
    path = tmp_path / "t.toml"
    path.write_text(format_thresholds(wanted))
    assert read_thresholds(path) == wanted


HEAD = 'schema = 2\nsuite = "t"\ncolumns = "width phi_max steps"\n'
ROW = '[problem.a.runs]\n"s dt=1" = "1.2  1.0  100"\n'
BOUND = '[problem.a.bounds."s dt=1"]\nphi_max = { upper = 1.0, reason = "r" }\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[", "t.toml"),
        ("schema = 1", "unknown schema 1 - known: 2"),
        (BOUND.replace("upper = 1.0, ", ""), "problem: a: bounds: s dt=1: phi_max: give upper or lower"),
        (BOUND.replace("phi_max", "phi_mx"), "a s dt=1: unknown metric 'phi_mx' - did you mean 'phi_max'"),
        (BOUND.replace('"r"', '""'), "reason must be text"),
        (BOUND.replace("upper", "value = 1.0, tolerance = 0.1, upper"), "tolerance is relative to value"),
        (BOUND.replace("upper = 1.0", "tolerance = 0.1"), "tolerance is relative to value"),
        (BOUND.replace("upper = 1.0", "value = 1.0, tolerance = 2.0"), "tolerance must be a number from 0 to 1"),
        (BOUND.replace("upper", "lower = 2.0, upper"), "lower is above upper"),
        (BOUND.replace("upper", 'expect = "maybe", upper'), "expect"),
        (BOUND.replace("1.0", "nan"), "upper must be a finite number"),
        (BOUND.replace("1.0", "1" + "0" * 400), "upper must be a finite number"),
        (BOUND.replace("1.0", "1" * 5000), "digits"),
        (BOUND.replace("upper", "uper"), "unknown key 'uper' - did you mean 'upper'"),
        (ROW + BOUND, "a s dt=1 phi_max is declared twice"),
        (ROW + '"s dt=1" = "1.2  1.0  100"', "overwrite"),
        (ROW.replace("1.2  1.0", "1.0"), "a s dt=1: 2 cells for 3 columns"),
        (ROW.replace("1.2  1.0  100", ""), "a s dt=1: 0 cells for 3 columns"),
        ("schema = 2\nsuite = 't'\n" + ROW, "of which the first must be width"),
        (ROW.replace("1.2", "1.3"), "width must be 1.2 or 2.5 .got '1.3'"),
        *(
            (ROW.replace("1.0", cell), "phi_max must be v, v<u, l<v<u or - .got")
            for cell in ("x", "nan", "1<", "<1", "1<2<3<4", "1<5x", "inf", "1>2")
        ),
        (ROW.replace("1.0", "3<2<1"), "lower is above upper"),
        ("x = " + "[" * 5000, "too deeply"),
        ('[[status]]\ncase = "a"\nstatus = "refusd"\nreason = "r"\n', "unknown status"),
    ],
)
def test_wrong_thresholds_are_reported(tmp_path, text, words):
    """A gate with a misread bound would be green for nothing."""
    path = tmp_path / "t.toml"
    path.write_text(text if text.startswith(("[\n", "schema")) else HEAD + text)
    with pytest.raises(FileError, match=words) as error:
        read_thresholds(path)
    assert "\n" not in str(error.value)


def test_the_committed_baseline_is_as_the_gate_writes_it():
    """A hand edit of a number stays; one of the layout would be lost by the next update, so it is none."""
    text = (FOLDER / "ci.toml").read_text(encoding="utf-8")
    assert format_thresholds(read_thresholds(FOLDER / "ci.toml")) == text and text.count("\n") <= 600


CELLS = ("{v}", "{v}<{u}", "{l}<{v}<{u}")


@given(st.tuples(*[st.floats(1e-99, 1e99)] * 3), st.sampled_from(["1.2", "2.5"]), st.sampled_from(CELLS))
def test_a_number_typed_into_a_cell_survives(tmp_path_factory, numbers, width, cell):
    """The next update writes the same bounds about the same value."""
    low, value, high = (f"{x:.4g}" for x in sorted(numbers))
    path = tmp_path_factory.mktemp("t") / "t.toml"
    path.write_text(HEAD + ROW.replace("1.2  1.0", f"{width}  {cell.format(l=low, v=value, u=high)}"))
    read = read_thresholds(path)
    (bound, steps) = read.bounds
    assert bound.holds(float(value)) and f"{bound.value:.4g}" == value and steps.holds(100.0)
    path.write_text(format_thresholds(read))
    assert read_thresholds(path) == read and ".bounds." not in path.read_text()


def test_a_wider_bound_or_another_value_is_a_change_of_its_own_line(tmp_path):
    """One run's numbers are in its own line, so that a diff shows that run alone."""
    runs = [threshold(f"p s dt=0.{k}", value=1.0, upper=1.2, lower=0.8333, reason=FIXED_STEP.reason) for k in range(5)]
    was = format_thresholds(Thresholds("t", tuple(runs))).splitlines()
    runs[2] = replace(runs[2], value=123.4, upper=5678.0)
    now = format_thresholds(Thresholds("t", tuple(runs))).splitlines()
    assert len(was) == len(now) and [k for k, line in enumerate(now) if line != was[k]] == [was.index(was[-3])]


def test_a_run_without_its_package_is_left_out_only_where_it_was_named():
    """One finding a case, whatever its thresholds and expectations; a gate that measured nothing is closed."""
    lacking = changed(status="refused", missing_package="a", message="a is not installed: pip install a")
    for without, opens in (((), False), (("b",), False), (("a",), True), (("a", "b"), True)):
        found = judge_runs(RUNS, lacking, BOUNDS, without=without)
        assert is_open(found) is opens and count_cases(found) == 2
        assert [f.quantity for f in found if f.subject == CASE] == ["status"]
    assert describe_gate(found) == "open for 1 of 2; 1 not measured here: a" and count_states(found)["SKIP"] == 1
    assert list_missing_packages(found) == {CASE: "a"} and select_notable(found) == []
    expects = Thresholds("t", BOUNDS.bounds[1:], (ExpectedStatus(CASE, Status.REFUSED, "redundant rows"),))
    assert not is_open(judge_runs(RUNS, lacking, expects))  # refused, but not for the reason that was expected
    breached = [lacking[0], dataclasses.replace(lacking[1], phi_max=9.0)]
    closed = judge_runs(RUNS, breached, BOUNDS, without=("a",))
    assert not is_open(closed) and describe_gate(closed) == "CLOSED; 1 not measured here: a"
    none = [dataclasses.replace(r, status="refused", missing_package="a") for r in RECORDS]
    nothing = judge_runs(RUNS, none, BOUNDS, without=("a",))
    assert not is_open(nothing) and describe_counts(nothing) == "nothing was judged"
    assert ElementTree.fromstring(format_junit(nothing, "t").partition("\n")[2]).attrib["failures"] == "1"
    stale = changed(status="success", missing_package="a", phi_max=9.0)  # it ran: the package is no excuse
    assert not is_open(judge_runs(RUNS, stale, BOUNDS, without=("a",)))
