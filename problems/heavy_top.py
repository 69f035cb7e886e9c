"""Heavy top in cuspidal motion (Sect. 5.4, Figs. 10, 11): released with spin only, it nutates and precesses.

All numbers: Sect. 5.4. I_t and I_a are about the fixed point O, so about C the transverse inertia is I_t - m l^2.
Exact: Lagrange's top by theta functions (problems/exact/lagrange_top).
"""

from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.motion import angular_momentum
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import Joint, RigidBody, assemble
from ..harness.mechanics.types import Invariant, Observable, Problem
from .exact.one_body import find_one_body_motion


@problem("heavy_top")
def heavy_top(
    *,
    mass: Annotated[float, Parameter("mass", "kg", above=0.0)] = 5.0,
    length: Annotated[float, Parameter("distance of C from the fixed point O", "m", above=0.0)] = 0.1,
    inertia_transverse: Annotated[float, Parameter("I_t about O", "kg m2", above=0.0)] = 0.1,
    inertia_axial: Annotated[float, Parameter("I_a about the axis", "kg m2", above=0.0)] = 0.01,
    theta0: Annotated[float, Parameter("initial nutation angle", "deg")] = 20.0,
    phi_dot0: Annotated[float, Parameter("initial precession rate", "rad/s")] = 0.0,
    theta_dot0: Annotated[float, Parameter("initial nutation rate", "rad/s")] = 0.0,
    spin: Annotated[float, Parameter("initial Omega_z", "rad/s")] = 50.0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Release a Lagrange top at theta0 with spin about its axis; by default it nutates between 20 and 138.93 deg.

    Raise ValueError if the inertia about O is too small for the mass and length.
    """
    about_C = inertia_transverse - mass * length**2
    if about_C <= 0.0:
        raise ValueError(
            f"inertia_transverse, about O, must be > mass length^2 = {mass * length**2:g} kg m2 "
            f"(got {inertia_transverse:g})"
        )
    top = RigidBody(mass, np.diag([about_C, about_C, inertia_axial]), "top")
    system = assemble([top], [Joint(0, (0.0, 0.0, -length), name="O")], (0.0, 0.0, -gravity))
    theta = np.deg2rad(theta0)
    R = so3.euler313(0.0, theta, 0.0)
    Omega = np.array([theta_dot0, phi_dot0 * np.sin(theta), spin])  # at phi = psi = 0
    arm = np.array([0.0, 0.0, length])
    start = State((R @ arm)[None], R[None], (R @ np.cross(Omega, arm))[None], Omega[None])
    return Problem(
        "heavy_top",
        system,
        start,
        t_end=5.0,
        dt=1e-3,
        section="Sect. 5.4",
        source="Sect. 5.4",
        observables=(
            Observable("theta", r"\theta", "deg", _measure_nutation),
            Observable("phi_dot", r"\dot\varphi", "rad/s", _measure_precession_rate),
            Observable("psi_dot", r"\dot\psi", "rad/s", _measure_spin_rate),
            Observable("C_x", "X_C", "m", lambda s: s.r[:, 0, 0]),
            Observable("C_y", "Y_C", "m", lambda s: s.r[:, 0, 1]),
            Observable("C_z", "Z_C", "m", lambda s: s.r[:, 0, 2]),
        ),
        invariants=(
            Invariant("L_Z", "kg m2/s", lambda s: angular_momentum(system, s)[:, 2]),
            Invariant("Omega_z", "rad/s", lambda s: s.Omega[:, 0, 2]),
        ),
        reference_from=partial(find_one_body_motion, system),
    )


def _measure_nutation(s: States) -> Float[np.ndarray, " nt"]:
    """Return the nutation angle theta [deg] of the top, that of its axis to OZ."""
    axis = s.R[:, 0, :, 2]
    return np.rad2deg(np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), axis[:, 2]))


def _measure_spin_rate(s: States) -> Float[np.ndarray, " nt"]:
    """Return the spin rate psi_dot = Omega_z - phi_dot cos(theta) [rad/s]; NaN with the axis upright."""
    return s.Omega[:, 0, 2] - _measure_precession_rate(s) * s.R[:, 0, 2, 2]


def _measure_precession_rate(s: States) -> Float[np.ndarray, " nt"]:
    """Return phi_dot = (Omega_x k_x + Omega_y k_y)/(k_x^2 + k_y^2) [rad/s], k = OZ in the body; NaN if upright."""
    k, Omega = s.R[:, 0, 2], s.Omega[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return (Omega[:, 0] * k[:, 0] + Omega[:, 1] * k[:, 1]) / (k[:, 0] ** 2 + k[:, 1] ** 2)
