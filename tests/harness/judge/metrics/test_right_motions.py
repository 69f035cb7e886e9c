"""Motions that are right are not called wrong: redundant rows, stiff springs, long steps; those that are false are."""

import dataclasses

import numpy as np
import pytest

from mbsbench import RigidBody, SpringDamper, States, assemble
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.judge.metrics import truncation as law
from mbsbench.harness.judge.metrics.reactions import compute_exact_loads
from mbsbench.harness.judge.metrics.truncation import measure_truncation
from mbsbench.harness.mechanics import projection
from mbsbench.harness.mechanics.motion import applied_loads, constraint
from mbsbench.harness.mechanics.projection import disturb_poses, project_poses
from mbsbench.harness.mechanics.types import Law, StepControl
from mbsbench.harness.reference.computation import find_reference
from mbsbench.tests.comparing import assert_same

from .judged import judge

PRINTED = {
    "gauge": "accumulate",
    "lambda_bar": True,
    "loop": "nested",
    "newton": "exact",
    "penalty": 1000.0,
    "sigma0": "carried",
    "tolerance": 0.001,
}


@pytest.fixture(scope="module")
def bricard():
    """The paper's augmented Lagrangian on rows that are redundant on the constraints alone: right to 1e-4 of 1.9 m."""
    problem = make_problem("bricard", {"t_end": 2.0})
    return problem, make_solver("gc_augmented_lagrangian", PRINTED).solve(problem, StepControl(dt=0.01))


def test_rows_that_are_redundant_on_the_constraints_alone_accuse_nobody(bricard, monkeypatch):
    """A pose that is off by the tolerance has contradicting rows; projected it has none, and no reason is left."""
    found = judge(*bricard)
    assert not found.doubts and found.m.truncation.accelerations < 0.1 and found.m.truncation.reactions < 0.1
    monkeypatch.setattr(law, "project_poses", lambda system, s: s)
    monkeypatch.setattr(law, "project_poses_of_each", lambda system, motions: motions)
    monkeypatch.setattr(projection, "project_poses", lambda system, s: s)
    monkeypatch.setattr(law, "SURE", np.inf)
    assert {r.law for r in judge(*bricard).doubts} == {Law.TRUNCATION}


@pytest.mark.parametrize("how", ["gravity", "velocities", "reactions"])
def test_what_is_false_there_is_found(bricard, how):
    """Twice the gravity, velocities a tenth larger, reactions half as large again: of the same mechanism."""
    problem, run = bricard
    if how == "gravity":
        system = dataclasses.replace(problem.system, gravity=2.0 * problem.system.gravity)
        heavy = dataclasses.replace(problem, system=system)
        run = make_solver("gc_augmented_lagrangian", PRINTED).solve(heavy, StepControl(dt=0.01))
        t = measure_truncation(problem.system, run.t, run.states, run.reaction, *sizes(judge(*bricard)))
        assert t.accelerations > 1.0
    elif how == "velocities":
        s = run.states
        run = dataclasses.replace(run, states=States(s.r, s.R, 1.1 * s.v, 1.1 * s.Omega))
        assert measure_truncation(problem.system, run.t, run.states, None, *sizes(judge(*bricard))).velocities > 1.0
    else:
        t = measure_truncation(problem.system, run.t, run.states, 1.5 * run.reaction, *sizes(judge(*bricard)))
        assert t.reactions > 1.0


def sizes(found):
    return found.m.size.speed, found.m.size.length


@pytest.mark.parametrize("name", ["bricard", "chain", "four_bar_grid", "driven_slider_crank"])
def test_projected_poses_satisfy_their_constraints(name):
    """From 1e-4 m off to rounding; a pose that satisfies them stays, to the bit."""
    problem = make_problem(name, {"t_end": 0.1})
    run = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-9))
    s = project_poses(problem.system, run.states.at(slice(0, None, 5)).with_times(run.t[::5]))
    assert_same(project_poses(problem.system, s).r, s.r)
    random = np.random.default_rng(3)
    off = States(s.r + 1e-4 * random.standard_normal(s.r.shape), s.R, s.v, s.Omega, s.times)
    near = project_poses(problem.system, off)
    assert np.max(np.abs(constraint(problem.system, off))) > 1e-5
    assert np.max(np.abs(constraint(problem.system, near))) < 1e-11
    assert np.max(np.abs(near.r - s.r)) < 1e-2
    moved = disturb_poses(problem.system, s, np.full(len(s), 1e-6), seed=1)
    assert np.max(np.abs(constraint(problem.system, moved))) < 1e-11
    least = 1e-8 if name != "driven_slider_crank" else 0.0  # what is driven cannot be moved
    assert least <= np.max(np.abs(moved.r - s.r)) < 1e-4


def vibration(per_period, phase=0.0, periods=20.0, frequency=160.0):
    """Return exact states of a mass on a spring along OX as a function of time, and times, so many a period."""
    w, mass = 2.0 * np.pi * frequency, 2.0
    spring = SpringDamper(0, np.zeros(3), -1, np.array([-1.0, 0.0, 0.0]), w**2 * mass, 1.0)
    system = assemble([RigidBody(mass, np.eye(3))], [], (0.0, 0.0, 0.0), [spring])
    t = np.linspace(0.0, periods / frequency, round(per_period * periods) + 1)

    def states(t):
        r, v = np.zeros((2, len(t), 1, 3))
        r[:, 0, 0], v[:, 0, 0] = 0.1 * np.cos(w * t + phase), -0.1 * w * np.sin(w * t + phase)
        return States(r, np.broadcast_to(np.eye(3), (len(t), 1, 3, 3)), v, np.zeros_like(v), t)

    return system, t, states


SPEED, REACH = 0.1 * 2.0 * np.pi * 160.0, 0.2


@pytest.mark.parametrize("phase", [0.0, 0.4, 0.5 * np.pi])
@pytest.mark.parametrize("per_period", [0.7, 1.0, 1.3, 2.0, 2.1, 5.0, 31.0, 200.0])
def test_an_exact_motion_is_right_however_it_was_sampled(per_period, phase):
    """Rows farther apart than half a period tell nothing of velocities; the law says so, and accuses nobody."""
    system, t, exact = vibration(per_period, phase)
    found = measure_truncation(system, t, exact(t), None, SPEED, REACH, lambda rows: exact(t[rows]), len(t))
    assert np.nanmax(list(found.shares.values())) < 1.0


def test_velocities_of_a_vibration_that_is_resolved_are_judged():
    """At 200 rows a period, half of them or reversed; at 31 and twice as fast."""
    for per_period, factor in ((200.0, 0.5), (200.0, -1.0), (31.0, 2.0)):
        system, t, exact = vibration(per_period)
        s = exact(t)
        false = States(s.r, s.R, factor * s.v, s.Omega, t)
        found = measure_truncation(
            system, t, false, None, SPEED, REACH, lambda rows, t=t, exact=exact: exact(t[rows]), len(t)
        )
        assert found.velocities > 1.0


@pytest.mark.parametrize("rate", [1e2, 1e5])
def test_beside_a_stiff_spring_poses_are_not_known_well_enough_for_accelerations(rate):
    """A mass swings at 1 Hz; another, held by a spring of 1e5 rad/s, is 1e-11 m off: by 0.1 of 4 m/s2.

    That is told, and nobody is accused; of a soft spring the same distance is nothing.
    """
    w, mass = 2.0 * np.pi, 2.0
    springs = [
        SpringDamper(0, np.zeros(3), -1, np.array([-1.0, 0.0, 0.0]), w**2 * mass, 1.0),
        SpringDamper(1, np.zeros(3), -1, np.array([-1.0, 5.0, 0.0]), rate**2 * mass, 1.0),
    ]
    system = assemble([RigidBody(mass, np.eye(3))] * 2, [], (0.0, 0.0, 0.0), springs)
    t = np.linspace(0.0, 2.0, 2001)
    r, v = np.zeros((2, len(t), 2, 3))
    r[:, 0, 0], v[:, 0, 0] = 0.1 * np.cos(w * t), -0.1 * w * np.sin(w * t)
    r[:, 1] = 1e-11, 5.0, 0.0
    s = States(r, np.broadcast_to(np.eye(3), (len(t), 2, 3, 3)), v, np.zeros_like(v), t)
    found = measure_truncation(system, t, s, None, 0.1 * w, 0.2)
    if rate > 1e4:
        assert np.isnan(found.accelerations) and found.unsure == found.rows > 0
    else:
        assert found.accelerations < 0.1 and found.unsure == 0


@pytest.mark.parametrize("factor", [1.5, 3.0, 10.0, 100.0, 1e200, -1.0, 0.0])
@pytest.mark.parametrize("step", [2e-3, 2e-2])
def test_false_reactions_are_found_however_large(factor, step):
    """One row counts for no more than two loads can differ by, and hides no other."""
    problem = make_problem("simple_pendulum", {"t_end": 2.0})
    run = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-10, max_step=step))
    t = measure_truncation(problem.system, run.t, run.states, factor * run.reaction, *sizes(judge(problem, run)))
    assert t.reactions > 1.0


def test_reactions_that_are_no_numbers_hide_no_false_ones():
    """A fifth of the rows is NaN; the others are half as large again."""
    problem = make_problem("simple_pendulum", {"t_end": 2.0})
    run = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-10, max_step=2e-3))
    told = 1.5 * run.reaction
    told[::5] = np.nan
    assert measure_truncation(problem.system, run.t, run.states, told, *sizes(judge(problem, run))).reactions > 1.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["bricard", "simple_pendulum", "four_bar_grid", "andrews"])
def test_poses_aside_hide_no_false_reactions(name):
    """A pose as far aside as the gap may be is the run's fault: it widens no bound by more than 1e-3 of the length."""
    problem = make_problem(name, {"t_end": 0.02 if name == "andrews" else 0.5})
    run = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-8, max_step=problem.t_end / 200))
    speed, length = sizes(judge(problem, run))
    s, random = run.states, np.random.default_rng(2)
    r = s.r + 5e-3 * length * random.standard_normal(s.r.shape[1:]) / np.sqrt(3.0)
    aside = States(r, s.R, s.v, s.Omega, s.times, s.angles)
    assert measure_truncation(problem.system, run.t, aside, 1.5 * run.reaction, speed, length).reactions > 1.0


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_projection_knows_no_metre(bricard, size):
    """Poses off by 1e-8 of their size come to rounding, however large a mechanism is."""
    problem, run = bricard
    system = problem.system
    system = dataclasses.replace(
        system, joint_s_i=size * system.joint_s_i, joint_s_j=size * system.joint_s_j, inertia=size**2 * system.inertia
    )
    s = run.states.at(slice(0, 3)).with_times(run.t[:3])
    aside = size * (s.r + 1e-8 * np.random.default_rng(4).standard_normal(s.r.shape))
    gap = constraint(system, project_poses(system, States(aside, s.R, s.v, s.Omega, s.times)))
    metres = np.where(np.isin(np.arange(system.nrows), system.turning_rows), size, 1.0)
    assert np.max(np.abs(gap * metres)) < 1e-13 * size


@pytest.mark.parametrize("name", ["andrews", "heavy_top", "bricard", "driven_slider_crank"])
def test_exact_loads_have_two_routes(name):
    """Index 1 at the exact states, and what accelerations by finer and finer differences leave to the joints."""
    problem = make_problem(name, {"t_end": 0.02 if name == "andrews" else 0.5})
    reference, system = find_reference(problem), problem.system
    assert reference is not None
    at = np.linspace(0.3, 0.7, 5) * problem.t_end
    found = compute_exact_loads(system, reference.states(at))
    weights, errors = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0, []
    for h in (1e-3 * problem.t_end, 0.5e-3 * problem.t_end, 0.25e-3 * problem.t_end):
        rows = [reference.states(at + k * h) for k in range(-3, 4)]
        a = sum(w * x.v for w, x in zip(weights, rows, strict=True)) / h
        alpha = sum(w * x.Omega for w, x in zip(weights, rows, strict=True)) / h
        here = rows[3]
        force = system.mass[:, None] * a - applied_loads(system, here)[..., :3]
        spun = np.einsum("bij,tbj->tbi", system.inertia, here.Omega)
        moment = np.einsum("bij,tbj->tbi", system.inertia, alpha) + np.cross(here.Omega, spun)
        moment -= applied_loads(system, here)[..., 3:]
        sides = ((force, found[..., :3]), (moment, found[..., 3:]))
        errors.append(max(np.max(np.abs(x - y)) / max(np.max(np.abs(y)), 1e-3) for x, y in sides))
    assert min(errors) < 1e-6, errors
