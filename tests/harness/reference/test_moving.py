"""Computed references of systems that time, drives, rows of velocities, or a user's law move: exact motions, faults."""

import numpy as np
import pytest

from mbsbench import Joint, Load, Problem, RigidBody, State, TimeFunction, TorsionSpring, UserForce, assemble, so3
from mbsbench.harness.base.cache import ROOT
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.reference import director_rows, moving_rows, orbit
from mbsbench.harness.reference.computation import Source, _digest_problem, compute_reference, describe_source
from mbsbench.harness.reference.directors import Directors
from mbsbench.harness.reference.newton_euler import NewtonEuler
from mbsbench.tests.comparing import assert_each, assert_same

from ...solvers.arbitrary_joints import KINDS, MOVING
from ...solvers.arbitrary_systems import with_user_forces
from ..mechanics.test_joints import consistent
from .mechanisms import problem

ROUNDING = 1e-11  # of accelerations up to 1e2 in rates, of rows with condition numbers up to 1e3
J, STIFFNESS, DAMPING, TORQUE, RATE = (
    0.3,
    5.0,
    0.2,
    0.7,
    2.3,
)  # of a forced wheel: kg m2, N m/rad, N m s/rad, N m, rad/s


@pytest.fixture(scope="module", autouse=True)
def fresh_references(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(orbit, "FOLDER", tmp_path_factory.mktemp("references"))
        yield


def law(t, r, R, v, Omega, F, T):  # type: ignore[no-untyped-def]
    angle = np.arctan2(R[0, 1, 0], R[0, 0, 0])
    T[0, 2] = -STIFFNESS * angle - DAMPING * Omega[0, 2] + TORQUE * np.sin(RATE * t)


def wheel(*, by_law: bool) -> Problem:
    """On a hinge, with a torsional spring and damper and a torque that swings; or all of these as one user's law."""
    body = RigidBody(1.0, np.diag([0.2, 0.25, J]))
    hinge = Joint(0, (0.1, 0.2, 0.0), GROUND, (0.1, 0.2, 0.0), (0, 0, 1), (0, 0, 1))
    parts = {
        "torsions": [TorsionSpring(0, (1, 0, 0), stiffness=STIFFNESS, damping=DAMPING)],
        "loads": [Load(0, torque=(0, 0, TORQUE), factor=TimeFunction((), 1.0, RATE))],
    }
    system = assemble([body], [hinge], **({"user_forces": [UserForce(law, 0)]} if by_law else parts))
    spin = 0.4
    pivot = np.array([0.1, 0.2, 0.0])
    v = np.cross((0.0, 0.0, spin), -pivot)
    start = State(np.zeros((1, 3)), np.eye(3)[None], v[None], np.array([[0.0, 0.0, spin]]))
    return problem("wheel", system, start, 2.0)


def swing(t: np.ndarray) -> np.ndarray:
    """theta of J' theta'' + c theta' + k theta = T sin(w t), theta(0) = 0, theta'(0) = 0.4; J' is about the hinge."""
    inertia = J + 0.1**2 + 0.2**2
    decay, own = DAMPING / (2.0 * inertia), STIFFNESS / inertia
    forced = TORQUE / inertia / (own - RATE**2 + 2j * decay * RATE)  # of exp(i w t)
    root = np.sqrt(own - decay**2)
    a = -forced.imag
    b = (0.4 - RATE * forced.real + decay * a) / root
    steady = np.imag(forced * np.exp(1j * RATE * t))
    return np.exp(-decay * t) * (a * np.cos(root * t) + b * np.sin(root * t)) + steady


@pytest.mark.parametrize("by_law", [False, True])
def test_a_forced_wheel_swings_as_its_formula_says(by_law) -> None:
    found, t = compute_reference(wheel(by_law=by_law)), np.linspace(0.0, 2.0, 101)
    assert found is not None and found.horizon == 2.0
    R = found.states(t).R[:, 0]
    gap = np.abs(np.arctan2(R[:, 1, 0], R[:, 0, 0]) - swing(t))
    assert_each(gap * np.hypot(0.1, 0.2), "<=", found.error(t))
    assert found.error(t)[-1] < 1e-10


def test_a_pinion_rolls_down_a_rack_as_its_formula_says() -> None:
    """a = g sin(slope) / (1 + J / (m r^2)), in a slide that keeps its axis level: several turns, past the half."""
    slope, r, g, mass = 0.6, 0.1, 9.81, 2.0
    way, up = np.array([np.cos(slope), -np.sin(slope), 0.0]), np.array([np.sin(slope), np.cos(slope), 0.0])
    axis = np.cross(way, up) * -1.0
    rack = Joint(0, (0, 0, 0), axis_i=axis, axis_j=axis, across_i=way, across_j=way, kind="rack and pinion", length=r)
    joints = [
        Joint(0, (0, 0, 0), axis_j=up, kind="point on plane"),
        Joint(0, (0, 0, 0), axis_j=axis, kind="point on plane"),
        Joint(0, (0, 0, 0), axis_i=axis, axis_j=way, kind="normal axes"),
        Joint(0, (0, 0, 0), axis_i=axis, axis_j=up, kind="normal axes"),
        rack,
    ]
    J = 0.5 * mass * r**2
    system = assemble([RigidBody(mass, J * np.eye(3))], joints, (0.0, -g, 0.0))
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    found, t = compute_reference(problem("pinion", system, start, 1.5)), np.linspace(0.0, 1.5, 61)
    assert found is not None and found.horizon == 1.5
    s = 0.5 * g * np.sin(slope) / (1.0 + J / (mass * r**2)) * t**2
    assert s[-1] / r > 4.0 * np.pi
    assert_each(np.linalg.norm(found.states(t).r[:, 0] - s[:, None] * way, axis=1), "<=", found.error(t))
    assert found.error(t)[-1] < 1e-9
    assert np.max(np.abs(found.states(t).R[:, 0] - so3.exp(s[:, None] / r * axis))) < found.error(t)[-1] / (0.5 * r)


EXACT = {
    "driven_slider_crank": {"t_end": 0.3},
    "knife_edge": {"t_end": 1.0},
    "rolling_disc": {"t_end": 1.0},
    "pumped_pendulum": {"t_end": 1.0},
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", EXACT)
def test_it_is_the_exact_motion_within_its_stated_error(name) -> None:
    p = make_problem(name, EXACT[name])
    exact, found = p.reference(), compute_reference(p)
    assert exact is not None and found is not None and found.horizon == p.t_end
    t = np.linspace(0.0, p.t_end, 101)
    gap = np.max(np.linalg.norm(found.states(t).r - exact.states(t).r, axis=2), axis=1)
    assert_each(gap, "<=", found.error(t) + exact.error(t))
    assert np.max(found.error(t)) < 1e-10
    assert_same(found.states(t).times, t)  # for what is a function of time


@pytest.mark.parametrize("ground", [False, True], ids=["pair", "ground"])
@pytest.mark.parametrize("kind", [*KINDS, *MOVING])
def test_both_routes_give_one_acceleration(kind, ground) -> None:
    """Of every kind, under a spring, a torsional one and loads that are functions of time, at an arbitrary state."""
    _agree(*consistent(kind, ground=ground))


def test_both_routes_take_a_users_law() -> None:
    from ...solvers.arbitrary_systems import consistent as at_rest

    system = with_user_forces()
    _agree(system, at_rest(system, 3))


def _agree(system, start: State) -> None:
    one, two = NewtonEuler(system), Directors(system)
    y, z = one.project_state(one.pack_state(start)), two.project_state(two.pack_state(start))
    assert np.max(np.abs(one.states(y[None]).r - two.states(z[None]).r)) < 1e-13
    nb, s = system.nb, one.states(y[None])[0]
    v_dot, Omega_dot = one.rate(y)[7 * nb : -1].reshape(2, nb, 3)
    z_ddot = two.rate(z[None])[0, :-1].reshape(2, nb, 4, 3)[1]
    hat = so3.hat(s.Omega)
    directors = np.swapaxes(s.R @ (hat @ hat + so3.hat(Omega_dot)), 1, 2)
    size = max(1.0, float(np.max(np.abs(z_ddot))))
    assert np.max(np.abs(z_ddot[:, 0] - v_dot)) < ROUNDING * size
    assert np.max(np.abs(z_ddot[:, 1:] - directors)) < ROUNDING * size


FAULTS = [  # table, kind, field of the row, its problem
    (moving_rows.ROW_FUNCTIONS, "driven angle", "phi_t_rate", "driven_slider_crank"),
    (moving_rows.ROW_FUNCTIONS, "driven distance", "F_rate", "pumped_pendulum"),
    (moving_rows.ROW_FUNCTIONS, "rolling disc", "x_rate", "rolling_disc"),
    (moving_rows.ROW_FUNCTIONS, "knife edge", "F_rate", "knife_edge"),
    (director_rows.ROWS, "driven angle", "gamma", "driven_slider_crank"),
    (director_rows.ROWS, "driven distance", "gamma", "pumped_pendulum"),
    (director_rows.ROWS, "rolling disc", "gamma", "rolling_disc"),
    (director_rows.ROWS, "knife edge", "gamma", "knife_edge"),
]


@pytest.mark.parametrize(("table", "kind", "name", "of"), FAULTS)
def test_a_flipped_sign_in_one_route_is_found_out(table, kind, name, of, monkeypatch, tmp_path) -> None:
    """The routes disagree: the reference ends at once, or states how far they are apart."""
    monkeypatch.setattr(orbit, "FOLDER", tmp_path)
    own = table[kind]
    flip = lambda *a: [row._replace(**{name: -getattr(row, name)}) for row in own(*a)]  # noqa: E731
    monkeypatch.setitem(table, kind, flip)
    p = make_problem(of, EXACT[of])
    if (found := compute_reference(p)) is not None:
        assert found.horizon < 0.3 * p.t_end


def test_every_kind_of_the_library_has_both_routes() -> None:
    assert set(MOVING) == set(moving_rows.ROW_FUNCTIONS) == set(director_rows.ROWS)
    assert all(describe_source(wheel(by_law=b)) is Source.COMPUTED for b in (False, True))
    page = " ".join((ROOT / "docs" / "joints-and-forces.md").read_text(encoding="utf-8").split())
    acting = "user forces, drives, rows of velocities, torsional springs or timed loads"
    assert f"{acting} is computed as any other" in page and "need a reference of their own" not in page


def test_a_users_law_enters_the_key() -> None:
    """Another law is another motion; one that no digest can be made of is never read from disk."""

    def other(t, r, R, v, Omega, F, T):  # type: ignore[no-untyped-def]
        T[0, 2] = 1.0

    p = wheel(by_law=True)
    changed = assemble([RigidBody(1.0, np.diag([0.2, 0.25, J]))], [], user_forces=[UserForce(other, 0)])
    same = assemble([RigidBody(1.0, np.diag([0.2, 0.25, J]))], [], user_forces=[UserForce(law, 0)])
    assert _digest_problem(wheel(by_law=True)) == _digest_problem(p)
    assert _digest_problem(problem("p", changed, p.initial, 1.0)) != _digest_problem(problem("p", same, p.initial, 1.0))
