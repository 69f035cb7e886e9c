"""The register is sound: its claims are about runs the suite has, every figure is there, bad ones are refused."""

import re
from pathlib import Path

import pytest

from mbsbench.harness.base.files import FileError, parse_toml
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.judge.referee.claims.frame import is_printed, list_values, read_dimensions, select_runs
from mbsbench.harness.judge.referee.claims.register import REGISTER as PATH
from mbsbench.harness.judge.referee.claims.register import parse_register, read_register
from mbsbench.harness.judge.referee.claims.settings import is_comparable_control, is_partner
from mbsbench.harness.judge.referee.judge import list_tried_runs

from .claiming import HEAD, MAP, TEST

REGISTER = read_register()
NEAREST = (
    'map = "m"\nacross = "tolerance"\n'
    'tests = [{ metric = "loss", combine = "nearest", at_most = 1, unit = "m" }, '
    '{ metric = "loss", combine = "largest", at_most = 1, unit = "m" }]\n'
)


@pytest.fixture(scope="module")
def places():
    return [read_dimensions(c) for c in list_tried_runs()]


def test_a_claim_says_which_bands_are_ours():
    """What the paper does not print is named in the sentence that every page shows; a size asked of nothing is none."""
    free = {"6-se-stops-early", "9-constant-step", "12-drift"}  # before the printed end, no step cut, the printed limit
    for c in (c for c in REGISTER.claims if c.tests and c.kind == "result" and c.id not in free):
        firm = all(t.compare.startswith("over") and 1 in (t.at_least, t.at_most) for t in c.tests)
        assert firm or "Ours: " in c.claim or "Our question: " in c.claim, c.id
        assert not c.id.startswith("beyond-") or c.claim.startswith("Our question: "), c.id


def test_a_blame_has_a_control_or_is_a_comparison():
    """That a DAE solver errs says nothing of DAEs where a solver of ODEs errs as much."""
    praise = {"7-fi-close", "7-se-runs"}
    for c in (c for c in REGISTER.claims if c.map and c.kind == "result" and not c.id.endswith("-control")):
        dae = any(s["solver"] not in ("rk45_strong_form", "gc_weak_form") for s in c.map.over) and c.section != "5.5"
        blames = dae and re.search(r"DAE|index [123]", c.claim) and c.id not in praise and "stay small" not in c.claim
        blames = blames and all(t.metric != "stop time" for t in c.tests)  # when it stops: that it does is asked apart
        assert not blames or c.control or c.against, c.id


def test_there_are_enough_claims_and_every_figure_has_one():
    """The issue asks for 25; Figs. 4, 8 and 10 are drawings, judged by the motions they show the start of."""
    assert len(REGISTER.claims) >= 25
    assert {f for c in REGISTER.claims for f in c.figure} == set(range(1, 13))
    assert {c.section for c in REGISTER.claims} >= {"5.1", "5.2", "5.3", "5.4", "5.5"}


def test_every_map_matches_runs_of_the_suite_and_has_its_dimensions(places):
    """A claim whose runs nobody runs would never be judged; a suite thinned later would shrink a map in silence."""
    for m in REGISTER.maps.values():
        for selection in m.over:
            assert select_runs(places, [selection]), f"{m.name}: {selection}"
        found = select_runs(places, m.over)
        for name, wanted in m.dimensions.items():
            values = list_values(p.dimensions.get(name) for p in found)
            assert len(values) == wanted, f"{m.name}: {name} has the values {values}"
        assert not m.printed or any(p for p in found), m.name


def test_the_suite_of_the_referee_runs_all_of_them(places):
    """The runs of `make paper` hold every run a claim is tried on."""
    assert {p.spec.settings_id for p in places} <= {c.settings_id for c in load_suite("referee").specs}


def test_every_map_is_used():
    used = {m.name for c in REGISTER.claims for m in (c.map, c.against, c.control) if m}
    rows = parse_toml(PATH.read_text(encoding="utf-8"), PATH.name)["maps"].values()
    assert used | {one["map"] for row in rows for one in row["over"] if "map" in one} == set(REGISTER.maps)


def test_every_dae_claim_is_tried_over_the_dimensions_of_the_issue(places):
    """Every open choice of a classical code varies: no verdict on DAE solvers rests on one setting of any."""
    asked = {"tolerance", "chart", "lambda_in_error_test", "consistent_start", "gain", "jacobian", "norm"}
    forms = {"fi": asked | {"max_step"}, "se": asked | {"form"}}  # DAE-SE: M^-1 substituted, and E(y) y' = f(y)
    for name in ("free-fi-tighter", *(f"{motion}-{form}" for motion in ("planar", "spatial", "top") for form in forms)):
        found = select_runs(places, REGISTER.maps[name].over)
        for d in forms.get(name[-2:], forms["fi"]):
            assert len(list_values(p.dimensions.get(d) for p in found)) > 1, f"{name}: {d}"


def test_dae_se_is_judged_by_the_ndf_or_by_both_codes(places):
    """ode15s is an NDF; where IDA runs the same equations the map says so, and each code has its own finding."""
    maps = {c.map.name: c.map for c in REGISTER.claims if c.map and "se" in c.map.name.split("-")}
    assert len(maps) > 5
    for name, m in maps.items():
        solvers = {p.spec.solver for p in select_runs(places, m.over)}
        assert solvers == {"ndf_index1"} | ({"ida_index1"} if name.endswith("-codes") else set()), name


def test_a_control_stands_beside_printed_settings(places):
    """A control that no setting has beside it controls nothing."""
    for c in (c for c in REGISTER.claims if c.control):
        own, controls = select_runs(places, c.map.over), select_runs(places, c.control.over)
        assert not {p.spec.solver for p in own} & {p.spec.solver for p in controls}, c.id
        printed = [p for p in own if is_printed(p, c.map.printed)] if c.map.printed else own
        assert any(is_comparable_control(c, p, q) for p in printed for q in controls), c.id


def test_what_is_printed_of_ode_gc_has_newtons_method_of_eq_79(places):
    """And never a gauge, a sigma or a correction of poses that Sect. 4 does not print; c_R is open there."""
    for m in (c.map for c in REGISTER.claims if c.map):
        own = [p for p in select_runs(places, m.over) if p.spec.solver.startswith("gc_") and is_printed(p, m.printed)]
        for p in (p for p in own if p.spec.problem != "torque_free_body"):
            assert (p.dimensions["gauge"], p.dimensions["sigma0"]) == ("accumulate", "carried"), m.name
            assert p.dimensions["newton"] == "exact", m.name
            assert p.dimensions.get("correct_pose", "never") == "never", m.name
        directions = {p.dimensions["direction"] for p in own}
        assert m.name not in {"planar-gc", "chain-gc", "top-gc"} or len(directions) == 3, m.name


def test_a_gain_of_zero_is_not_the_papers(places):
    """Eq. (94) replaces Eq. (93) in both DAE solvers."""
    for m in (c.map for c in REGISTER.claims if c.map):
        classical = (p for p in select_runs(places, m.over) if p.spec.solver in ("ida_index1", "ndf_index1"))
        assert not any(p.dimensions.get("gain") == 0.0 and is_printed(p, m.printed) for p in classical), m.name


def test_beyond_the_printed_frame_whoever_is_to_leave_the_plane_can(places):
    """In a frame that is aligned with it rounding has no way out: such a run counts where it is printed alone."""
    turned = {"yawed by 0.3 rad", "yawed by 0.7 rad"}
    for name, printed in (("6-dae-not-planar", {"aligned"}), ("6-se-out-of-plane-20s", set())):
        (m,) = (c.map for c in REGISTER.claims if c.id == name)
        frames = {True: set(), False: set()}
        for p in select_runs(places, m.over):
            frames[is_printed(p, m.printed)].add(p.dimensions["frame"])
        assert frames == {True: printed, False: turned}, name


def test_a_frame_turned_against_the_plane_is_not_the_papers(places):
    """Sect. 5.2 prints the plane OXY and gravity along OY, Sect. 5.3 the axes of the chain."""
    for m in (c.map for c in REGISTER.claims if c.map and c.map.printed):
        own = [p for p in select_runs(places, m.over) if p.spec.problem in ("spherical_pendulum", "chain")]
        assert {p.dimensions["frame"] for p in own if is_printed(p, m.printed)} <= {"aligned"}, m.name


def test_paired_claims_find_their_partners(places):
    """A comparison without the other run is none."""
    for c in (c for c in REGISTER.claims if c.map and c.against):
        others = select_runs(places, c.against.over)
        for p in select_runs(places, c.map.over):
            assert any(is_partner(c, p, q) for q in others) or p in others, f"{c.id}: {p.spec.case}"


def test_values_named_along_a_dimension_are_in_a_group_of_its_map(places):
    """Else every group would be left open."""
    for c in (c for c in REGISTER.claims if not isinstance(c.along, int)):
        assert set(c.along) <= {p.dimensions.get(c.across) for p in select_runs(places, c.map.over)}, c.id


def test_solvers_with_a_stand_in_are_worded_for_what_was_run(places):
    """Every classical solver of a claim of the paper has its sentence: IDA is not ode15i. Others stand for none."""
    own = [c for c in REGISTER.claims if c.map and not c.id.startswith("beyond-")]
    run = {p.spec.solver for c in own for p in select_runs(places, c.map.over)}
    modern = {"gc_composed", "gc_extrapolated", "scipy_strong_form"}  # stand for none: the paper invites such methods
    assert run - {"gc_weak_form", "gc_augmented_lagrangian"} - modern <= REGISTER.solvers.keys()


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("x = 1", "unknown key 'x'"),
        ("", "claims: claims is missing"),
        ("[[claims]]\nid = 1", "claims: claim 1: id must be text"),
        (MAP + HEAD, "add `map` and `[[tests]]`, or say under `needs` why the claim cannot be tested"),
        (MAP + HEAD + TEST.replace('"m"', '"n"'), "unknown map 'n'"),
        (MAP + HEAD + TEST.replace('"column"', '"colum"'), "unknown metric 'colum' - did you mean 'column'?"),
        (MAP + HEAD + TEST.replace("name = ", "nam = "), "unknown key 'nam'"),
        (MAP + HEAD + TEST.replace('name = "phi_max", ', ""), "metric column needs name"),
        (MAP + HEAD + TEST.replace("at_most = 1.0", "at_most = 1.0, at_least = 2.0"), "the band is empty"),
        (MAP + HEAD + TEST.replace("at_most = 1.0, ", ""), "a band is needed"),
        (MAP + HEAD + TEST.replace("at_most = 1.0", 'at_most = "1"'), "at_most must be a number (got '1')"),
        (MAP + HEAD + TEST + 'across = "tolerance"\n', "combine goes with across"),
        (MAP + HEAD + TEST + "along = 3\n", "along and ranges go with across"),
        (MAP + HEAD + TEST + 'along = "all"\n', "along must be"),
        (MAP + HEAD + TEST + 'against = "gc"\n', "compare goes with against"),
        (MAP + HEAD + TEST + "at_equal_work = true\n", "at_equal_work goes with against"),
        (MAP.replace("{ problem = ", '{ map = "x", problem = ', 1) + HEAD + TEST, "selection 1: unknown map 'x'"),
        (MAP.replace('tolerance = "any"', "tolerance = { from = 0.1 }", 1) + HEAD + TEST, "tolerance: to is missing"),
        (MAP + HEAD + TEST + 'quantifier = "most"\n', "unknown quantifier 'most'"),
        (MAP + HEAD + TEST + 'kind = "guess"\n', "unknown kind 'guess'"),
        (MAP + HEAD + TEST + 'starting = "yes"\n', "starting must be true or false"),
        (MAP + HEAD + NEAREST, "goes with all tests or none"),
        (MAP + HEAD + TEST + 'needs = [{ why = "x" }]\n', "give one of solver, observable, given"),
        (MAP + HEAD.replace("[5]", "[13]") + TEST, "figure 1 must be a whole number <= 12 (got 13)"),
        (MAP + HEAD.replace("words", "w" * 500) + TEST, "quote must be a line of at most 400 characters"),
        (MAP + HEAD + TEST + "[[claims]]\n" + HEAD + TEST, "the id is taken"),
        ("[[claims]", "claims:"),
    ],
)
def test_a_bad_register_is_refused_in_a_line_with_the_place(text, complaint):
    with pytest.raises(FileError, match=re.escape(complaint)) as caught:
        parse_register(text)
    assert "\n" not in str(caught.value) and str(caught.value).startswith("claims:")


def test_a_map_takes_the_settings_of_another_and_keys_share_a_value():
    """``{ map = ..., chart = ... }`` replaces one choice and keeps the rest; ``"a, b" = x`` is ``a = x, b = x``."""
    derived = '\n[maps.n]\nover = [{ map = "m", "chart, gain" = "any" }]\n\n[[claims]]\n'
    register = parse_register((MAP + HEAD + TEST).replace("\n[[claims]]\n", derived))
    (own,), (other,) = register.maps["m"].over, register.maps["n"].over
    assert other == own | {"chart": "any", "gain": "any"}


def test_a_register_that_is_not_there_is_a_line():
    with pytest.raises(FileError, match="cannot read claims"):
        read_register(Path("nowhere/claims.toml"))
