"""Each verdict from runs made up for it, and each flips when one number is changed."""

import json
import random

import numpy as np
import pytest

from harness.referee.claims import parse_register
from harness.referee.judge import as_text
from harness.referee.verdicts import judge
from tests.referee.synthetic import HEAD, cells_of, record, series

SUITE = """
[[cells]]
problem = "spherical_pendulum"
solver = "ida_index1"
options = { coordinates = ["euler313", "quaternion"], lambda_in_error_test = [true, false] }
rtol = [1e-3, 1e-4, 1e-6]
max_step = 0.01

[[cells]]
problem = "spherical_pendulum"
solver = "gc_weak_form"
dt = 0.01
"""
MAP = """
[solvers]
ida_index1 = "IDA was run, which is not ode15i"

[maps.m]
over = [{ problem = "spherical_pendulum", solver = "ida_index1", max_step = 0.01, tolerance = "any", chart = "any", lambda_in_error_test = "any" }]
dimensions = { tolerance = 3, chart = 2, lambda_in_error_test = 2 }
printed = { chart = "euler313", tolerance = 1e-3 }

[maps.gc]
over = [{ problem = "spherical_pendulum", solver = "gc_weak_form", step = 0.01, tolerance = "any" }]

[[claims]]
"""  # noqa: E501
TEST = 'map = "m"\ntests = [{ metric = "column", name = "phi_max", at_most = 1.0, unit = "m" }]\n'
CELLS = cells_of(SUITE)


def options(cell):
    return {"chart": cell.options.get("coordinates", "quaternion"), "lam": cell.options.get("lambda_in_error_test")}


def claim(text=TEST, records=None, of=lambda r: None, cells=CELLS):
    """The verdict on one claim; by default every run has |phi| = 0.5 m."""
    found = [record(c, phi_max=0.5) for c in cells] if records is None else records
    return judge(parse_register(MAP + HEAD + text), cells, found, of)[0]


def test_holding_everywhere_is_supported_and_worded_for_the_solver_run():
    c = claim()
    assert c["verdict"] == "SUPPORTED" and c["measured"] == 0.5 and c["band"] == [None, 1.0] and c["unit"] == "m"
    assert "not ode15i" in c["because"] and "12 of 12" in c["because"] and len(c["map"]) == 12
    assert set(c["cells"]) == {x.settings for x in CELLS if x.solver == "ida_index1"}


def test_holding_nowhere_is_refuted():
    c = claim(records=[record(x, phi_max=1.5) for x in CELLS])
    assert c["verdict"] == "REFUTED" and "0 of 12" in c["because"]


def test_one_altered_number_flips_the_verdict():
    """Each of the twelve runs alone: its number out of the band, and the claim holds no longer everywhere."""
    own = [c for c in CELLS if c.solver == "ida_index1"]
    for k in range(len(own)):
        c = claim(records=[record(x, phi_max=1.5 if x is own[k] else 0.5) for x in CELLS])
        assert c["verdict"] == "CONDITIONAL"
        assert [row["holds"] for row in c["map"]].count(False) == 1
        assert next(row for row in c["map"] if not row["holds"])["cell"] == own[k].settings


def test_conditional_names_the_planted_condition():
    """Runs in the paper's chart are bad: the chart is named, with counts, and what is printed counted apart."""
    c = claim(records=[record(x, phi_max=1.5 if options(x)["chart"] == "euler313" else 0.5) for x in CELLS])
    assert c["verdict"] == "CONDITIONAL"
    assert "Chart decides alone: holds with chart quaternion (6 of 6), not with chart euler313 (0 of 6)" in c["because"]
    assert "what the paper prints in 0 of 2" in c["because"] and c["measured"] == 1.5
    assert c["factors"]["chart"]["chart quaternion"] == [6, 6]


def test_missing_cells_are_untestable_never_green():
    """One of twelve runs is not there: nothing is decided, and it is said what is missing."""
    c = claim(records=[record(x, phi_max=0.5) for x in CELLS[1:]])
    assert c["verdict"] == "UNTESTABLE" and c["map"] == [] and "cells missing: 1 of 12" in c["missing"]


def test_a_suite_that_shrank_is_untestable():
    """Cells taken out of the suite leave the map with fewer values than the claim asks for."""
    small = [c for c in CELLS if options(c)["chart"] == "euler313"]
    c = claim(cells=small)
    assert c["verdict"] == "UNTESTABLE" and "1 of 2 values of chart" in c["missing"]


CUT = {"status": "stalled", "t_reached_s": 3.0, "steps": 9, "max_steps": 9}  # of 10 s


def one_of(columns, others=None):
    """The first run with these columns, the others with |phi| = 0.5 m."""
    return [record(x, **(columns if k == 0 else others or {"phi_max": 0.5})) for k, x in enumerate(CELLS)]


def pace(last):
    """Nine steps to 3 s, the last of ``last`` s: the others take what is left."""
    return lambda r: series(np.append(np.linspace(0.0, 3.0 - last, 9), 3.0)) if r.t_reached_s == 3.0 else None


def test_runs_ended_by_a_clock_are_left_out_and_named():
    """They would decide it, and another machine might let them go on: by a clock, out of memory, killed."""
    for columns in (CUT | {"steps": 8}, CUT | {"status": "memory"}):
        c = claim(records=one_of(columns))
        assert c["verdict"] == "SUPPORTED" and "Holds in 11 of 11" in c["because"] and c["map"][0]["holds"] is None
        assert "1 setting is left out: a limit on time or memory ended them" in c["because"]
    killed = {"status": "crashed", "message": "the solver was done, but measuring its motion took more than 120 s"}
    assert claim(records=one_of(killed | {"t_reached_s": float("nan")}))["verdict"] == "SUPPORTED"


def test_a_budget_of_steps_ends_stuck_runs_and_interrupts_slow_ones():
    """Nine steps to 3 of 10 s, a hundred budgets are 900: at 0.01 s a step 700 more are needed, at 1e-3 s 7000."""
    slow, stuck = (claim(records=one_of(CUT), of=pace(last)) for last in (0.01, 1e-3))
    assert slow["verdict"] == "SUPPORTED" and "only slow" in slow["because"] and slow["map"][0]["holds"] is None
    assert stuck["verdict"] == "CONDITIONAL" and "left out" not in stuck["because"] and not stuck["map"][0]["holds"]


def test_what_a_slow_run_had_settled_counts():
    """Over 2 s it got through, nothing is open; |phi| beyond its band so far is beyond it, within it is not yet."""
    for asked, phi, holds in (
        ("to = 2.0, at_most = 1.0", 0.5, True),
        ("to = 4.0, at_most = 1.0", 0.5, None),
        ("partial = true, at_most = 1.0", 0.5, None),
        ("partial = true, at_most = 1.0", 1.5, False),
        ("partial = true, at_least = 1.0", 1.5, True),
        ("partial = true, at_least = 1.0", 0.5, None),
    ):
        text = f'map = "m"\ntests = [{{ metric = "largest", series = "phi_norm", {asked}, unit = "m" }}]\n'

        def of(r, phi=phi):
            t = np.append(np.linspace(0.0, 2.99, 9), 3.0) if r.t_reached_s == 3.0 else np.linspace(0.0, 10.0, 9)
            return series(t, phi_norm=np.full(len(t), phi))

        assert claim(text, one_of(CUT), of)["map"][0]["holds"] is holds, (asked, phi)


@pytest.mark.parametrize(("band", "holds"), [("at_least = 5, at_most = 6", None), ("at_least = 1, at_most = 2", False)])
def test_a_slow_run_stops_later_than_it_was_interrupted(band, holds):
    """At 3 s: it does not stop between 1 and 2 s; between 5 and 6 s it might."""
    text = f'map = "m"\ntests = [{{ metric = "stops at", {band}, unit = "s" }}]\n'
    assert claim(text, one_of(CUT, {"phi_max": 0.5}), pace(0.01))["map"][0]["holds"] is holds


def test_a_limit_is_passed_later_than_a_slow_run_was_interrupted():
    """Not passed by 3 s: not between 1 and 2 s, perhaps between 5 and 6 s. Passed at 1.5 s: that stays."""
    for leaves, band, holds in (
        (9.0, "at_least = 1, at_most = 2", False),
        (9.0, "at_least = 5, at_most = 6", None),
        (1.5, "at_least = 1, at_most = 2", True),
    ):
        text = f'map = "m"\ntests = [{{ metric = "leaves at", series = "x", limit = 0.5, {band}, unit = "s" }}]\n'

        def of(r, leaves=leaves):
            t = np.append(np.linspace(0.0, 2.99, 200), 3.0) if r.t_reached_s == 3.0 else np.linspace(0.0, 10.0, 200)
            return series(t, x=(t > leaves).astype(float))

        assert claim(text, one_of(CUT), of)["map"][0]["holds"] is holds


def test_runs_that_took_no_step_are_left_out_and_named():
    """Nothing moved: neither for nor against, unless the claim is about starting. A refusal is the solver's answer."""
    never = {"status": "step_underflow", "t_reached_s": 0.0, "steps": 0}
    for band in ("at_most = 5", "at_least = 5"):
        text = f'map = "m"\ntests = [{{ metric = "stops at", {band}, unit = "s" }}]\n'
        c = claim(text, one_of(never))
        assert c["map"][0]["holds"] is None
        assert "1 setting is left out: they could not take a first step" in c["because"]
        assert claim(text + "starting = true\n", one_of(never))["map"][0]["holds"] is (band == "at_most = 5")
    assert claim(text, one_of(never | {"status": "refused"}))["map"][0]["holds"] is False


def test_a_comparison_with_a_run_cut_short_is_left_out():
    """ODE-GC, to be compared with, ran into a clock: no setting is settled; over a time it got through all are."""
    head = 'map = "m"\nagainst = "gc"\n'
    cut = {"status": "stalled", "t_reached_s": 3.0, "steps": 5, "max_steps": 9}
    found = [record(x, **(cut if x.solver == "gc_weak_form" else {})) for x in CELLS]

    def of(r):
        t = np.linspace(0.0, r.t_reached_s, 11)
        return series(t, phi_norm=np.ones(11))

    for to, verdict in ((4.0, "UNTESTABLE"), (2.0, "SUPPORTED")):
        test = f'metric = "largest", series = "phi_norm", to = {to}, compare = "over largest", at_least = 1, unit = ""'
        assert claim(f"{head}tests = [{{ {test} }}]\n", found, of)["verdict"] == verdict


def test_no_setting_that_settles_it_is_untestable():
    c = claim(records=[record(x, phi_max=0.5, **CUT | {"steps": 8}) for x in CELLS])
    assert c["verdict"] == "UNTESTABLE" and "12 settings are left out: a limit on time" in c["missing"]


def test_it_is_told_how_many_hold_because_a_run_stopped():
    """Losses of 2 m are above 1 m; two runs have no loss but an end before the end."""
    text = 'map = "m"\ntests = [{ metric = "loss", at_least = 1, unit = "m" }]\n'
    ends = [{"t_reached_s": 3.0, "steps": 9, "status": "diverged"}] * 2 + [{}] * len(CELLS)
    found = [record(x, position_error_max_m=2.0, **e) for x, e in zip(CELLS, ends, strict=False)]
    assert (
        "Holds in 12 of 12 settings. In 2 of these 12 because a run did not get to its end"
        in claim(text, found)["because"]
    )
    assert "because a run" not in claim(text, [record(x, position_error_max_m=2.0) for x in CELLS])["because"]


def test_a_number_that_nowhere_exists_refutes_nothing():
    c = claim(records=[record(x) for x in CELLS])
    assert c["verdict"] == "UNTESTABLE" and "no run of the map has the number 'column'" in c["missing"]


def test_some_needs_one_and_all_needs_all():
    """An existence claim is supported by one run; the map still says where."""
    found = [record(x, phi_max=0.5 if k == 0 else 1.5) for k, x in enumerate(CELLS)]
    c = claim(TEST + 'quantifier = "some"\n', found)
    assert c["verdict"] == "SUPPORTED" and "1 of 12" in c["because"]
    assert claim(TEST + 'quantifier = "some"\n', [record(x, phi_max=1.5) for x in CELLS])["verdict"] == "REFUTED"


@pytest.mark.parametrize(
    ("need", "verdict"),
    [
        ('{ solver = "adams", why = "ADAMS is not here" }', "UNTESTABLE"),
        ('{ solver = "ida_index1", why = "no IDA" }', "SUPPORTED"),
        ('{ observable = "four_bar_grid.joint_A_y", why = "which joint is A" }', "UNTESTABLE"),
        ('{ observable = "four_bar_grid.angle_1", why = "no angle" }', "SUPPORTED"),
        ('{ given = "a table", why = "not printed" }', "UNTESTABLE"),
    ],
)
def test_what_is_needed_is_looked_up(need, verdict):
    """A solver or an observable that joins the catalogue makes its claim testable without a change to the claim."""
    c = claim(TEST + f"needs = [{need}]\n")
    assert c["verdict"] == verdict and (verdict == "SUPPORTED" or c["missing"])


def test_across_a_dimension_values_are_taken_in_order():
    """Errors that fall tenfold from the loosest to the tightest tolerance converge; reversed they do not."""
    text = TEST.replace("at_most = 1.0", 'combine = "last over first", at_most = 0.1').replace(
        "map =", 'across = "tolerance"\nmap ='
    )
    falls = claim(text, [record(x, phi_max=(x.control.rtol or 1.0) ** 0.5) for x in CELLS])
    grows = claim(text, [record(x, phi_max=(x.control.rtol or 1.0) ** -0.5) for x in CELLS])
    assert falls["verdict"] == "SUPPORTED" and len(falls["map"]) == 4 and "tolerance" not in falls["map"][0]
    assert falls["measured"] == pytest.approx(1e-3**0.5, rel=1e-5) and grows["verdict"] == "REFUTED"


def test_two_failures_across_a_dimension_compare_nothing():
    """Both fail: a tighter tolerance neither helps nor not, whatever the band; one failure can be compared."""
    stopped = {"t_reached_s": 3.0, "steps": 9, "status": "diverged"}
    for how in ("last over first", "worst step"):
        text = f'across = "tolerance"\ntests = [{{ metric = "loss", combine = "{how}", at_least = 1, unit = "" }}]\n'
        text = 'map = "m"\n' + text

        def made(ends, chart="euler313"):
            return [
                record(x, position_error_max_m=1.0, **(ends if options(x)["chart"] == chart else {})) for x in CELLS
            ]

        c = claim(text, made(stopped))
        assert [row["holds"] for row in c["map"]].count(None) == 2 and "2 settings are left out: fewer than" in c[
            "because"
        ]
        tight = [record(x, position_error_max_m=1.0, **(stopped if x.control.rtol == 1e-6 else {})) for x in CELLS]
        assert claim(text, tight)["verdict"] == "SUPPORTED"


def test_a_group_of_one_value_across_a_dimension_tests_nothing():
    """One tolerance alone converges to nothing: its group is no setting."""
    text = TEST.replace("at_most = 1.0", 'combine = "largest", at_most = 1.0').replace(
        "map =", 'across = "tolerance"\nmap ='
    )
    few = [x for x in CELLS if options(x)["chart"] == "quaternion" or x.control.rtol in (None, 1e-3)]
    assert len(claim(text, cells=few)["map"]) == 2
    none = claim(text, cells=[x for x in CELLS if x.control.rtol in (None, 1e-3)])
    assert none["verdict"] == "UNTESTABLE"


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
        return record(x, phi_max=phi, phi_dot_max=phi_dot)

    c = claim(text, [both(x) for x in CELLS])
    assert c["verdict"] == "CONDITIONAL" and "Holds in 2 of 4 settings" in c["because"]
    assert "One tolerance that meets it suffices: tolerance 0.0001 in 2" in c["because"]
    assert "chart decides alone" in c["because"].lower()
    (row,) = {(r["case"].split()[2], r["measured"]) for r in c["map"] if r["holds"]}
    assert row == ("rtol=0.0001", 0.5)


def test_against_others_the_worst_of_them_counts():
    """Twice the |phi| of ODE-GC is at least once it; with ODE-GC's number tripled it is not."""
    text = TEST.replace("at_most = 1.0", 'compare = "over largest", at_least = 1.0') + 'against = "gc"\n'

    def made(gc):
        return [record(x, phi_max=gc if x.solver == "gc_weak_form" else 1.0) for x in CELLS]

    assert claim(text, made(0.5))["measured"] == 2.0 and claim(text, made(0.5))["verdict"] == "SUPPORTED"
    assert claim(text, made(1.5))["verdict"] == "REFUTED"


def test_several_tests_must_all_hold():
    """A good |phi| does not make up for a bad |phi_dot|, nor the other way round."""
    text = TEST.replace("}]", '}, { metric = "column", name = "phi_dot_max", at_most = 1.0, unit = "m/s" }]')
    for phi, phi_dot, verdict in ((0.5, 0.5, "SUPPORTED"), (0.5, 1.5, "REFUTED"), (1.5, 0.5, "REFUTED")):
        assert claim(text, [record(x, phi_max=phi, phi_dot_max=phi_dot) for x in CELLS])["verdict"] == verdict


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
    records = [record(x, phi_max=size[options(x)["chart"]] * (2.0 if x.control.rtol == 1e-3 else 1.0)) for x in CELLS]
    registers = [parse_register(split + HEAD + t) for t in (text, text.replace('pair_by = ["chart"]\n', ""))]
    verdicts = [judge(r, CELLS, records, lambda _: None)[0]["verdict"] for r in registers]
    assert verdicts == ["SUPPORTED", "CONDITIONAL"]


def test_numbers_are_read_off_series():
    """Leaving the plane at 6 s is between 5 and 7 s; a tenth of a second later it is not."""
    text = 'map = "m"\ntests = [{ metric = "leaves at", series = "out_of_plane", limit = 0.05, at_least = 5, at_most = 6.05, unit = "s" }]\n'  # noqa: E501
    t = np.linspace(0.0, 10.0, 101)

    def of(leaves):
        return lambda r: series(t, out_of_plane=np.where(t < leaves - 0.01, 0.0, 0.1))

    records = [record(x) for x in CELLS]
    assert claim(text, records, of(6.0))["verdict"] == "SUPPORTED" and claim(text, records, of(6.0))["measured"] == 6.0
    assert claim(text, records, of(6.1))["verdict"] == "REFUTED"


def test_the_newer_of_two_codes_counts():
    """The same settings run again: the verdict follows the later result."""
    old = [record(x, phi_max=1.5, finished="2026-01-01") for x in CELLS]
    new = [record(x, phi_max=0.5, finished="2026-01-02") for x in CELLS]
    assert claim(records=[*new, *old])["verdict"] == "SUPPORTED" == claim(records=[*old, *new])["verdict"]


def test_verdicts_do_not_depend_on_the_order_of_records():
    """Shuffled records give the same bytes, whatever the number of processes that wrote them."""
    cut = {"status": "memory", "t_reached_s": 3.0}
    found = [record(x, phi_max=1.5 if k % 3 else 0.5, **({} if k % 4 else cut)) for k, x in enumerate(CELLS)]
    texts = set()
    for seed in range(5):
        random.Random(seed).shuffle(found)
        texts.add(as_text([claim(records=found)]))
    assert len(texts) == 1


def test_judgements_are_strict_json():
    """Numbers that do not exist are null; a row of a map is a line."""
    c = claim(records=[record(x, phi_max=float("inf") if k == 0 else 0.5) for k, x in enumerate(CELLS)])
    text = as_text([c])
    assert json.loads(text, parse_constant=pytest.fail)[0]["map"][0]["measured"] is None
    assert sum('"holds"' in line for line in text.splitlines()) == 12
