"""Grid of four-bar linkages with redundant joints (Sect. 5.5, Fig. 12), hanging from the ground, with initial rates.

Numbers: Sect. 5.5: 5 x 5 cells, bars of 1 m and 1 kg, revolute joints along OX, gravity along -Z, 2 pi/3 rad/s, 10 s,
energy drift of 1 J allowed. "Negligible" axial inertia: 1e-4 kg m2, without effect on planar motion. The wording
("the six top bodies") sets only the top row turning (``top_row``: the rows below translate); ``all_rows`` turns all.
Reference: every row stays a set of parallel bars, so it moves as one rod with the mass of its verticals, the
horizontals riding on its end; certified (problems/exact/certification, docs/decisions).
"""

from collections.abc import Callable
from functools import partial
from typing import Annotated

import numpy as np
from jaxtyping import Float

from ..harness.catalogue.options import Parameter
from ..harness.catalogue.registry import problem
from ..harness.mechanics.motion import point_position
from ..harness.mechanics.state import State, States
from ..harness.mechanics.system import GROUND, Joint, MultibodySystem, RigidBody, assemble
from ..harness.mechanics.types import Observable, Problem, Trait
from .exact.certification import CertifiedMotion
from .exact.linkage import Linkage
from .exact.linkage_motion import certify_linkage_motion, find_planar_angles

ENERGY_ALLOWED = 1.0  # [J] Sect. 5.5
AXIS = (0.0, 0.0, 1.0)  # joint axis in every bar: body z = OX; then 3-1-3 angles stay at theta = pi/2
BAR_ALONG_Y = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # R of the horizontal bars
PLANE = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # columns OY, OZ, and the normal OX
PARALLEL = 1e-9  # [rad], [rad/s] difference of parallel bars: the tolerance of a start
SOUGHT = 20.0  # [s] duration to certify


@problem("four_bar_grid", tests=(Trait.SINGULAR, Trait.REDUNDANT))
def four_bar_grid(
    *,
    rows: Annotated[int, Parameter("rows of cells, one degree of freedom each", "", at_least=1, at_most=100)] = 5,
    columns: Annotated[int, Parameter("cells in a row", "", at_least=1, at_most=100)] = 5,
    release: Annotated[str, Parameter("which rows turn at the start", "", choices=("top_row", "all_rows"))] = "top_row",
    rate: Annotated[float, Parameter("initial rate of these rows about OX", "rad/s")] = 2.0 * np.pi / 3.0,
    mass: Annotated[float, Parameter("mass of a bar", "kg", above=0.0)] = 1.0,
    length: Annotated[float, Parameter("length of a bar", "m", above=0.0)] = 1.0,
    axial_inertia: Annotated[float, Parameter("inertia of a bar about its axis", "kg m2", at_least=0.0)] = 1e-4,
    mass_spread: Annotated[
        float, Parameter("relative spread of the masses, uniformly distributed", "", at_least=0.0, at_most=0.9)
    ] = 0.0,
    mass_seed: Annotated[int, Parameter("seed of mass_spread", "", at_least=0)] = 0,
    gravity: Annotated[float, Parameter("along -Z", "m/s2")] = 9.81,
) -> Problem:
    """Swing a grid of parallelogram cells on revolute joints: redundant rows, one degree of freedom per row."""
    nb = rows * (2 * columns + 1)
    spread = np.random.default_rng(mass_seed).uniform(-1.0, 1.0, nb)
    masses = mass * (1.0 + mass_spread * spread)
    bodies = [
        _make_bar(m, length, axial_inertia, name) for m, name in zip(masses, _name_bars(rows, columns), strict=True)
    ]
    system = assemble(bodies, _make_joints(rows, columns, length), (0.0, 0.0, -gravity))
    turns = np.zeros(rows)
    turns[: 1 if release == "top_row" else rows] = rate
    start = make_grid_states(np.zeros((1, rows)), turns[None], columns, length)[0]
    foot = np.array([0.5 * length, 0.0, 0.0])
    last = (rows - 1) * (2 * columns + 1) + columns
    observables = [
        Observable(name, symbol, unit, of)
        for i in range(rows)
        for name, symbol, unit, of in (
            (f"angle_{i + 1}", rf"\varphi_{{{i + 1}}}", "rad", _make_angle_function(i * (2 * columns + 1))),
            (f"rate_{i + 1}", rf"\dot\varphi_{{{i + 1}}}", "rad/s", _make_rate_function(i * (2 * columns + 1))),
        )
    ]
    observables += [
        Observable("bottom_left_y", "Y_{BL}", "m", lambda s: point_position(s, last - columns, foot)[:, 1]),
        Observable("bottom_left_z", "Z_{BL}", "m", lambda s: point_position(s, last - columns, foot)[:, 2]),
        Observable("bottom_right_y", "Y_{BR}", "m", lambda s: point_position(s, last, foot)[:, 1]),
        Observable("bottom_right_z", "Z_{BR}", "m", lambda s: point_position(s, last, foot)[:, 2]),
    ]
    return Problem(
        "four_bar_grid",
        system,
        start,
        t_end=10.0,
        dt=1e-2,
        section="Sect. 5.5",
        source="Sect. 5.5; axial inertia chosen",
        observables=tuple(observables),
        reference_from=partial(_certify_motion, system, rows, columns, length, gravity),
        planar_normal=np.array([1.0, 0.0, 0.0]),
        energy_allowed=ENERGY_ALLOWED,
    )


def make_grid_states(
    angle: Float[np.ndarray, "nt rows"], rate: Float[np.ndarray, "nt rows"], columns: int, length: float
) -> States:
    """Return the states of all bars from the row angles about OX [rad], 0 hanging, and their rates [rad/s].

    Bodies are ordered by rows from the top: ``columns + 1`` verticals from left to right, then ``columns`` horizontals.
    """
    nt, rows = angle.shape
    zero = np.zeros_like(angle)
    # (nt, rows, 3), downwards along a vertical bar
    along = length * np.stack((zero, np.sin(angle), -np.cos(angle)), axis=-1)
    across = length * np.stack((zero, np.cos(angle), np.sin(angle)), axis=-1)
    foot, foot_v = np.cumsum(along, axis=1), np.cumsum(rate[..., None] * across, axis=1)
    n = 2 * columns + 1
    place = np.concatenate((np.arange(columns + 1.0), np.arange(columns) + 0.5))  # position along OY in bar lengths
    middle = np.where(np.arange(n) <= columns, 0.5, 0.0)[:, None]  # verticals have C half a bar above the foot
    r = foot[:, :, None] - middle * along[:, :, None] + place[:, None] * np.array([0.0, length, 0.0])
    v = foot_v[:, :, None] - middle * (rate[..., None] * across)[:, :, None]
    R = np.empty((nt, rows, n, 3, 3))
    R[:, :, columns + 1 :] = BAR_ALONG_Y
    R[:, :, : columns + 1, :, 0] = (along / length)[:, :, None]
    R[:, :, : columns + 1, :, 1] = (across / length)[:, :, None]
    R[:, :, : columns + 1, :, 2] = (1.0, 0.0, 0.0)
    Omega = np.zeros((nt, rows, n, 3))
    Omega[:, :, : columns + 1, 2] = rate[..., None]
    nb = rows * n
    return States(r.reshape(nt, nb, 3), R.reshape(nt, nb, 3, 3), v.reshape(nt, nb, 3), Omega.reshape(nt, nb, 3))


def _make_bar(mass: float, length: float, axial_inertia: float, name: str) -> RigidBody:
    """Return a slender bar along body x; ``axial_inertia`` is about that axis [kg m2]."""
    transverse = mass * length**2 / 12.0
    return RigidBody(mass, np.diag([axial_inertia, transverse, transverse]), name)


def _name_bars(rows: int, columns: int) -> list[str]:
    """Return the names of all bars in the order of ``make_grid_states``: ``v1,0`` for a vertical, ``h1,0`` across."""
    across = [f"v{{0}},{j}" for j in range(columns + 1)] + [f"h{{0}},{j}" for j in range(columns)]
    return [name.format(i + 1) for i in range(rows) for name in across]


def _make_joints(rows: int, columns: int, length: float) -> list[Joint]:
    """Return the joints: the top row is hinged to the ground, and at each node all other bars to the vertical above it.

    ``length`` is that of a bar [m].
    """
    n = 2 * columns + 1
    head, tail = (-0.5 * length, 0.0, 0.0), (0.5 * length, 0.0, 0.0)
    joints = [
        Joint(j, head, GROUND, (0.0, j * length, 0.0), AXIS, (1.0, 0.0, 0.0), name=f"ground {j}")
        for j in range(columns + 1)
    ]
    for i in range(rows):
        for j in range(columns + 1):
            above = i * n + j
            meeting = [(i * n + columns + j, tail)] if j > 0 else []  # the horizontal from the left ends here
            meeting += [(i * n + columns + 1 + j, head)] if j < columns else []
            meeting += [((i + 1) * n + j, head)] if i + 1 < rows else []
            joints += [
                Joint(body, end, above, tail, AXIS, AXIS, name=f"node {i + 1},{j}: {k + 1}")
                for k, (body, end) in enumerate(meeting)
            ]
    return joints


def _make_angle_function(body: int) -> Callable[[States], Float[np.ndarray, " nt"]]:
    """Return the function of states for a vertical bar's angle about OX [rad], continuous in time."""
    return lambda s: np.unwrap(np.arctan2(s.R[:, body, 1, 0], -s.R[:, body, 2, 0]))


def _make_rate_function(body: int) -> Callable[[States], Float[np.ndarray, " nt"]]:
    """Return the function of states for a vertical bar's rate about OX [rad/s]."""
    return lambda s: s.Omega[:, body, 2]


def _certify_motion(
    system: MultibodySystem, rows: int, columns: int, length: float, gravity: float, start: State
) -> CertifiedMotion | None:
    """Return the certified motion from ``start``, computed as that of one rod per row.

    Return None if the bars of a row are not parallel, if the start is not planar, or if there are too many rows.
    """
    planar = find_planar_angles(start, PLANE)
    if planar is None:
        return None
    verticals = columns + 1
    angle, rate = (a.reshape(rows, -1)[:, :verticals] for a in planar)
    if max(np.max(np.ptp(angle, axis=1)), np.max(np.ptp(rate, axis=1))) > PARALLEL:
        return None
    mass = system.mass.reshape(rows, -1)
    link = Linkage(mass[:, :verticals].sum(axis=1), mass[:, verticals:].sum(axis=1), length, gravity)
    return certify_linkage_motion(link, angle[:, 0], rate[:, 0], SOUGHT, partial(_find_states, columns, length))


def _find_states(
    columns: int, length: float, angle: Float[np.ndarray, "nt rows"], rate: Float[np.ndarray, "nt rows"]
) -> States:
    """Return the states of all bars from angles of the rods to OY [rad] and rates [rad/s]."""
    return make_grid_states(angle + 0.5 * np.pi, rate, columns, length)  # hanging is -pi/2 from OY
