"""Slender rods and point masses: what joints do about an axis without inertia."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

import mbsbench
from mbsbench.harness.mechanics import added_inertia
from mbsbench.harness.mechanics.dynamics import Rates, accelerations
from mbsbench.harness.mechanics.joints import JointKind
from mbsbench.harness.mechanics.state import State
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
from mbsbench.harness.mechanics.types import Problem
from mbsbench.harness.mechanics.zero_inertia import check_axes
from mbsbench.tests.comparing import assert_close, assert_each

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


IDLE = {
    "a point mass on a link": one(POINT, LINK),
    "a point mass on a spring": one(POINT, springs=[SpringDamper(0, O, GROUND, (0.0, 1.0, 0.0), 50.0)]),
    "a rod on a ball": one(ROD, Joint(0, FOOT)),
    "a rod in a plane": one(ROD, Joint(0, FOOT, GROUND, O, Z, Z)),
    "a rod that turns on its axis": one(ROD, Joint(0, O, GROUND, (ARM, 0.0, 0.0), X, X)),
    "a rod pulled along its axis": one(ROD, Joint(0, FOOT), springs=[SpringDamper(0, O, GROUND, Z, 50.0)]),
}


@pytest.mark.parametrize("accelerations", [accelerations, mbsbench.accelerations], ids=["numpy", "public"])
@pytest.mark.parametrize("name", IDLE)
def test_axes_that_nothing_turns_are_lent_inertia_that_changes_nothing(
    name: str, accelerations: Callable[..., Rates], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By hand; and accelerations are the same with a hundred times as much."""
    system = IDLE[name]
    start = at_x(system)
    check_axes(system, start, 1.0)
    assert_each(np.linalg.eigvalsh(system.regular_inertia), ">", 0.0)
    found = accelerations(system, start)
    monkeypatch.setattr(added_inertia, "SHARE", 1.0)
    other = accelerations(dataclasses.replace(system), start)
    for a, b in ((found.v_dot, other.v_dot), (found.Omega_dot, other.Omega_dot)):
        assert_close(a, b, rtol=1e-12, atol=1e-12)


UNDEFINED = {
    "a point mass on an arm that a hinge holds": (one(POINT, Joint(0, FOOT, GROUND, O, Z, Z)), O, "'bob' .*0, 0, 1"),
    "a point mass on an arm that a ball holds": (one(POINT, Joint(0, FOOT)), O, "'bob' .* joints or loads turn it"),
    "a rod askew on its hinge": (
        one(ROD, Joint(0, FOOT, GROUND, O, (1.0, 1.0, 0.0), (1.0, 1.0, 0.0))),
        O,
        r"'rod' .*\(1, 0, 0\)",
    ),
    "spin of a point mass": (one(POINT, LINK), (0.0, 0.3, 0.0), r"'bob' .*\(0, 1, 0\).* start at 0 rad/s \(got 0.3\)"),
    "spin of a rod": (one(ROD, Joint(0, FOOT)), (0.3, 0.0, 0.0), r"'rod' .*\(1, 0, 0\).* start at 0 rad/s \(got 0.3\)"),
    "a spring beside the axis": (
        one(ROD, Joint(0, FOOT), springs=[SpringDamper(0, (0.0, 0.1, 0.0), GROUND, Z, 50.0)]),
        O,
        r"'rod' has no inertia about \(1, 0, 0\) of its frame, where joints or loads turn it",
    ),
    "a torque that begins later": (
        one(POINT, LINK, loads=[Load(0, torque=Z, factor=TimeFunction(amplitude=1.0, frequency=2.0))]),
        O,
        "'bob' has no inertia about .* turn it",
    ),
    "a point mass that turns about C with a wheel of none": (
        assemble([POINT, POINT], [LINK, Joint(1, O, 0, O, Z, Z)], WEIGHT, [SpringDamper(1, X, GROUND, Z, 50.0)]),
        O,
        "turn it",
    ),
}


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


@pytest.mark.parametrize("accelerations", [accelerations, mbsbench.accelerations], ids=["numpy", "public"])
def test_bare_axes_without_a_motion_are_found_out(accelerations: Callable[..., Rates]) -> None:
    """``accelerations`` of a system that no problem has looked at."""
    system, *_ = UNDEFINED["a spring beside the axis"]
    with pytest.raises(ValueError, match="body 0 is accelerated about an axis without inertia"):
        accelerations(system, at_x(system))


WHEEL = RigidBody(1.0, np.eye(3), "wheel")
APART = np.array([[ARM, 0.0, 0.0], [2.0, 0.0, 0.0]])
SEEN_LATER = {  # (bodies, joints, gravity, start of C, parts): loads about n that are 0 at the start
    "a spring through C": (
        [POINT],
        [],
        WEIGHT,
        np.zeros((1, 3)),
        {"springs": [SpringDamper(0, (0.1, 0, 0), GROUND, (1.0, 0, 0), 50.0)]},
    ),
    "a damper, all at rest": (
        [POINT, WHEEL],
        [LINK],
        O,
        APART,
        {"torsions": [TorsionSpring(0, X, 1, Z, X, damping=1.0)]},
    ),
    "50 Hz": (
        [POINT],
        [LINK],
        WEIGHT,
        APART[:1],
        {"loads": [Load(0, torque=Z, factor=TimeFunction(amplitude=1.0, frequency=100.0 * np.pi))]},
    ),
    "beside a great load": (
        [POINT, WHEEL],
        [LINK],
        WEIGHT,
        APART,
        {"loads": [Load(0, torque=(0, 0, 1e-4)), Load(1, force=(1e7, 0, 0))]},
    ),
}


@pytest.mark.parametrize("name", SEEN_LATER)
def test_a_load_about_an_axis_without_inertia_is_found_wherever_it_acts(name: str) -> None:
    """Lent inertia would be spun by it."""
    bodies, joints, gravity, r, parts = SEEN_LATER[name]
    none = np.zeros((len(r), 3))
    with pytest.raises(ValueError, match="body 'bob' has no inertia about"):
        check_axes(
            assemble(bodies, joints, gravity, **parts), State(r, np.eye(3)[None] + none[:, None], none, none), 1.0
        )


def test_a_problem_with_another_start_or_load_is_judged_anew() -> None:
    """The inertia that an axis may keep was found for another problem."""
    p = Problem("p", one(POINT, LINK), at_x(one(POINT, LINK)), 1.0, 1e-2, "", "")
    with pytest.raises(ValueError, match="must start at 0 rad/s"):
        dataclasses.replace(p, initial=at_x(p.system, (0.3, 0.0, 0.0)))
    with pytest.raises(ValueError, match="joints or loads turn it"):
        dataclasses.replace(p, system=one(POINT, LINK, loads=[Load(0, torque=Z)]))


def test_loads_that_are_no_numbers_are_refused() -> None:
    """A spring of no length has no direction."""
    system = one(POINT, springs=[SpringDamper(0, O, GROUND, (ARM, 0.0, 0.0), 50.0)])
    with pytest.raises(ValueError, match="the loads on body 'bob' must be finite"):
        check_axes(system, at_x(system), 1.0)
