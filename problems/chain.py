"""Chain of rigid bars on two hinges (Sect. 5.3, Figs. 8, 9): three static spans whose inner supports vanish at t = 0.

Numbers: Sect. 5.3: 15 bars of 1 kg and 0.3048 m, supports A, B, C, D 0.9144 m apart, that is 3/5 of the length of the
five bars of a span; ``span_ratio`` keeps this for other numbers of links, with bars of the same size. The axial
inertia is not given: 1e-4 kg m2, without effect on planar motion. Start: the equilibrium of rigid bars, computed.
Reference: planar, certified (exact/certification, docs/decisions); the motion is chaotic and it ends after 5.3 s.
"""

from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics import so3
from ..harness.mechanics.motion import energy, kinetic_energy, point_position, potential_energy
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact.certification import CertifiedMotion
from .exact.linkage import Linkage
from .exact.linkage_motion import PLANE_XY, certify_linkage_motion, find_planar_angles

ENERGY_ALLOWED = 1.0  # [J] rule of the benchmark
SOUGHT = 8.0  # [s] the certificate of the default chain ends earlier


@problem("chain", tests=(Trait.CHAOTIC,))
def chain(
    *,
    links: Annotated[int, Parameter("number of bars, a multiple of three", "", at_least=6, at_most=30_000)] = 15,
    mass: Annotated[float, Parameter("mass of a bar", "kg", above=0.0)] = 1.0,
    length: Annotated[float, Parameter("length of a bar", "m", above=0.0)] = 0.3048,
    span_ratio: Annotated[
        float, Parameter("distance between two supports / length of the bars between them", "", above=0.0)
    ] = 0.6,
    axial_inertia: Annotated[float, Parameter("inertia of a bar about its axis", "kg m2", at_least=0.0)] = 1e-4,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Swing a chain of bars on spherical joints, hinged at A and D, released from three separately static spans."""
    alpha = find_start_angles(links, span_ratio)
    transverse = mass * length**2 / 12.0
    bar = np.diag([axial_inertia, transverse, transverse])
    span = span_ratio * length * (links // 3)
    left, right = (-0.5 * length, 0.0, 0.0), (0.5 * length, 0.0, 0.0)
    joints = [Joint(0, left, GROUND, (0.0, 0.0, 0.0), name="A")]
    joints += [Joint(k, right, k + 1, left, name=f"{k + 1}-{k + 2}") for k in range(links - 1)]
    joints += [Joint(links - 1, right, GROUND, (3.0 * span, 0.0, 0.0), name="D")]
    bodies = [RigidBody(mass, bar, f"bar {k + 1}") for k in range(links)]
    system = assemble(bodies, joints, (0.0, -gravity, 0.0))
    rest = np.zeros((links, 3))
    start = State(find_centres(alpha, length), make_frames(alpha), rest, rest)
    link = Linkage(np.full(links, mass), np.zeros(links), length, gravity, (3.0 * span, 0.0))
    middle = links // 2
    E = np.array([0.0 if links % 2 else -0.5 * length, 0.0, 0.0])  # even: the joint of the two middle bars
    return Problem(
        "chain",
        system,
        start,
        t_end=20.0,
        dt=1e-3,
        section="Sect. 5.3",
        source="Sect. 5.3; span ratio from 0.9144 m and five bars; axial inertia chosen",
        observables=(
            Observable("E_x", "X_E", "m", lambda s: point_position(s, middle, E)[:, 0]),
            Observable("E_y", "Y_E", "m", lambda s: point_position(s, middle, E)[:, 1]),
            Observable("E_z", "Z_E", "m", lambda s: point_position(s, middle, E)[:, 2]),
            Observable("energy_of_mean", r"E(\bar v)", "J", partial(evaluate_energy_of_mean, system)),
            Observable("out_of_plane", "|Z|_{max}", "m", lambda s: np.max(np.abs(s.r[:, :, 2]), axis=1)),
        ),
        reference_from=partial(_certify_motion, link),
        planar_normal=np.array([0.0, 0.0, 1.0]),
        energy_allowed=ENERGY_ALLOWED,
    )


def evaluate_energy_of_mean(system: MultibodySystem, s: States) -> Float[np.ndarray, " nt"]:
    """Return the energy [J] of the mean velocity of each step, (q_m+1 - q_m)/dt under Eq. (66), of shape (nt,).

    It is T at that velocity plus the mean of V at both ends of the step; the first value is E(0). The paper does not
    print where Fig. 9a evaluates the energy, and this lies between two nodes.
    """
    before = States(s.r[:-1], s.R[:-1], 0.5 * (s.v[:-1] + s.v[1:]), 0.5 * (s.Omega[:-1] + s.Omega[1:]))
    V = potential_energy(system, s)
    return np.concatenate((energy(system, s.at(slice(0, 1))), kinetic_energy(system, before) + 0.5 * (V[:-1] + V[1:])))


def find_start_angles(links: int, span_ratio: float) -> Float[np.ndarray, " links"]:
    """Return the angles alpha [rad] to OX of the bars of three static spans of n bars each.

    tan alpha_i = -((n+1)/2 - i) a: the force in the joints has a constant horizontal part and a vertical part that
    falls by m g per bar; a bar lies along the mean of its two joint forces. The closure of a span, sum cos alpha_i =
    ``span_ratio`` n, gives a. Raise ValueError for numbers with which no span hangs.
    """
    n, rest = divmod(links, 3)
    if rest:
        raise ValueError(f"links must be a multiple of three, for three equal spans (got {links})")
    if not (n % 2) / n < span_ratio < 1.0:
        raise ValueError(
            f"span_ratio must be between {(n % 2) / n:g} and 1 for {n} bars a span to hang (got {span_ratio:g})"
        )
    lever = np.arange(1, n + 1) - 0.5 * (n + 1)

    def gap(a: float) -> float:
        """Return sum cos alpha_i less ``span_ratio`` n for the steepness ``a``."""
        return float(np.sum(1.0 / np.hypot(1.0, lever * a))) - span_ratio * n

    steep = 1.0
    while gap(steep) > 0.0:
        steep *= 2.0
    a = brentq(gap, 0.0, steep, xtol=1e-16, rtol=1e-15)
    return np.tile(np.arctan(lever * a), 3)


def find_centres(alpha: Float[np.ndarray, "*nt links"], length: float) -> Float[np.ndarray, "*nt links 3"]:
    """Return the centres of bars strung from A = 0 at angles ``alpha`` in OXY [m]."""
    bar = length * np.stack((np.cos(alpha), np.sin(alpha), np.zeros_like(alpha)), axis=-1)
    return np.cumsum(bar, axis=-2) - 0.5 * bar


def make_frames(alpha: Float[np.ndarray, "*nt links"]) -> Float[np.ndarray, "*nt links 3 3"]:
    """Return R with body x along the bar and body y along OZ: 3-1-3 angles (alpha, pi/2, 0), far from singular."""
    turn = np.zeros((*alpha.shape, 3))
    turn[..., 2] = alpha
    return so3.exp(turn) @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def _certify_motion(link: Linkage, start: State) -> CertifiedMotion | None:
    """Return the certified planar motion from ``start``; None if the start is not planar or there are too many links.

    A motion that starts in the plane, with velocities in it, stays there: only the start is examined. ``link`` is the
    chain as a linkage of rods.
    """
    planar = find_planar_angles(start, PLANE_XY)
    if planar is None:
        return None
    return certify_linkage_motion(link, *planar, SOUGHT, partial(_find_states, link.length, start))


def _find_states(
    length: float, start: State, alpha: Float[np.ndarray, "nt links"], rate: Float[np.ndarray, "nt links"]
) -> States:
    """Return the states of bars at angles ``alpha`` to OX [rad] with rates ``rate`` [rad/s].

    Each bar keeps the roll about its axis that it has in the ``start``.
    """
    c, s, zero = np.cos(alpha), np.sin(alpha), np.zeros_like(alpha)
    bar = length * np.stack((c, s, zero), axis=-1)
    across = length * np.stack((-s * rate, c * rate, zero), axis=-1)
    v = np.cumsum(across, axis=1) - 0.5 * across
    first = np.arctan2(start.R[:, 1, 0], start.R[:, 0, 0])
    rolled = np.swapaxes(make_frames(first), -1, -2) @ start.R  # roll of each bar about its axis
    R = np.stack((c, zero, s, s, zero, -c, zero, zero + 1.0, zero), axis=-1).reshape(*c.shape, 3, 3) @ rolled
    r = np.cumsum(bar, axis=1) - 0.5 * bar
    return States(r, R, v, rate[..., None] * start.R[:, 2])  # row Z of R is OZ in the body frame
