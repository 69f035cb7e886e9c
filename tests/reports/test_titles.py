"""Titles of plots are findings: their numbers are those of the data that are drawn."""

import dataclasses
import math

import numpy as np
import pytest
from msgspec.structs import replace

from mbsbench.harness.results.judgements.runs import WorkProfile
from mbsbench.harness.results.series import Series
from mbsbench.reports.model.accuracy import choose_measure
from mbsbench.reports.model.results import read_results
from mbsbench.reports.model.words import number
from mbsbench.reports.pages.judged.cost import measure_growths, plot_growth
from mbsbench.reports.pages.judged.orders import plot_ladders
from mbsbench.reports.plots.laws import plot_errors, plot_invariants, plot_laws, plot_observables
from mbsbench.reports.plots.work import list_points, plot_pairs, plot_profile
from mbsbench.tests.factories import make_measured_record, make_swing

from .conftest import put
from .pages.synthetic import ORDER
from .test_charts import drawing_of

SIZES = {"alpha": 2e-3, "beta": 0.4, "gamma": 3e-2}
SERIES = {  # of a plot: the series that it draws, with its unit
    "energy": ("energy_error", "J"),
    "phi": ("phi_norm", "m"),
    "phi-dot": ("phi_dot_norm", "m/s"),
    "position": ("position_error", "m"),
    "orientation": ("orientation_error", "rad"),
    "inv-L": ("inv_L", "kg m²/s"),
}


def growing(size: float) -> Series:
    """Each error is a power of time of its own, so that no two have the same largest value."""
    motion = make_swing()
    t = motion["t"]
    for k, (name, _) in enumerate(SERIES.values()):
        motion.arrays[name] = size * (k + 1) * (t / 2.0) ** (k + 1)
    motion.arrays["obs_theta"] = motion["ref_theta"] + size * t
    return motion


@pytest.fixture
def drawn(tmp_path):
    """Three solvers, judged to half of the time; a coarser run and another label that no title is about."""
    for name, size in SIZES.items():
        put(tmp_path, make_measured_record(name, name, judged_to_s=1.0), growing(size))
    put(tmp_path, make_measured_record("coarse", judged_to_s=1.0, dt_s=0.1), growing(7.0))
    put(tmp_path, make_measured_record("printed", "delta", judged_to_s=1.0, label="as printed"), growing(9.0))
    return dataclasses.replace(drawing_of(tmp_path), label="recommended")


def test_laws_and_errors_go_from_the_smallest_to_the_largest(drawn):
    """Of each solver's finest run its largest value: of laws to the end, of errors to where they are judged."""
    found = {p.name: p for chapter in (plot_laws, plot_errors, plot_invariants) for p in chapter(drawn).plots}
    for name, (column, unit) in SERIES.items():
        until = 1.0 if name in ("position", "orientation") else 2.0
        ends = []
        for solver in ("alpha", "beta"):
            motion = growing(SIZES[solver])
            ends.append(f"{number(motion[column][motion['t'] <= until].max())} {unit} ({solver})")
        assert found[name].finding == f"{found[name].title} at the finest settings: {ends[0]} to {ends[1]}"


def test_observables_say_how_far_off_they_are(drawn):
    """From the reference, over the whole time that this is known."""
    (plot,) = [p for p in plot_observables(drawn).plots if p.name == "obs-theta"]
    low, high = (number(2.0 * SIZES[name]) for name in ("alpha", "beta"))
    assert plot.finding == f"theta at the finest settings: off by {low} rad (alpha) to {high} rad (beta)"


def test_growth_names_the_smallest_and_the_largest_exponent(tmp_path):
    """Least squares in the logarithms, from the table's numbers."""
    rates = {"alpha": (1.0, 0.9, 1.3), "beta": (1.0, 3.0, 10.0)}
    sizes = np.array([2, 4, 8])
    for solver, cost in rates.items():
        for n, cpu in zip(sizes, cost, strict=True):
            put(
                tmp_path,
                make_measured_record(f"{solver}{n}", solver, problem_parameters=f'{{"links": {n}}}', cpu_median_s=cpu),
            )
    results = read_results(tmp_path)
    found = measure_growths(results.runs, {c.record.run_id: int(c.record.run_id[-1]) for c in results.runs})
    slopes = [np.polyfit(np.log(sizes), np.log(rates[name]), 1)[0] for name in ("alpha", "beta")]
    title = plot_growth("pendulum", found, lambda run: "").title
    assert title == (
        f"pendulum: a step of alpha grows with the number of bodies to the power {slopes[0]:.2f}, "
        f"one of beta to {slopes[1]:.2f}"
    )


def test_a_profile_names_who_reaches_most_targets():
    """By the best of its settings; default ones beside it do not count."""
    best = [WorkProfile("alpha", "evaluations", 9, (1.0, 2.0)), WorkProfile("beta", "evaluations", 9, (5.0, 6.0, 7.0)),
            WorkProfile("gamma", "steps", 9, (1.0, 2.0, 3.0, 4.0))]  # fmt: skip
    default = [WorkProfile("gamma", "evaluations", 9, (1.0, 2.0, 3.0, 4.0))]
    assert plot_profile(best, default, "evaluations").finding == "beta reaches 3 of 9 targets with the best settings"
    both = [best[1], WorkProfile("alpha", "evaluations", 9, (1.0, 2.0, 9.0))]
    assert plot_profile(both, (), "evaluations").finding.startswith("alpha and beta reach 3 of 9 targets")


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1.05, "alpha and beta need 0.100 s for 10⁻⁴ m, gamma 4.0 times as much"),
        (1.5, "alpha needs 0.100 s for 10⁻⁴ m, gamma 4.0 times as much"),
    ],
)
def test_cpu_times_that_are_equal_have_no_winner(tmp_path, factor, words):
    """Within a tenth, as on the page of cost."""
    for solver, cpu in (("alpha", 0.1), ("beta", 0.1 * factor), ("gamma", 0.4)):
        put(tmp_path, make_measured_record(solver, solver, position_error_max_m=1e-4, cpu_median_s=cpu))
    (variant,) = read_results(tmp_path).variants
    plots = plot_pairs("work", list_points(variant), choose_measure(variant.runs))
    assert plots["error-cpu"].finding == f"pendulum: {words}"


def test_a_title_on_orders_names_whose_they_are():
    """The least and the largest of several methods; never the first one's for all."""
    own = replace(ORDER, quantity="position", dt=(0.1, 0.05), error=(1e-2, 2.5e-3), used=(True, True), fit="power")
    two = [replace(own, solver=s, case=s, order=p) for s, p in (("alpha", 4.0), ("beta", 2.0))]
    assert plot_ladders(two)[0].title == "pendulum: position converges with order 2.00 (beta) to 4.00 (alpha)"
    assert plot_ladders(two[:1])[0].title == "pendulum: position converges with order 4.00 (alpha)"


def test_work_says_what_the_tightest_common_error_costs(tmp_path):
    """Three ladders of order 2, 1 and none: two of three get to 1e-4, interpolated in the logarithms."""
    for k in range(4):
        for solver, error, cpu in (
            ("alpha", 0.01 * 4.0**-k, 0.1 * 2.0**k),
            ("beta", 1e-3 * 2.0**-k, 2.0 * 2.0**k),
            ("gamma", 0.3, 1.0),
        ):
            put(
                tmp_path,
                make_measured_record(
                    f"{solver}{k}", solver, dt_s=0.1 * 2.0**-k, position_error_max_m=error, cpu_median_s=cpu
                ),
            )
    (variant,) = read_results(tmp_path).variants
    finding = plot_pairs("work", list_points(variant), choose_measure(variant.runs))["error-cpu"].finding
    target = 1e-3
    alpha = 0.1 * (0.01 / target) ** 0.5
    assert finding == (
        f"pendulum: alpha needs {number(alpha)} s for 0.001 m, beta {number(2.0 / alpha, 2)} times as much; "
        "1 of 3 do not get there"
    )
    assert math.isclose(alpha, 0.316, rel_tol=1e-3)
