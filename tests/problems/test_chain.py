"""The chain: its start is the equilibrium of three spans, whatever their number of bars."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.types import Problem
from mbsbench.problems.chain import start_angles


def test_the_start_matches_the_five_bar_span() -> None:
    """1 + 2/sqrt(1 + a^2) + 2/sqrt(1 + 4 a^2) = 3 gives a = 1.24304."""
    slope = np.tan(start_angles(15, 0.6))
    a = slope[3]
    assert abs(1.0 + 2.0 / np.sqrt(1.0 + a**2) + 2.0 / np.sqrt(1.0 + 4.0 * a**2) - 3.0) < 1e-14
    assert abs(a - 1.24304) < 5e-6
    assert np.allclose(slope, np.tile([-2 * a, -a, 0.0, a, 2 * a], 3), rtol=1e-14, atol=1e-15)


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
    """Sect. 5.3: 90 coordinates, 48 constraints, A and D three times 0.9144 m apart; E below the middle at rest."""
    p = make_problem("chain")
    assert (p.system.nb, p.system.nj, p.system.nrows) == (15, 16, 48)
    assert np.allclose(p.system.joint_s_j[-1], [3 * 0.9144, 0.0, 0.0], atol=1e-15)
    E = {name: p.observe(p.reference().states(np.zeros(1)))[name][0] for name in ("E_x", "E_y", "E_z")}
    assert abs(E["E_x"] - 1.5 * 0.9144) < 1e-14
    assert E["E_y"] < -0.5
    assert E["E_z"] == 0.0


def test_e_of_an_even_chain_is_the_middle_joint() -> None:
    """The two middle bars meet on the axis of symmetry."""
    p = make_problem("chain", {"links": 12})
    E = p.observe(p.reference().states(np.zeros(1)))
    assert abs(E["E_x"][0] - 0.5 * p.system.joint_s_j[-1, 0]) < 1e-14


def test_the_fall_is_symmetric_at_first() -> None:
    """The start and gravity are mirror images about the middle: E falls straight until rounding has grown."""
    p = make_problem("chain")
    E_x = p.observe(p.reference().states(np.linspace(0.0, 1.0, 101)))["E_x"]
    assert np.max(np.abs(E_x - E_x[0])) < 1e-9


def test_a_long_chain_is_cheap_to_set_up() -> None:
    """1,500 links in an array construction; no reference is promised for them."""
    p = make_problem("chain", {"links": 1500})
    assert p.system.nrows == 3 * 1501
    assert p.reference() is None


def test_a_start_out_of_the_plane_has_no_reference() -> None:
    """The planar model says nothing about it, and says so."""
    assert make_problem("chain", {"perturb": 1e-6}).reference() is None
