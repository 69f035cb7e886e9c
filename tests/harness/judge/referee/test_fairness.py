"""Fair to both sides: what is listed was judged, controls stand over equal values, and who ended a run counts."""

import math

import numpy as np
import pytest

from mbsbench.harness.judge.referee.claims.endings import classify_ending, ended_by_open_joint
from mbsbench.harness.results.judgements.claims import ClaimGap, Ending, ExcludedSettings
from mbsbench.reports.model.claim_words import (
    describe_control,
    explain_verdicts,
    format_by_solver,
    format_verdict,
    name_metric,
)
from mbsbench.tests.factories import make_record, make_series, parse_specs

from .claiming import RUNS, TEST, claim, options

APART = {"status": "diverged", "t_reached_s": 8.0, "steps": 900, "max_step_s": 0.01, "phi_end": 0.52}  # arm: 0.5 m
STOPPED = {"status": "step_underflow", "t_reached_s": 8.0, "steps": 900, "max_step_s": 0.01}
BOTH = parse_specs("""
[[runs]]
problem = "spherical_pendulum"
solver = ["ida_index1", "ndf_index1"]
options = { coordinates = ["euler313", "quaternion"] }
rtol = [1e-3, 1e-4, 1e-6]
max_step = 0.01

[[runs]]
problem = "spherical_pendulum"
solver = "rk45_strong_form"
options = { coordinates = "euler313" }
rtol = [1e-1, 1e-3, 1e-4, 1e-6]
max_step = 0.01
""")
MAPS = """
[maps.both]
over = [{ problem = "spherical_pendulum", solver = ["ida_index1", "ndf_index1"], max_step = 0.01, "tolerance, chart" = "any" }]

[maps.ida]
over = [{ map = "both", solver = "ida_index1" }]

[maps.rk]
over = [{ problem = "spherical_pendulum", solver = "rk45_strong_form", max_step = 0.01, "tolerance, chart" = "any" }]

"""  # noqa: E501


def first_of(columns):
    """The first run with these columns, the others of |phi| = 0.5 m."""
    return [make_record(x, **({"phi_max": 0.5} | (columns if k == 0 else {}))) for k, x in enumerate(RUNS)]


@pytest.mark.parametrize("band", ["at_least = 9", "at_most = 9"])
@pytest.mark.parametrize(
    "asked",
    [
        'metric = "stops at"',
        'metric = "stop time"',
        'metric = "loss"',
        'metric = "late energy"',
        'metric = "column", name = "phi_max"',
        'metric = "column", name = "out_of_plane_max_m", partial = true',
    ],
)
def test_a_run_that_we_ended_is_open_in_every_kind_of_test(asked, band):
    """Its joint was open by more than its arm: our guard ended it, and neither side may lean on that end."""
    found = claim(f'map = "m"\ntests = [{{ {asked}, {band}, unit = "" }}]\n', first_of(APART | {"phi_max": 0.52}))
    assert found.map[0].holds is None
    assert ExcludedSettings(Ending.APART, 1) in found.beyond.left_out or "phi_max" in asked or "partial" in asked


def test_what_a_run_that_we_ended_had_settled_counts():
    """Out of the plane by 1 m it stays out; getting to the end is open, where a run that failed does not."""
    out = 'metric = "column", name = "out_of_plane_max_m", partial = true, at_least = 0.5, unit = "m"'
    end = 'metric = "reached", at_least = 1, unit = ""'
    for test, apart, stopped in ((out, True, True), (end, None, False)):
        for columns, holds in ((APART, apart), (STOPPED, stopped)):
            found = claim(f'map = "m"\ntests = [{{ {test} }}]\n', first_of(columns | {"out_of_plane_max_m": 1.0}))
            assert found.map[0].holds is holds, (test, columns)


def test_the_guard_is_told_by_the_joint():
    """By status and size of the gap, not by its message: a method that ends by itself with an open joint failed."""
    ends = {"problem": "spherical_pendulum", "problem_parameters": "{}"}
    assert classify_ending(make_record(**ends | APART)) is Ending.APART
    assert not ended_by_open_joint(make_record(**ends | APART | {"phi_end": 0.4}))
    assert not ended_by_open_joint(make_record(**ends | APART | {"status": "step_underflow"}))
    assert not ended_by_open_joint(
        make_record(**ends | APART | {"control": "dt"})
    )  # fixed steps have no guard: it is their doing
    assert not ended_by_open_joint(make_record(**ends | APART | {"phi_end": math.nan}))
    assert not ended_by_open_joint(make_record(**ends | APART | {"t_reached_s": 10.0}))


def test_tried_with_lists_what_is_judged():
    """The NDF's runs have all stopped, at 1e-6 nothing is known: neither is listed, and the solver is named as such."""
    text = 'map = "both"\ntests = [{ metric = "column", name = "phi_max", at_most = 1, unit = "m" }]\n'
    found = []
    for x in BOTH:
        gone = x.solver == "ndf_index1" or x.control.rtol == 1e-6
        found.append(make_record(x, phi_max=0.5, **(STOPPED if gone else {})))
    c = claim(text + MAPS, found, specs=BOTH)
    assert c.settings["solver"] == ("ida_index1",) and c.settings["tolerance"] == (1e-4, 1e-3)
    assert c.because.unjudged == ("ndf_index1",) and len(c.because.stand_ins) == 1
    assert "No setting of ndf_index1 is judged: the verdicts say nothing of it" in explain_verdicts(c)
    assert c.settings["jacobian"] == ("exact",)  # a code may be taken for another by its Jacobian: said where one alone
    assert len(c.settings_ids) == 12  # runs of the map stay linked


@pytest.mark.parametrize("combine", ["spread", "nearest"])
def test_a_control_is_asked_over_the_values_of_the_setting(combine):
    """The control errs at 0.1, which the setting has not got: over the same three tolerances it does not."""
    text = f'map = "ida"\ncontrol = "rk"\nacross = "tolerance"\ntests = [{{ metric = "column", name = "phi_max", combine = "{combine}", at_least = 1.0, unit = "m" }}]\n'  # noqa: E501
    size = {1e-1: 9.0, 1e-3: 0.1, 1e-4: 0.1, 1e-6: 0.1}
    own = {1e-3: 9.0, 1e-4: 5.0, 1e-6: 1.0}
    found = [make_record(x, phi_max=(size if x.solver == "rk45_strong_form" else own)[x.control.rtol]) for x in BOTH]
    c = claim(text + MAPS, found, specs=BOTH)
    assert c.verdict.startswith("reproduced") and c.control.both == 0 and c.control.finding.holds == 0
    few = [x for x in BOTH if x.solver != "rk45_strong_form" or x.control.rtol != 1e-6]
    none = claim(text + MAPS, [make_record(x, phi_max=own.get(x.control.rtol, 9.0)) for x in few], specs=few)
    assert none.control is None  # it has not got all of them: nothing is compared


def test_a_control_that_settles_nothing_where_the_claim_holds_is_said():
    """Beside Euler angles the control stopped, beside quaternions there is none: nothing is known of it."""
    test = 'tests = [{ metric = "column", name = "phi_max", at_least = 1.0, unit = "m" }]'
    text, found = f'map = "ida"\ncontrol = "rk"\n{test}\n', []
    for x in BOTH:
        loose = x.solver == "rk45_strong_form" and x.control.rtol == 1e-3
        size = 2.0 if x.solver != "rk45_strong_form" and x.control.rtol == 1e-3 else 0.1
        found.append(make_record(x, phi_max=size, **(STOPPED if loose else {})))
    c = claim(text + MAPS, found, specs=BOTH)
    assert (c.control.alone, c.control.both) == (2, 0)
    assert (
        "beside 2 settings where the claim holds nothing is known of it (their runs ended before" in describe_control(c)
    )


def test_a_claim_that_there_are_such_says_where():
    """Of some, all is reproduced; where some settings are such and others not, they are named by value."""
    some = TEST.replace('map = "m"', 'map = "m"\nquantifier = "some"')
    c = claim(some, [make_record(x, phi_max=0.5 if options(x)["chart"] == "euler313" else 2.0) for x in RUNS])
    assert c.verdict == "reproduced" and format_verdict(c.beyond) == "reproduced: there are such if chart euler313"
    assert "It holds with chart euler313 always, and never without" in explain_verdicts(c)
    assert format_verdict(claim(some).beyond) == "reproduced" and claim(some).beyond.decision is None


NEAREST = """map = "both"
across = "tolerance"
tests = [{ metric = "energy ratio", combine = "nearest", at_least = 30, unit = "" }]
"""


def met_by(solver_failed, meets):
    """The claim with the energy of these (solver, chart, tolerance) hundredfold; those of a solver that stopped."""

    def energy(r):
        spec = next(x for x in BOTH if x.settings_id == r.settings_id)
        high = (spec.solver, options(spec)["chart"], spec.control.rtol) in meets
        return make_series(np.linspace(0.0, r.t_reached_s, 3), energy=[1.0, 100.0 if high else 1.0, 1.0])

    found = []
    for x in BOTH:
        met = (x.solver, options(x)["chart"], x.control.rtol) in meets
        found.append(make_record(x, **(STOPPED if met and x.solver == solver_failed else {})))
    return claim(NEAREST + MAPS, found, energy, BOTH)


def test_total_and_solvers_treat_a_failed_run_alike():
    """One failed run of IDA meets it in quaternions, sound ones in Euler angles: the first counts as not met."""
    sound = {("ndf_index1", "euler313", 1e-3), ("ndf_index1", "euler313", 1e-4)}
    c = met_by("ida_index1", sound | {("ida_index1", "quaternion", 1e-3)})
    assert c.verdict == "reproduced if" and (c.beyond.holds, c.beyond.settings, c.beyond.lone) == (1, 4, 1)
    assert "ida_index1" not in format_verdict(
        c.beyond
    ) and "1 setting that one failed run alone meets" in explain_verdicts(c)
    assert c.by_solver["ndf_index1"].holds == 1 and "hangs" not in format_by_solver(c)
    rest = {(s, k, 1e-3) for s in ("ida_index1", "ndf_index1") for k in ("euler313", "quaternion")}
    most = met_by("ida_index1", rest | {("ida_index1", "euler313", 1e-4), ("ida_index1", "euler313", 1e-6)})
    assert most.verdict == "reproduced if" and (most.beyond.holds, most.beyond.lone) == (3, 1)  # and no doubt in it
    alone = met_by("ida_index1", {("ida_index1", "quaternion", 1e-3)})
    assert alone.verdict == "cannot be told" and alone.beyond.missing[0].gap is ClaimGap.HANGS


def test_one_stop_of_many_runs_is_no_verdict_and_one_in_the_start_up_none():
    """All others get to the end: where one stops is rounding. One in the first hundredth of the time tells nothing."""
    text = 'map = "m"\ntests = [{ metric = "stop time", at_least = 2, at_most = 9, unit = "s" }]\n'
    c = claim(text, first_of(STOPPED))
    assert c.map[0].holds is True and c.verdict == "cannot be told" and c.beyond.missing[0].gap is ClaimGap.HANGS
    early = [make_record(x, **(STOPPED | {"t_reached_s": 0.05 if k else 8.0})) for k, x in enumerate(RUNS)]
    c = claim(text, early)
    assert c.beyond.left_out == (ExcludedSettings(Ending.START_UP, 11),) and c.map[1].holds is None
    assert claim(text, [make_record(x, **STOPPED | {"t_reached_s": 0.11}) for x in RUNS]).verdict == "not reproduced"


def test_a_run_that_ended_and_broke_a_law_is_a_result():
    """One of twelve is off and wrong: it did not fail, so that the verdict does not hang on it."""
    c = claim(records=first_of({"phi_max": 9.0, "status": "wrong"}))
    assert c.verdict == "reproduced if" and (c.beyond.holds, c.beyond.settings) == (11, 12)
    assert claim(records=first_of({"phi_max": 9.0} | STOPPED)).beyond.left_out == (ExcludedSettings(Ending.EARLY, 1),)


def test_conditions_at_the_papers_settings_name_its_values_alone():
    """Beyond, a run has the series of a printed one: it is counted with it, and adds neither row nor condition."""

    def row(x):
        same = options(x)["lam"] is True and x.control.rtol in (1e-3, 1e-4)
        digest = options(x)["chart"] if same else x.settings_id
        return make_record(x, phi_max=0.5 if options(x)["lam"] else 2.0, series_sha256=digest)

    c = claim(TEST.replace('"m"', '"p"'), [row(x) for x in RUNS])
    assert (c.paper.settings, c.paper.rows, c.paper.like) == (2, 2, 1) and c.paper.decision.by
    assert "1 setting beyond them with the series of one counted with it" in explain_verdicts(c)


def test_the_number_shown_is_one_that_the_verdict_rests_on():
    """The worst where it holds; where none does the nearest; where there are such, one of them."""
    sizes = dict(zip((1e-3, 1e-4, 1e-6), (0.1, 0.7, 0.3), strict=True))

    def shown(text, factor=1.0):
        return (
            claim(text, [make_record(x, phi_max=factor * sizes.get(x.control.rtol, 0.1)) for x in RUNS])
            .tests[0]
            .measured
        )

    assert shown(TEST) == 0.7 and shown(TEST, 20.0) == 2.0
    assert shown(TEST.replace('"m"', '"p"')) == 0.1  # the paper's is that at 1e-3
    assert shown(TEST.replace("map", 'quantifier = "some"\nmap', 1), 2.0) == 0.2


def test_a_comparison_names_its_rival():
    text = 'map = "m"\nagainst = "gc"\ntests = [{ metric = "column", name = "phi_max", compare = "over smallest", at_most = 1, unit = "" }]\n'  # noqa: E501
    c = claim(text)
    assert "spherical_pendulum gc_weak_form" in c.tests[0].rival and f"here {c.tests[0].rival}" in name_metric(
        c.tests[0]
    )
    assert claim().tests[0].rival == ""
    two = text.replace('"gc"', '"ida"'), [make_record(x, phi_max=x.control.rtol) for x in BOTH]
    for compare, loosest in (("over smallest", False), ("over largest", True)):
        rival = (
            claim(two[0].replace("over smallest", compare).replace('"m"', '"rk"', 1) + MAPS, two[1], specs=BOTH)
            .tests[0]
            .rival
        )
        assert ("rtol=0.001" if loosest else "rtol=1e-06") in rival and "ida_index1" in rival


@pytest.mark.parametrize(("key", "holds"), [("", True), ("must_act = true\n", None)])
def test_runs_that_are_the_same_compare_nothing_where_the_choice_must_act(key, holds):
    """A penalty that is never raised leaves the run as it was: that it costs nothing tells nothing."""
    text = f'map = "m"\nagainst = "gc"\n{key}tests = [{{ metric = "column", name = "phi_max", compare = "over smallest", at_most = 1, unit = "" }}]\n'  # noqa: E501
    c = claim(text, [make_record(x, phi_max=0.5, series_sha256="one") for x in RUNS])
    assert {m.holds for m in c.map} == {holds}
    assert {m.holds for m in claim(text, [make_record(x, phi_max=0.5, series_sha256=x.case) for x in RUNS]).map} == {
        True
    }


def test_a_rise_is_a_gain_in_its_interval():
    """From 5 J at 2 s to 6 J at 4 s the energy rises by 1 J, however high it stood; a run to 3 s has risen by 0.5 J."""
    text = 'map = "m"\ntests = [{{ metric = "rise", series = "e", from = 2.0, to = 4.0, partial = true, at_least = {}, unit = "J" }}]\n'  # noqa: E501

    def energy(r):
        t = np.linspace(0.0, r.t_reached_s, 1 + 10 * int(r.t_reached_s))
        return make_series(t, e=4.0 + 0.5 * t)

    for least, ended, cut in ((0.9, True, None), (0.4, True, True), (1.1, False, None)):
        found = claim(text.format(least), first_of(STOPPED | {"t_reached_s": 3.0}), energy)
        assert (found.map[1].holds, found.map[0].holds) == (ended, cut)


def test_a_claim_on_runs_that_stop_is_not_refuted_by_those_that_do_not():
    """Where it stops |phi| has passed 1 m: one that gets to its end with 0.5 m says nothing on that."""
    text = """map = "m"
tests = [
    { metric = "stop time", at_most = 9, unit = "s" },
    { metric = "column", name = "phi_max", partial = true, at_least = 1.0, unit = "m" },
]
"""
    found = [make_record(x, phi_max=2.0 if k < 2 else 0.5, **(STOPPED if k < 2 else {})) for k, x in enumerate(RUNS)]
    c = claim(text, found)
    assert (c.verdict, c.beyond.settings) == ("reproduced", 2) and c.beyond.left_out == (
        ExcludedSettings(Ending.ENDED, 10),
    )
