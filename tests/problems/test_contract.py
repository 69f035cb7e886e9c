"""Every problem of the catalogue, as it stands, turned and perturbed: consistent start, lawful reference.

The laws are those of the full system in (r, R): nothing here knows angles, elliptic functions or linkages.
"""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, problems
from mbsbench.harness.conformance import laws
from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.state import States, rotated
from mbsbench.harness.types import Problem, Reference

TURN = {"yaw": 0.7, "rotation": (0.3, -0.2, 0.5)}
CASES = [(name, given) for name in problems() for given in ({}, TURN, {"perturb": 1e-3, "seed": 2})]
CASES += [
    ("simple_pendulum", {"angle": 60.0, "gyration": 0.1}),
    *(
        ("simple_pendulum", {**given, **turned})
        for given in ({"support": "link"}, {"gyration": 0.0})
        for turned in ({}, TURN, {"perturb": 0.1})
    ),
    ("n_four_bar", {"windows": 3, "speed": 2.0}),
    ("free_body", {"omega": (3.0, 0.5, -1.0)}),
    ("bricard", {"section": "thin"}),
    ("bricard", {"section": "thin", "axial_inertia": 0.0}),
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


@pytest.fixture(params=CASES, ids=NAMES)
def presented(request: pytest.FixtureRequest) -> Problem:
    return make_problem(*request.param)


@pytest.fixture
def known(presented: Problem) -> Reference:
    reference = presented.reference()
    if reference is None:
        pytest.skip("no reference of its own from this start")
    return reference


def times(p: Problem, reference: Reference) -> np.ndarray:
    return np.linspace(0.0, min(p.t_end, reference.horizon), 41)


def test_the_start_is_consistent(presented: Problem) -> None:
    """phi and phi_dot vanish to rounding, three digits below what a start is refused for."""
    start = States.one(presented.initial)
    assert np.max(np.abs(motion.constraint(presented.system, start)), initial=0.0) < 1e-12
    assert np.max(np.abs(motion.constraint_rate(presented.system, start)), initial=0.0) < 1e-12


LAWS = (
    laws.check_reference_start, laws.check_rates, laws.check_newton_euler, laws.check_joints, laws.check_energy,
    laws.check_invariants,
)  # fmt: skip


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_the_reference_obeys_the_laws_that_are_asked_of_anybodys(law, presented: Problem, known: Reference) -> None:
    """Start, rates of poses, Newton and Euler, joints, energy and invariants, to its stated error."""
    subject = laws.Subject(presented.name)
    vars(subject)["problem"] = presented
    found = law(subject)
    assert found.holds, found


def test_the_stated_error_grows_from_rounding(presented: Problem, known: Reference) -> None:
    """A bound: positive, never falling, far below a millimetre at first, and good for a second at least."""
    assert known.horizon >= 1.0
    e = known.error(times(presented, known))
    assert 0.0 < e[0] < 1e-12
    assert np.all(np.diff(e) >= 0.0)


def test_observables_do_not_depend_on_the_frame(presented: Problem) -> None:
    """They are taken in the home frame: turning motion and frame together changes nothing but rounding."""
    random = np.random.default_rng(5)
    s = States.one(presented.initial)
    Q = so3.exp(random.standard_normal(3))
    turned = make_problem(
        presented.name, {**presented.parameters, "rotation": so3.log(Q @ presented.frame), "yaw": 0.0}
    )
    for name, value in presented.observe(s).items():
        there = turned.observe(rotated(s, Q))[name]
        assert value.shape == (1,)
        assert np.allclose(there, value, rtol=1e-12, atol=1e-12, equal_nan=True), name


@pytest.mark.parametrize("name", OWN)
def test_the_reference_turns_with_the_problem(name: str) -> None:
    """The turned problem's motion is the turned motion; the chain's rounding grows by a digit every 0.6 s."""
    here, there = make_problem(name), make_problem(name, TURN)
    ours, theirs = here.reference(), there.reference()
    assert ours is not None
    assert theirs is not None
    t = np.linspace(0.0, 1.0, 11)
    expected, got = rotated(ours.states(t), there.frame), theirs.states(t)
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
        assert np.array_equal(reference.states(t[k : k + 1]).r[0], s.r[k])
