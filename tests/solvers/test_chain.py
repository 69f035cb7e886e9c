"""The 15-link chain (Sect. 5.3): accuracy while it is predictable, energy for the whole 20 s, symmetry."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint_rate, energy
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import GROUND, MultibodySystem
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

FIRST_DIP = 0.45  # [s] before E is at its lowest and the pull in the joints peaks


@cache
def solved(solver: str, t_end: float, step: float, **parameters: float) -> Trajectory:
    """By fixed step for ODE-GC, by tolerance for the others."""
    s = make_solver(solver)
    control = StepControl(dt=step) if s.control == "dt" else StepControl(rtol=step)
    t = s.solve(chain(t_end, **parameters), control)
    assert t.status is Status.SUCCESS, t.message
    return t


@cache
def chain(t_end: float, **parameters: float) -> Problem:
    return make_problem("chain", {"t_end": t_end, **parameters})


def error_of_E(t: Trajectory, until: float) -> float:
    """Largest distance [m] of point E from the reference."""
    problem = chain(float(t.t[-1]))
    reference = problem.reference()
    assert reference is not None
    upto = t.t <= until + 1e-9
    ours, exact = problem.observe(t.states.at(upto)), problem.observe(reference.states(t.t[upto]))
    return float(np.max(np.hypot(ours["E_x"] - exact["E_x"], ours["E_y"] - exact["E_y"])))


def energy_error(t: Trajectory) -> np.ndarray:
    E = energy(chain(1.0).system, t.states)
    return E - E[0]


def test_E_follows_the_reference():
    """At dt = 1e-3 E stays within 5e-5 m to the first dip and 5e-3 m to 1 s; the reference is certified far below."""
    t = solved("gc_weak_form", 1.0, 1e-3)
    assert error_of_E(t, FIRST_DIP) < 5e-5
    assert error_of_E(t, 1.0) < 5e-3


def test_energy_peaks_and_recovers():
    """The peak of the pull at 0.48 s costs energy for an instant; a reversible step gives it back."""
    error = energy_error(solved("gc_weak_form", 1.0, 1e-3))
    assert np.max(np.abs(error)) < 1.2
    assert abs(error[-1]) < 0.03


def test_velocities_keep_to_the_joints():
    """Eq. (75) is solved to its tolerance at every step."""
    t = solved("gc_weak_form", 1.0, 1e-3)
    assert np.max(np.linalg.norm(constraint_rate(chain(1.0).system, t.states), axis=1)) < 1e-6


def test_error_falls_with_the_square_of_the_step():
    """Three halvings, before the dip; the last slope within 0.2 of 2."""
    errors = [error_of_E(solved("gc_weak_form", 0.4, dt), 0.4) for dt in (2e-3, 1e-3, 5e-4, 2.5e-4)]
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert abs(slopes[-1] - 2.0) < 0.2, slopes


def test_augmented_lagrangian_walks_the_same_steps():
    """With independent rows the proximal saddle has the plain one's solution: both stop at 1e-8 sqrt(J)."""
    plain, augmented = (solved(s, 0.4, 1e-3) for s in ("gc_weak_form", "gc_augmented_lagrangian"))
    assert np.max(np.abs(plain.states.r - augmented.states.r)) < 1e-7


@pytest.mark.parametrize("solver", ["rk45_strong_form", "ndf_index1", "ida_index1"])
def test_error_control_keeps_the_energy(solver):
    """At 1e-7, 2 s and the peak of the pull included."""
    assert np.max(np.abs(energy_error(solved(solver, 2.0, 1e-7)))) < 0.02


def test_order_of_the_bodies_does_not_matter():
    """Bodies and joints shuffled: the same motion, but for what the chain makes of rounding in 0.5 s."""
    problem, random = chain(0.5), np.random.default_rng(3)
    bodies, joints = random.permutation(problem.system.nb), random.permutation(problem.system.nj)
    shuffled = renumbered(problem, bodies, joints)
    t = make_solver("gc_weak_form").solve(shuffled, StepControl(dt=1e-3))
    assert np.max(np.abs(t.states.r - solved("gc_weak_form", 0.5, 1e-3).states.r[:, bodies])) < 1e-7


@pytest.mark.parametrize(("solver", "step"), [("gc_weak_form", 1e-3), ("ida_index1", 1e-8)])
def test_turned_chain_moves_the_turned_way(solver, step):
    """No axis of space is special; an error control may place its steps elsewhere, within its error."""
    turned, straight = solved(solver, 0.4, step, yaw=0.7), solved(solver, 0.4, step)
    home = chain(0.4, yaw=0.7).home(turned.states)
    if solver == "gc_weak_form":
        assert np.max(np.abs(home.r - straight.states.r)) < 1e-8
    assert np.max(np.abs(home.r[-1] - straight.states.r[-1])) < 1e-6


def test_planar_chain_stays_in_its_plane():
    """Aligned with OXY nothing pushes out of it: not by rounding either."""
    t = solved("gc_weak_form", 1.0, 1e-3)
    assert np.max(np.abs(t.states.r[:, :, 2])) == 0.0


def test_energy_has_no_secular_drift():
    """20 s: reversible steps let the energy error breathe, not grow: means of the quarters agree to 5e-3 J."""
    t = solved("gc_weak_form", 20.0, 1e-3)
    error = energy_error(t)
    assert np.max(np.abs(error)) < 1.2
    assert abs(error[-1]) < 0.03
    quarters = [float(np.mean(q)) for q in np.array_split(error[1:], 4)]
    assert np.ptp(quarters) < 5e-3, quarters
    assert np.max(np.linalg.norm(constraint_rate(chain(1.0).system, t.states), axis=1)) < 1e-6


def renumbered(problem: Problem, bodies: np.ndarray, joints: np.ndarray) -> Problem:
    """The same mechanism with body ``bodies[k]`` as number k, joint ``joints[k]`` likewise."""
    s, start = problem.system, problem.initial
    number = np.append(np.argsort(bodies), GROUND)
    below = ("joint_i", "joint_j", "joint_names")
    of_joint = {name: a[joints] for name, a in vars(s).items() if name.startswith("joint_") and name not in below}
    system: MultibodySystem = replace(
        s,
        mass=s.mass[bodies],
        inertia=s.inertia[bodies],
        joint_i=number[s.joint_i[joints]],
        joint_j=number[s.joint_j[joints]],
        body_names=tuple(s.body_names[b] for b in bodies),
        joint_names=tuple(s.joint_names[j] for j in joints),
        **of_joint,
    )
    initial = State(start.r[bodies], start.R[bodies], start.v[bodies], start.Omega[bodies])
    return replace(problem, system=system, initial=initial, reference_from=None, observables=())
