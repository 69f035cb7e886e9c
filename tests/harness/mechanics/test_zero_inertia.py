"""Slender rods and point masses: what joints do about an axis without inertia, and accelerations with the true M."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import mbsbench
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.consistency import perturbed
from mbsbench.harness.mechanics.dynamics import Rates, accelerations, equations
from mbsbench.harness.mechanics.joints import JointKind, MovingKind
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import (
    GROUND,
    Joint,
    Load,
    MultibodySystem,
    RigidBody,
    SpringDamper,
    TorsionSpring,
    assemble,
)
from mbsbench.harness.mechanics.time_functions import TimeFunction
from mbsbench.harness.mechanics.work import power, work
from mbsbench.harness.mechanics.zero_inertia import classified
from mbsbench.harness.types import Problem, Status, StepControl

MASS, ARM, G = 2.0, 0.5, 9.81
WEIGHT = (0.0, -G, 0.0)
POINT, ROD = RigidBody(MASS, np.zeros((3, 3)), "bob"), RigidBody(MASS, np.diag([0.0, 0.04, 0.04]), "rod")
O, FOOT, X, Z = (0.0, 0.0, 0.0), (-ARM, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
LINK = Joint(0, O, GROUND, O, kind=JointKind.DISTANCE, length=ARM)


def at_x(system: MultibodySystem, spin: tuple[float, float, float] = O) -> State:
    """One body with C at (ARM, 0, 0), at rest but for its spin."""
    return State(np.array([[ARM, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)), np.array([spin]))


def one(body: RigidBody, *joints: Joint, **parts: object) -> MultibodySystem:
    return assemble([body], joints, WEIGHT, **parts)


COUPLED = {  # rank of the inertia that is taken back
    "a point mass on a link": (one(POINT, LINK), 0),
    "a point mass on a spring": (one(POINT, springs=[SpringDamper(0, O, GROUND, (0.0, 1.0, 0.0), 50.0)]), 0),
    "a rod on a ball": (one(ROD, Joint(0, FOOT)), 0),
    "a rod in a plane": (one(ROD, Joint(0, FOOT, GROUND, O, Z, Z)), 0),
    "a rod that turns on its axis": (one(ROD, Joint(0, O, GROUND, (ARM, 0.0, 0.0), X, X)), 0),
    "a rod pulled along its axis": (one(ROD, Joint(0, FOOT), springs=[SpringDamper(0, O, GROUND, Z, 50.0)]), 0),
    "a point mass on an arm that a hinge holds": (one(POINT, Joint(0, FOOT, GROUND, O, Z, Z)), 1),
    "a point mass on an arm that a ball holds": (one(POINT, Joint(0, FOOT)), 2),
    "a rod askew on its hinge": (one(ROD, Joint(0, FOOT, GROUND, O, (1.0, 1.0, 0.0), (1.0, 1.0, 0.0))), 1),
}


@pytest.mark.parametrize("name", COUPLED)
def test_only_axes_that_joints_turn_with_other_inertia_are_coupled(name: str) -> None:
    """By hand: what is locked or decoupled may keep what it is lent, the rest must give it back."""
    system, rank = COUPLED[name]
    found = classified(system, at_x(system), 1.0)
    assert found.coupled is not None
    assert np.linalg.matrix_rank(found.coupled[0]) == rank
    assert np.all(np.linalg.eigvalsh(found.regular_inertia) > 0.0)
    assert np.allclose(found.coupled, found.lent @ np.linalg.pinv(found.lent) @ found.coupled)  # a part of it


UNDEFINED = {
    "spin of a point mass": (one(POINT, LINK), (0.0, 0.3, 0.0), r"'bob' .*\(0, 1, 0\).* start at 0 rad/s \(got 0.3\)"),
    "spin of a rod": (one(ROD, Joint(0, FOOT)), (0.3, 0.0, 0.0), r"'rod' .*\(1, 0, 0\).* start at 0 rad/s \(got 0.3\)"),
    "a spring beside the axis": (
        one(ROD, Joint(0, FOOT), springs=[SpringDamper(0, (0.0, 0.1, 0.0), GROUND, Z, 50.0)]), O,
        r"'rod' has no inertia about \(1, 0, 0\).* no motion is defined",
    ),
    "a torque that begins later": (
        one(POINT, LINK, loads=[Load(0, torque=Z, factor=TimeFunction(amplitude=1.0, frequency=2.0))]), O,
        "'bob' has no inertia about .* no motion is defined",
    ),
    "a point mass that turns about C with a wheel of none": (
        assemble([POINT, POINT], [LINK, Joint(1, O, 0, O, Z, Z)], WEIGHT, [SpringDamper(1, X, GROUND, Z, 50.0)]), O,
        "no motion is defined",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", UNDEFINED)
def test_what_defines_no_motion_is_refused_in_a_line(name: str) -> None:
    """The body, the axis in its frame, and what to do."""
    system, spin, says = UNDEFINED[name]
    r, v, Omega = (np.tile(a, (system.nb, 1)) for a in ((ARM, 0.0, 0.0), O, spin))
    start = State(r, np.tile(np.eye(3), (system.nb, 1, 1)), v, Omega)
    with pytest.raises(ValueError, match=says) as refused:
        Problem("none", system, start, 1.0, 1e-2, "", "")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("inertia", [(0.1, 0.0, 0.0), (0.0, 0.1, 0.2), (0.1, 0.1, -1e-9)])
def test_inertias_without_a_mass_distribution_are_refused(inertia: tuple[float, ...]) -> None:
    """Matter along a line has two equal ones, at a point it has none."""
    with pytest.raises(ValueError, match=r"no mass distribution|>= 0 kg m2"):
        assemble([RigidBody(1.0, np.diag(inertia))])


def slender_linkage(turn: np.ndarray) -> Problem:
    """A tree with all of them: a rod askew on its hinge, a universal joint, a rod, a ball, a point mass on an arm."""
    rods = [RigidBody(m, Q @ np.diag([0.0, 0.05, 0.05]) @ Q.T) for m, Q in ((1.0, so3.exp(turn)), (0.7, np.eye(3)))]
    end = RigidBody(0.4, np.zeros((3, 3)))
    joints = [
        Joint(0, (0.1, 0.3, 0.0), GROUND, (0.2, 0.0, 0.1), (1.0, 0.4, 0.2), (1.0, 0.4, 0.2)),
        Joint(1, (-0.3, 0.0, 0.0), 0, (-0.1, -0.3, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), kind=JointKind.UNIVERSAL),
        Joint(2, (0.0, 0.25, 0.0), 1, (0.3, 0.0, 0.0)),
    ]
    r = np.array([[0.1, -0.3, 0.1], [0.3, -0.6, 0.1], [0.6, -0.85, 0.1]])
    start = State(r, np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)), np.zeros((3, 3)))
    system = assemble([*rods, end], joints, (1.0, -9.0, 2.0))
    return Problem("linkage", system, perturbed(system, start, 0.3, 4), 1.0, 1e-3, "", "")


@pytest.mark.parametrize("name", ["linkage", "bricard"])
def test_accelerations_solve_the_true_equations(name: str) -> None:
    """M a - A^T reaction = f with the inertia that bodies have, and A a = -A_dot v."""
    p = slender_linkage(np.array([0.3, -0.5, 0.2]))
    if name == "bricard":
        p = make_problem("bricard", {"section": "thin", "axial_inertia": 0.0, "perturb": 0.1})
    assert np.any(p.system.coupled)
    s, e = p.initial, equations(p.system, p.initial)
    found = accelerations(p.system, s)
    a = np.concatenate((found.v_dot, found.Omega_dot), axis=1)
    balance = np.einsum("bij,bj->bi", e.M, a) - e.f - (found.reaction @ e.A).reshape(-1, 6)
    assert np.max(np.abs(balance)) < 1e-11 * np.max(np.abs(e.f))
    assert np.max(np.abs(e.A @ a.ravel() + e.A_dot_v)) < 1e-10 * np.max(np.abs(e.A_dot_v))


def test_one_that_no_problem_has_looked_at_has_the_same_accelerations() -> None:
    """All that is lent is taken back then."""
    p = make_problem("chain", {"axial_inertia": 0.0, "perturb": 0.01})
    bare = dataclasses.replace(p.system, coupled=None)
    known, anew = (accelerations(s, p.initial).Omega_dot for s in (p.system, bare))
    assert np.max(np.abs(known - anew)) < 1e-10 * np.max(np.abs(known))


@pytest.mark.parametrize("accelerations", [accelerations, mbsbench.accelerations], ids=["numpy", "public"])
def test_bare_axes_without_a_motion_are_found_out(accelerations: Callable[..., Rates]) -> None:
    """``accelerations`` of a system that no problem has looked at."""
    system, *_ = UNDEFINED["a spring beside the axis"]
    with pytest.raises(ValueError, match="M is singular"):
        accelerations(system, at_x(system))


@pytest.mark.parametrize(
    "how", [Presentation(mirror="Y"), Presentation(renumber=5), Presentation(unit_length=100.0, unit_mass=3.0)]
)
def test_presented_otherwise_the_same_is_taken_back(how: Presentation) -> None:
    """Classes are of the mechanism, not of its coordinates."""
    p = slender_linkage(np.array([0.3, -0.5, 0.2]))
    known = how.system(p.system)
    anew = classified(dataclasses.replace(known, coupled=None), how.state(p.system, p.initial), p.t_end)
    assert known.coupled is not None
    assert np.allclose(known.coupled, anew.coupled, rtol=1e-9, atol=1e-9 * np.max(known.coupled))


def test_the_drive_of_a_massless_arm_lifts_its_point_mass() -> None:
    """Rate 3 rad/s, rising by 4 rad/s2: torque m (L^2 w' + g L). No velocity but the drive's turns the arm."""
    drive = TimeFunction(polynomial=(0.0, 3.0, 2.0))
    hinge, rate = Joint(0, FOOT, GROUND, O, Z, Z), np.array([[0.0, 0.0, 3.0]])
    driven = Joint(0, O, GROUND, O, Z, Z, "drive", MovingKind.DRIVEN_ANGLE, X, X, motion=drive)
    start = State(np.array([[ARM, 0.0, 0.0]]), np.eye(3)[None], np.cross(rate, (ARM, 0.0, 0.0)), rate)
    p = Problem("crank", one(POINT, hinge, driven), start, 1.0, 1e-3, "", "")
    assert power(p.system, States.one(p.initial))[0] == pytest.approx(3.0 * MASS * (4.0 * ARM**2 + G * ARM))


WHEEL = RigidBody(1.0, np.eye(3), "wheel")
APART = np.array([[ARM, 0.0, 0.0], [2.0, 0.0, 0.0]])
SEEN_LATER = {  # (bodies, joints, gravity, start of C, parts): loads about n that are 0 at the start
    "a spring through C": ([POINT], [], WEIGHT, np.zeros((1, 3)),
                           {"springs": [SpringDamper(0, (0.1, 0, 0), GROUND, (1.0, 0, 0), 50.0)]}),
    "a damper, all at rest": ([POINT, WHEEL], [LINK], O, APART,
                              {"torsions": [TorsionSpring(0, X, 1, Z, X, damping=1.0)]}),
    "50 Hz": ([POINT], [LINK], WEIGHT, APART[:1],
              {"loads": [Load(0, torque=Z, factor=TimeFunction(amplitude=1.0, frequency=100.0 * np.pi))]}),
    "beside a great load": ([POINT, WHEEL], [LINK], WEIGHT, APART,
                            {"loads": [Load(0, torque=(0, 0, 1e-4)), Load(1, force=(1e7, 0, 0))]}),
}  # fmt: skip


@pytest.mark.parametrize("name", SEEN_LATER)
def test_a_load_about_an_axis_without_inertia_is_found_wherever_it_acts(name: str) -> None:
    """Lent inertia would be spun by it."""
    bodies, joints, gravity, r, parts = SEEN_LATER[name]
    none = np.zeros((len(r), 3))
    with pytest.raises(ValueError, match="body 'bob' has no inertia about"):
        classified(
            assemble(bodies, joints, gravity, **parts), State(r, np.eye(3)[None] + none[:, None], none, none), 1.0
        )


def test_a_problem_with_another_start_or_load_is_judged_anew() -> None:
    """What an axis may keep was found for another problem."""
    p = Problem("p", one(POINT, LINK), at_x(one(POINT, LINK)), 1.0, 1e-2, "", "")
    with pytest.raises(ValueError, match="must start at 0 rad/s"):
        dataclasses.replace(p, initial=at_x(p.system, (0.3, 0.0, 0.0)))
    with pytest.raises(ValueError, match="its joints lend it none"):
        dataclasses.replace(p, system=one(POINT, LINK, loads=[Load(0, torque=Z)]))


def test_units_leave_what_is_solved_for() -> None:
    """A weld without arms: the scale of what is lent is that of the bodies."""
    system = assemble(
        [WHEEL, POINT], [Joint(0, O), Joint(1, O, 0, O, X, X, kind=JointKind.FIXED, across_i=Z, across_j=Z)]
    )
    start = State(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.zeros((2, 3)))
    for size in (1.0, 100.0, 0.01):
        seen = Presentation(unit_length=size).system(classified(system, start, 1.0))
        assert np.max(np.abs(seen.solved_inertia[1])) < 1e-12 * size**2


def test_loads_that_are_no_numbers_are_refused() -> None:
    """A spring of no length has no direction."""
    system = one(POINT, springs=[SpringDamper(0, O, GROUND, (ARM, 0.0, 0.0), 50.0)])
    with pytest.raises(ValueError, match="the loads on body 'bob' must be finite"):
        classified(system, at_x(system), 1.0)


def polar_arm() -> Problem:
    """A point mass drawn in along a hinged carrier of 1e-3 kg m2: what it is lent exceeds what the joints give it."""
    carrier = RigidBody(1.0, np.diag([1e-3] * 3), "carrier")
    y = (0.0, 1.0, 0.0)
    slide = Joint(1, O, 0, O, X, X, "slide", JointKind.PRISMATIC, y, y)
    drive = Joint(1, O, 0, O, None, X, "drive", MovingKind.DRIVEN_POSITION, motion=TimeFunction((1.0, -0.95)))
    system = assemble([carrier, POINT], [Joint(0, O, GROUND, O, Z, Z, "hinge"), slide, drive])
    spin, poses = np.tile([0.0, 0.0, 0.1], (2, 1)), np.tile(np.eye(3), (2, 1, 1))
    start = State(np.array([O, X]), poses, np.array([O, (-0.95, 0.1, 0.0)]), spin)
    return Problem("polar_arm", system, start, 1.0, 1e-2, "", "")


@pytest.mark.parametrize("solver", ["rkmk_dop853", "ida_index1", "scipy_strong_form"])
def test_angular_momentum_is_kept_where_lent_inertia_is_most_of_it(solver: str) -> None:
    """(J + m r^2) omega about the hinge, r from 1 to 0.05 m; the work of the drive is the energy gained."""
    p = polar_arm()
    out = make_solver(solver).solve(p, StepControl(rtol=1e-9))
    assert out.status == Status.SUCCESS, out.message
    J = 1e-3 + MASS * np.linalg.norm(out.states.r[:, 1], axis=1) ** 2
    assert np.max(np.abs(J * out.states.Omega[:, 0, 2] - J[0] * 0.1)) < 1e-6
    E = energy(p.system, out.states)
    assert np.max(np.abs(E - E[0] - work(p.system, out.t, out.states, E)[0])) < 1e-3 * np.ptp(E)
