"""Orders are found where they are known: in made-up ladders, and in ladders of solvers, broken ones among them."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mbsbench.harness.base.confined_paths import ConfinedPath
from mbsbench.harness.judge.order import fit_ladder, fit_scattered
from mbsbench.harness.judge.referee.certificates.orders import QUANTITIES, certify_orders, select_motion
from mbsbench.harness.results.judgements.files import ORDERS, format_judgement, read_judgement
from mbsbench.harness.results.store import create_folder
from mbsbench.harness.run.job import Job
from mbsbench.reports.pages.judged.orders import describe_order
from mbsbench.tests.factories import make_record, specify_run
from mbsbench.tests.factories import run_here as run

DT = 0.1 * 0.5 ** np.arange(10)
NOWHERE = Path()


def test_a_pure_power_is_found_to_rounding():
    """C dt^p: nothing left out, an interval of no width."""
    fit = fit_ladder(DT, 3.0 * DT**2)
    assert fit.kind == "power"
    assert all(fit.used)
    assert fit.order == pytest.approx(2.0, abs=1e-9)
    assert fit.high - fit.low < 1e-6


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_a_floor_is_detected_and_left_out(order):
    """C dt^p + F: points within a factor of F are not fitted, and F is told."""
    floor = 3.0 * DT[5] ** order
    fit = fit_ladder(DT, 3.0 * DT**order + floor * np.array([1.0, 1.02] * 5))
    assert fit.kind == "power"
    assert fit.order == pytest.approx(order, abs=0.1)
    assert not any(fit.used[6:])
    assert fit.floor == pytest.approx(floor, rel=0.5)


@pytest.mark.parametrize(
    ("error", "first", "last"),
    [
        (DT**2 + 1e-8 / np.sqrt(DT), True, False),  # errors of the steps' solution pile up like sqrt(1/dt)
        (3.0 * DT**2 * (1.0 + 20.0 * DT), False, True),  # the first slopes are 2.4 and 2.2
        (3.0 * DT**2 * (1.0 + 5.0 * DT) + 3e-8, False, False),  # all at once, as a real ladder has them
    ],
)
def test_steps_out_of_the_asymptotic_range_are_left_out(error, first, last):
    """Coarse ones and those at a floor, also one that grows with the number of steps."""
    fit = fit_ladder(DT, error)
    assert fit.order == pytest.approx(2.0, abs=0.1)
    assert (fit.used[0], fit.used[-1]) == (first, last)


def test_an_order_that_is_lost_at_small_steps_is_not_certified():
    """dt^2 + c dt is of first order, however long the second-order range looks."""
    fit = fit_ladder(DT, DT**2 + 2e-3 * DT)
    assert fit.kind != "power" or fit.order < 1.5


def following(*slopes):
    """Errors whose neighbours have these slopes."""
    return np.exp(np.concatenate(([0.0], np.cumsum(np.asarray(slopes) * -math.log(2.0)))))


@pytest.mark.parametrize("tail", [(1.1,), (0.1,), (1.1, 1.1), (1.5, 1.0, 0.9), (3.0,), (0.53, 0.54)])
def test_finest_slopes_that_no_floor_explains_are_not_left_out_in_silence(tail):
    """2, 2, 2, 2, 1.1: a floor that takes half of the last step would have bent the step before it too."""
    error = following(2.0, 2.0, 2.0, 2.0, *tail)
    fit = fit_ladder(DT[: len(error)], error)
    assert fit.kind == "lost"
    assert fit.finer_slopes == pytest.approx(tail)
    assert fit_ladder(DT[: len(error)], error, small=float(error[-1])).kind == "power"  # a tolerance may hold the last


@pytest.mark.parametrize("tail", [(1.1, 0.1), (1.1, -1.6), (1.6, 1.1, 0.2, 0.0)])
def test_finest_slopes_into_a_floor_that_is_seen_are_explained(tail):
    """From one left-out step to the finest nothing is gained: that level is the floor, and is told."""
    error = following(2.0, 2.0, 2.0, 2.0, *tail)
    fit = fit_ladder(DT[: len(error)], error)
    assert fit.kind == "power" and fit.order == pytest.approx(2.0)
    assert fit.floor == pytest.approx(float(np.exp(np.median(np.log(error[5:])))))


def made_up(column, errors, **columns):
    """A ladder of the spatial pendulum that declares order two, with these errors of one column."""
    return [
        make_record(
            t_end_s=4.0,
            problem="spherical_pendulum",
            solver="made_up",
            case=f"pendulum made_up dt={dt}",
            control="dt",
            dt_s=dt,
            steps=math.ceil(4.0 / dt - 1e-6),
            claimed="success",
            status="success",
            declared_order=2.0,
            settings_id=str(dt),
            length_scale_m=0.5,
            speed_scale_m_per_s=3.132,
            energy_scale_J=4.9,
            **{"reference_own_error_m": 1e-12, column: error, **columns},
        )
        for dt, error in zip(DT, errors, strict=False)
    ]


@pytest.mark.parametrize(
    ("order", "verdict"),
    [
        (1.5, "below declared"),
        (1.85, "below declared"),
        (1.95, "certified"),
        (2.0, "certified"),
        (2.09, "certified"),
        (2.15, "above declared"),
        (2.6, "above declared"),
        (3.0, "above declared"),
    ],
)
def test_a_certificate_has_two_sides(order, verdict):
    """Exact powers: within 0.1 of two is certified; what is higher is another order, said apart."""
    entry = by_quantity(made_up("position_error_max_m", 0.1 * DT**order))["position"]
    assert entry.verdict == verdict
    assert f"order {order:.2f}" in describe_order(entry) and "declared 2" in describe_order(entry)


@pytest.mark.parametrize(("order", "wrong"), [(2.0, "above declared"), (2.0, "below declared"), (2.3, "certified")])
def test_noise_does_not_change_sides(order, wrong):
    """2 % of noise, 100 ladders: orders 2 and 2.3 are never taken for each other."""
    random = np.random.default_rng(3)
    noise = np.exp(0.02 * random.standard_normal((100, 10)))
    found = [by_quantity(made_up("position_error_max_m", 0.1 * DT**order * n))["position"] for n in noise]
    assert wrong not in {e.verdict for e in found}


def test_words_say_why_finest_slopes_are_left_out():
    """At a floor, with its level; or for no reason that is seen, and then the order is not certified."""
    lost = by_quantity(made_up("position_error_max_m", 0.1 * following(2.0, 2.0, 2.0, 2.0, 1.1)))["position"]
    assert lost.verdict == "undecided"
    assert "the finest slope 1.10 does not follow it, and no floor is seen" in describe_order(lost)
    floored = by_quantity(made_up("position_error_max_m", 0.1 * following(2.0, 2.0, 2.0, 2.0, 1.1, 0.1)))["position"]
    assert floored.verdict == "certified"
    assert "finest slopes 1.10, 0.10 left out: at the floor of 1.8e-04 m" in describe_order(floored)


def test_what_steps_leave_unsolved_is_a_floor_and_nothing_above_it():
    """Tolerance [sqrt(J)] x steps / sqrt(energy) x length: 1e-8 over 1280 steps of the pendulum is 2.9e-6 m."""
    shape = following(2.0, 2.0, 2.0, 2.0, 1.1)
    for last, verdict in ((2.8e-6, "certified"), (3.0e-6, "undecided")):
        errors = last * shape / shape[-1]
        runs = [dataclasses.replace(r, solver="gc_weak_form") for r in made_up("position_error_max_m", errors)]
        assert by_quantity(runs)["position"].verdict == verdict
        sharp = [dataclasses.replace(r, solver_options='{"tolerance": 1e-12}') for r in runs]
        assert by_quantity(sharp)["position"].verdict == "undecided"


def test_velocities_have_scales_and_own_errors_of_their_unit():
    """[m] becomes [m/s] by speed / length of the motion, 6.264 1/s here, and nothing else does."""
    (r,) = made_up("velocity_error_max_m_per_s", [1.0])
    speed, length = 3.132, 0.5
    q = {k.name: k for k in QUANTITIES}
    assert q["velocity"].scale(r) == pytest.approx(speed)
    assert q["|phi_dot|"].scale(r) == pytest.approx(speed)
    assert q["angular velocity"].scale(r) == pytest.approx(speed / length)
    for rate, base in (("velocity", "position"), ("angular velocity", "orientation")):
        assert q[rate].find_resolution(r) == pytest.approx(q[base].find_resolution(r) * speed / length)


def test_velocity_errors_the_reference_cannot_resolve_are_left_out():
    """Own error 1e-6 m: velocities below 3 x 6.26e-6 m/s are not told apart, though above 3e-6."""
    errors = 1e-2 * DT**2 / DT[0] ** 2
    entry = by_quantity(made_up("velocity_error_max_m_per_s", errors, reference_own_error_m=1e-6))["velocity"]
    told = [e > 3.0 * 1e-6 * 6.264 for e in errors]
    assert entry.used == tuple(told) and sum(told) == 5
    assert sum(e > 3e-6 for e in errors) == 6


def test_records_without_a_scale_of_velocities_have_no_order_in_velocity():
    """Positions as ever; of velocities it is said why not."""
    runs = made_up("position_error_max_m", 0.1 * DT**2, velocity_error_max_m_per_s=1.0)
    runs = [dataclasses.replace(r, speed_scale_m_per_s=math.nan) for r in runs]
    found = by_quantity(runs)
    assert found["position"].verdict == "certified"
    assert found["velocity"].verdict == "undecided" and "no scale" in describe_order(found["velocity"])


def test_errors_that_do_not_depend_on_the_step_have_no_order():
    """Nothing is fitted to a constant."""
    assert fit_ladder(DT, np.full(10, 1e-12)).kind == "flat"
    assert math.isnan(fit_ladder(DT, np.full(10, 1e-12)).order)


def test_jitter_widens_the_interval_and_it_holds_the_order():
    """2 % of noise, as from a maximum over few steps: 95 of 100 intervals and more hold the truth.

    It bends the finest slopes by a tenth; of 200 second orders hardly one is said to be lost.
    """
    random = np.random.default_rng(4)
    fits = [fit_ladder(DT, DT**2 * np.exp(0.02 * random.standard_normal(10))) for _ in range(200)]
    assert np.mean([fit.kind == "power" and fit.low <= 2.0 <= fit.high for fit in fits]) > 0.93
    assert [fit.kind for fit in fits].count("power") >= 198


def test_scattered_errors_have_the_median_of_slopes():
    """Error control: half a decade of scatter about rtol^0.8, and a floor of two runs."""
    random = np.random.default_rng(1)
    rtol = 10.0 ** -np.arange(3.0, 12.0)
    error = rtol**0.8 * 10.0 ** (0.2 * random.standard_normal(9))
    error[-2:] = error[-3]
    fit = fit_scattered(rtol, error)
    assert fit.low <= 0.8 <= fit.high
    assert fit.order == pytest.approx(0.8, abs=0.1)
    assert not any(fit.used[-2:])
    assert fit_scattered(rtol[:3], error[:3]).kind == "none"


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Records of runs, each run once."""
    folder = create_folder(tmp_path_factory.mktemp("ladders"))
    for part in ("series", "stderr"):
        (folder / part).mkdir(exist_ok=True)
    known = {}

    def of(problem, solver, steps, parameters=None, options=None, control="dt"):
        out = []
        for step in steps:
            spec = specify_run(problem, solver, parameters, options, **{control: step})
            if spec.settings_id not in known:
                known[spec.settings_id] = run(Job(spec, folder))
            out.append(known[spec.settings_id])
        return out

    return of


def by_quantity(records):
    return {e.quantity: e for e in certify_orders(NOWHERE, records)}


SHARP = {"tolerance": 1e-12}


@pytest.mark.parametrize(
    ("problem", "parameters", "dt"),
    [
        ("spherical_pendulum", {"t_end": 2.0}, 0.04),
        ("spherical_pendulum", {"t_end": 2.0, "omega_z": 0.1}, 0.04),
        ("heavy_top", {"t_end": 0.5}, 0.004),
        pytest.param("chain", {"t_end": 0.4}, 0.008, marks=pytest.mark.slow),
    ],
)
def test_ode_gc_is_certified_of_order_two(ran, problem, parameters, dt):
    """q, v, energy, |phi| and the reaction, within 0.1; |phi_dot| is held by the tolerance at every step."""
    found = by_quantity(ran(problem, "gc_weak_form", [dt / 2**k for k in range(6)], parameters, SHARP))
    for name in ("position", "orientation", "velocity", "angular velocity", "energy", "|phi|", "reaction"):
        assert found[name].verdict == "certified", describe_order(found[name])
        assert abs(found[name].order - 2.0) < 0.1, name
    assert found["|phi_dot|"].verdict in ("floor", "exact")


def test_without_the_b_term_no_order_is_certified(ran):
    """Break the physics: in the zero gauge the scheme is of first order without the B-term of Eq. (71)."""
    steps = [0.02 / 2**k for k in range(7)]
    away = {"t_end": 1.0, "omega_z": 3.0}
    sound = by_quantity(ran("spherical_pendulum", "gc_weak_form", steps, away, {**SHARP, "gauge": "zero"}))
    broken = by_quantity(
        ran("spherical_pendulum", "gc_weak_form", steps, away, {**SHARP, "gauge": "zero", "b_term": False})
    )
    for name in ("position", "velocity"):
        assert sound[name].verdict == "certified", describe_order(sound[name])
        assert broken[name].verdict == "below declared", describe_order(broken[name])
        assert broken[name].order < 1.2


def test_a_free_sphere_is_exact_and_has_no_order(ran):
    """One step of any size is the motion: said, not fitted."""
    entry = by_quantity(ran("torque_free_body", "gc_weak_form", [1.0, 0.5, 0.25, 0.125], {"t_end": 4.0}))["orientation"]
    assert entry.verdict == "exact"
    assert "no order to fit" in describe_order(entry)
    assert math.isnan(entry.order)


def test_error_control_has_an_order_achieved_and_an_exponent(ran):
    """Runge-Kutta 5(4): fifth order in the mean step, and errors proportional to rtol."""
    runs = ran("heavy_top", "rk45_strong_form", [1e-5, 1e-6, 1e-7, 1e-8, 1e-9], {"t_end": 0.5}, control="rtol")
    entry = by_quantity(runs)["orientation"]
    assert entry.verdict == "measured"
    assert entry.against == "mean step"
    assert 4.5 < entry.order < 5.6
    assert 0.85 < entry.exponent < 1.15
    assert math.isnan(entry.declared)


def test_runs_that_failed_or_cut_their_steps_are_not_fitted(ran):
    """Their error belongs to other steps than the one asked for."""
    runs = ran("spherical_pendulum", "gc_weak_form", [0.04 / 2**k for k in range(6)], {"t_end": 2.0}, SHARP)
    cut = [dataclasses.replace(runs[0], steps=runs[0].steps + 3), *runs[1:]]
    assert not by_quantity(cut)["position"].used[0]
    failed = [dataclasses.replace(runs[0], claimed="diverged"), *runs[1:]]
    entry = by_quantity(failed)["position"]
    assert len(entry.dt) == 5
    assert "1 of 6 runs did not finish" in describe_order(entry)
    assert certify_orders(NOWHERE, runs[:3]) == ()


def test_certificates_survive_their_file(ran, tmp_path):
    """Written and read back they are the same, numbers that do not exist among them."""
    runs = ran("spherical_pendulum", "gc_weak_form", [0.04 / 2**k for k in range(6)], {"t_end": 2.0}, SHARP)
    found = certify_orders(NOWHERE, runs)
    (tmp_path / "certificates.json").write_text(format_judgement(found))
    assert repr(read_judgement(ORDERS, ConfinedPath(tmp_path))) == repr(found)
    assert found[0].settings_ids == tuple(r.settings_id for r in runs)


def test_a_ladder_that_is_refused_or_fails_says_why():
    """One certificate with the solver's own words, and no order; fewer than four runs are no ladder."""
    runs = made_up("position_error_max_m", 0.1 * DT**2)[:4]
    no = [dataclasses.replace(r, claimed="refused", status="refused", message="no springs") for r in runs]
    (refused,) = certify_orders(NOWHERE, no)
    assert (refused.verdict, describe_order(refused)) == ("refused", "refused: no springs")
    stop = [dataclasses.replace(r, claimed="diverged", status="diverged", message="at 0.1 s") for r in runs[:2]]
    (failed,) = certify_orders(NOWHERE, [*stop, *runs[2:]])
    assert failed.verdict == "not measured" and math.isnan(failed.order)
    assert describe_order(failed) == "diverged: at 0.1 s; 2 of 4 runs did not finish"
    assert certify_orders(NOWHERE, no[:3]) == ()


def test_the_order_of_a_motion_is_that_of_what_moves_with_the_step():
    """A free body's C falls exactly under any step: its orientations have the order."""
    runs = made_up("orientation_error_max_rad", 0.1 * DT**2, position_error_max_m=1e-16)
    (found,) = select_motion(certify_orders(NOWHERE, runs))
    assert (found.quantity, found.verdict) == ("orientation", "certified")
    (both,) = select_motion(
        certify_orders(NOWHERE, made_up("position_error_max_m", 0.1 * DT**2, orientation_error_max_rad=0.0))
    )
    assert both.quantity == "position"


def test_the_order_of_a_motion_is_the_worse_of_its_two():
    """Second order in positions hides no first order in orientations, nor the other way round; a floor hides none."""
    good, bad, flat = 0.1 * DT**2, 0.1 * DT, 1e-11 + 0.0 * DT
    for r, R, worse in (
        (good, bad, "orientation"),
        (bad, good, "position"),
        (good, good, "position"),
        (flat, good, "orientation"),
        (good, flat, "position"),
    ):
        runs = [
            dataclasses.replace(run, orientation_error_max_rad=e)
            for run, e in zip(made_up("position_error_max_m", r), R, strict=True)
        ]
        (found,) = select_motion(certify_orders(NOWHERE, runs))
        assert found.quantity == worse and found.verdict == ("below declared" if bad is r or bad is R else "certified")


def test_a_ladder_without_a_reference_keeps_its_row_and_its_reason():
    """Its runs succeed and have an energy error, but none of positions: not measured, for want of a reference."""
    none = {"position_error_max_m": math.nan, "orientation_error_max_rad": math.nan}
    runs = [dataclasses.replace(r, **none) for r in made_up("energy_drift_max_J", 0.1 * DT**2)][:4]
    found = certify_orders(NOWHERE, runs)
    assert by_quantity(runs)["energy"].verdict == "certified"
    (row,) = select_motion(found)
    assert (row.quantity, row.verdict) == ("position", "not measured")
    assert describe_order(row) == "no error to measure: no reference"
    silent = [dataclasses.replace(r, energy_drift_max_J=math.nan) for r in runs]
    (alone,) = certify_orders(NOWHERE, silent)
    assert describe_order(alone) == "no error to measure: no reference" and not alone.status
    crashed = dataclasses.replace(silent[0], claimed="crashed", status="crashed", message="at 0 s")
    (mixed,) = select_motion(certify_orders(NOWHERE, [crashed, *silent[1:]]))
    expected = "crashed: at 0 s; 1 of 4 runs did not finish; 3 of 4 runs have no error to measure"
    assert describe_order(mixed) == expected
