"""Who holds, drifts and breaks; the cheapest for an error, how long motions are followed, the card of it all."""

import json
import math
import re
import xml.etree.ElementTree as ET

import pytest
from msgspec.structs import replace

from mbsbench.reports import site
from mbsbench.reports.model.frontier import (
    describe_cheapest,
    find_frontiers,
    select_at_shared_target,
    sort_engines_first,
)
from mbsbench.reports.model.results import StoredRun, Variant, read_results
from mbsbench.reports.model.scores import count_outcomes, find_finest, name_unpredictable, rank_solvers
from mbsbench.reports.model.tracking import list_tracking_times
from mbsbench.reports.model.variants import OTHER_PARAMETERS, find_plain_label, group_variants, select_variants
from mbsbench.reports.pages.judged.cost import state_cheapest
from mbsbench.reports.pages.runs.solvers import describe_solver
from mbsbench.tests.factories import make_measured_record

from .conftest import because, put
from .pages.synthetic import DRIFT, ORDER

HALVINGS = range(9)


def ladder(folder, solver, order, cost, **changes):
    """Runs whose error is (10 dt)^order [m] at ``cost``/dt [s] of CPU, dt = 0.1 down to 0.1/256 s."""
    for k in HALVINGS:
        dt = 0.1 / 2**k
        error = (10.0 * dt) ** order
        numbers = {"dt_s": dt, "position_error_max_m": error, "cpu_median_s": cost / dt}
        put(folder, make_measured_record(f"{changes.get('problem', '')}{solver}{k}", solver, **{**numbers, **changes}))


def test_work_is_interpolated_on_the_power_law(tmp_path):
    """error = (10 dt)^p and CPU = c/dt: CPU at an error e is 10 c e^(-1/p), between the steps that were run too."""
    ladder(tmp_path, "alpha", 2.0, 1e-3)
    ladder(tmp_path, "beta", 4.0, 3e-3)
    (found,) = [f for f in find_frontiers(read_results(tmp_path)) if f.target == 1e-3]
    assert [p.run.record.solver for p in found.places] == ["beta", "alpha"]
    assert found.places[0].cpu_s == pytest.approx(10.0 * 3e-3 * 1e3**0.25)
    assert found.places[1].cpu_s == pytest.approx(10.0 * 1e-3 * 1e3**0.5)
    assert found.places[1].factor == pytest.approx(1e3**0.25 / 3.0)


def test_who_misses_and_who_refuses_is_said(tmp_path):
    """Neither is left out without a word; wrong runs reach nothing."""
    ladder(tmp_path, "alpha", 4.0, 1e-3)
    ladder(tmp_path, "beta", 4.0, 2e-3)
    ladder(tmp_path, "gamma", 1.0, 1e-3)
    ladder(tmp_path, "delta", 4.0, 1e-6, status="wrong")
    put(
        tmp_path,
        make_measured_record("eps", "epsilon", "refused", message="no springs", position_error_max_m=float("nan")),
    )
    found = {f.target: f for f in find_frontiers(read_results(tmp_path))}
    assert [p.run.record.solver for p in found[1e-6].places] == ["alpha", "beta"]
    assert found[1e-6].missed == ("delta", "gamma")
    assert [r.record.message for r in found[1e-6].refused] == ["no springs"]


@pytest.mark.beyond_core
def test_variants_on_which_an_engine_leads_come_first(tmp_path):
    """Losses are shown before wins; the spread is that of the repeats of the run that reaches the error."""
    ladder(tmp_path, "rattle", 4.0, 1e-3, problem="arm", cpu_min_s=1.0, cpu_max_s=1.5)
    ladder(tmp_path, "gc_weak_form", 4.0, 2e-3, problem="arm")
    for solver, cost in (("mujoco", 1e-3), ("radau_ggl", 2e-3)):
        ladder(tmp_path, solver, 4.0, cost, problem="bar")
    found = [f for f in sort_engines_first(find_frontiers(read_results(tmp_path))) if f.target == 1e-3]
    assert [f.places[0].run.record.solver for f in found] == ["mujoco", "rattle"]
    assert [f.is_led_by_engine for f in found] == [True, False]
    assert found[1].places[0].spread == pytest.approx(1.5)


def test_a_coarsest_run_below_the_error_is_a_bound(tmp_path):
    """No run shows how much less would do."""
    ladder(tmp_path, "alpha", 4.0, 1e-3, position_error_max_m=1e-9)
    ladder(tmp_path, "beta", 4.0, 1e-3)
    (found,) = [f for f in find_frontiers(read_results(tmp_path)) if f.target == 1e-3]
    bounds = {p.run.record.solver: p.bound for p in found.places}
    assert bounds == {"alpha": True, "beta": False}


def test_a_run_that_is_better_and_cheaper_counts_for_looser_errors(tmp_path):
    """An error is met by any run below it: the cost never falls where the error asked for gets smaller."""
    ladder(tmp_path, "alpha", 4.0, 1e-3)
    for name, dt, error, cpu in (("b0", 0.1, 5e-3, 9.0), ("b1", 0.05, 1e-7, 2.0)):
        put(tmp_path, make_measured_record(name, "beta", dt_s=dt, position_error_max_m=error, cpu_median_s=cpu))
    found = {f.target: {p.run.record.solver: p for p in f.places} for f in find_frontiers(read_results(tmp_path))}
    costs = [found[10.0**-k]["beta"].cpu_s for k in range(3, 8)]
    assert costs == [2.0] * 5 and found[1e-2]["beta"].bound and not found[1e-4]["beta"].bound


def test_the_page_names_the_cheapest_where_two_reach_an_error(tmp_path):
    """With its ratios; one solver alone is no comparison."""
    ladder(tmp_path, "alpha", 4.0, 1e-3)
    alone = site.build_report(tmp_path).parent
    assert "cheapest" not in (alone / "cost.html").read_text(encoding="utf-8").partition("</h1>")[0]
    ladder(tmp_path, "beta", 4.0, 2e-3)
    page = (site.build_report(tmp_path).parent / "cost.html").read_text(encoding="utf-8")
    assert page.count('<td class="n" data-v="2">') >= 2 and "alpha is cheapest on 1 of 1 problem" in page


def test_errors_below_that_of_the_reference_are_marked(tmp_path):
    """Who is nearer to a motion that is itself known to 3e-5 m may be further from the true one."""
    for solver in ("alpha", "beta"):
        ladder(tmp_path, solver, 4.0, 1e-3, reference_own_error_m=3e-5)
    found = find_frontiers(read_results(tmp_path))
    assert {f.target: f.is_below_reference for f in found} == {f.target: f.target < 3e-5 for f in found}
    page = (site.build_report(tmp_path).parent / "cost.html").read_text(encoding="utf-8")
    assert page.count("Below the stated error") == sum(f.target < 3e-5 for f in found) > 0


def test_each_undecided_lead_says_why(tmp_path):
    """Decided where the lead is at least the spread; else by the spread, or a tie where nobody would ask for it."""
    many = {"repeats": 40, "cpu_q1_s": 1.0, "cpu_min_s": 0.1, "cpu_max_s": 9.0}  # the extremes decide nothing
    expected = {
        "wide": (1.5, 1.3, "spread"), "tie": (1.2, 1.02, "tie"), "close": (1.01, 1.02, ""), "clear": (1.2, 9.0, ""),
    }  # fmt: skip
    for problem, (spread, lead, _) in expected.items():
        ladder(tmp_path, "alpha", 4.0, 1e-3, problem=problem, cpu_q3_s=spread, **many)
        ladder(tmp_path, "beta", 4.0, lead * 1e-3, problem=problem, cpu_q3_s=99.0, **many)
    found = find_frontiers(read_results(tmp_path))
    assert {f.variant: f.doubt for f in found} == {problem: doubt for problem, (*_, doubt) in expected.items()}
    for f in found:
        spread, lead, doubt = expected[f.variant]
        assert f.places[0].spread == pytest.approx(spread) and f.places[1].factor == pytest.approx(lead)
        assert bool(f.doubt_words) is bool(doubt) is (spread > lead)
        if doubt:
            assert all(word in f.doubt_words for word in ("alpha", "beta", "40 repeats", f"{spread:g}", f"{lead:g}"))
    page = (site.build_report(tmp_path).parent / "cost.html").read_text(encoding="utf-8")
    assert page.count("Not decided: ") == sum(bool(f.doubt) for f in found) > page.count("Not decided: a tie: ") > 0
    assert page.count("the cheapest is not decided: ") == 2
    answers = {f.variant: describe_cheapest(f) for f in found}
    assert {v: "who is the cheapest is not decided" in words for v, words in answers.items()} == {
        problem: bool(doubt) for problem, (*_, doubt) in expected.items()
    }
    at = [f for f in found if f.target == 1e-3]
    assert state_cheapest(at).startswith("At 0.001 m, alpha is cheapest on 2 of 4 problems, 2 not decided; ")
    undecided = [f for f in at if f.doubt]
    assert state_cheapest(undecided).startswith("At 0.001 m, the cheapest is decided on none of 2 problems; ")


def test_a_presentation_has_no_frontier(tmp_path):
    """The problem in another unit costs what the problem costs."""
    for solver in ("alpha", "beta"):
        ladder(tmp_path, solver, 4.0, 1e-3, problem_parameters='{"unit_mass": 1024}')
    assert find_frontiers(read_results(tmp_path)) == []


def test_bars_end_where_the_error_passes_or_the_reference_ends():
    """Of 4 s, compared to 3 s: left at 2 s, followed to the end of the reference, never compared, stopped at 1 s."""
    asked = {"t_end_s": 4.0, "t_reached_s": 4.0, "compared_to_s": 3.0}

    def until(*times: float) -> dict[str, float]:
        return dict(zip(("accurate_until_s", "accurate_until_1pct_s", "accurate_until_0p1pct_s"), times, strict=True))

    stopped = {**asked, "t_reached_s": 1.0, "compared_to_s": 1.0, **until(1.0, 1.0, 0.5)}
    runs = [
        StoredRun(make_measured_record("a1", "alpha", **asked, **until(2.0, 1.0, 0.5))),
        StoredRun(make_measured_record("a2", "alpha", dt_s=0.1, **asked, **until(0.5, 0.2, 0.1))),  # coarser
        StoredRun(make_measured_record("b1", "beta", **asked, **until(3.0, 3.0, 2.0))),
        StoredRun(make_measured_record("c1", "gamma")),
        StoredRun(make_measured_record("d1", "delta", "diverged", **stopped)),
    ]
    beta, alpha, delta = list_tracking_times(Variant("p", "p", tuple(runs)))
    assert [f.run.record.run_id for f in (beta, alpha, delta)] == ["b1", "a1", "d1"]
    assert alpha.known == 4.0 and alpha.shades == (("tenth", 12.5), ("one", 12.5), ("ten", 25.0)) and not alpha.whole
    assert beta.shades == (("tenth", 50.0), ("one", 25.0), ("ten", 0.0)) and beta.whole and not delta.whole
    assert beta.words == "at least 3 s (10 %), at least 3 s (1 %), 2 s (0.1 %)"
    assert delta.words == "1 s (10 %), 1 s (1 %), 0.5 s (0.1 %)"


def facts(card) -> dict[str, str]:
    return {name: value for name, value, _, _ in card["facts"]}


def test_the_order_is_the_narrowest_one_at_default_options():
    wide = replace(ORDER, solver="alpha", case="alpha", quantity="position", order=3.9, low=3.5, high=4.3, declared=4.0)
    own = [
        wide,
        replace(wide, order=4.01, low=3.99, high=4.03, verdict="certified"),
        replace(wide, case="alpha[gauge=zero]", order=1.0, low=1.0, high=1.0),
    ]
    card = describe_solver("alpha", own, (), (), ())
    assert facts(card)["order"].startswith("4.01 (3.99 to 4.03), declared 4") and len(card["facts"]) == 1


def test_the_energy_is_that_of_the_longest_run():
    long = replace(
        DRIFT, solver="alpha", case="pendulum alpha dt=0.1", periods=320, verdict="trend", trend_W=2e-5, span_s=100.0
    )
    card = describe_solver("alpha", (), (replace(long, periods=30, verdict="bounded"), long), (), ())
    assert facts(card)["energy"] == f"drifts over 320 periods of {long.problem}, by 0.0020 J at dt=0.1"
    assert f"energy drifts over 320 periods of {long.problem}" in str(card["badge"])


def test_cost_and_followed_time_are_those_of_the_runs(tmp_path):
    """Twice as dear at every error on one problem; left at 1.5 of 2 s."""
    ladder(tmp_path, "alpha", 4.0, 2e-3, accurate_until_s=1.5, accurate_until_1pct_s=1.0, accurate_until_0p1pct_s=0.5)
    ladder(tmp_path, "beta", 4.0, 1e-3)
    results = read_results(tmp_path)
    follow = [f for v in results.variants for f in list_tracking_times(v)]
    card = describe_solver("alpha", (), (), follow, select_at_shared_target(find_frontiers(results)))
    assert re.match(r"×2.0 the cheapest at \S+ m, reached on 1 of 1 problem", facts(card)["cost"])
    least = f"least pendulum, 1.5 of 2 s at dt = {0.1 / 2 ** HALVINGS[-1]:g} s"
    assert facts(card)["followed"] == f"0 of 1 motion to the end of the reference; {least}"
    assert re.search(r"followed 0 of 1 motion; cost ×2.0 the cheapest at \S+ m\"", str(card["badge"]))


@pytest.mark.parametrize("name", ["alpha", '<script>alert("1")</script>'])
def test_the_badge_is_a_file_of_its_own(tmp_path, name):
    """An SVG that needs no page, with the values of the card, whatever the solver is called."""
    own = replace(ORDER, solver=name, case=name, quantity="position", order=2.0, low=1.9, high=2.1)
    badge = str(describe_solver(name, [own], (), (), ())["badge"])
    assert "order 2.00" in badge and "<script>" not in badge and "var(" not in badge
    root = ET.fromstring(badge)
    assert root.tag.endswith("svg") and float(root.attrib["width"]) > 0.0
    texts = [t for t in root.iter() if t.tag.endswith("text")]
    right = max(float(t.attrib["x"]) for t in texts)
    assert right < float(root.attrib["width"]) and re.match(r"[\w<]", texts[0].text)


def test_nothing_is_said_of_what_is_not_known(tmp_path):
    put(tmp_path, make_measured_record("aa01", accurate_until_s=math.nan))
    assert describe_solver("alpha", (), (), (), ())["facts"] == []


def test_finest_settings_speak_for_a_solver_and_the_rest_are_counted(tmp_path):
    """A coarse step that fails is no breakdown of the fine one, and not hidden either."""
    put(tmp_path, make_measured_record("aa01", dt_s=0.01, status="diverged", message="too coarse"))
    put(tmp_path, make_measured_record("aa02", dt_s=0.005))
    (v,) = rank_solvers(read_results(tmp_path))
    assert (v["finest"].succeeded, v["finest"].runs) == (1, 1) and not v["breaks_on"]
    assert (v["everything"].succeeded, v["everything"].stopped) == (1, 1)


def test_each_solver_has_its_own_ending(tmp_path):
    """One succeeds, one drifts, one is wrong, one refuses: each is said where it belongs, and only there."""
    drift = {"energy_mean_first_quarter_J": 1e-4, "energy_mean_last_quarter_J": 9e-4}
    put(tmp_path, make_measured_record("aa01", "alpha"))
    put(tmp_path, make_measured_record("bb01", "beta", **drift))
    put(tmp_path, make_measured_record("cc01", "gamma", "wrong", wrong_because=because("it left"), judged_to_s=0.5))
    put(tmp_path, make_measured_record("cc02", "gamma", dt_s=0.001, label="work", judged_to_s=0.5))
    put(tmp_path, make_measured_record("dd01", "delta", "refused", message="rank"))
    results = read_results(tmp_path)
    found = {v["solver"]: v for v in rank_solvers(results)}
    assert {s: [why for _, why in v["breaks_on"]] for s, v in found.items() if v["breaks_on"]} == {
        "gamma": ["it left reaches 2 m, more than 1 m; succeeds at dt = 0.001 s"],
        "delta": ["rank"],
    }
    assert name_unpredictable(results) == "Errors are judged while the motion is predictable: pendulum to 0.5 of 2 s."


def test_broadest_label_is_that_of_most_pairs(tmp_path):
    """A map of many runs of one solver is no overview."""
    for k in range(9):
        put(tmp_path, make_measured_record(f"m{k}", label="map", dt_s=0.001 * (k + 1)))
    put(tmp_path, make_measured_record("aa01", "alpha", label="sound"))
    put(tmp_path, make_measured_record("bb01", "beta", label="sound"))
    results = read_results(tmp_path)
    assert find_plain_label(results) == "sound"
    head = find_finest(results.variants[0], "alpha", "sound")
    assert head is not None and head.record.run_id == "aa01"


def test_problems_stand_before_their_variants(tmp_path):
    """Frames, units and shorter times are many and say nothing of who holds: they are counted apart."""
    put(tmp_path, make_measured_record("aa01", "alpha"))
    for k in range(3):
        told = json.dumps({"t_end": 1.0, "yaw": 0.1 * (k + 1)})
        put(tmp_path, make_measured_record(f"y{k}", label="symmetries", problem_parameters=told, status="wrong"))
        put(
            tmp_path, make_measured_record(f"b{k}", f"beta{k}", label="symmetries", problem_parameters='{"t_end": 1.0}')
        )
    put(tmp_path, make_measured_record("cc01", problem="other", label="symmetries"))
    results = read_results(tmp_path)
    label = find_plain_label(results)
    assert label == "recommended"
    assert {p.title for p in select_variants(results, label)} == {"pendulum", "other"}
    apart = {words: len(own) for words, own in group_variants(results, label).items()}
    assert apart == {OTHER_PARAMETERS: 1, "turned about the vertical": 3}
    (v,) = [v for v in rank_solvers(results) if v["solver"] == "alpha"]
    assert v["finest"].runs == 1 and not v["breaks_on"] and v["everything"].wrong == 3
    assert find_plain_label(read_results(only(tmp_path, "symmetries"))) == "symmetries"


def only(folder, label):
    """The run without the runs of other labels."""
    for r in read_results(folder).runs:
        if r.record.label != label:
            (folder / "runs" / f"{r.record.run_id}.json").unlink()
    return folder


def test_scores_count_every_kind_of_ending(built):
    results = read_results(built[0])
    s = count_outcomes(results.runs)
    assert (s.succeeded, s.wrong, s.refused) == (3, 1, 1) and s.runs == len(results.runs)
    assert sum(share for _, _, share in s.shares) == 100.0
