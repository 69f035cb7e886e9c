"""Andrews' squeezing mechanism (IFToMM library, A03; IVP test set II-9): seven flat bodies driven by a constant torque.

Numbers: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, VI.9; IVP test set II-9, with the start
of A03 (beta = -0.0620, 0.05 s, the path of F); that of the test set is ``beta`` = -0.0617138900142764496, for 0.03 s.
B_x = -0.03635: A03 in github RehabEngGroup/MBSbenchmarksInOpenSim prints +0.03635, with which no loop closes.
The other angles of the start close the loops. Inertia out of the plane is that of flat discs, without effect on the
motion. The 50 rows have rank 41. Reference: computed.
"""

from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.optimize import root

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import GROUND, Joint, Load, RigidBody, SpringDamper, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact.planar import AXIS, OZ, make_bar_frames

O, A, B, C = (np.array(p) for p in ((0.0, 0.0), (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)))  # [m]
MASS = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)  # [kg]
INERTIA = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)  # [kg m2] about OZ through C
D_, DA, E_, EA, RR, RA = 28e-3, 11.5e-3, 20e-3, 14.21e-3, 7e-3, 0.92e-3  # [m] names of the test set
SS, SA, SB, SC, SD = 35e-3, 18.74e-3, 10.43e-3, 18e-3, 20e-3
TA, TB, U, UA, UB, ZF, ZT, FA = 23.08e-3, 9.16e-3, 40e-3, 12.28e-3, 4.49e-3, 20e-3, 40e-3, 14.21e-3
STIFFNESS, REST_LENGTH = 4530.0, 0.07785  # [N/m], [m] of the spring D-C
CLOSED = np.array([0.0, 0.455279819, 0.222668390, 0.487364980, -0.222668390, 1.230547445])  # [rad] from beta = -0.0617


@problem("andrews", tests=(Trait.REDUNDANT, Trait.DRIVEN))
def andrews(
    *,
    beta: Annotated[float, Parameter("angle of the crank at the start", "rad", at_least=-0.3, at_most=0.3)] = -0.0620,
    drive: Annotated[float, Parameter("constant torque on the crank", "N m")] = 0.033,
) -> Problem:
    """Model IFToMM A03: seven bodies in a plane with one degree of freedom, driven to 1140 rad/s within 0.05 s.

    The start is at rest; its angles other than beta close the loops.
    """

    def prepend_crank(x: np.ndarray) -> np.ndarray:
        """Return all seven angles [rad] of the test set: beta, and the six others ``x``."""
        return np.append(beta, x)

    def gaps(x: np.ndarray) -> np.ndarray:
        """Return the gaps of the loops (6,) [m] for the six angles ``x`` [rad] other than beta."""
        return _measure_gaps(prepend_crank(x))

    q = prepend_crank(root(gaps, CLOSED, tol=1e-13).x)
    angle, centre, points = _find_poses(q)
    R = make_bar_frames(angle)

    def body_coordinates(body: int, point: Float[np.ndarray, " 2"]) -> np.ndarray:
        """Return the position of a ``point`` (X, Y) [m] relative to C of a body, in the body's frame [m]."""
        return R[body].T @ np.append(point - centre[body], 0.0)

    def hinge(name: str, i: int, j: int = GROUND) -> Joint:
        """Return the hinge between bodies ``i`` and ``j`` at the point of the mechanism with this name."""
        at = points[name]
        other = np.append(at, 0.0) if j == GROUND else body_coordinates(j, at)
        return Joint(i, body_coordinates(i, at), j, other, AXIS, OZ if j == GROUND else AXIS, name)

    names = ("OF", "FE", "BDE", "GE", "AG", "HE", "AH")
    bodies = [RigidBody(m, np.diag([0.5, 1.0, 0.5]) * I, n) for m, I, n in zip(MASS, INERTIA, names, strict=True)]
    joints = [
        hinge("O", 0),
        hinge("F", 1, 0),
        hinge("E", 1, 2),
        hinge("E", 3, 2),
        hinge("E", 5, 2),
        hinge("B", 2),
        hinge("G", 3, 4),
        hinge("A", 4),
        hinge("A", 6),
        hinge("H", 5, 6),
    ]
    spring = SpringDamper(2, body_coordinates(2, points["D"]), GROUND, (*C, 0.0), STIFFNESS, REST_LENGTH)
    rest = np.zeros((7, 3))
    F = body_coordinates(0, points["F"])
    return Problem(
        "andrews",
        assemble(bodies, joints, springs=[spring], loads=[Load(0, torque=(0.0, 0.0, drive))]),
        State(np.concatenate((centre, np.zeros((7, 1))), axis=1), R, rest, rest),
        t_end=0.05,
        dt=1e-5,
        section="",
        source="IFToMM library of computational benchmarks, A03; IVP test set II-9",
        observables=(
            Observable("beta", r"\beta", "rad", _measure_crank_angle),
            Observable("F_x", "X_F", "m", lambda s: point_position(s, 0, F)[:, 0]),
            Observable("F_y", "Y_F", "m", lambda s: point_position(s, 0, F)[:, 1]),
        ),
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )


def _measure_crank_angle(s: States) -> Float[np.ndarray, " nt"]:
    """Return the angle of OF to OX [rad], continuous in time."""
    return np.unwrap(np.arctan2(s.R[:, 0, 1, 0], s.R[:, 0, 0, 0]))


def _find_poses(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Return the bodies' angles (7,) [rad] and centres (7, 2) [m], and the mechanism's points by name.

    ``q`` are the test set's angles (beta, Theta, gamma, phi, delta, Omega, eps) [rad].
    """
    beta, Theta, gamma, phi, delta, Omega, eps = q

    def c(a: float) -> np.ndarray:
        """Return the direction at the angle ``a`` to OX."""
        return np.array([np.cos(a), np.sin(a)])

    def s(a: float) -> np.ndarray:
        """Return the direction at the angle ``a`` less pi/2 to OX."""
        return np.array([np.sin(a), -np.cos(a)])

    F, G, H = RR * c(beta), A + ZT * c(delta), A + U * s(eps)
    E, D = B + SS * s(gamma), B + SC * s(gamma) + SD * c(gamma)
    centre = np.stack(
        [
            RA * c(beta),
            F - DA * c(beta + Theta),
            B + SA * s(gamma) + SB * c(gamma),
            G + (E_ - EA) * s(phi + delta),
            A + TA * c(delta) - TB * s(delta),
            H + (ZF - FA) * c(Omega + eps),
            A + UA * s(eps) - UB * c(eps),
        ]
    )
    angle = np.array([beta, beta + Theta, gamma, phi + delta, delta, Omega + eps, eps])
    return angle, centre, {"O": O, "A": A, "B": B, "D": D, "E": E, "F": F, "G": G, "H": H}


def _measure_gaps(q: np.ndarray) -> np.ndarray:
    """Return the gaps of three loops (6,) [m]: E computed along each of the three other paths, less E on the body BDE.

    ``q`` are the test set's seven angles [rad], as in ``_find_poses``.
    """
    beta, Theta, _, phi, delta, Omega, eps = q
    p = _find_poses(q)[2]
    paths = (
        p["F"] - D_ * np.array([np.cos(beta + Theta), np.sin(beta + Theta)]),
        p["G"] + E_ * np.array([np.sin(phi + delta), -np.cos(phi + delta)]),
        p["H"] + ZF * np.array([np.cos(Omega + eps), np.sin(Omega + eps)]),
    )
    return np.concatenate([path - p["E"] for path in paths])
