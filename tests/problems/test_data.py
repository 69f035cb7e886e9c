"""The numbers of the paper, those that follow from it, and data that are refused in one sentence with the numbers."""

import numpy as np
import pytest

from mbsbench import Problem, State, States, constraint, constraint_rate
from mbsbench.harness.catalogue.registry import make_problem, problems
from mbsbench.harness.mechanics.consistency import InconsistentStart, check_start
from mbsbench.harness.mechanics.jacobian import compute_singular_values, constraint_jacobian, independent_rows
from mbsbench.problems import four_bar_grid
from mbsbench.problems.exact.passages import find_singular_passages
from mbsbench.tests.comparing import assert_close, assert_each, assert_same


def test_the_rods_have_a_spherical_inertia() -> None:
    """Sect. 5.1: three rods of 1 kg and 1 m: 3 kg and J = I/6."""
    p = make_problem("torque_free_body")
    assert p.system.mass[0] == 3.0
    assert_close(p.system.inertia[0], np.eye(3) / 6.0, rtol=1e-15)


def test_the_pendulum_is_a_solid_cylinder() -> None:
    """J_C = diag(0.005, 0.0858333, 0.0858333); in the spatial set the start moves C by (0, 0, 0.05) m/s."""
    p = make_problem("spherical_pendulum", {"omega_z": 0.1})
    assert_close(np.diag(p.system.inertia[0]), [0.005, 0.0858333333, 0.0858333333], atol=1e-10)
    assert_close(p.initial.v, [[0.0, 0.0, 0.05]], atol=1e-16)
    assert p.planar_normal is None
    assert make_problem("spherical_pendulum").planar_normal is not None


def test_the_top_has_its_inertia_about_the_pin() -> None:
    """I_t = 0.1 and I_a = 0.01 about O: 0.05 about C by Steiner."""
    assert_close(make_problem("heavy_top").system.inertia[0], np.diag([0.05, 0.05, 0.01]), atol=1e-16)


def test_initial_rates_of_the_top_are_what_it_then_has() -> None:
    """theta_dot0, phi_dot0 and spin, read back from the motion."""
    p = make_problem("heavy_top", {"theta0": 40.0, "phi_dot0": 3.0, "theta_dot0": -2.0, "spin": 7.0})
    start = p.observe(States.one(p.initial))
    assert_close(start["theta"][0], 40.0, rtol=1e-14)
    assert_close(start["phi_dot"][0], 3.0, rtol=1e-14)
    theta = np.deg2rad(p.observe(p.reference().states(np.array([0.0, 1e-6])))["theta"])
    assert_close((theta[1] - theta[0]) / 1e-6, -2.0, rtol=1e-4)  # curvature 1e-6 s of some 100 rad/s2
    assert p.initial.Omega[0, 2] == 7.0


def test_small_swings_of_the_pendulum_take_the_textbook_period() -> None:
    """2 pi sqrt(I_O/(m g l)), at 0.1 deg: the correction theta^2/16 is 2e-7."""
    p = make_problem("spherical_pendulum", {"angle": -89.9})
    period = 2.0 * np.pi * np.sqrt((0.0858333333333 + 0.25) / (9.81 * 0.5))
    C_x = p.observe(p.reference().states(np.array([0.0, period / 2, period, 100 * period])))["C_x"]
    assert_close(C_x / C_x[0], [1.0, -1.0, 1.0, 1.0], atol=1e-7)  # second order in the shift of phase


@pytest.mark.parametrize("links", [6, 9, 15, 150])
def test_the_start_is_static_while_b_and_c_hold(links: int) -> None:
    """With forces at A, B, C, D and in the joints every bar balances its weight: it is in the range of A^T."""
    p = make_problem("chain", {"links": links})
    assert residual(p, supports=True) < 1e-9 * links**2  # the pull at A is of the order of the chain's weight
    assert residual(p, supports=False) > 1.0  # and without B and C it must move


def residual(p: Problem, supports: bool) -> float:
    """Largest unbalanced force [N] or torque [N m]."""
    A = constraint_jacobian(p.system, p.initial).toarray()
    third = p.system.nb // 3
    held = []
    for k in (third, 2 * third) if supports else ():  # the joint of bars k-1 and k is point_i of its row: bar k-1's end
        for row in A[3 * k : 3 * k + 3]:
            only = row.copy()
            only[6 * k :] = 0.0
            held.append(only)
    rows = np.vstack((A, *held)) if held else A
    weight = np.zeros((p.system.nb, 6))
    weight[:, :3] = -p.system.mass[:, None] * p.system.gravity
    force = np.linalg.lstsq(rows.T, weight.ravel(), rcond=None)[0]
    return float(np.max(np.abs(rows.T @ force - weight.ravel())))


def test_the_chain_is_as_specified() -> None:
    """Sect. 5.3: 90 coordinates, 48 constraints, A and D three times 0.9144 m apart; E below the middle at rest.

    The start and gravity are mirror images about it: E falls straight until rounding has grown.
    """
    p = make_problem("chain")
    assert (p.system.nb, p.system.nj, p.system.nrows) == (15, 16, 48)
    assert_close(p.system.joint_s_j[-1], [3 * 0.9144, 0.0, 0.0], atol=1e-15)
    E = p.observe(p.reference().states(np.linspace(0.0, 1.0, 101)))
    assert np.max(np.abs(E["E_x"] - 1.5 * 0.9144)) < 1e-9 and abs(E["E_x"][0] - 1.5 * 0.9144) < 1e-14
    assert E["E_y"][0] < -0.5
    assert_each(E["E_z"], "==", 0.0)
    assert make_problem("chain", {"perturb": 1e-6}).reference() is None  # the planar model says nothing about it


def test_the_grid_is_as_specified() -> None:
    """Sect. 5.5: 55 bodies, 80 joints (6 + 64 + 10), 400 rows of rank 325, 5 degrees of freedom."""
    p = make_problem("four_bar_grid")
    assert (p.system.nb, p.system.nj, p.system.nrows) == (55, 80, 400)
    assert len(independent_rows(p.system, p.initial)) == 325
    assert 6 * p.system.nb - 325 == 5


def test_only_the_top_row_turns_in_top_row() -> None:
    """Sect. 5.5: the six top bars at 2 pi/3 rad/s; what hangs below translates with their feet."""
    p = make_problem("four_bar_grid")
    assert_close(p.initial.Omega[:6, 2], 2.0 * np.pi / 3.0)
    assert_each(p.initial.Omega[6:], "==", 0.0)
    assert_close(p.initial.v[6:], [0.0, 2.0 * np.pi / 3.0, 0.0])


def test_masses_spread_by_seed() -> None:
    """The same seed gives the same masses, another one others, all within the spread."""
    mass = [make_problem("four_bar_grid", {"mass_spread": 0.2, "mass_seed": k}).system.mass for k in (1, 1, 2)]
    assert_same(mass[0], mass[1])
    assert np.max(np.abs(mass[0] - mass[2])) > 0.0
    assert 0.01 < np.max(np.abs(mass[0] - 1.0)) <= 0.2


def test_rows_fold_flat_where_the_passages_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """At a passage A loses rank (one more singular value falls to rounding), and a millisecond before it has not."""
    monkeypatch.setattr(four_bar_grid, "SOUGHT", 1.5)
    p = make_problem("four_bar_grid", {"release": "all_rows", "columns": 2})
    passages = find_singular_passages(p, 1.2)
    assert len(passages) >= 3
    reference = p.reference()
    rank = 6 * p.system.nb - 5
    for t, _ in passages:
        at, before = (
            compute_singular_values(p.system, reference.states(np.array([s]))[0])[rank - 1] for s in (t, t - 1e-3)
        )
        assert at < 1e-9 < 1e-6 < before


def test_top_row_is_never_singular() -> None:
    """Its rows stay within 70 degrees of hanging in 10 s (here: the first 1.5 s)."""
    assert find_singular_passages(make_problem("four_bar_grid"), 10.0) == ()


IMPOSSIBLE = [
    ("torque_free_body", {"rod_mass": -1.0}, "rod_mass must be > 0"),
    ("torque_free_body", {"inertia_factors": (1.0, 1.0, 3.0)}, "no mass distribution"),
    ("torque_free_body", {"inertia_factors": (1.0, 0.0, 1.0)}, "inertia_factors must be > 0"),
    ("torque_free_body", {"omega": "1,2"}, "3 numbers"),
    ("torque_free_body", {"omega": (1.0, float("nan"), 0.0)}, "finite"),
    ("spherical_pendulum", {"mass": 0.0}, "mass must be > 0"),
    ("spherical_pendulum", {"half_length": "long"}, "half_length must be a number"),
    ("heavy_top", {"inertia_transverse": 0.05}, "about O, must be > mass length"),
    ("heavy_top", {"inertia_axial": 0.2}, "no mass distribution"),
    ("heavy_top", {"spin": float("inf")}, "finite"),
    ("chain", {"links": 16}, "multiple of three"),
    ("chain", {"links": 3}, "links must be >= 6"),
    ("chain", {"links": 9, "span_ratio": 0.3}, "span_ratio must be between 0.333333 and 1"),
    ("chain", {"span_ratio": 1.0}, "span_ratio must be between"),
    ("chain", {"axial_inertia": 1.0}, "no mass distribution"),
    ("chain", {"mass": -1.0}, "mass must be > 0"),
    ("chain", {"links": 303, "axial_inertia": 0.0}, "at most 300"),
    ("simple_pendulum", {"gyration": 0.6}, "gyration must be <= length/2 = 0.5 m"),
    ("n_four_bar", {"windows": 0}, "windows must be >= 1"),
    ("bricard", {"section": "round"}, "square, thin"),
    ("four_bar_grid", {"rows": 0}, "rows must be >= 1"),
    ("four_bar_grid", {"release": "bottom"}, "top_row, all_rows"),
    ("four_bar_grid", {"mass_spread": 1.0}, "mass_spread must be <= 0.9"),
    ("four_bar_grid", {"columns": 2.5}, "columns must be an integer"),
    ("heavy_top", {"duplicate": 2}, r"duplicate must be 0\.\.1"),
]


@pytest.mark.parametrize(("name", "given", "says"), IMPOSSIBLE, ids=[f"{n} {g}" for n, g, _ in IMPOSSIBLE])
def test_impossible_data_are_refused(name: str, given: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says) as refused:
        make_problem(name, given)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", [n for n in problems() if make_problem(n).system.nrows])
@pytest.mark.parametrize("part", ["r", "v", "Omega"])
def test_a_start_off_the_constraints_is_refused(name: str, part: str) -> None:
    """Shifted, pushed or spun by a micron or so: the message has the violation."""
    p = make_problem(name)
    if part == "Omega" and name in ("torque_free_body", "knife_edge", "pumped_pendulum"):
        pytest.skip("any Omega is consistent: the joint, the blade or the rod is at C")
    s = p.initial
    moved = {k: np.array(getattr(s, k)) for k in ("r", "R", "v", "Omega")}
    moved[part] += 1e-6
    with pytest.raises(InconsistentStart, match=r"got \|phi\| = "):
        check_start(p.system, State(**moved))


def test_the_printed_start_of_the_spatial_pendulum_opens_the_joint_by_l_omega() -> None:
    """C at rest and Omega_z = 0.1 rad/s at l = 0.5 m: phi = 0, |phi_dot| = 0.05 m/s. The waiver is of phi_dot alone."""
    p = make_problem("spherical_pendulum", {"omega_z": 0.1, "literal_start": True})
    start = States.one(p.initial)
    assert np.max(np.abs(constraint(p.system, start))) < 1e-15
    assert np.linalg.norm(constraint_rate(p.system, start)) == pytest.approx(0.05)
    with pytest.raises(InconsistentStart):
        check_start(p.system, p.initial)
    moved = State(p.initial.r + 1e-6, p.initial.R, p.initial.v, p.initial.Omega)
    with pytest.raises(InconsistentStart):
        check_start(p.system, moved, literal=True)
