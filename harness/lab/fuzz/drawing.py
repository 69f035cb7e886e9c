"""Draw mechanisms: trees, free bodies, loops in space and in a plane, over-constrained ones turned against the axes.

A third of them have simple numbers, multiples of a half and of a right angle, where special cases of a code lie. Masses
and inertias differ by up to four decades, some bodies spin fast, some loops start nearly flat, where they are singular.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from ...mechanics import so3
from ...mechanics.consistency import InconsistentStart
from ...mechanics.joints import JointKind
from ...mechanics.system import GROUND
from .mechanism import ZERO, RandomBody, RandomJoint, RandomMechanism, Spring, Vec

HINGE, BALL = JointKind.REVOLUTE, JointKind.SPHERICAL
RARE = (JointKind.PRISMATIC, JointKind.CYLINDRICAL, JointKind.FIXED, JointKind.DISTANCE)
SPEEDS, DECADES, FLAT = (0.0, 1.0, 1.0, 3.0, 30.0), (0.0, 0.0, 1.0, 2.0, 4.0), (0.01, 0.1)
TRIES = 50  # draws until a velocity satisfies the joints: fewer fail for rare families, more only delay that message
Draw = np.random.Generator
Turn = Float[np.ndarray, "3 3"]


def draw_mechanism(seed: int, number: int) -> RandomMechanism:
    """Draw mechanism ``number`` of a campaign, the same one every time; raise ValueError if ``TRIES`` draws fail."""
    for attempt in range(TRIES):
        random = np.random.default_rng((seed, number, attempt))
        family = FAMILIES[random.integers(len(FAMILIES))]
        try:
            drawn = family(random, bool(random.random() < 0.35)).choose_step()
            if drawn.problem().initial.nb:
                return drawn
        except (InconsistentStart, ValueError, np.linalg.LinAlgError):  # no velocity satisfies the joints: draw again
            continue
    raise ValueError(f"no mechanism could be drawn from seed {seed}, number {number}")


def _draw_tree(random: Draw, simple: bool) -> RandomMechanism:
    """Draw a tree of one to four bodies on joints of all kinds, some of them free.

    With ``simple`` points, axes and velocities are simple numbers (see ``_draw_vector``), as in all families.
    """
    n = int(random.integers(1, 5))
    places = [_draw_vector(random, simple, n ** (1 / 3)) for _ in range(n)]
    rare = random.random() < 0.2
    connections = []
    for k in range(n):
        j = int(random.integers(GROUND, k)) if k else GROUND
        kinds = [HINGE, HINGE, HINGE, BALL, BALL, BALL, *(RARE if rare else ())]
        if random.random() > 0.15:
            kind = kinds[random.integers(len(kinds))]
            other = np.zeros(3) if j == GROUND else np.array(places[j])
            middle = 0.5 * (np.array(places[k]) + other) if not simple else other
            point = _round_if_simple(middle + np.array(_draw_vector(random, simple, 0.3)), simple)
            connections.append(
                RandomJoint(kind, k, j, point, _draw_axis(random, simple), _draw_vector(random, simple, 2.0))
            )
    return _complete_mechanism(random, simple, places, connections)


def _draw_loop(random: Draw, simple: bool) -> RandomMechanism:
    """Draw a chain of two to four bodies in space that a ball joint to the ground closes to a loop."""
    n = int(random.integers(2, 5))
    places = [_draw_vector(random, simple, 1.0) for _ in range(n)]
    free, connections = -3, []
    for k in range(n):
        kind = BALL if random.random() < 0.5 or (k == n - 1 and free < 1) else HINGE
        free += 3 if kind == BALL else 1
        point = _round_if_simple(np.array(places[k]) + np.array(_draw_vector(random, simple, 0.5)), simple)
        connections.append(RandomJoint(kind, k, k - 1, point, _draw_axis(random, simple)))
    if free < 1:
        connections[0] = RandomJoint(BALL, 0, GROUND, connections[0].point)
    connections.append(RandomJoint(BALL, n - 1, GROUND, _draw_vector(random, simple, 1.0)))
    return _complete_mechanism(random, simple, places, connections)


def _draw_planar_loop(random: Draw, simple: bool) -> RandomMechanism:
    """Draw a closed polygon of bars with parallel hinges, which has three redundant rows; one in five is nearly flat.

    Its plane is turned in space, except if ``simple`` and for one in five others.
    """
    n = int(random.integers(3, 5))
    flat = FLAT[random.integers(len(FLAT))] if random.random() < 0.2 else 1.0
    corners = np.array([_draw_vector(random, simple, 1.0) for _ in range(n + 1)]) * [1.0, flat, 0.0]
    Q = np.eye(3) if simple or random.random() < 0.2 else so3.exp(random.standard_normal(3))
    axis = _make_tuple(Q[:, 2])
    connections = [
        RandomJoint(HINGE, min(k, n - 1), k - 1 if k < n else GROUND, _make_tuple(Q @ c), axis)
        for k, c in enumerate(corners)
    ]
    places = [_make_tuple(Q @ (0.5 * (corners[k] + corners[k + 1]))) for k in range(n)]
    return _complete_mechanism(random, simple, places, connections, Q)


def _draw_parallel_cranks(random: Draw, simple: bool) -> RandomMechanism:
    """Draw two or three equal cranks that carry one coupler: one degree of freedom, three or more redundant rows.

    Their plane is turned in space as that of ``_draw_planar_loop``.
    """
    m = int(random.integers(2, 4))
    crank, along = np.array(_draw_vector(random, simple, 1.0)), np.array(_draw_vector(random, simple, 1.0))
    crank, along = crank * [1.0, 1.0, 0.0], along * [1.0, 1.0, 0.0]
    Q = np.eye(3) if simple or random.random() < 0.2 else so3.exp(random.standard_normal(3))
    axis, connections, places = _make_tuple(Q[:, 2]), [], []
    for k in range(m):
        foot = k * along
        places.append(_make_tuple(Q @ (foot + 0.5 * crank)))
        connections += [
            RandomJoint(HINGE, k, GROUND, _make_tuple(Q @ foot), axis),
            RandomJoint(HINGE, m, k, _make_tuple(Q @ (foot + crank)), axis),
        ]
    places.append(_make_tuple(Q @ (crank + 0.5 * (m - 1) * along)))
    return _complete_mechanism(random, simple, places, connections, Q)


FAMILIES: tuple[Callable[[Draw, bool], RandomMechanism], ...] = (
    _draw_tree,
    _draw_tree,
    _draw_loop,
    _draw_planar_loop,
    _draw_parallel_cranks,
)


def _complete_mechanism(
    random: Draw, simple: bool, places: list[Vec], connections: list[RandomJoint], Q: Turn | None = None
) -> RandomMechanism:
    """Return a mechanism of these joints, with masses, inertias, velocities, springs and gravity drawn at random.

    ``places`` are the centres of mass [m], ``connections`` the joints. ``Q`` turns the plane of a planar mechanism into
    space; gravity then lies in it half of the time.
    """
    decades, spread = (DECADES[random.integers(len(DECADES))] for _ in range(2))
    speed = SPEEDS[random.integers(len(SPEEDS))]
    bodies = []
    for place in places:
        mass = 10.0 ** (decades * random.uniform(-0.5, 0.5))
        angles = np.array(_draw_vector(random, simple, 1.0)) * (np.pi if simple else 1.0)
        turns_simply = np.count_nonzero(angles) == 1  # by right angles about one axis
        turn = _make_tuple(angles * (simple is False or turns_simply))
        velocity, spin = (_make_tuple(speed * np.array(_draw_vector(random, simple, 1.0))) for _ in range(2))
        mass = float(f"{mass:.1g}") if simple else mass
        bodies.append(RandomBody(mass, _draw_inertia(random, simple, mass, spread), place, turn, velocity, spin))
    springs = []
    if random.random() < 0.4:
        for _ in range(int(random.integers(1, 3))):
            i, j = int(random.integers(len(places))), int(random.integers(GROUND, len(places)))
            ends = [_draw_vector(random, simple, 0.3), _draw_vector(random, simple, 1.5)]
            start = _make_tuple(np.array(places[i]) + np.array(ends[0]))
            length = float(np.linalg.norm(np.array(start) - ends[1]))
            if i != j and length > 0.3:
                k, c = bodies[i].mass * random.uniform(5.0, 200.0), random.choice((0.0, 0.02))
                rest = length * float(random.choice((0.8, 1.0, 1.2)))
                springs.append(Spring(i, j, start, ends[1], k, rest, float(c * k)))
    down = [(0.0, 0.0, -9.81), (0.0, -9.81, 0.0), ZERO, _make_tuple(9.81 * np.array(_draw_axis(random, False)))]
    gravity = down[random.integers(len(down))]
    if Q is not None and random.random() < 0.5:
        gravity = _make_tuple(Q @ np.array((0.0, -9.81, 0.0)))  # in the plane of the bars
    return RandomMechanism(tuple(bodies), tuple(connections), tuple(springs), gravity)


def _draw_inertia(random: Draw, simple: bool, mass: float, decades: float) -> tuple[Vec, Vec, Vec]:
    """Draw the inertia of a body about C [kg m2], whose second moments differ by up to ``decades`` powers of ten.

    It satisfies the triangle inequality. A simple one is diagonal, and symmetric about the third axis.
    """
    a = mass * 0.04 * random.uniform(0.3, 1.0, 3) * 10.0 ** (-decades * random.random(3))
    if simple:
        a = mass * np.array([0.04, 0.04, 0.04 * 10.0**-decades])
    Q = np.eye(3) if simple else so3.exp(random.standard_normal(3))
    moments = Q @ np.diag(a) @ Q.T
    J = np.trace(moments) * np.eye(3) - 0.5 * (moments + moments.T)
    return _make_tuple(J[0]), _make_tuple(J[1]), _make_tuple(J[2])


def _draw_vector(random: Draw, simple: bool, size: float) -> Vec:
    """Draw a vector of three normal numbers of standard deviation ``size``.

    A simple one has multiples of a half between -1 and 1, whatever the size.
    """
    if simple:
        return _make_tuple(0.5 * random.integers(-2, 3, 3))
    return _make_tuple(size * random.standard_normal(3))


def _draw_axis(random: Draw, simple: bool) -> Vec:
    """Draw a unit vector; a simple one is an axis of space."""
    return _make_tuple(np.eye(3)[random.integers(3)]) if simple else _make_tuple(so3.exp(random.standard_normal(3))[0])


def _round_if_simple(x: np.ndarray, simple: bool) -> Vec:
    """Return the vector ``x`` as a tuple, rounded to multiples of a half if ``simple``."""
    return _make_tuple(np.round(2.0 * x) / 2.0 if simple else x)


def _make_tuple(x: np.ndarray) -> Vec:
    """Return an array of three numbers as a tuple of floats."""
    a, b, c = (float(v) for v in x)
    return a, b, c
