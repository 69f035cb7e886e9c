"""Velocities, forces and reactions that no truncation explains are no success, however near the motion is."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import energy, kinetic_energy
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.metrics.measure import measure
from mbsbench.harness.metrics.summary import columns
from mbsbench.harness.metrics.truncation import truncation
from mbsbench.harness.metrics.verdict import doubts
from mbsbench.harness.types import Law, StepControl

SOUND = ("rattle", "gc_weak_form", "generalized_alpha", "energy_momentum", "half_explicit", "al_index3")


@pytest.fixture(scope="module")
def top():
    """The exact motion, to 1e-9, at steps of 5e-4 s at most."""
    problem = make_problem("heavy_top", {"t_end": 1.0})
    run = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-10, max_step=5e-4))
    return problem, run


def verdict(problem, run) -> dict[Law, str]:
    m = measure(problem, run)
    reasons = doubts(problem, run, m, columns(problem, run, m))
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


@pytest.mark.parametrize("factor", [0.98, 1.02])
def test_velocities_two_per_cent_off_are_found(top, factor):
    """With exact poses, no step of a thousandth of a turn leaves that open."""
    problem, run = top
    assert "velocities" in verdict(problem, faster(run, factor))[Law.TRUNCATION]


def test_velocities_that_hide_an_energy_error_are_found(top):
    """A run of a top 9 % too heavy, its velocities rescaled so that T + V stays: poses do not follow them."""
    problem, _ = top
    system = dataclasses.replace(problem.system, gravity=1.09 * problem.system.gravity)
    heavy = dataclasses.replace(problem, system=system)
    run = make_solver("rkmk_dop853").solve(heavy, StepControl(rtol=1e-10, max_step=5e-4))
    E, T = energy(problem.system, run.states), kinetic_energy(problem.system, run.states)
    hidden = faster(run, np.sqrt(np.maximum(1.0 + (E[0] - E) / T, 0.0)))
    assert np.ptp(energy(problem.system, hidden.states)) < 1e-9 * E[0]
    assert Law.TRUNCATION in verdict(problem, hidden)
    assert "reactions" in verdict(problem, run)[Law.TRUNCATION]


@pytest.mark.parametrize("factor", [9.0, 0.9, -1.0])
def test_false_reactions_are_found(top, factor):
    """A^T lam is that of index 1 at the recorded poses and velocities, but for what a step changes."""
    problem, run = top
    assert "reactions" in verdict(problem, dataclasses.replace(run, reaction=factor * run.reaction))[Law.TRUNCATION]


@pytest.mark.parametrize("name", ["heavy_top", "slider_crank", "bricard", "driven_slider_crank", "simple_pendulum"])
@pytest.mark.parametrize("solver", SOUND)
def test_sound_solvers_are_far_from_the_limit(solver, name):
    """Methods of first and second order, redundant rows, drives, at the problem's step."""
    problem = make_problem(name, {"t_end": 1.0})
    made, control = make_solver(solver), StepControl(dt=problem.dt)
    if reason := made.refuses(problem, control):
        pytest.skip(reason)
    run = made.solve(problem, control)
    found = truncation(problem.system, run.t, run.states, run.reaction)
    assert found.velocities < 0.5 and found.accelerations < 0.7 and not found.reactions > 0.9, found
