"""Define the cases of the kit: catalogue problems with parameters, and a bar on a hinge with spring, damper and torque.

The bar obeys J theta'' + c theta' + k theta = a sin(w t), so that its motion is a formula.
"""

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from ....problems.exact import planar
from ....problems.exact.closed_form import ClosedForm
from ...base.hints import suggest_name
from ...catalogue import registry
from ...mechanics import so3
from ...mechanics.state import State, States
from ...mechanics.system import GROUND, Joint, Load, TorsionSpring, assemble
from ...mechanics.time_functions import TimeFunction
from ...mechanics.types import Problem, Reference

FREE: dict[str, Any] = {"gravity": 0.0, "velocity": (0.0, 0.0, 0.0), "t_end": 2.0}
LOOP: dict[str, Any] = {"rows": 1, "columns": 1, "axial_inertia": 0.01, "t_end": 1.0}
TURNED = (0.3, -0.5, 0.7)  # [rad] a rotation about no axis of space
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "free_fall": ("free_body", {"omega": (0.0, 0.0, 0.0), "velocity": (2.0, 0.0, 5.0), "t_end": 1.0}),
    "spin_sphere": ("free_body", {**FREE, "sides": (0.4, 0.4, 0.4), "omega": (1.0, 4.0, 2.0)}),
    "spin_symmetric": ("free_body", {**FREE, "sides": (0.4, 0.4, 0.2), "omega": (1.0, 2.0, 4.0)}),
    "spin_asymmetric": ("free_body", {**FREE, "omega": (0.05, 6.0, 0.1)}),
    "spin_products": ("free_body", {**FREE, "omega": (3.0, 4.0, 2.0)}),  # in axes that are not principal
    "pendulum": ("simple_pendulum", {"gyration": 0.3, "t_end": 2.0}),
    "ball_pendulum": ("spherical_pendulum", {"omega_x": 5.0, "omega_z": 3.0, "t_end": 2.0}),
    "top": ("heavy_top", {"t_end": 1.0}),
    "four_bar": ("four_bar_grid", LOOP),
    "four_bar_turned": ("four_bar_grid", {**LOOP, "rotation": TURNED}),
    "slider_crank": ("slider_crank", {"t_end": 1.0}),
    "slider_crank_turned": ("slider_crank", {"rotation": TURNED, "t_end": 1.0}),
    "damped_linkage": ("damped_linkage", {"t_end": 1.0}),
    "damped_hinge": ("", {"torque": 0.0}),
    "driven_hinge": ("", {"torque": 2.0}),
}
MASS, LENGTH, AXIAL = 1.0, 1.0, 0.01  # [kg], [m], [kg m2] of the bar
ABOUT_HINGE = MASS * LENGTH**2 / 3.0  # [kg m2]
STIFFNESS, DAMPING, FREQUENCY, ANGLE = 20.0, 0.5, 5.0, 0.5  # [N m/rad], [N m s/rad], [rad/s], [rad] at the start


def make_case(name: str) -> Problem:
    """Return the problem of the case ``name`` in ``CASES``; raise ValueError for an unknown name."""
    if name not in CASES:
        raise ValueError(f"unknown case {name!r}{suggest_name(name, list(CASES))}; there are {', '.join(CASES)}")
    problem, parameters = CASES[name]
    if not problem:
        return _make_hinged_bar(name, **parameters)
    made = registry.make_problem(problem, parameters)
    return _turn_body_axes(made, so3.exp(np.array(TURNED))) if name == "spin_products" else made


@dataclass(frozen=True)
class ReframedMotion:
    """Express the motion of one body in other body axes, turned by Q."""

    own: Reference
    Q: Float[np.ndarray, "3 3"]

    @property
    def route(self) -> str:
        """Route of the reference in the original axes."""
        return self.own.route

    @property
    def horizon(self) -> float:
        """Horizon of the reference in the original axes [s]."""
        return self.own.horizon

    def states(self, t: Float[np.ndarray, " nt"]) -> States:
        """Return the motion at ``t`` [s]."""
        s = self.own.states(t)
        return States(s.r, s.R @ self.Q, s.v, s.Omega @ self.Q, t)

    def error(self, t: Float[np.ndarray, " nt"]) -> Float[np.ndarray, " nt"]:
        """Return the stated error of the reference in the original axes [m]."""
        return self.own.error(t)


def _turn_body_axes(p: Problem, Q: Float[np.ndarray, "3 3"]) -> Problem:
    """Return the problem with the axes of its one free body turned by Q, so that the inertia has products.

    Its reference is turned, too; observables and invariants are dropped.
    """
    own, start = p.reference(), p.initial
    assert own is not None
    system = dataclasses.replace(p.system, inertia=Q.T @ p.system.inertia @ Q)
    turned = State(start.r, start.R @ Q, start.v, start.Omega @ Q)
    return dataclasses.replace(
        p, system=system, initial=turned, observables=(), invariants=(), reference_from=lambda _: ReframedMotion(own, Q)
    )


def _make_hinged_bar(name: str, torque: float) -> Problem:
    """Return the problem of a bar hinged about OZ, without gravity, from rest at ``ANGLE``.

    ``torque`` [N m] is the amplitude a of the sine that drives it.
    """
    half = np.array([0.5 * LENGTH, 0.0, 0.0])
    bar = planar.make_slender_bar(MASS, LENGTH, AXIAL, "bar")
    joint = Joint(0, -half, GROUND, (0.0, 0.0, 0.0), planar.AXIS, planar.OZ, "O")
    X, Z = (1.0, 0.0, 0.0), planar.OZ
    spring = TorsionSpring(0, X, GROUND, Z, X, STIFFNESS, 0.0, DAMPING)
    drive = Load(0, torque=(0.0, 0.0, torque), factor=TimeFunction((), 1.0, FREQUENCY))
    system = assemble([bar], [joint], (0.0, 0.0, 0.0), torsions=[spring], loads=[drive] if torque else [])
    exact = ClosedForm("closed form: damped oscillator", partial(_evaluate_oscillation, torque), 1.0, FREQUENCY)
    return Problem(name, system, exact.start(), 2.0, 1e-2, "", "chosen", reference_from=exact.match_start)


def _evaluate_oscillation(torque: float, t: Float[np.ndarray, " nt"]) -> States:
    """Return the states of the bar at ``t`` [s], driven by a torque of amplitude ``torque`` [N m].

    Its angle is Re(z exp(s t)) of the free motion plus the driven motion Re(driven exp(i w t)).
    """
    root = (-DAMPING + np.emath.sqrt(DAMPING**2 - 4.0 * ABOUT_HINGE * STIFFNESS)) / (2.0 * ABOUT_HINGE)
    dynamic_stiffness = STIFFNESS - ABOUT_HINGE * FREQUENCY**2 + 1j * DAMPING * FREQUENCY
    driven = -1j * torque / dynamic_stiffness
    theta_0, rate_0 = ANGLE - driven.real, -(1j * FREQUENCY * driven).real
    free = theta_0 + 1j * (root.real * theta_0 - rate_0) / root.imag
    terms = [(free, root), (driven, 1j * FREQUENCY)]
    theta, rate = (sum((z * s**k * np.exp(s * t)).real for z, s in terms)[:, None] for k in (0, 1))
    centre = 0.5 * LENGTH * np.stack((np.cos(theta), np.sin(theta)), axis=-1)
    velocity = rate[..., None] * np.stack((-centre[..., 1], centre[..., 0]), axis=-1)
    return planar.make_planar_states(centre, theta, velocity, rate)
