"""What a series keeps suffices to compute every reported maximum anew, with nothing but its own arrays."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.judge.metrics.scales import measure_displacement, measure_speeds
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.results import store
from mbsbench.tests.comparing import assert_same
from mbsbench.tests.factories import specify_run, store_run

RUNS = {  # a slow order, a fast one, mechanisms beside each other, redundant rows
    "top": ("heavy_top", {"t_end": 0.5}, "gc_weak_form", {"dt": 0.002}),
    "pendulum": ("spherical_pendulum", {"omega_z": 0.1}, "gc_weak_form", {"dt": 0.02}),
    "grid": ("four_bar_grid", {"t_end": 0.5}, "rattle", {"dt": 0.01}),
    "free": ("torque_free_body", {"t_end": 20.0}, "lie_variational", {"dt": 0.01}),
    "chain": ("chain", {"t_end": 2.0}, "rkmk_dopri5", {"rtol": 1e-5}),
}


def run_stored(folder, problem, parameters, solver, control, *, lossless=False):
    record = store_run(folder, specify_run(problem, solver, parameters, **control), lossless=lossless)
    assert record.status == "success", record.message or record.wrong_because
    return make_problem(problem, parameters), record, store.read_run_series(folder, record)


def states(series, kind):
    return States(*(series[f"{kind}_{name}"] for name in ("r", "R", "v", "Omega")), series[f"{kind}_t"])


@pytest.mark.parametrize("name", RUNS)
def test_every_reported_maximum_is_that_of_the_kept_states(tmp_path, name):
    """A maximum over all steps is taken at a step that is kept; no kept step exceeds it."""
    problem, record, series = run_stored(tmp_path, *RUNS[name])
    s, exact, system = states(series, "state"), states(series, "sample"), problem.system
    E = energy(system, s)
    scale = np.max(np.abs(E)) + record.energy_scale_J
    assert np.max(np.abs(E - E[0])) == pytest.approx(record.energy_drift_max_J, abs=1e-14 * scale)
    phi, phi_dot = (np.linalg.norm(f(system, s), axis=1) for f in (constraint, constraint_rate))
    assert np.max(phi) == pytest.approx(record.phi_max, abs=1e-14)
    assert np.max(phi_dot) == pytest.approx(record.phi_dot_max, abs=1e-13)
    assert np.max(so3.orthogonality_defect(s.R)) == pytest.approx(record.orthogonality_max, abs=1e-15)

    known, at = np.nonzero(series["state_t"][:, None] == series["sample_t"])
    here, there = s.at(known), exact.at(at)
    within = here.times <= record.judged_to_s
    position = np.max(np.linalg.norm(here.r - there.r, axis=2), axis=1)
    turned = np.max(so3.angle_between(here.R, there.R), axis=1)
    motion = np.max(measure_displacement(system, here, there), axis=1)
    rate = States(there.r, there.R, here.v - there.v, here.Omega - there.Omega)
    rates = np.max(measure_speeds(system, rate), axis=1)
    for found, column in (
        (position, "position_error_judged_m"),
        (turned, "orientation_error_judged_rad"),
        (motion, "motion_error_judged_m"),
        (rates, "rate_error_judged_m_per_s"),
    ):
        assert np.max(found[within]) == pytest.approx(getattr(record, column), rel=1e-9, abs=1e-14), column
    assert np.max(position) == pytest.approx(record.position_error_max_m, rel=1e-9, abs=1e-14)
    own = series["sample_error"][at][within]
    assert np.max(own) == pytest.approx(record.reference_own_error_judged_m)


@pytest.mark.parametrize("name", ["top", "chain"])
def test_the_scales_are_those_of_the_kept_exact_motion(tmp_path, name):
    """It is kept where it reaches farthest, is fastest and exchanges most energy, as 2,001 of its instants tell."""
    problem, record, series = run_stored(tmp_path, *RUNS[name])
    exact, start = states(series, "sample"), States.one(problem.initial)
    T = 0.5 * measure_speeds(problem.system, exact) ** 2 @ problem.system.mass
    V = energy(problem.system, exact) - T
    for found, scale in (
        (np.max(measure_displacement(problem.system, exact, start)), record.length_scale_m),
        (np.max(measure_speeds(problem.system, exact)), record.speed_scale_m_per_s),
        (max(np.max(T), np.ptp(V)), record.energy_scale_J),
    ):
        assert (1.0 - 1e-12) * scale <= found <= 1.001 * scale


def test_a_lossless_series_keeps_every_step(tmp_path):
    _, record, series = run_stored(tmp_path, *RUNS["top"], lossless=True)
    assert len(series["state_t"]) == record.steps + 1 == len(series["t"])
    assert_same(series["state_t"], series["t"])
    assert_same(series["end_R"], series["state_R"][-1])


def test_a_series_names_when_maxima_occurred(tmp_path):
    _, record, series = run_stored(tmp_path, *RUNS["pendulum"])
    at = series.peaks["energy_drift_max_J"]
    assert abs(series["energy_error"][series["t"] == at]) == record.energy_drift_max_J
    assert series.peaks["judged_to_s"] == record.judged_to_s
    assert set(series.peaks.values()) <= {*series["state_t"], *series["sample_t"]}
    assert series.reference == "own"


def test_states_of_a_large_system_are_few(tmp_path):
    """A series of a grid of 65 bodies keeps few even states: its file must not grow by more than a third."""
    _, record, series = run_stored(tmp_path, *RUNS["grid"])
    states = sum(a.nbytes for k, a in series.arrays.items() if k.startswith(("state_", "sample_")))
    assert states < 40 * 288 * series["end_r"].shape[0] and record.steps > 40
