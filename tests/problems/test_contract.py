"""Every problem of the catalogue, as it stands, turned and perturbed: consistent start, lawful reference.

The laws are those of the full system in (r, R): nothing here knows angles, elliptic functions or linkages.
"""

import dataclasses

import numpy as np
import pytest

from mbsbench import Problem, Reference, constraint_jacobian, solve
from mbsbench.harness.catalogue.registry import make_problem, problems
from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.state import States, rotate_states
from mbsbench.tests.comparing import assert_close, assert_each, assert_same

TURN = {"yaw": 0.7, "rotation": (0.3, -0.2, 0.5)}
CASES = [(name, given) for name in problems() for given in ({}, TURN, {"perturb": 1e-3, "seed": 2})]
CASES += [
    ("simple_pendulum", {"angle": 60.0, "gyration": 0.1}),
    *(("simple_pendulum", {"support": "link", **turned}) for turned in ({}, TURN, {"perturb": 0.1})),
    ("n_four_bar", {"windows": 3, "speed": 2.0}),
    ("free_body", {"omega": (3.0, 0.5, -1.0)}),
    ("bricard", {"section": "thin"}),
    ("slider_crank", {"variant": "planar"}),
    ("andrews", {"beta": -0.0617138900142764496}),
    ("torque_free_body", {"inertia_factors": (1.0, 2.0, 2.5)}),
    ("torque_free_body", {"inertia_factors": (2.5, 2.0, 1.0), "omega": (0.3, -1.0, 2.0)}),
    ("spherical_pendulum", {"omega_z": 0.1}),
    ("spherical_pendulum", {"omega_z": 4.0, "omega_x": 30.0, "angle": -20.0}),
    ("heavy_top", {"phi_dot0": 3.0, "theta_dot0": -2.0, "theta0": 60.0}),
    ("heavy_top", {"gravity": -9.81}),
    ("chain", {"links": 9, "mass": 2.0, "length": 0.2}),
    ("chain", {"axial_inertia": 0.0}),
    ("four_bar_grid", {"rows": 3, "columns": 2, "release": "all_rows", "mass_spread": 0.3}),
]
OWN = [name for name in problems() if make_problem(name).reference_from is not None]
NAMES = [f"{name} {' '.join(given)}".strip() for name, given in CASES]

STEP = 2e-4  # [s] of differences: rounding/STEP and (rate STEP)^6 rate are both below 1e-10 at 50 rad/s
DIFFERENCE = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / 60.0


@pytest.fixture(scope="module", params=CASES, ids=NAMES)
def presented(request: pytest.FixtureRequest) -> Problem:
    return make_problem(*request.param)


@pytest.fixture(scope="module")
def known(presented: Problem) -> Reference:
    reference = presented.reference()
    if reference is None:
        pytest.skip("no reference of its own from this start")
    return reference


def around(p: Problem, reference: Reference) -> list[States]:
    """The motion at a few times, and three steps before and after each."""
    return [reference.states(times(p, reference)[5:36:10] + k * STEP) for k in range(-3, 4)]


def rate(name: str, near: list[States]) -> np.ndarray:
    """Sixth-order differences."""
    return sum(c * getattr(s, name) for c, s in zip(DIFFERENCE, near, strict=True)) / STEP


def times(p: Problem, reference: Reference) -> np.ndarray:
    return np.linspace(0.0, min(p.t_end, reference.horizon), 41)


def test_the_start_is_consistent(presented: Problem) -> None:
    """phi and phi_dot vanish to rounding, three digits below what a start is refused for."""
    start = States.one(presented.initial)
    assert np.max(np.abs(motion.constraint(presented.system, start)), initial=0.0) < 1e-12
    assert np.max(np.abs(motion.constraint_rate(presented.system, start)), initial=0.0) < 1e-12


@pytest.mark.sampled(2)
def test_the_reference_starts_where_the_problem_does(presented: Problem, known: Reference) -> None:
    """To the rounding of a turn back home, times the rate for velocities."""
    first = known.states(np.zeros(1))[0]
    rate = 1.0 + np.max(np.abs(presented.initial.Omega))
    for name in ("r", "R", "v", "Omega"):
        assert np.max(np.abs(getattr(first, name) - getattr(presented.initial, name))) < 1e-14 * rate


def test_velocities_are_the_derivative_of_poses(presented: Problem, known: Reference) -> None:
    near = around(presented, known)
    turn = 1.0 + np.max(np.abs(near[3].Omega))
    assert np.max(np.abs(rate("r", near) - near[3].v)) < 1e-10 * turn
    assert np.max(np.abs(rate("R", near) - near[3].R @ so3.hat(near[3].Omega))) < 1e-10 * turn


def test_the_reference_obeys_newton_and_euler(presented: Problem, known: Reference) -> None:
    """m a and J Omega_dot + Omega x J Omega less what is applied are the joints' forces: in the range of A^T."""
    system, near = presented.system, around(presented, known)
    v_dot, W_dot = rate("v", near), rate("Omega", near)
    for k in range(len(near[3])):
        here = near[3][k]
        force = system.mass[:, None] * v_dot[k]
        momentum = np.einsum("bij,bj->bi", system.inertia, here.Omega)
        torque = np.einsum("bij,bj->bi", system.inertia, W_dot[k]) + np.cross(here.Omega, momentum)
        wrench = (np.concatenate((force, torque), axis=1) - motion.applied_loads(system, States.one(here))[0]).ravel()
        A = constraint_jacobian(system, here).toarray()
        reaction = np.linalg.lstsq(A.T, wrench, rcond=1e-10)[0]
        assert np.max(np.abs(A.T @ reaction - wrench)) < 1e-8 * (1.0 + np.max(np.abs(wrench)))


def test_the_reference_keeps_joints_energy_and_invariants(presented: Problem, known: Reference) -> None:
    """To its stated error e: |phi| <= 2 e and, at the rates w of the motion, speeds wrong by w e."""
    t = times(presented, known)
    s = known.states(t)
    e, w = float(known.error(t[-1:])[0]), 1.0 + float(np.max(np.abs(s.Omega)))
    assert np.max(np.abs(motion.constraint(presented.system, s)), initial=0.0) < 2.0 * e + 1e-14
    assert np.max(so3.orthogonality_defect(s.R)) < 1e-14
    momentum = np.sum(presented.system.mass) * (1.0 + np.max(np.abs(s.v)))  # of all bodies: bounds what e can change
    weight = np.sum(presented.system.mass) * np.linalg.norm(presented.system.gravity)
    driven = not presented.system.is_conservative
    assert driven or np.ptp(motion.energy(presented.system, s)) < 10.0 * e * (w * momentum + weight)
    for kept in presented.invariants:
        assert np.ptp(kept.of(presented.home(s))) < 10.0 * e * w * (1.0 + momentum), kept.name


def test_the_stated_error_grows_from_rounding(presented: Problem, known: Reference) -> None:
    """A bound: positive, never falling, far below a millimetre at first, and good for a second at least."""
    assert known.horizon >= 1.0
    e = known.error(times(presented, known))
    assert 0.0 < e[0] < 1e-12
    assert_each(np.diff(e), ">=", 0.0)


@pytest.mark.sampled(2)
def test_observables_do_not_depend_on_the_frame(presented: Problem) -> None:
    """They are taken in the home frame: turning motion and frame together changes nothing but rounding."""
    random = np.random.default_rng(5)
    s = States.one(presented.initial)
    Q = so3.exp(random.standard_normal(3))
    turned = make_problem(
        presented.name, {**presented.parameters, "rotation": so3.log(Q @ presented.frame), "yaw": 0.0}
    )
    for name, value in presented.observe(s).items():
        there = turned.observe(rotate_states(s, Q))[name]
        assert value.shape == (1,)
        assert_close(there, value, rtol=1e-12, atol=1e-12, equal_nan=True, what=name)


@pytest.mark.parametrize("name", OWN)
def test_the_reference_turns_with_the_problem(name: str) -> None:
    """The turned problem's motion is the turned motion; the chain's rounding grows by a digit every 0.6 s."""
    here, there = make_problem(name), make_problem(name, TURN)
    ours, theirs = here.reference(), there.reference()
    assert ours is not None
    assert theirs is not None
    t = np.linspace(0.0, 1.0, 11)
    expected, got = rotate_states(ours.states(t), there.frame), theirs.states(t)
    assert np.max(np.abs(got.r - expected.r)) < np.max(ours.error(t) + theirs.error(t)) + 1e-13
    assert np.max(np.abs(got.R - expected.R)) < 1e-10


@pytest.mark.parametrize("name", OWN)
def test_a_reference_takes_times_in_any_order(name: str) -> None:
    """``states`` is a function of each time alone."""
    reference = make_problem(name).reference()
    assert reference is not None
    t = np.array([0.9, 0.0, 0.4, 0.4])
    s = reference.states(t)
    for k in range(len(t)):
        assert_same(reference.states(t[k : k + 1]).r[0], s.r[k])


def test_a_motion_begins_at_zero():
    """Solvers begin at t = 0, each of them: a start with another time is refused in words."""
    problem = make_problem("heavy_top", {"t_end": 0.1})
    later = dataclasses.replace(problem, initial=dataclasses.replace(problem.initial, t=0.05))
    with pytest.raises(ValueError, match=r"the start has t = 0.05 s, and every motion begins at t = 0"):
        solve(later, "rattle")
