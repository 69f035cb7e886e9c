"""Orders are found where they are known: in made-up ladders, and in ladders of solvers, broken ones among them."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from harness.cell import make_cell
from harness.job import Job
from harness.referee.fitting import ladder, scattered
from harness.referee.orders import certify
from harness.registry import make_problem
from harness.store import create
from harness.worker import run

DT = 0.1 * 0.5 ** np.arange(10)
NOWHERE = Path()


def test_a_pure_power_is_found_to_rounding():
    """C dt^p: nothing left out, an interval of no width."""
    fit = ladder(DT, 3.0 * DT**2)
    assert fit.kind == "power"
    assert all(fit.used)
    assert fit.order == pytest.approx(2.0, abs=1e-9)
    assert fit.high - fit.low < 1e-6


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_a_floor_is_detected_and_left_out(order):
    """C dt^p + F: points within a factor of F are not fitted, and F is told."""
    floor = 3.0 * DT[5] ** order
    fit = ladder(DT, 3.0 * DT**order + floor * np.array([1.0, 1.02] * 5))
    assert fit.kind == "power"
    assert fit.order == pytest.approx(order, abs=0.1)
    assert not any(fit.used[6:])
    assert fit.floor == pytest.approx(floor, rel=0.5)


def test_a_floor_that_grows_with_the_number_of_steps_is_one_too():
    """Errors of the steps' solution pile up like sqrt(1/dt)."""
    fit = ladder(DT, DT**2 + 1e-8 / np.sqrt(DT))
    assert fit.kind == "power"
    assert fit.order == pytest.approx(2.0, abs=0.1)


def test_coarse_steps_out_of_the_range_are_left_out():
    """C dt^2 (1 + K dt): the first slopes are 2.4 and 2.2, and not fitted."""
    error = 3.0 * DT**2 * (1.0 + 20.0 * DT)
    fit = ladder(DT, error)
    assert not fit.used[0]
    assert fit.used[-1]
    assert fit.order == pytest.approx(2.0, abs=0.05)
    assert fit.low <= fit.slopes[-1] <= fit.high


def test_pre_asymptotic_range_power_and_floor_together():
    """All three at once, as a real ladder has them."""
    fit = ladder(DT, 3.0 * DT**2 * (1.0 + 5.0 * DT) + 3e-8)
    assert fit.order == pytest.approx(2.0, abs=0.1)
    assert not fit.used[0]
    assert not fit.used[-1]


def test_an_order_that_is_lost_at_small_steps_is_not_certified():
    """dt^2 + c dt is of first order, however long the second-order range looks."""
    fit = ladder(DT, DT**2 + 2e-3 * DT)
    assert fit.kind != "power" or fit.order < 1.5


def test_errors_that_do_not_depend_on_the_step_have_no_order():
    """Nothing is fitted to a constant."""
    assert ladder(DT, np.full(10, 1e-12)).kind == "flat"
    assert math.isnan(ladder(DT, np.full(10, 1e-12)).order)


def test_jitter_widens_the_interval_and_it_holds_the_order():
    """2 % of noise, as from a maximum over few steps: 95 of 100 intervals and more hold the truth."""
    random = np.random.default_rng(4)
    held = []
    for _ in range(200):
        fit = ladder(DT, DT**2 * np.exp(0.02 * random.standard_normal(10)))
        held.append(fit.kind == "power" and fit.low <= 2.0 <= fit.high)
    assert np.mean(held) > 0.93


def test_scattered_errors_have_the_median_of_slopes():
    """Error control: half a decade of scatter about rtol^0.8, and a floor of two runs."""
    random = np.random.default_rng(1)
    rtol = 10.0 ** -np.arange(3.0, 12.0)
    error = rtol**0.8 * 10.0 ** (0.2 * random.standard_normal(9))
    error[-2:] = error[-3]
    fit = scattered(rtol, error)
    assert fit.low <= 0.8 <= fit.high
    assert fit.order == pytest.approx(0.8, abs=0.1)
    assert not any(fit.used[-2:])
    assert scattered(rtol[:3], error[:3]).kind == "none"


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Records of cells, each run once."""
    folder = create(tmp_path_factory.mktemp("ladders"))
    for part in ("series", "stderr"):
        (folder / part).mkdir(exist_ok=True)
    known = {}

    def of(problem, solver, steps, parameters=None, options=None, control="dt"):
        out = []
        for step in steps:
            cell = make_cell(make_problem(problem, parameters or {}), solver, options, {control: step})
            if cell.settings not in known:
                known[cell.settings] = run(Job(cell, folder))
            out.append(known[cell.settings])
        return out

    return of


def by_quantity(records):
    return {e["quantity"]: e for e in certify(NOWHERE, records)}


SHARP = {"tolerance": 1e-12}


@pytest.mark.parametrize(
    ("problem", "parameters", "dt"),
    [("spherical_pendulum", {"t_end": 2.0}, 0.04), ("spherical_pendulum", {"t_end": 2.0, "omega_z": 0.1}, 0.04),
     ("heavy_top", {"t_end": 0.5}, 0.004), ("chain", {"t_end": 0.4}, 0.008)],
)  # fmt: skip
def test_ode_gc_is_certified_of_order_two(ran, problem, parameters, dt):
    """q, v, energy, |phi| and the reaction, within 0.1; |phi_dot| is held by the tolerance at every step."""
    found = by_quantity(ran(problem, "gc_weak_form", [dt / 2**k for k in range(6)], parameters, SHARP))
    for name in ("position", "orientation", "velocity", "angular velocity", "energy", "|phi|", "reaction"):
        assert found[name]["verdict"] == "certified", found[name]["words"]
        assert abs(found[name]["order"] - 2.0) < 0.1, name
    assert found["|phi_dot|"]["verdict"] in ("floor", "exact")


def test_without_the_b_term_no_order_is_certified(ran):
    """Break the physics: in the zero gauge the scheme is of first order without the B-term of Eq. (71)."""
    steps = [0.02 / 2**k for k in range(7)]
    away = {"t_end": 1.0, "omega_z": 3.0}
    sound = by_quantity(ran("spherical_pendulum", "gc_weak_form", steps, away, {**SHARP, "gauge": "zero"}))
    broken = by_quantity(
        ran("spherical_pendulum", "gc_weak_form", steps, away, {**SHARP, "gauge": "zero", "b_term": False})
    )
    for name in ("position", "velocity"):
        assert sound[name]["verdict"] == "certified", sound[name]["words"]
        assert broken[name]["verdict"] == "below declared", broken[name]["words"]
        assert broken[name]["order"] < 1.2


def test_a_free_sphere_is_exact_and_has_no_order(ran):
    """One step of any size is the motion: said, not fitted."""
    entry = by_quantity(ran("torque_free_body", "gc_weak_form", [1.0, 0.5, 0.25, 0.125], {"t_end": 4.0}))["orientation"]
    assert entry["verdict"] == "exact"
    assert "no order to fit" in entry["words"]
    assert math.isnan(entry["order"])


def test_error_control_has_an_order_achieved_and_an_exponent(ran):
    """Runge-Kutta 5(4): fifth order in the mean step, and errors proportional to rtol."""
    runs = ran("heavy_top", "rk45_strong_form", [1e-5, 1e-6, 1e-7, 1e-8, 1e-9], {"t_end": 0.5}, control="rtol")
    entry = by_quantity(runs)["orientation"]
    assert entry["verdict"] == "measured"
    assert entry["against"] == "mean step"
    assert 4.5 < entry["order"] < 5.6
    assert 0.85 < entry["exponent"] < 1.15
    assert math.isnan(entry["declared"])


def test_runs_that_failed_or_cut_their_steps_are_not_fitted(ran):
    """Their error belongs to other steps than the one asked for."""
    runs = ran("spherical_pendulum", "gc_weak_form", [0.04 / 2**k for k in range(6)], {"t_end": 2.0}, SHARP)
    cut = [dataclasses.replace(runs[0], steps=runs[0].steps + 3), *runs[1:]]
    assert not by_quantity(cut)["position"]["used"][0]
    failed = [dataclasses.replace(runs[0], claimed="diverged"), *runs[1:]]
    entry = by_quantity(failed)["position"]
    assert len(entry["dt"]) == 5
    assert "1 of 6 runs did not finish" in entry["words"]
    assert certify(NOWHERE, runs[:3]) == []


def test_certificates_are_json(ran):
    """Numbers, texts and lists; NaN is left to the writer."""
    runs = ran("spherical_pendulum", "gc_weak_form", [0.04 / 2**k for k in range(6)], {"t_end": 2.0}, SHARP)
    assert json.loads(json.dumps(certify(NOWHERE, runs)))[0]["cells"] == [r.settings for r in runs]
