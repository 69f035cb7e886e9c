"""Verdicts on runs: they follow the laws and the motion, not bodies that stand still nor the units."""

import dataclasses
import json

import numpy as np
import pytest

from mbsbench import RigidBody, States, api, assemble
from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.metrics.scales import measure_displacement
from mbsbench.harness.judge.metrics.summary import make_columns
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.types import Law, Problem, Status, Trajectory
from mbsbench.harness.results.words import format_accurate_times
from mbsbench.tests.comparing import assert_close, assert_each

from ...reference.mechanisms import beside_ballast, slider_crank
from .judged import claimed, judge

SOUND = ("gc_weak_form", {"dt": 1e-3})
LOOSE = ("ida_index3", {"rtol": 1e-3})
SIZES = ("length", "speed", "momentum", "energy")


def laws_and_sizes(problem: Problem, trajectory: Trajectory) -> tuple[list[Law], np.ndarray]:
    judged = judge(problem, trajectory)
    return judged.laws, np.array([getattr(judged.m.size, k) for k in SIZES])


@pytest.fixture(scope="module", params=[SOUND, LOOSE], ids=["sound", "loose"])
def run(request) -> api.Run:
    solver, steps = request.param
    return api.solve(slider_crank(), solver, **steps)


def test_the_recorded_limits_are_those_that_are_judged():
    """A pin pulled apart by a little less and a little more; none with axis rows, which are judged in metres."""
    problem = registry.make_problem("spherical_pendulum", {"t_end": 0.1})
    reference = problem.reference()
    t = np.linspace(0.0, problem.t_end, 21)
    exact = claimed(t, reference.states(t))
    m, c, *_ = judge(problem, exact)
    limit = c["phi_limit_m"]
    assert "phi_limit_m" not in make_columns(dataclasses.replace(problem, system=slider_crank().system), exact, m)
    for part, broken in ((0.9, False), (1.1, True)):
        s = exact.states
        away = np.where(np.arange(len(t)) == 5, part * limit, 0.0)[:, None, None] * [1.0, 0.0, 0.0]
        pulled = dataclasses.replace(exact, states=States(s.r + away, s.R, s.v, s.Omega))
        judged = judge(problem, pulled)
        assert (Law.CONSTRAINT in judged.laws) is broken
        assert judged.c["gap_share_max"] == pytest.approx(part, rel=1e-9)


def test_of_hinges_the_share_of_the_limit_is_recorded():
    """A crank pulled out of its hinge: 1 is where the verdict changes."""
    problem = slider_crank()
    exact = api.solve(problem, SOUND[0], **SOUND[1]).trajectory
    for size in (1e-4, 1e-2, 1.0):
        away = size * np.array([1.0, 0.0, 0.0]) * (np.arange(len(exact.t)) == 5)[:, None, None]
        pulled = dataclasses.replace(exact, states=dataclasses.replace(exact.states, r=exact.states.r + away))
        judged = judge(problem, pulled)
        assert (Law.CONSTRAINT in judged.laws) is (judged.c["gap_share_max"] > 1.0)


def test_a_long_rocker_hides_no_lost_energy():
    """Index 3 at rtol 1e-3 ends at the wrong rate of the crank, its energy gone astray; a sound solver is a success."""
    sound, loose = (api.solve(slider_crank(), solver, **steps) for solver, steps in (SOUND, LOOSE))
    exact = api.solve(slider_crank(), "rkmk_dop853", rtol=1e-9).trajectory.states.Omega[-1, 0, 2]
    ends = [r.trajectory.states.Omega[-1, 0, 2] for r in (sound, loose)]
    assert abs(ends[0] - exact) < 0.01 * abs(exact) < abs(ends[1] - exact)
    assert sound.status is Status.SUCCESS and loose.status is Status.WRONG
    assert loose.record.energy_drift_max_J > 0.5 * sound.record.energy_scale_J
    assert "energy" in {r["law"] for r in json.loads(loose.record.wrong_because)}


def test_a_longer_rocker_changes_no_scale():
    """From 20 m to 2 km the slider's path changes by its sagitta, 0.26^2 / 40 m = 2 mm of 0.26 m."""
    near, far = (api.solve(slider_crank(rocker=length), SOUND[0], **SOUND[1]) for length in (20.0, 2000.0))
    assert near.status is far.status is Status.SUCCESS
    for name in ("length_scale_m", "energy_scale_J", "speed_scale_m_per_s"):
        assert getattr(far.record, name) == pytest.approx(getattr(near.record, name), rel=0.01)


def test_dead_weight_changes_neither_scales_nor_verdict(run):
    """Ten tonnes welded to the ground 50 m away take no part; rounding of their m g y is 1e-9 J."""
    heavy, states = slider_crank(ballast=True), beside_ballast(run.trajectory.states)
    plain = laws_and_sizes(run.problem, run.trajectory)
    loaded = laws_and_sizes(heavy, dataclasses.replace(run.trajectory, states=states, reaction=None))
    assert loaded[0] == plain[0]
    assert_close(loaded[1], plain[1], rtol=1e-6)


def test_scales_have_units(run):
    """In centimetres, grams and milliseconds scales are the same quantities: L, L/T, M L/T and M L^2/T^2."""
    units = Presentation(unit_length=100.0, unit_mass=1000.0, unit_time=1000.0)
    t, s = run.trajectory.t * units.unit_time, run.trajectory.states
    seen = States(s.r * units.unit_length, s.R, s.v * units.speed, s.Omega / units.unit_time)
    other = dataclasses.replace(
        run.problem, system=units.system(run.problem.system), initial=seen[0], t_end=run.problem.t_end * units.unit_time
    )
    factors = np.array([100.0, units.speed, units.unit_mass * units.speed, units.unit_mass * units.speed**2])
    plain = laws_and_sizes(run.problem, run.trajectory)
    turned = laws_and_sizes(other, dataclasses.replace(run.trajectory, t=t, states=seen, reaction=None))
    if not plain[0]:  # |phi| adds metres and axis rows, so that where a run is cut may differ
        assert_close(turned[1], factors * plain[1], rtol=1e-9)
    assert bool(turned[0]) == bool(plain[0])


def test_a_run_that_blows_up_does_not_widen_its_own_limits(run):
    """A sound motion that flies apart half way is wrong, by the scales of its sound part."""
    s = run.trajectory.states
    out = 1.0 + np.maximum(np.linspace(-1.0, 1.0, len(s)), 0.0)[:, None, None] * 1e6
    blown = dataclasses.replace(run.trajectory, states=States(s.r * out, s.R, s.v * out, s.Omega))
    laws, sizes = laws_and_sizes(run.problem, blown)
    assert {Law.ENERGY, Law.CONSTRAINT} <= set(laws)
    assert_each(sizes, "<=", 1.05 * laws_and_sizes(run.problem, run.trajectory)[1])


def test_displacement_is_that_of_a_bodys_matter():
    """Against 200,000 points drawn from the matter of a bar of 1 x 2 x 3 m, moved and turned at will."""
    random = np.random.default_rng(1)
    sides = np.array([1.0, 2.0, 3.0])
    J = np.diag((np.sum(sides**2) - sides**2) / 12.0)
    system = assemble([RigidBody(1.0, J)])
    Q = np.linalg.qr(random.standard_normal((2, 3, 3)))[0]
    Q *= np.linalg.det(Q)[:, None, None]
    r = random.standard_normal((2, 1, 3))
    a, b = (States(r[k][None], Q[k][None, None], np.zeros((1, 1, 3)), np.zeros((1, 1, 3))) for k in range(2))
    x = (random.random((200_000, 3)) - 0.5) * sides
    points = [r[k] + x @ Q[k].T for k in range(2)]
    expected = np.sqrt(np.mean(np.sum((points[0] - points[1]) ** 2, axis=1)))
    assert measure_displacement(system, a, b)[0, 0] == pytest.approx(expected, rel=5e-3)  # 1/sqrt(200,000), twice


@pytest.mark.parametrize("t_end", [3.0, 20.0])
def test_the_chain_is_not_wrong_where_it_is_only_chaotic(t_end):
    """ODE-GC at the paper's step keeps all laws; it says until when it follows the exact motion."""
    run = api.solve("chain", "gc_weak_form", dt=1e-3, t_end=t_end)
    r = run.record
    assert run.status.lawful and not set(json.loads(r.wrong_because)) - {Law.MOTION}
    assert 0.5 < r.accurate_until_0p1pct_s < r.accurate_until_1pct_s < r.accurate_until_s < min(t_end, r.compared_to_s)
    assert all("at least" not in words for words in format_accurate_times(r))


def test_a_motion_followed_to_the_end_of_its_reference_is_accurate_at_least_until_then():
    """The chain's reference ends before 20 s: an exact motion beyond it cannot be said to be accurate for longer."""
    run = api.solve("chain", "rkmk_dop853", rtol=1e-10, t_end=8.0)
    r = run.record
    assert r.compared_to_s < 8.0 and r.accurate_until_s == r.compared_to_s
    assert format_accurate_times(r)[0].startswith("at least")


def test_a_turn_alone_makes_a_motion_inaccurate():
    """A body free of forces turns wrongly at a coarse step; C, at rest, has no error at all, and all laws hold."""
    run = api.solve(registry.make_problem("torque_free_body", {"inertia_factors": (1.0, 1.5, 2.0)}), SOUND[0], dt=0.1)
    r = run.record
    (reason,) = json.loads(r.wrong_because)
    assert run.status is Status.INACCURATE and reason["law"] == Law.MOTION and r.position_error_max_m < 1e-12
    assert reason["time_s"] == r.accurate_until_s and reason["value"] > reason["limit"]


def test_solve_exits_with_zero_for_an_inaccurate_run(tmp_path, capsys):
    """The top at five times its step keeps all laws and is late after 4 s."""
    out = str(tmp_path / "top.npz")
    assert main(["solve", "heavy_top", SOUND[0], "--set", "dt=0.005", "--out", out]) == 0
    said = capsys.readouterr().out
    assert "inaccurate, reactions off by 18.3 %: the motion error reaches" in " ".join(said.split())
    assert "accurate until" in said
    assert main(["solve", "four_bar_grid", SOUND[0], "--out", out]) == 1
    said = capsys.readouterr().out
    assert "refused" in said and "nan" not in said and "CPU" not in said
