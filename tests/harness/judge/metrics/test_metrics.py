"""Metrics against motions whose energy, errors and drifts are known in closed form."""

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench import Joint, RigidBody, SpringDamper, States, assemble
from mbsbench.harness.catalogue import registry
from mbsbench.harness.columns.numbers import compute_time_mean, find_largest, fit_trend
from mbsbench.harness.judge.metrics import measure, passes, rows, scales, thinning
from mbsbench.harness.judge.metrics.thinning import choose_frames, choose_rows
from mbsbench.harness.mechanics.types import ACCURATE, Law, Problem, State, StepControl
from mbsbench.tests.comparing import assert_close, assert_each, assert_same

from .judged import claimed, judge


def judge_fall(solver: str, options: dict | None = None, t_end: float = 2.0, dt: float = 0.01):
    """Problem, trajectory and judgement of a solver of the plugin."""
    problem = registry.make_problem("free_fall", {"t_end": t_end})
    trajectory = registry.make_solver(solver, options).solve(problem, StepControl(dt=dt))
    return problem, trajectory, judge(problem, trajectory)


def test_exact_motion_has_no_drift_and_no_error():
    """In free fall T + V is constant; rounding of 20 m against 10 m/s2 is below 1e-12."""
    c = judge_fall("exact")[2].c
    assert c["energy_drift_max_J"] < 1e-12 * 100.0
    assert c["position_error_max_m"] == 0.0
    assert c["orientation_error_max_rad"] < 1e-14
    assert c["steps"] == 200 and c["step_ratio"] == pytest.approx(1.0)
    assert c["evaluations"] == 7 and "newton_iterations" not in c


def test_known_error_is_measured():
    """A body lifted by a t^2 gains m g a t^2: energy error, its trend and the position error are known."""
    lift, weight = 0.02, 2.0 * 10.0
    m, c, *_ = judge_fall("exact", {"lift": lift})[2]
    assert c["energy_drift_max_J"] == pytest.approx(weight * lift, rel=1e-9)
    assert c["energy_drift_end_J"] == pytest.approx(weight * lift, rel=1e-9)
    # the least-squares slope of s^2 on [0, 1] is 1, here over 2 s; its means over the outer quarters 1/48 and 37/48
    assert c["energy_trend_W"] == pytest.approx(weight * lift / 2.0, rel=1e-3)
    assert c["energy_mean_first_quarter_J"] == pytest.approx(weight * lift / 48.0, rel=1e-2)
    assert c["energy_mean_last_quarter_J"] == pytest.approx(weight * lift * 37.0 / 48.0, rel=1e-3)
    # the reference ends at 1 s, half the time: a quarter of the lift
    assert c["position_error_max_m"] == pytest.approx(lift / 4.0, rel=1e-9)
    assert c["reference_horizon_s"] == 1.0 and c["reference_own_error_m"] == 1e-15
    np.testing.assert_array_equal(m.position_error[m.t > 1.0], np.nan)
    assert_each(m.position_error[m.t <= 1.0], "<=", np.inf)
    assert json.loads(c["observable_errors"])["height"]["max"] == pytest.approx(lift / 4.0, rel=1e-9)
    assert json.loads(c["invariant_drifts"])["P_X"] == {"max": 0.0, "end": 0.0, "start": 2.0, "unit": "kg m/s"}


def test_constraint_norms_of_a_known_gap():
    """A pendulum shifted by d has |phi| = d; moved at w, |phi_dot| = w."""
    system = assemble([RigidBody(1.0, np.eye(3))], [Joint(0, (-1.0, 0.0, 0.0))])
    start = State(np.array([[1.0, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    moved = States(
        np.array([[[1.0, 0.0, 0.0]], [[1.0, 0.3, 0.4]]]), np.stack([np.eye(3)[None]] * 2),
        np.array([[[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.2]]]), np.zeros((2, 1, 3)),
    )  # fmt: skip
    problem = Problem("p", system, start, 1.0, 0.1, "", "", planar_normal=np.array([0.0, 2.0, 0.0]))
    m = judge(problem, claimed(np.array([0.0, 1.0]), moved)).m
    assert m.phi_norm == pytest.approx([0.0, 0.5])
    assert m.phi_dot_norm == pytest.approx([0.0, 0.2])
    assert m.out_of_plane == pytest.approx([0.0, 0.3])


def test_damper_work_is_no_drift():
    """Along a damped line E falls by c v^2; the energy error is what is left, second order in the step."""
    system = assemble([RigidBody(1.0, np.eye(3))], springs=[SpringDamper(0, (0, 0, 0), damping=0.5)])
    t = np.linspace(0.0, 2.0, 2001)
    x, v = 1.0 + 2.0 * (1.0 - np.exp(-0.5 * t)), np.exp(-0.5 * t)  # m v' = -c v from v = 1
    r, rate = np.zeros((len(t), 1, 3)), np.zeros((len(t), 1, 3))
    r[:, 0, 0], rate[:, 0, 0] = x, v
    s = States(r, np.broadcast_to(np.eye(3), (len(t), 1, 3, 3)), rate, np.zeros_like(r))
    m = judge(Problem("p", system, s[0], 2.0, 0.1, "", ""), claimed(t, s)).m
    assert np.max(np.abs(m.energy - m.energy[0])) > 0.3
    assert find_largest(m.energy_error) < 1e-6
    assert find_largest(np.array([0.0, np.nan])) == np.inf  # max() of numpy comparisons would drop NaN


def test_trend_weights_time_not_steps():
    """A line stays a line however its steps are bunched."""
    t = np.concatenate((np.linspace(0.0, 1.0, 1000), np.linspace(1.1, 10.0, 20)))
    assert fit_trend(t, 3.0 * t - 1.0) == pytest.approx(3.0)
    assert compute_time_mean(t, 3.0 * t, 0.0, 10.0) == pytest.approx(15.0, rel=1e-6)


@pytest.mark.parametrize(("solver", "laws"), [("exact", []), ("stops_early", [Law.END]), ("not_numbers", [Law.FINITE])])
def test_claims_are_doubted_with_reason(solver, laws):
    """Only a success that nothing contradicts is one."""
    assert judge_fall(solver)[2].laws == laws


def test_a_motion_away_from_the_reference_is_inaccurate():
    """The lift grows as t^2: the error passes each part of the reach at a known time, within a step."""
    _, c, (reason,), *_ = judge_fall("exact", {"lift": 4.0})[2]
    assert reason.law is Law.MOTION and reason.value == pytest.approx(1.0) and reason.unit == "m"
    assert reason.time_s == pytest.approx(c["accurate_until_s"], abs=1e-12)
    for name, level in ACCURATE.items():
        assert c[name] == pytest.approx(math.sqrt(level * c["length_scale_m"]), abs=0.01)
    _, c, reasons, *_ = judge_fall("exact")[2]
    assert reasons == [] and c["accurate_until_s"] == c["compared_to_s"] == 1.0  # the horizon, of 2 s


def test_another_start_is_wrong():
    """A solver may not choose an easier start."""
    problem, trajectory, _ = judge_fall("exact")
    other = dataclasses.replace(problem, initial=dataclasses.replace(problem.initial, v=problem.initial.v * 1.01))
    assert judge(other, trajectory).laws == [Law.START]


def test_thinning_keeps_every_peak():
    """A spike of one step in a million must be seen in the plot."""
    a, b = np.zeros(1_000_000), np.zeros(1_000_000)
    a[123_456], b[765_432] = -5.0, np.nan
    kept = choose_rows(len(a), a, b, at_most=3000)
    assert len(kept) <= 3001 and {0, 123_456, 765_432, 999_999} <= set(kept)
    assert_same(choose_rows(10, a[:10]), np.arange(10))


def bar(t: np.ndarray, angle: np.ndarray) -> States:
    """A bar of 1 m about its end, at ``angle`` from OX in the plane OXY."""
    c, s, zero = np.cos(angle), np.sin(angle), 0.0 * t
    R = np.stack((c, -s, zero, s, c, zero, zero, zero, zero + 1.0), axis=-1).reshape(-1, 1, 3, 3)
    r = 0.5 * R[..., 0]
    return States(r, R, 0.0 * r, 0.0 * r)


def test_frames_are_spread_over_time():
    """A run that crawls at its end must not have all its frames there."""
    t = np.concatenate((np.linspace(0.0, 1.0, 5000), 1.0 + np.linspace(1e-9, 1e-6, 50_000)))
    frames = t[choose_frames(t, bar(t, 3.0 * t).at, 0.5, 100)]
    assert frames[0] == 0.0 and frames[-1] == t[-1]
    assert 95 <= len(frames) <= 102 and np.max(np.diff(frames)) < 0.011


def test_frames_of_many_bodies_are_chosen_in_less_memory(monkeypatch):
    """Blocks are as small as the bodies are many, and change no frame."""
    t = np.linspace(0.0, 1.0, 3000) ** 2
    states, asked = bar(t, 3.0 * t), list[int]()
    whole = choose_frames(t, states.at, 0.5, 100)
    monkeypatch.setattr(thinning, "BODIES", 64)

    def some(k: slice) -> States:
        out = states.at(k)
        asked.append(len(out))
        return out

    assert_same(choose_frames(t, some, 0.5, 100), whole)
    assert max(asked) == 66  # with a neighbour on either side


def test_a_whip_is_drawn_to_a_hundredth_of_the_body():
    """Three turns in a fiftieth of the time: chords between frames even in time leave the end by a tenth of the bar."""
    t = np.linspace(0.0, 10.0, 20_001)
    states = bar(t, 0.3 * np.sin(t) + 6.0 * np.pi / (1.0 + np.exp(-(t - 5.0) / 0.02)))

    def off(kept):
        end = 2.0 * states.r[:, 0]
        chords = np.stack([np.interp(t, t[kept], x) for x in end[kept].T], axis=-1)
        return np.max(np.linalg.norm(chords - end, axis=-1))

    kept = choose_frames(t, states.at, 0.5, 300)
    assert len(kept) <= 300 and off(kept) < 0.01
    assert off(np.linspace(0, 20_000, 300).astype(int)) > 0.1


def test_chaos_is_not_held_against_a_solver(monkeypatch):
    """Where the reference itself has lost its digits, being away from it is no verdict; before, it is."""

    def lost(self, t):
        return np.where(t > 0.25, 1e-6, 1e-15)

    problem, trajectory, _ = judge_fall("exact", {"lift": 4.0})
    monkeypatch.setattr(type(problem.reference()), "error", lost)
    c = judge(problem, trajectory).c
    assert c["judged_to_s"] == pytest.approx(0.25)
    assert c["position_error_judged_m"] == pytest.approx(4.0 / 64.0)
    assert c["position_error_max_m"] == pytest.approx(1.0)


ROUNDING = 1e-13  # of the largest value: sums of some hundred terms in another order
PLACES = {"random_mechanism": {"bodies": 7, "loops": 2}}


@pytest.fixture(params=[n for n in registry.problems() if registry.is_own_problem(n)])
def anywhere(request):
    """A system, and any poses and velocities of its bodies: joints are open, R is off a rotation by a millionth."""
    system = registry.make_problem(request.param, PLACES.get(request.param)).system
    rng, shape = np.random.default_rng(7), (40, system.nb, 3)
    R = Rotation.random(40 * system.nb, rng=rng).as_matrix().reshape(*shape, 3)
    r, v, Omega = (rng.normal(size=shape) for _ in range(3))
    return system, States(r, R + 1e-6 * rng.normal(size=R.shape), v, Omega, np.linspace(0.0, 1.0, 40))


def in_both(call, monkeypatch):
    """Its results in numpy and compiled."""
    found = []
    for many in (10**9, 0):
        monkeypatch.setattr(scales, "MANY", many)
        found.append(call())
    return found


def test_all_laws_and_sizes_are_those_of_numpy(anywhere, monkeypatch):
    """T + V, |phi| and its rate in in_both units, Eq. (81), R, displacement, speeds, the kinematic defect."""
    system, s = anywhere
    first = States(*(getattr(s, k)[:1] for k in ("r", "R", "v", "Omega")))
    h = np.linspace(0.01, 2.0, len(s) - 1)

    def step():
        end = rows._advance(h, s.at(slice(0, -1)), s.at(slice(1, None)))
        return end.r, end.R, end.v, end.Omega

    calls = {
        "laws": lambda: measure._compute_laws(system, s),
        "displacement": lambda: (
            scales.measure_displacement(system, s, first),
            scales.measure_displacement(system, s, s),
        ),
        "speeds": lambda: (scales.measure_speeds(system, s),),
        "moved": step,
    }
    for name, call in calls.items():
        for k, (plain, fast) in enumerate(zip(*in_both(call, monkeypatch), strict=True)):
            assert_close(fast, plain, rtol=0.0, atol=ROUNDING * np.max(np.abs(plain), initial=1.0), what=(name, k))


def test_what_is_no_number_stays_none(monkeypatch):
    """A motion that blew up is no small error: a NaN of one body is one of all."""
    p = registry.make_problem("chain")
    r = np.tile(p.initial.r, (5, 1, 1))
    R = np.tile(p.initial.R, (5, 1, 1, 1))
    R[2, -1, 0, 0] = np.nan
    s = States(r, R, np.zeros_like(r), np.zeros_like(r))
    for plain, fast in zip(*in_both(lambda: measure._compute_laws(p.system, s), monkeypatch), strict=True):
        assert_same(np.isnan(plain), np.isnan(fast))
    assert not passes.are_rotations(R) and passes.are_rotations(R[:2])
