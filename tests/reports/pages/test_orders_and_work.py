"""Certificates, drift, the scorecard and work: numbers of known answer come out as they went in."""

import dataclasses
import math

import pytest
from msgspec.structs import replace

from mbsbench.harness.results.judgements.runs import WorkProfile
from mbsbench.reports.model.results import group_by, read_results
from mbsbench.reports.pages.judged.cost import find_work, list_fields, make_cost_plots, sort_profiles
from mbsbench.reports.pages.judged.orders import EARLY, FLOORED, USED, find_fit_ends, list_points, mark_verdict
from mbsbench.reports.pages.judged.symmetries import summarize_outcomes
from mbsbench.reports.plots.work import make_step_line, plot_profile
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.factories import make_measured_record, make_swing

from ..conftest import every_kind, put
from . import synthetic


def test_points_left_out_of_a_fit_say_why():
    """Coarser than all used ones: pre-asymptotic; else on the floor."""
    order = replace(synthetic.ORDER, dt=(0.4, 0.2, 0.1, 0.05, 0.025), error=(9.0, 0.04, 0.01, 1.1e-12, 1e-12),
                    floor=1e-12, used=(False, True, True, False, False), fit="power")  # fmt: skip
    assert [kind for _, _, kind in list_points(order)] == [EARLY, USED, USED, FLOORED, FLOORED]


def test_drawn_fit_has_the_order_and_goes_through_the_points():
    """error = dt^2 exactly: the drawn line is that law."""
    order = next(o for o in synthetic.orders(["aa01"]) if o.quantity == "q")
    x, y = find_fit_ends(order)
    assert math.log(y[1] / y[0]) / math.log(x[1] / x[0]) == pytest.approx(order.order)
    assert y == pytest.approx(x**2)


def test_an_order_above_the_declared_one_has_a_mark_of_its_own_and_is_no_failure():
    """Neither certified nor failed: counted apart."""
    above = mark_verdict("above declared")
    assert (above.word, above.kind) == ("above declared", "refused")
    assert above.symbol not in {mark_verdict(word).symbol for word in ("certified", "below declared", "undecided")}


def test_a_check_that_decides_nothing_is_no_success():
    """Its box says so, and it is not counted among those that hold."""
    mark, count = summarize_outcomes([synthetic.SYMMETRY, replace(synthetic.SYMMETRY, verdict="undecided")])
    assert (mark.word, mark.kind, count) == ("not decided", "refused", "1 of 2")


def test_box_of_the_scorecard_shows_its_worst_outcome():
    found = group_by(synthetic.symmetries(["aa01"]), lambda s: (s.solver, s.title))
    boxes = {key: summarize_outcomes(own) for key, own in found.items()}
    assert boxes["alpha", "time reversal"][0].word == "broken" and boxes["alpha", "time reversal"][1] == "1 of 2"
    assert boxes["alpha", "yaw"][0].word == "holds"
    assert boxes["gamma", "yaw"][1] == ""  # what does not apply is not counted
    assert boxes[synthetic.HOSTILE, synthetic.HOSTILE][0].kind == "refused"  # decides nothing


def test_profile_rises_by_one_target_at_its_work():
    p = WorkProfile("alpha", "evaluations", 4, (10.0, 100.0, 1000.0))
    x, y = make_step_line(p)
    assert_same(x, [10, 10, 100, 100, 1000, 1000])
    assert y == pytest.approx([0.0, 0.25, 0.25, 0.5, 0.5, 0.75])
    assert find_work(p, 0.5) == 100.0
    assert math.isnan(find_work(p, 1.0))
    plot = plot_profile(sort_profiles(synthetic.work(["aa01"]).profile), (), "evaluations")
    assert len(plot.traces) == 3 and plot.x.log


def test_work_of_records_stands_in_until_it_is_judged(tmp_path):
    """Without work.json every run with an error is a point all the same; wrong and stopped ones are marked."""
    every_kind(tmp_path)
    results = read_results(tmp_path)
    found = next(f for f in list_fields(results, ()) if f["variant"] == "pendulum")
    traces = make_cost_plots(found)["error-evaluations"].traces
    ends = {t.solver: list(t.ends) for t in traces if t.solver}
    assert ends["beta"] == ["wrong"] and ends["delta"] == ["failed"]
    assert all(t.solver for t in traces)  # no run comes near the reference's stated error: it is not drawn
    near = found | {"measure": dataclasses.replace(found["measure"], own=1e-4)}
    region = make_cost_plots(near)["error-evaluations"].traces[0]
    assert not region.solver and region.high[0] == pytest.approx(1e-4) and region.low[0] < 1e-4


def test_zeros_stay_zeros(tmp_path):
    put(tmp_path, make_measured_record("aa01", phi_max=0.0), make_swing())
    (found,) = list_fields(read_results(tmp_path), ())
    plots = make_cost_plots(found)
    zeros = next(t for t in plots["phi-evaluations"].traces if t.solver)
    assert_each(zeros.y, "==", 0.0)  # what is drawn for them is the axis' matter
    assert "error-factorisations" not in plots  # nobody counted them


def test_the_first_picture_of_work_has_all_solvers_and_others_say_who_is_absent(tmp_path):
    """A hole has its reason in words: not run, or how the runs ended."""
    put(tmp_path, make_measured_record("aa01", problem="a_few"), make_swing())
    unknown = dict.fromkeys(("position_error_max_m", "energy_drift_max_J", "phi_max"), math.nan)
    put(tmp_path, make_measured_record("aa02", "beta", "refused", problem="a_few", message="rank", **unknown))
    for solver in ("alpha", "beta", "gamma"):
        put(tmp_path, make_measured_record(f"b{solver}", solver, problem="whole"), make_swing())
    first, second = list_fields(read_results(tmp_path), ())
    assert (first["variant"], first["absent"]) == ("whole", [])
    assert (second["variant"], second["absent"]) == ("a_few", ["beta (refused)", "gamma (not run)"])
