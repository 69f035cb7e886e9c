"""Only what differs as the claim says is compared: like with like, over the values named, where something changed."""

import math

import pytest

from mbsbench.harness.judge.referee.claims.judging import judge_claims
from mbsbench.harness.judge.referee.claims.register import parse_register
from mbsbench.harness.results.judgements.claims import Ending, ExcludedSettings
from mbsbench.tests.factories import make_record, parse_specs

from .claiming import HEAD, MAP, RUNS, SUITE, claim, options

STOPPED = {"t_reached_s": 3.0, "steps": 9, "status": "diverged"}
PHI = 'metric = "column", name = "phi_max"'


def open_for(c, why=Ending.UNCOMPARED):
    """How many settings are left open, all of them for this reason."""
    left = [row.holds for row in c.map].count(None)
    assert c.beyond.left_out == ((ExcludedSettings(why, left),) if left else ())
    return left


def of_maps(maps, text, specs, found):
    """The verdict on a claim over maps of its own."""
    return judge_claims(parse_register(maps + "[[claims]]\n" + HEAD + text), specs, found, lambda r: None)[0]


def test_pairs_differ_in_the_form_alone():
    """SE is twice FI at each gain, 1 against 2 and 10 against 20: paired by the chart alone it would fail at gain 0.

    The gain that FI was not run with has no partner, and a dimension that SE has not got (norm) separates nothing.
    """
    suite = """
[[runs]]
problem = "spherical_pendulum"
solver = "ida_index1"
options = { form = "se", "alpha, beta" = [0.0, 5.0, 20.0] }
rtol = 1e-3

[[runs]]
problem = "spherical_pendulum"
solver = "ndf_index1"
options = { "alpha, beta" = [0.0, 5.0] }
rtol = 1e-3
"""
    maps = """
[maps.se]
over = [{ problem = "spherical_pendulum", solver = "ida_index1", form = "se", "tolerance, gain" = "any" }]
[maps.fi]
over = [{ problem = "spherical_pendulum", solver = "ndf_index1", "tolerance, gain" = "any" }]
"""
    text = 'map = "se"\nagainst = "fi"\npair_by = ["chart"{}]\ntests = [{{ {}, compare = "over largest", at_least = 2, unit = "" }}]\n'  # noqa: E501
    specs = parse_specs(suite)
    size = {0.0: 1.0, 5.0: 10.0, 20.0: 1.0}
    found = [
        make_record(x, phi_max=size[x.options.get("alpha", 5.0)] * (2.0 if x.solver == "ida_index1" else 1.0))
        for x in specs
    ]
    loose = of_maps(maps, text.format("", PHI), specs, found)
    assert loose.verdict == "reproduced if"
    like = of_maps(maps, text.format(', "gain", "norm"', PHI), specs, found)
    assert like.verdict == "reproduced" and like.beyond.settings == 2 and open_for(like) == 1


@pytest.mark.parametrize(("along", "left"), [("[1e-3, 1e-6]", 2), ("3", 2), ("2", 0), ("[1e-3]", 0)])
def test_a_group_without_the_values_named_is_left_open(along, left):
    """With quaternions the tolerance ends at 1e-4: that is no answer to what happens from 1e-3 to 1e-6."""
    few = [x for x in RUNS if options(x)["chart"] == "euler313" or x.control.rtol != 1e-6]
    for combine in ("largest", "nearest"):
        text = f'map = "m"\nacross = "tolerance"\nalong = {along}\ntests = [{{ {PHI}, combine = "{combine}", at_most = 1, unit = "m" }}]\n'  # noqa: E501
        c = claim(text, specs=few)
        assert len(c.map) == 4 and open_for(c) == left and c.beyond.settings == 4 - left


@pytest.mark.parametrize("combine", ["last over first", "worst step"])
@pytest.mark.parametrize(
    ("steps", "holds"), [((1000, 1000, 1000), None), ((1000, 1005, 1009), None), ((1000, 2000, 4000), True)]
)
def test_equal_steps_show_nothing_about_reducing_them(combine, steps, holds):
    """The same error at each tolerance: it did not help where steps shrank; where they are the same it did not act."""
    text = f'map = "m"\nacross = "tolerance"\ntests = [{{ {PHI}, combine = "{combine}", at_least = 1, unit = "" }}]\n'
    many = dict(zip((1e-3, 1e-4, 1e-6), steps, strict=True))
    c = claim(text, [make_record(x, phi_max=0.5, steps=many.get(x.control.rtol, 1)) for x in RUNS])
    assert {row.holds for row in c.map} == {holds}


def test_a_step_that_did_not_act_does_not_hide_one_that_did():
    """From 1e-3 to 1e-4 nothing changes; to 1e-6 steps and the error fall: each reduction that acted helps."""
    text = f'map = "m"\nacross = "tolerance"\ntests = [{{ {PHI}, combine = "worst step", at_most = 0.9, unit = "" }}]\n'
    found = [
        make_record(x, phi_max=0.1 if x.control.rtol == 1e-6 else 0.5, steps=2000 if x.control.rtol == 1e-6 else 1000)
        for x in RUNS
    ]
    c = claim(text, found)
    assert c.verdict == "reproduced" and c.tests[0].measured == 0.2


def test_a_run_is_not_compared_with_itself():
    """The loosest runs stand in both maps: they have no partner, and the others have theirs."""
    maps = """
[maps.all]
over = [{ problem = "spherical_pendulum", solver = "ida_index1", max_step = 0.01, "tolerance, chart, lambda_in_error_test" = "any" }]
[maps.loose]
over = [{ map = "all", tolerance = 1e-3 }]
"""  # noqa: E501
    text = f'map = "all"\nagainst = "loose"\npair_by = ["chart", "lambda_in_error_test"]\ntests = [{{ {PHI}, compare = "over largest", at_most = 1.01, unit = "" }}]\n'  # noqa: E501
    c = of_maps(maps, text, RUNS, [make_record(x, phi_max=0.5 if x.control.rtol == 1e-3 else 0.6) for x in RUNS])
    assert c.verdict == "not reproduced" and (c.beyond.settings, open_for(c)) == (8, 4)


RIVALS = MAP.replace("[[claims]]", '[maps.all]\nover = [{ map = "gc", step = "any" }]\n\n')
EQUAL_WORK = """map = "m"
against = "all"
at_equal_work = true
tests = [{ metric = "loss", compare = "over smallest", at_least = 1, unit = "" }]
"""


@pytest.mark.parametrize(
    ("error", "work", "holds"),
    [(1.0, 5.0, False), (2.0, 5.0, False), (3.0, 5.0, None), (1.0, 50.0, False), (3.0, 50.0, True), (1.0, 500.0, True)],
)
def test_at_equal_work_a_cheaper_and_better_run_counts_against(error, work, holds):
    """ODE-GC errs by 2 m at 10 operations, by 0.1 m at 100; at 1 it stopped. IDA at 5: no worse than 2 m beats them."""
    specs = parse_specs(SUITE.replace("dt = 0.01", "dt = [0.01, 0.001, 0.1]"))
    rivals = {0.01: (2.0, 10.0), 0.001: (0.1, 100.0), 0.1: (0.0, 6.0)}
    found = []
    for x in specs:
        own, evaluations = rivals.get(x.control.dt, (error, work))
        ends = STOPPED if x.control.dt == 0.1 else {}
        found.append(make_record(x, position_error_judged_m=own, evaluations=evaluations, **ends))
    assert {row.holds for row in of_maps(RIVALS, EQUAL_WORK, specs, found).map} == {holds}


@pytest.mark.parametrize(
    ("metric", "own", "other", "holds"),
    [
        ("loss", 1.0, 0.5, True),
        ("loss", math.inf, 0.5, True),
        ("loss", 0.5, math.inf, False),
        ("loss", math.inf, math.inf, None),
        ("column", math.inf, 0.5, None),
        ("column", 0.5, math.inf, None),
        ("column", math.inf, math.inf, None),
    ],
)
def test_two_failures_beside_each_other_compare_nothing(metric, own, other, holds):
    """A stopped run is worse than one that ended, whichever side it is on; of two stopped ones neither is.

    Its |phi| is not known, and without either number there is nothing to compare.
    """
    of = PHI if metric == "column" else 'metric = "loss"'
    text = f'map = "m"\nagainst = "gc"\ntests = [{{ {of}, compare = "over largest", at_least = 1, unit = "" }}]\n'
    sizes, found = {"ida_index1": own, "gc_weak_form": other}, []
    for x in RUNS:
        size = sizes[x.solver]
        found.append(
            make_record(x, position_error_judged_m=size, phi_max=size, **(STOPPED if math.isinf(size) else {}))
        )
    c = claim(text, found)
    assert {row.holds for row in c.map} == {holds}
    if metric == "loss":
        assert open_for(c) == (12 if holds is None else 0)


def test_any_choice_is_admitted_for_the_others_too():
    """0.5 beside 0.1 and 0.9 of one solver and 0.3 of another: over 0.3, each at its best settings, not over 0.9."""
    suite = """
[[runs]]
problem = "spherical_pendulum"
solver = "rk45_strong_form"
rtol = [1e-3, 1e-6]
max_step = 0.01
"""
    specs = (*RUNS, *parse_specs(suite))
    maps = '[maps.others]\nover = [{ map = "gc" }, { problem = "spherical_pendulum", solver = "rk45_strong_form", max_step = 0.01, tolerance = "any" }]\n'  # noqa: E501
    size = {"gc_weak_form": 0.3, "ida_index1": 0.5}
    found = [make_record(x, phi_max=size.get(x.solver, 0.9 if x.control.rtol == 1e-3 else 0.1)) for x in specs]
    text = 'map = "m"\nagainst = "others"\ntests = [{{ {}, compare = "{}", at_least = 1, unit = "" }}]\n'
    best, largest = (
        claim(text.format(PHI, c) + maps, found, specs=specs) for c in ("over best settings", "over largest")
    )
    assert (best.verdict, largest.verdict) == ("reproduced", "not reproduced")
    assert best.tests[0].measured == 1.66667 and "gc_weak_form" in best.tests[0].rival
