"""Impossible data are refused in one sentence with the numbers."""

import numpy as np
import pytest

from mbsbench import State, States, constraint, constraint_rate
from mbsbench.harness.catalogue.registry import make_problem, problems
from mbsbench.harness.mechanics.consistency import InconsistentStart, check_start

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
