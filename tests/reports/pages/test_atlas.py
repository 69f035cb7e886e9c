"""The atlas: survival counts every run once, and the cause of a stop is found in series made to show it."""

import dataclasses
import math

import numpy as np
import pytest

from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results.records import format_reasons
from mbsbench.reports.model.results import StoredRun, read_results
from mbsbench.reports.pages.runs.atlas import (
    CAUSES,
    find_first_cause,
    find_usual_step,
    group_broken,
    group_stops,
    plot_last_steps,
    state_stops,
    tabulate_survival,
)
from mbsbench.reports.pages.svg import choose_ticks
from mbsbench.reports.plots.spec import choose_styles
from mbsbench.tests.factories import make_measured_record, make_swing

from ..conftest import put


def stopped(status: str = "diverged", **changes) -> StoredRun:
    return StoredRun(make_measured_record("aa01", status=status, t_reached_s=1.0, message="it stopped", **changes))


def made(**arrays):
    """The series of a swing, with some arrays put in their place."""
    base = make_swing(200, 1.0)
    return dataclasses.replace(base, arrays={**base.arrays, **arrays})


def test_each_cause_is_read_from_the_series_that_shows_it():
    t = np.linspace(0.0, 1.0, 200)
    falling = np.append(np.full(190, 0.01), 10.0 ** -np.arange(3.0, 13.0))
    rising = np.append(np.full(190, 1e-6), 10.0 ** np.linspace(-6.0, 1.0, 10))
    margin = np.append(np.full(190, 0.9), np.linspace(0.9, 1e-3, 10))
    cases = {
        "collapse": (stopped("step_underflow"), made(dt=falling)),
        "energy": (stopped(), made(energy_error=rising)),
        "apart": (stopped(), made(phi_norm=rising)),
        "chart": (stopped("singular"), made(diag_chart_margin=margin, dt=falling)),
        "dependent": (stopped("singular"), made(dt=falling)),
        "corrector": (stopped("diverged"), made()),
        "limit": (stopped("stalled"), made()),
        "killed": (stopped("crashed"), made(energy_error=rising)),
        "unmoved": (stopped("diverged"), None),
    }
    assert set(cases) == set(CAUSES)
    for key, (run, shown) in cases.items():
        assert find_first_cause(run, shown)[0] == key, key
    assert len(t) == 200


def test_values_that_are_no_numbers_are_a_blow_up():
    """An energy error of NaN is over every limit."""
    broken_off = np.append(np.zeros(199), math.nan)
    assert find_first_cause(stopped(), made(energy_error=broken_off))[0] == "energy"


def test_usual_step_is_not_that_of_the_many_small_ones_before_a_stop():
    """A thousand steps of 1e-9 s cover nothing of the second that a hundred steps covered."""
    dt = np.append(np.full(100, 0.01), np.full(1000, 1e-9))
    assert find_usual_step(dt) == 0.01
    assert np.median(dt) == 1e-9


def test_evidence_says_numbers_with_units():
    _, told = find_first_cause(stopped(), made())
    assert any(" J at the end" in e for e in told) and any(" m at the end" in e for e in told)


def test_survival_counts_every_run_once():
    """Of ten runs: two stop, one is refused, three are wrong: 7 of 9 reach the end, 4 right."""
    runs = [StoredRun(make_measured_record(f"w{k}", status="wrong")) for k in range(3)] + [
        StoredRun(make_measured_record(f"s{k}")) for k in range(4)
    ]
    runs += [
        StoredRun(make_measured_record("d1", status="diverged", t_reached_s=0.5)),
        StoredRun(make_measured_record("r1", status="refused")),
    ]
    runs += [StoredRun(make_measured_record("d2", status="crashed", t_reached_s=math.nan))]
    ((found, least),) = tabulate_survival(runs).values()
    assert (found.began, found.refused, found.stopped, found.wrong, found.succeeded) == (9, 1, 2, 3, 4)
    assert least == 0.0
    assert state_stops(found) == "2 of 9 runs stopped, 3 report success and are wrong"


def test_wrong_ones_are_grouped_by_the_law_they_break():
    reasons = Reason(Law.ENERGY, 3.0, 1.0, "J"), Reason(Law.ENERGY, 9.0, 1.0, "J"), Reason(Law.CONSTRAINT, 1.0, 0.1)
    runs = [
        StoredRun(make_measured_record(f"w{k}", status="wrong", wrong_because=format_reasons([why])))
        for k, why in enumerate(reasons)
    ]
    found = group_broken([*runs, StoredRun(make_measured_record("aa01"))])
    assert [(law, sum(map(len, own))) for law, own in found.items()] == [("the energy error", 2), ("|phi|", 1)]


def test_zoom_ends_with_a_star_and_survives_what_is_no_number():
    assert plot_last_steps(stopped(), None, "#000") == ()
    panels = plot_last_steps(stopped(), made(energy_error=np.full(200, math.nan)), "#123456")
    assert len(panels) == 3 and 'class="star"' in panels[0] and "#123456" in panels[0]
    assert "no number" in panels[1] and 'class="star"' not in panels[1]


@pytest.mark.parametrize(("low", "high"), [(1e-15, 1e3), (2e-4, 9e-4), (0.5, 2.0), (3e-7, 3.1e-7), (1.0, 1000.0)])
def test_ticks_are_few_round_and_inside(low, high):
    found = choose_ticks(low, high)
    assert len(found) <= 4 and all(low <= v <= high for v in found)
    assert found == sorted(found)


def test_stops_of_one_solver_on_one_problem_stand_together(tmp_path):
    """Five runs, two causes: each is in one family, the plainest settings at its head."""
    for k, options in enumerate(('{"a": 1}', "{}", '{"a": 2}')):
        put(
            tmp_path,
            make_measured_record(f"s{k}", status="stalled", solver_options=options, t_reached_s=1.0),
            make_swing(40, 1.0),
        )
    put(tmp_path, make_measured_record("c1", status="crashed", t_reached_s=1.0), make_swing(40, 1.0))
    put(tmp_path, make_measured_record("o1", "beta", status="stalled", t_reached_s=1.0), make_swing(40, 1.0))
    results = read_results(tmp_path)
    found = group_stops(
        results, [c for c in results.runs if c.has_stopped and not c.is_unfinished], choose_styles(results.solvers)
    )
    assert {k: g["total"] for k, g in found.items()} == {"killed": 1, "limit": 4}
    heads = [
        (f["runs"][0].record.solver, len(f["runs"]), f["runs"][0].record.run_id) for f in found["limit"]["families"]
    ]
    assert heads == [("alpha", 3, "s1"), ("beta", 1, "o1")]
    assert found["limit"]["counts"]["alpha"] == 3
