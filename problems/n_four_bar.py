"""N four-bar windows in a row (IFToMM library, A02): redundant rows, singular where all bars lie along one line.

Numbers: A02: N + 1 uprights on the ground at X = 0 .. N and N couplers, all 1 m and 1 kg, slender; revolute joints
about OZ, upright at the start with v(B0) = (1, 0), gravity along -Y, 10 s (github RehabEngGroup/
MBSbenchmarksInOpenSim, A02). The library's published curve is that of 40 windows: its text says 2, which is 0.69 m
away from it, its code and its plot say 40. The axial inertia is not given: 1e-4 kg m2, without effect on planar motion.
Reference: one angle, the uprights as one rod with the couplers on its end; certified (problems/exact/certification).
"""

from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import GROUND, Joint, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact.certification import CertifiedMotion
from .exact.linkage import Linkage
from .exact.linkage_motion import PLANE_XY, certify_linkage_motion, find_planar_angles
from .exact.planar import AXIS, OZ, make_planar_states, make_slender_bar

MASS, LENGTH, AXIAL = 1.0, 1.0, 1e-4  # [kg], [m], [kg m2] of every bar
SOUGHT = 20.0  # [s] duration to certify
PARALLEL = 1e-9  # [rad], [rad/s] difference of parallel uprights: the tolerance of a start


@problem("n_four_bar", tests=(Trait.SINGULAR, Trait.REDUNDANT))
def n_four_bar(
    *,
    windows: Annotated[int, Parameter("N, the number of four-bar cells", "", at_least=1, at_most=10_000)] = 40,
    speed: Annotated[float, Parameter("speed of B0 at the start, along OX", "m/s")] = 1.0,
    gravity: Annotated[float, Parameter("along -Y", "m/s2")] = 9.81,
) -> Problem:
    """Model IFToMM A02: N four-bar windows with one degree of freedom and two singular positions per turn."""
    bars = [make_slender_bar(MASS, LENGTH, AXIAL, f"upright {k}") for k in range(windows + 1)]
    bars += [make_slender_bar(MASS, LENGTH, AXIAL, f"coupler {k}") for k in range(windows)]
    low, high = (-0.5 * LENGTH, 0.0, 0.0), (0.5 * LENGTH, 0.0, 0.0)
    joints = [Joint(k, low, GROUND, (k * LENGTH, 0.0, 0.0), AXIS, OZ, f"A{k}") for k in range(windows + 1)]
    for k in range(windows):
        joints += [
            Joint(windows + 1 + k, end, k + e, high, AXIS, AXIS, f"B{k + e}") for e, end in enumerate((low, high))
        ]
    system = assemble(bars, joints, (0.0, -gravity, 0.0))
    start = np.array([[0.5 * np.pi]]), np.array([[-speed / LENGTH]])
    rod = Linkage(np.array([MASS * (windows + 1)]), np.array([MASS * windows]), LENGTH, gravity)
    B0 = np.array(high)
    return Problem(
        "n_four_bar",
        system,
        _find_states(windows, *start)[0],
        t_end=10.0,
        dt=1e-2,
        section="",
        source="IFToMM library of computational benchmarks, A02; axial inertia chosen",
        observables=(
            Observable("B0_x", "X_{B0}", "m", lambda s: point_position(s, 0, B0)[:, 0]),
            Observable("B0_y", "Y_{B0}", "m", lambda s: point_position(s, 0, B0)[:, 1]),
        ),
        reference_from=partial(_certify_motion, windows, rod),
        planar_normal=np.array([0.0, 0.0, 1.0]),
    )


def _find_states(windows: int, angle: Float[np.ndarray, "nt 1"], rate: Float[np.ndarray, "nt 1"]) -> States:
    """Return the states of all bars, uprights first, from the uprights' angle to OX [rad] and its rate [rad/s]."""
    k, upright = np.arange(2 * windows + 1), np.arange(2 * windows + 1) <= windows
    up = LENGTH * np.stack((np.cos(angle), np.sin(angle)), axis=-1) * np.where(upright, 0.5, 1.0)[:, None]
    foot = np.where(upright, k, k - windows - 0.5) * LENGTH
    v = rate[:, :, None] * np.stack((-up[..., 1], up[..., 0]), axis=-1)
    centre = up + np.stack((foot, np.zeros_like(foot)), axis=-1)
    return make_planar_states(centre, np.where(upright, angle, 0.0), v, np.where(upright, rate, 0.0))


def _certify_motion(windows: int, rod: Linkage, start: State) -> CertifiedMotion | None:
    """Return the certified motion from ``start``, computed as that of one ``rod`` with the mass of all uprights.

    Return None if at the start the uprights are not parallel, since the motion may be on another branch, or if the
    start is not planar. A motion that starts in the plane stays there.
    """
    planar = find_planar_angles(start, PLANE_XY)
    if planar is None or any(np.ptp(a[: windows + 1]) > PARALLEL for a in planar):
        return None
    angle, rate = (a[:1] for a in planar)
    return certify_linkage_motion(rod, angle, rate, SOUGHT, partial(_find_states, windows))
