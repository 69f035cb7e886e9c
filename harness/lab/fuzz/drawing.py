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


def _tree(random: Draw, simple: bool) -> RandomMechanism:
    """Draw a tree of bodies on joints of all kinds, some of them free; with ``simple`` by simple numbers, as below."""
    n = int(random.integers(1, 5))
    places = [_vector(random, simple, n ** (1 / 3)) for _ in range(n)]
    rare = random.random() < 0.2
    connections = []
    for k in range(n):
        j = int(random.integers(GROUND, k)) if k else GROUND
        kinds = [HINGE, HINGE, HINGE, BALL, BALL, BALL, *(RARE if rare else ())]
        if random.random() > 0.15:
            kind = kinds[random.integers(len(kinds))]
            other = np.zeros(3) if j == GROUND else np.array(places[j])
            middle = 0.5 * (np.array(places[k]) + other) if not simple else other
            point = _round_if_simple(middle + np.array(_vector(random, simple, 0.3)), simple)
            connections.append(RandomJoint(kind, k, j, point, _axis(random, simple), _vector(random, simple, 2.0)))
    return _complete_mechanism(random, simple, places, connections)


def _loop(random: Draw, simple: bool) -> RandomMechanism:
    """Draw a chain of bodies in space that a ball joint closes to a loop."""
    n = int(random.integers(2, 5))
    places = [_vector(random, simple, 1.0) for _ in range(n)]
    free, connections = -3, []
    for k in range(n):
        kind = BALL if random.random() < 0.5 or (k == n - 1 and free < 1) else HINGE
        free += 3 if kind == BALL else 1
        point = _round_if_simple(np.array(places[k]) + np.array(_vector(random, simple, 0.5)), simple)
        connections.append(RandomJoint(kind, k, k - 1, point, _axis(random, simple)))
    if free < 1:
        connections[0] = RandomJoint(BALL, 0, GROUND, connections[0].point)
    connections.append(RandomJoint(BALL, n - 1, GROUND, _vector(random, simple, 1.0)))
    return _complete_mechanism(random, simple, places, connections)


def _planar(random: Draw, simple: bool) -> RandomMechanism:
    """Draw a closed polygon of bars with parallel hinges: three redundant rows."""
    n = int(random.integers(3, 5))
    flat = FLAT[random.integers(len(FLAT))] if random.random() < 0.2 else 1.0
    corners = np.array([_vector(random, simple, 1.0) for _ in range(n + 1)]) * [1.0, flat, 0.0]
    Q = np.eye(3) if simple or random.random() < 0.2 else so3.exp(random.standard_normal(3))
    axis = _vec(Q[:, 2])
    connections = [
        RandomJoint(HINGE, min(k, n - 1), k - 1 if k < n else GROUND, _vec(Q @ c), axis) for k, c in enumerate(corners)
    ]
    places = [_vec(Q @ (0.5 * (corners[k] + corners[k + 1]))) for k in range(n)]
    return _complete_mechanism(random, simple, places, connections, Q)


def _parallel(random: Draw, simple: bool) -> RandomMechanism:
    """Draw two or three equal cranks that carry one coupler: one degree of freedom, more redundant rows."""
    m = int(random.integers(2, 4))
    crank, along = np.array(_vector(random, simple, 1.0)), np.array(_vector(random, simple, 1.0))
    crank, along = crank * [1.0, 1.0, 0.0], along * [1.0, 1.0, 0.0]
    Q = np.eye(3) if simple or random.random() < 0.2 else so3.exp(random.standard_normal(3))
    axis, connections, places = _vec(Q[:, 2]), [], []
    for k in range(m):
        foot = k * along
        places.append(_vec(Q @ (foot + 0.5 * crank)))
        connections += [
            RandomJoint(HINGE, k, GROUND, _vec(Q @ foot), axis),
            RandomJoint(HINGE, m, k, _vec(Q @ (foot + crank)), axis),
        ]
    places.append(_vec(Q @ (crank + 0.5 * (m - 1) * along)))
    return _complete_mechanism(random, simple, places, connections, Q)


FAMILIES: tuple[Callable[[Draw, bool], RandomMechanism], ...] = (_tree, _tree, _loop, _planar, _parallel)


def _complete_mechanism(
    random: Draw, simple: bool, places: list[Vec], connections: list[RandomJoint], Q: Turn | None = None
) -> RandomMechanism:
    """Complete a mechanism by masses, inertias, velocities, springs and gravity.

    ``places`` are the centres of mass [m], ``connections`` the joints. ``Q`` turns the plane of a planar mechanism
    into space; gravity then lies in it half of the time.
    """
    decades, spread = (DECADES[random.integers(len(DECADES))] for _ in range(2))
    speed = SPEEDS[random.integers(len(SPEEDS))]
    bodies = []
    for place in places:
        mass = 10.0 ** (decades * random.uniform(-0.5, 0.5))
        angles = np.array(_vector(random, simple, 1.0)) * (np.pi if simple else 1.0)
        turn = _vec(angles * (simple is False or np.count_nonzero(angles) == 1))  # right angles about one axis
        velocity, spin = (_vec(speed * np.array(_vector(random, simple, 1.0))) for _ in range(2))
        mass = float(f"{mass:.1g}") if simple else mass
        bodies.append(RandomBody(mass, _inertia(random, simple, mass, spread), place, turn, velocity, spin))
    springs = []
    if random.random() < 0.4:
        for _ in range(int(random.integers(1, 3))):
            i, j = int(random.integers(len(places))), int(random.integers(GROUND, len(places)))
            ends = [_vector(random, simple, 0.3), _vector(random, simple, 1.5)]
            start = _vec(np.array(places[i]) + np.array(ends[0]))
            length = float(np.linalg.norm(np.array(start) - ends[1]))
            if i != j and length > 0.3:
                k, c = bodies[i].mass * random.uniform(5.0, 200.0), random.choice((0.0, 0.02))
                rest = length * float(random.choice((0.8, 1.0, 1.2)))
                springs.append(Spring(i, j, start, ends[1], k, rest, float(c * k)))
    down = [(0.0, 0.0, -9.81), (0.0, -9.81, 0.0), ZERO, _vec(9.81 * np.array(_axis(random, False)))]
    gravity = down[random.integers(len(down))]
    if Q is not None and random.random() < 0.5:
        gravity = _vec(Q @ np.array((0.0, -9.81, 0.0)))  # in the plane of the bars
    return RandomMechanism(tuple(bodies), tuple(connections), tuple(springs), gravity)


def _inertia(random: Draw, simple: bool, mass: float, decades: float) -> tuple[Vec, Vec, Vec]:
    """Draw the inertia of a body about C [kg m2], whose second moments differ by up to ``decades`` powers of ten.

    It satisfies the triangle inequality. A simple one has axes along those of the body.
    """
    a = mass * 0.04 * random.uniform(0.3, 1.0, 3) * 10.0 ** (-decades * random.random(3))
    if simple:
        a = mass * np.array([0.04, 0.04, 0.04 * 10.0**-decades])
    Q = np.eye(3) if simple else so3.exp(random.standard_normal(3))
    moments = Q @ np.diag(a) @ Q.T
    J = np.trace(moments) * np.eye(3) - 0.5 * (moments + moments.T)
    return _vec(J[0]), _vec(J[1]), _vec(J[2])


def _vector(random: Draw, simple: bool, size: float) -> Vec:
    """Draw a vector of three normal numbers of this size or, if simple, of multiples of a half up to one."""
    if simple:
        return _vec(0.5 * random.integers(-2, 3, 3))
    return _vec(size * random.standard_normal(3))


def _axis(random: Draw, simple: bool) -> Vec:
    """Draw a unit vector; a simple one is an axis of space."""
    return _vec(np.eye(3)[random.integers(3)]) if simple else _vec(so3.exp(random.standard_normal(3))[0])


def _round_if_simple(x: np.ndarray, simple: bool) -> Vec:
    """Return the vector ``x`` as a tuple, rounded to multiples of a half if ``simple``."""
    return _vec(np.round(2.0 * x) / 2.0 if simple else x)


def _vec(x: np.ndarray) -> Vec:
    """Return an array of three numbers as a tuple of floats."""
    a, b, c = (float(v) for v in x)
    return a, b, c
