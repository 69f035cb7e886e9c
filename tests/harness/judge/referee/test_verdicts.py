"""Each verdict from runs made up for it, and each flips when one number is changed."""

import json
import random

import pytest

from mbsbench.harness.judge.referee.claims.judging import judge_claims
from mbsbench.harness.judge.referee.claims.register import parse_register
from mbsbench.harness.results.judgements.files import format_judgement
from mbsbench.reports.model.claim_words import describe_missing, explain_verdicts
from mbsbench.tests.factories import make_record

from .claiming import HEAD, RUNS, TEST, claim, options


def steps(spec):
    """More at a tighter tolerance."""
    return round(100.0 * (spec.control.rtol or 1.0) ** -0.2)


def test_holding_everywhere_or_nowhere_is_worded_for_the_solver_run():
    c = claim(records=[make_record(x, phi_max=1.5) for x in RUNS])
    assert c.verdict == "not reproduced" and "none of 12" in explain_verdicts(c)
    c = claim()
    assert c.verdict == "reproduced" and c.tests[0].measured == 0.5 and c.tests[0].band == (None, 1.0)
    assert "not ode15i" in explain_verdicts(c) and "all 12 tried" in explain_verdicts(c) and len(c.map) == 12
    assert set(c.settings_ids) == {x.settings_id for x in RUNS if x.solver == "ida_index1"}


def test_one_altered_number_flips_the_verdict():
    """Each of the twelve runs alone: its number out of the band, and the claim holds no longer everywhere."""
    own = [c for c in RUNS if c.solver == "ida_index1"]
    for k in range(len(own)):
        c = claim(records=[make_record(x, phi_max=1.5 if x is own[k] else 0.5) for x in RUNS])
        assert c.verdict == "reproduced if"
        assert [row.holds for row in c.map].count(False) == 1
        assert next(row for row in c.map if not row.holds).settings_id == own[k].settings_id


def test_missing_runs_are_untestable_never_green():
    """One of twelve runs is not there: nothing is decided, and it is said what is missing."""
    c = claim(records=[make_record(x, phi_max=0.5) for x in RUNS[1:]])
    assert c.verdict == "cannot be told" and c.map == () and "runs missing: 1 of 12" in describe_missing(c)


def test_a_suite_that_shrank_is_untestable():
    """Runs taken out of the suite leave the map with fewer values than the claim asks for."""
    small = [c for c in RUNS if options(c)["chart"] == "euler313"]
    c = claim(specs=small)
    assert c.verdict == "cannot be told" and "1 of 2 values of chart" in describe_missing(c)


def test_a_number_that_nowhere_exists_refutes_nothing():
    c = claim(records=[make_record(x) for x in RUNS])
    assert c.verdict == "cannot be told" and "no run of the map has the number 'column'" in describe_missing(c)


def test_some_needs_one_and_all_needs_all():
    """An existence claim is supported by one run; the map still says where."""
    found = [make_record(x, phi_max=0.5 if k == 0 else 1.5) for k, x in enumerate(RUNS)]
    c = claim(TEST + 'quantifier = "some"\n', found)
    assert c.verdict == "reproduced" and "1 of 12" in explain_verdicts(c)
    assert (
        claim(TEST + 'quantifier = "some"\n', [make_record(x, phi_max=1.5) for x in RUNS]).verdict == "not reproduced"
    )


@pytest.mark.parametrize(
    ("need", "verdict"),
    [
        ('{ solver = "adams", why = "ADAMS is not here" }', "cannot be told"),
        ('{ solver = "ida_index1", why = "no IDA" }', "reproduced"),
        ('{ observable = "four_bar_grid.joint_A_y", why = "which joint is A" }', "cannot be told"),
        ('{ observable = "four_bar_grid.angle_1", why = "no angle" }', "reproduced"),
        ('{ given = "a table", why = "not printed" }', "cannot be told"),
    ],
)
def test_what_is_needed_is_looked_up(need, verdict):
    """A solver or an observable that joins the catalogue makes its claim testable without a change to the claim."""
    c = claim(TEST + f"needs = [{need}]\n")
    assert c.verdict == verdict and (verdict == "reproduced" or describe_missing(c))


def test_across_a_dimension_values_are_taken_in_order():
    """Errors that fall tenfold from the loosest to the tightest tolerance converge; reversed they do not."""
    text = TEST.replace("at_most = 1.0", 'combine = "last over first", at_most = 0.1').replace(
        "map =", 'across = "tolerance"\nmap ='
    )
    falls = claim(text, [make_record(x, phi_max=(x.control.rtol or 1.0) ** 0.5, steps=steps(x)) for x in RUNS])
    grows = claim(text, [make_record(x, phi_max=(x.control.rtol or 1.0) ** -0.5, steps=steps(x)) for x in RUNS])
    assert falls.verdict == "reproduced" and len(falls.map) == 4 and "tolerance" not in falls.map[0].at
    assert falls.tests[0].measured == pytest.approx(1e-3**0.5, rel=1e-5) and grows.verdict == "not reproduced"


def test_a_group_of_one_value_across_a_dimension_tests_nothing():
    """One tolerance alone converges to nothing: its group is no setting."""
    text = TEST.replace("at_most = 1.0", 'combine = "largest", at_most = 1.0').replace(
        "map =", 'across = "tolerance"\nmap ='
    )
    few = [x for x in RUNS if options(x)["chart"] == "quaternion" or x.control.rtol in (None, 1e-3)]
    assert len(claim(text, specs=few).map) == 2
    none = claim(text, specs=[x for x in RUNS if x.control.rtol in (None, 1e-3)])
    assert none.verdict == "cannot be told"


def test_one_tolerance_that_meets_all_tests_suffices():
    """In Euler angles 1e-4 meets both tests; with quaternions each is met, but by different tolerances."""
    text = (
        'map = "m"\nacross = "tolerance"\ntests = [\n'
        '{ metric = "column", name = "phi_max", combine = "nearest", at_most = 1.0, unit = "m" },\n'
        '{ metric = "column", name = "phi_dot_max", combine = "nearest", at_most = 1.0, unit = "m/s" }]\n'
    )
    good = {"euler313": {1e-4: (0.5, 0.5)}, "quaternion": {1e-3: (0.5, 1.5), 1e-6: (1.5, 0.5)}}

    def both(x):
        phi, phi_dot = good[options(x)["chart"]].get(x.control.rtol, (3.0, 3.0)) if x.control.rtol else (0.5, 0.5)
        return make_record(x, phi_max=phi, phi_dot_max=phi_dot)

    c = claim(text, [both(x) for x in RUNS])
    assert c.verdict == "reproduced if" and "holds for 2 of 4 tried" in explain_verdicts(c)
    assert "One tolerance that meets it suffices: tolerance 0.0001 in 2" in explain_verdicts(c)
    assert "chart euler313 and tolerance 0.0001" in explain_verdicts(c)
    (row,) = {(r.case.split()[2], r.measured) for r in c.map if r.holds}
    assert row == ("rtol=0.0001", 0.5)


def test_against_others_the_worst_of_them_counts():
    """Twice the |phi| of ODE-GC is at least once it; with ODE-GC's number tripled it is not."""
    text = TEST.replace("at_most = 1.0", 'compare = "over largest", at_least = 1.0') + 'against = "gc"\n'

    def made(gc):
        return [make_record(x, phi_max=gc if x.solver == "gc_weak_form" else 1.0) for x in RUNS]

    assert claim(text, made(0.5)).tests[0].measured == 2.0 and claim(text, made(0.5)).verdict == "reproduced"
    assert claim(text, made(1.5)).verdict == "not reproduced"


def test_several_tests_must_all_hold():
    """A good |phi| does not make up for a bad |phi_dot|, nor the other way round."""
    text = TEST.replace("}]", '}, { metric = "column", name = "phi_dot_max", at_most = 1.0, unit = "m/s" }]')
    for phi, phi_dot, verdict in ((0.5, 0.5, "reproduced"), (0.5, 1.5, "not reproduced"), (1.5, 0.5, "not reproduced")):
        assert claim(text, [make_record(x, phi_max=phi, phi_dot_max=phi_dot) for x in RUNS]).verdict == verdict


def test_pairs_share_the_dimensions_asked_for():
    """Each chart against its own: 2 over 1 and 20 over 10. Against both charts' largest, 2 over 10 would not hold."""
    split = """
[maps.loose]
over = [{ problem = "spherical_pendulum", solver = "ida_index1", max_step = 0.01, tolerance = 1e-3, chart = "any" }]
[maps.tight]
over = [{ problem = "spherical_pendulum", solver = "ida_index1", max_step = 0.01, tolerance = 1e-6, chart = "any" }]
[[claims]]
"""
    text = (
        'map = "loose"\nagainst = "tight"\npair_by = ["chart"]\n'
        'tests = [{ metric = "column", name = "phi_max", compare = "over largest", at_least = 2.0, unit = "" }]\n'
    )
    size = {"euler313": 1.0, "quaternion": 10.0}
    records = [
        make_record(x, phi_max=size[options(x)["chart"]] * (2.0 if x.control.rtol == 1e-3 else 1.0)) for x in RUNS
    ]
    registers = [parse_register(split + HEAD + t) for t in (text, text.replace('pair_by = ["chart"]\n', ""))]
    verdicts = [judge_claims(r, RUNS, records, lambda _: None)[0].verdict for r in registers]
    assert verdicts == ["reproduced", "reproduced if"]


def test_verdicts_do_not_depend_on_the_order_of_records():
    """Shuffled records give the same bytes, whatever the number of processes that wrote them."""
    cut = {"status": "memory", "t_reached_s": 3.0}
    found = [make_record(x, phi_max=1.5 if k % 3 else 0.5, **({} if k % 4 else cut)) for k, x in enumerate(RUNS)]
    texts = set()
    for seed in range(5):
        random.Random(seed).shuffle(found)
        texts.add(format_judgement([claim(records=found)]))
    assert len(texts) == 1


def test_judgements_are_strict_json():
    """Numbers that do not exist are null; a row of a map is a line."""
    c = claim(records=[make_record(x, phi_max=float("inf") if k == 0 else 0.5) for k, x in enumerate(RUNS)])
    text = format_judgement([c])
    assert json.loads(text, parse_constant=pytest.fail)[0]["map"][0]["measured"] is None
    assert sum('"settings_id"' in line for line in text.splitlines()) == 12
