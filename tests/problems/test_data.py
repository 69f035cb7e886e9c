"""The numbers of the paper, those that follow from it, and parameters that mean what they say."""

import numpy as np

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.state import States


def test_the_rods_have_a_spherical_inertia() -> None:
    """Sect. 5.1: three rods of 1 kg and 1 m: 3 kg and J = I/6."""
    p = make_problem("torque_free_body")
    assert p.system.mass[0] == 3.0
    assert np.allclose(p.system.inertia[0], np.eye(3) / 6.0, rtol=1e-15)


def test_the_pendulum_is_a_solid_cylinder() -> None:
    """J_C = diag(0.005, 0.0858333, 0.0858333); in the spatial set the start moves C by (0, 0, 0.05) m/s."""
    p = make_problem("spherical_pendulum", {"omega_z": 0.1})
    assert np.allclose(np.diag(p.system.inertia[0]), [0.005, 0.0858333333, 0.0858333333], atol=1e-10)
    assert np.allclose(p.initial.v, [[0.0, 0.0, 0.05]], atol=1e-16)
    assert p.planar_normal is None
    assert make_problem("spherical_pendulum").planar_normal is not None


def test_the_top_has_its_inertia_about_the_pin() -> None:
    """I_t = 0.1 and I_a = 0.01 about O: 0.05 about C by Steiner."""
    assert np.allclose(make_problem("heavy_top").system.inertia[0], np.diag([0.05, 0.05, 0.01]), atol=1e-16)


def test_initial_rates_of_the_top_are_what_it_then_has() -> None:
    """theta_dot0, phi_dot0 and spin, read back from the motion."""
    p = make_problem("heavy_top", {"theta0": 40.0, "phi_dot0": 3.0, "theta_dot0": -2.0, "spin": 7.0})
    start = p.observe(States.one(p.initial))
    assert np.isclose(start["theta"][0], 40.0, rtol=1e-14)
    assert np.isclose(start["phi_dot"][0], 3.0, rtol=1e-14)
    theta = np.deg2rad(p.observe(p.reference().states(np.array([0.0, 1e-6])))["theta"])
    assert np.isclose((theta[1] - theta[0]) / 1e-6, -2.0, rtol=1e-4)  # curvature 1e-6 s of some 100 rad/s2
    assert p.initial.Omega[0, 2] == 7.0


def test_small_swings_of_the_pendulum_take_the_textbook_period() -> None:
    """2 pi sqrt(I_O/(m g l)), at 0.1 deg: the correction theta^2/16 is 2e-7."""
    p = make_problem("spherical_pendulum", {"angle": -89.9})
    period = 2.0 * np.pi * np.sqrt((0.0858333333333 + 0.25) / (9.81 * 0.5))
    C_x = p.observe(p.reference().states(np.array([0.0, period / 2, period, 100 * period])))["C_x"]
    assert np.allclose(C_x / C_x[0], [1.0, -1.0, 1.0, 1.0], atol=1e-7)  # second order in the shift of phase
