"""Velocities, forces and reactions that no truncation explains are no success, however near the motion is."""

import dataclasses

import numpy as np
import pytest

from mbsbench import Joint, RigidBody, States, assemble, so3
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.judge.metrics import truncation
from mbsbench.harness.judge.metrics.truncation import measure_truncation
from mbsbench.harness.mechanics.motion import energy, kinetic_energy
from mbsbench.harness.mechanics.types import Law, StepControl

from .judged import judge

SOUND = ("rattle", "gc_weak_form", "generalized_alpha", "energy_momentum", "half_explicit", "al_index3")


@pytest.fixture(scope="module")
def top():
    """The exact motion, to 1e-9, at steps of 5e-4 s at most."""
    problem = make_problem("heavy_top", {"t_end": 1.0})
    run = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-10, max_step=5e-4))
    return problem, run


def verdict(problem, run) -> dict[Law, str]:
    reasons = judge(problem, run).doubts
    return {law: " ".join(r.name for r in reasons if r.law is law) for law in {r.law for r in reasons}}


def faster(run, factor):
    """The same poses with other velocities, of all bodies (nt,) from the second row on."""
    s, f = run.states, np.array(np.broadcast_to(factor, len(run.t)))[:, None, None]
    f[0] = 1.0
    return dataclasses.replace(run, states=States(s.r, s.R, f * s.v, f * s.Omega))


def test_the_exact_motion_is_a_success(top):
    """And its reactions may be those of the step before, as methods of first order give them."""
    problem, run = top
    late = np.concatenate((run.reaction[:1], run.reaction[:-1]))
    assert not verdict(problem, run) and not verdict(problem, dataclasses.replace(run, reaction=late))


def heavier(problem, factor, step):
    """The run of one whose gravity is false."""
    system = dataclasses.replace(problem.system, gravity=factor * problem.system.gravity)
    heavy = dataclasses.replace(problem, system=system)
    return make_solver("rkmk_dop853").solve(heavy, StepControl(rtol=1e-10, max_step=step))


def hide(problem, run):
    """Its velocities rescaled so that T + V stays."""
    E, T = energy(problem.system, run.states), kinetic_energy(problem.system, run.states)
    hidden = faster(run, np.sqrt(np.maximum(1.0 + (E[0] - E) / T, 0.0)))
    assert np.ptp(energy(problem.system, hidden.states)) < 1e-9 * E[0]
    return hidden


def test_velocities_that_hide_an_energy_error_are_found(top):
    """A run of a top 5 % too heavy, its velocities rescaled: reactions tell."""
    problem, _ = top
    run = heavier(problem, 1.05, 5e-4)
    assert Law.TRUNCATION in verdict(problem, hide(problem, run))
    assert "reactions" in verdict(problem, run)[Law.TRUNCATION]


def test_a_false_gravity_is_found_without_reactions():
    """A pendulum's accelerations, where no fast spin makes others."""
    problem = make_problem("simple_pendulum", {"t_end": 1.0})
    run = dataclasses.replace(heavier(problem, 1.05, 5e-4), reaction=None)
    assert "accelerations" in verdict(problem, run)[Law.TRUNCATION]


def test_an_inaccurate_run_stays_inaccurate(top):
    """A motion known to be off is reported as off."""
    problem, _ = top
    run = hide(problem, heavier(problem, 1.09, 5e-4))
    judged = judge(problem, run)
    assert judged.m.truncation.reactions > 1.0 and Law.TRUNCATION not in judged.laws
    assert [r.law for r in judged.inaccuracy] == [Law.MOTION]


@pytest.mark.parametrize("solver", ["energy_momentum", "lie_variational"])
def test_a_steady_spin_at_long_steps_is_explained(solver):
    """Of constant components in the body: its matter moves, and the phase is off by (h Omega)^2 / 12 a step."""
    problem = make_problem("torque_free_body", {"t_end": 10.0})
    run = make_solver(solver).solve(problem, StepControl(dt=0.1))
    turn = 0.1 * np.max(np.linalg.norm(run.states.Omega, axis=2))
    assert turn > 0.3
    found = judge(problem, run).m.truncation
    assert 1e-3 < found.velocities < turn


@pytest.mark.parametrize(
    ("what", "factor"), [("velocities", 0.98), ("velocities", 1.02), *(("reactions", x) for x in (9.0, 0.9, -1.0))]
)
def test_false_reactions_and_velocities_are_found(top, what, factor):
    """A^T lam is that of index 1 at the recorded poses and velocities; exact poses leave no 2 % of the rates open."""
    problem, run = top
    slower = faster(run, factor)
    false = slower if what == "velocities" else dataclasses.replace(run, reaction=factor * run.reaction)
    assert what in verdict(problem, false)[Law.TRUNCATION]


MECHANISMS = ("heavy_top", "slider_crank", "bricard", "driven_slider_crank", "simple_pendulum")
PAIRS = [  # two mechanisms for each solver, at least two solvers for each mechanism; all others are slow
    pytest.param(solver, name, marks=() if (j - 2 * i) % len(MECHANISMS) in (0, 1) else pytest.mark.slow)
    for i, solver in enumerate(SOUND)
    for j, name in enumerate(MECHANISMS)
]


@pytest.mark.parametrize(("solver", "name"), PAIRS)
def test_sound_solvers_are_far_from_the_limit(solver, name):
    """Methods of first and second order, redundant rows, drives, at the problem's step."""
    problem = make_problem(name, {"t_end": 1.0})
    made, control = make_solver(solver), StepControl(dt=problem.dt)
    if reason := made.refuses(problem, control):
        pytest.skip(reason)
    run = made.solve(problem, control)
    found = judge(problem, run).m.truncation
    assert found.velocities < 0.5 and found.accelerations < 0.7 and not found.reactions > 0.9, found


@pytest.mark.parametrize("factor", [1.0, 1.02, 1.5])
def test_the_rows_alone_bound_the_ratios_from_above(top, factor, monkeypatch):
    """What is not evaluated beside them changes no verdict: a ratio above the limit is that of whole bounds."""
    problem, run = top
    run = dataclasses.replace(run, reaction=factor * run.reaction)
    short = judge(problem, run).m.truncation
    monkeypatch.setattr(truncation, "CLEAR", 0.0)
    whole = judge(problem, run).m.truncation
    for name, share in whole.shares.items():
        assert share == short.shares[name] or share < short.shares[name] <= 0.5
    assert (short.rate, short.rows) == (whole.rate, whole.rows)


def test_a_body_at_rest_and_reactions_of_nothing_have_no_size_of_their_own():
    """Rounding of a body without acceleration, or of a joint without load, is measured by the motion beside it."""
    still, t = np.eye(3), np.linspace(0.0, 1.0, 201)
    two = assemble([RigidBody(1.0, still)] * 2)
    r = np.zeros((201, 2, 3))
    r[:, 0, 0], r[:, 1, 0] = 3.0 * t, 5e-10 * t**2
    v = np.gradient(r, t, axis=0, edge_order=2)
    s = States(r, np.broadcast_to(still, (201, 2, 3, 3)), v, np.zeros((201, 2, 3)), t)
    assert np.nanmax(list(measure_truncation(two, t, s, None, 3.0, 3.0).shares.values())) < 0.1
    wheel = assemble([RigidBody(1.0, still)], [Joint(0, np.zeros(3), -1, np.zeros(3), still[2], still[2])])
    spin = np.zeros((201, 1, 3))
    spin[..., 2] = 5.0
    R = np.stack([so3.exp(np.array([0.0, 0.0, 5.0 * x])) for x in t])[:, None]
    s = States(np.zeros((201, 1, 3)), R, np.zeros((201, 1, 3)), spin, t)
    assert measure_truncation(wheel, t, s, np.full((201, 5), 1e-18), 5.0, 1.0).reactions < 1e-6
