"""The cheapest solver for an error: interpolated along each method, refusals and misses kept beside."""

import pytest

from mbsbench.reports import site
from mbsbench.reports.model.frontier import frontiers
from mbsbench.reports.model.results import read_results

from .conftest import put, record

HALVINGS = range(9)


def ladder(folder, solver, order, cost, **changes):
    """Runs whose error is (10 dt)^order [m] at ``cost``/dt [s] of CPU, dt = 0.1 down to 0.1/256 s."""
    for k in HALVINGS:
        dt = 0.1 / 2**k
        error = (10.0 * dt) ** order
        numbers = {"dt_s": dt, "position_error_max_m": error, "cpu_median_s": cost / dt}
        put(folder, record(f"{solver}{k}", solver, **{**numbers, **changes}))


def test_work_is_interpolated_on_the_power_law(tmp_path):
    """error = (10 dt)^p and CPU = c/dt: CPU at an error e is 10 c e^(-1/p), between the steps that were run too."""
    ladder(tmp_path, "alpha", 2.0, 1e-3)
    ladder(tmp_path, "beta", 4.0, 3e-3)
    (found,) = [f for f in frontiers(read_results(tmp_path)) if f.target == 1e-3]
    assert [p.reach.run.record.solver for p in found.places] == ["beta", "alpha"]
    assert found.places[0].reach.cpu_s == pytest.approx(10.0 * 3e-3 * 1e3**0.25)
    assert found.places[1].reach.cpu_s == pytest.approx(10.0 * 1e-3 * 1e3**0.5)
    assert found.next_factor == pytest.approx(1e3**0.25 / 3.0)


def test_who_misses_and_who_refuses_is_said(tmp_path):
    """Neither is left out without a word; wrong runs reach nothing."""
    ladder(tmp_path, "alpha", 4.0, 1e-3)
    ladder(tmp_path, "beta", 4.0, 2e-3)
    ladder(tmp_path, "gamma", 1.0, 1e-3)
    ladder(tmp_path, "delta", 4.0, 1e-6, status="wrong")
    put(tmp_path, record("eps", "epsilon", "refused", message="no springs", position_error_max_m=float("nan")))
    found = {f.target: f for f in frontiers(read_results(tmp_path))}
    assert [p.reach.run.record.solver for p in found[1e-6].places] == ["alpha", "beta"]
    assert found[1e-6].missed == ("delta", "gamma")
    assert [r.record.message for r in found[1e-6].refused] == ["no springs"]


def test_a_coarsest_run_below_the_error_is_a_bound(tmp_path):
    """No run shows how much less would do."""
    ladder(tmp_path, "alpha", 4.0, 1e-3, position_error_max_m=1e-9)
    ladder(tmp_path, "beta", 4.0, 1e-3)
    (found,) = [f for f in frontiers(read_results(tmp_path)) if f.target == 1e-3]
    bounds = {p.reach.run.record.solver: p.reach.bound for p in found.places}
    assert bounds == {"alpha": True, "beta": False}


def test_a_run_that_is_better_and_cheaper_counts_for_looser_errors(tmp_path):
    """An error is met by any run below it: the cost never falls where the error asked for gets smaller."""
    ladder(tmp_path, "alpha", 4.0, 1e-3)
    for name, dt, error, cpu in (("b0", 0.1, 5e-3, 9.0), ("b1", 0.05, 1e-7, 2.0)):
        put(tmp_path, record(name, "beta", dt_s=dt, position_error_max_m=error, cpu_median_s=cpu))
    found = {
        f.target: {p.reach.run.record.solver: p.reach for p in f.places} for f in frontiers(read_results(tmp_path))
    }
    costs = [found[10.0**-k]["beta"].cpu_s for k in range(3, 8)]
    assert costs == [2.0] * 5 and found[1e-2]["beta"].bound and not found[1e-4]["beta"].bound


def test_the_page_names_the_cheapest_where_two_reach_an_error(tmp_path):
    """With its ratios; one solver alone is no comparison."""
    ladder(tmp_path, "alpha", 4.0, 1e-3)
    alone = site.build(tmp_path).parent
    assert "cheapest" not in (alone / "cost.html").read_text(encoding="utf-8").partition("</h1>")[0]
    ladder(tmp_path, "beta", 4.0, 2e-3)
    page = (site.build(tmp_path).parent / "cost.html").read_text(encoding="utf-8")
    assert page.count('<td class="n" data-v="2">') >= 2 and "alpha is the cheapest on 1 of 1 problem" in page


def test_a_presentation_has_no_frontier(tmp_path):
    """The problem in another unit costs what the problem costs."""
    for solver in ("alpha", "beta"):
        ladder(tmp_path, solver, 4.0, 1e-3, problem_parameters='{"unit_mass": 1024}')
    assert frontiers(read_results(tmp_path)) == []
