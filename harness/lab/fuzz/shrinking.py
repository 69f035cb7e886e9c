"""Shrink a mechanism on which a code still behaves as before: fewer parts, then simple numbers, then less time."""

from collections.abc import Callable, Iterator
from dataclasses import replace

from ...mechanics.joints import JointKind
from ...mechanics.system import GROUND
from .mechanism import ZERO, RandomBody, RandomJoint, RandomMechanism, Spring, Vec
from .oracle import Oracle, OracleOutcome
from .presenting import Form

MOST = 300  # largest number of trials
CLEAR = 3.0  # times its limit: a deviation that exceeds this must still do so
FEWEST_STEPS = 4  # shorter runs make smaller cases, but show less of what differs
BALL = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
Case = tuple[RandomMechanism, Form]


def shrink_case(case: Case, keeps_kind: Callable[[Case], bool], most: int = MOST) -> Case:
    """Return the smallest case found for which ``keeps_kind`` holds, by accepting every change that preserves it.

    Changes are tried again until none is accepted, or ``keeps_kind`` was called ``most`` times.
    """
    calls_left, changed = most, True
    while changed:
        changed = False
        for list_changes in (_list_smaller_cases, _list_simpler_cases):
            position = 0
            while calls_left:
                candidate = next((c for k, c in enumerate(list_changes(case)) if k == position), None)
                if candidate is None:
                    break
                calls_left -= 1
                if candidate != case and keeps_kind(candidate):
                    case, changed = candidate, True
                else:
                    position += 1
    return case


def shrink_outcome(
    oracle: Oracle, found: OracleOutcome, examine: Callable[[Oracle], OracleOutcome], most: int = MOST
) -> tuple[Oracle, OracleOutcome]:
    """Return the smallest mechanism and form with an outcome of the same kind as ``found``, and that outcome.

    ``examine`` returns the outcome of an oracle. ``oracle`` itself is returned if ``found`` cannot be repeated.
    """

    def keeps_kind(case: Case) -> bool:
        """Return whether the code behaves alike on a case, with a deviation as clear."""
        try:
            now = examine(Oracle(*case, oracle.floor))
            return now.kind == found.kind and now.strength >= min(CLEAR, found.strength)
        except Exception:  # no start satisfies the joints, or no code accepts the numbers: not a smaller case
            return False

    first = (oracle.mechanism, found.form)
    case = shrink_case(first, keeps_kind, most) if keeps_kind(first) else (oracle.mechanism, oracle.form)
    smallest = Oracle(*case, oracle.floor)
    return smallest, replace(examine(smallest), number=found.number)


def _list_smaller_cases(case: Case) -> Iterator[Case]:
    """Yield cases with one part fewer: a change of the form, a body, a spring, a joint, or half of the steps.

    A body is removed with its joints, or replaced by the ground.
    """
    m, form = case
    yield from ((m, part) for part in form.list_smaller_forms())
    for b in range(len(m.bodies)):
        for grounded in (False, True):
            if len(m.bodies) > 1 and form.split != b + 1:
                yield _remove_body(m, b, grounded), _remove_from_form(form, m, b)
    for k in range(len(m.springs)):
        yield replace(m, springs=m.springs[:k] + m.springs[k + 1 :]), form
    for k in range(len(m.connections)):
        left = replace(m, connections=m.connections[:k] + m.connections[k + 1 :])
        yield left, _renumber_duplicate(form, len(left.connections), k)
    if m.steps > FEWEST_STEPS:
        yield replace(m, steps=max(m.steps // 2, FEWEST_STEPS)), form


def _list_simpler_cases(case: Case) -> Iterator[Case]:
    """Yield cases with simpler numbers: first changes of all parts together, then of one part at a time."""
    m, form = case
    yield replace(m, gravity=ZERO), form
    yield replace(m, gravity=(0.0, 0.0, -10.0)), form
    for turned in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        if any(form.rotation):
            yield m, replace(form, rotation=turned)
    if form.plain.renumber > 1:
        yield m, replace(form, plain=replace(form.plain, renumber=1))
    for digits in (1, 2):
        yield _round_numbers(m, digits), form
    plainer: tuple[Callable[[RandomBody], RandomBody], ...] = (_stop_body, _align_body, _simplify_mass)
    for change in plainer:
        yield replace(m, bodies=tuple(map(change, m.bodies))), form
    for k, b in enumerate(m.bodies):
        for change in (*plainer, *(_move_body_to(place) for place in dict.fromkeys(c.point for c in m.connections))):
            yield replace(m, bodies=(*m.bodies[:k], change(b), *m.bodies[k + 1 :])), form
    for k, c in enumerate(m.connections):
        for simple in (replace(c, kind=JointKind.SPHERICAL, axis=(0.0, 0.0, 1.0)), replace(c, axis=(0.0, 0.0, 1.0))):
            if c.kind == simple.kind or c.kind == JointKind.REVOLUTE:
                yield replace(m, connections=(*m.connections[:k], simple, *m.connections[k + 1 :])), form
    for s in range(len(m.springs)):
        plain = replace(m.springs[s], damping=0.0, stiffness=100.0, rest=1.0)
        yield replace(m, springs=(*m.springs[:s], plain, *m.springs[s + 1 :])), form
    for digits in (1, 2):
        for k, b in enumerate(m.bodies):
            yield replace(m, bodies=(*m.bodies[:k], _round_body(b, digits), *m.bodies[k + 1 :])), form
        for k, c in enumerate(m.connections):
            yield replace(m, connections=(*m.connections[:k], _round_joint(c, digits), *m.connections[k + 1 :])), form


def _remove_body(m: RandomMechanism, body: int, grounded: bool) -> RandomMechanism:
    """Return the mechanism without a body and its joints and springs or, if ``grounded``, with ground in its place."""

    def renumber(b: int) -> int:
        """Return the number of body ``b`` after the removal; ``GROUND`` for the removed body."""
        return GROUND if b == body else b - (b > body)

    bodies = m.bodies[:body] + m.bodies[body + 1 :]
    connections = [
        replace(c, i=renumber(c.i), j=renumber(c.j))
        if renumber(c.i) != GROUND
        else replace(
            c, i=renumber(c.j), j=renumber(c.i), point=c.far if c.kind == JointKind.DISTANCE else c.point, far=c.point
        )
        for c in m.connections
        if _is_kept(c, body, grounded) and renumber(c.i) != renumber(c.j)
    ]
    springs = [
        replace(s, i=renumber(s.i), j=renumber(s.j))
        if renumber(s.i) != GROUND
        else replace(s, i=renumber(s.j), j=renumber(s.i), point_i=s.point_j, point_j=s.point_i)
        for s in m.springs
        if _is_kept(s, body, grounded) and renumber(s.i) != renumber(s.j)
    ]
    return replace(m, bodies=bodies, connections=tuple(connections), springs=tuple(springs))


def _is_kept(part: RandomJoint | Spring, body: int, grounded: bool) -> bool:
    """Return whether a joint or spring stays when number ``body`` is removed: always if it becomes the ground."""
    return grounded or body not in (part.i, part.j)


def _remove_from_form(form: Form, m: RandomMechanism, body: int) -> Form:
    """Return ``form`` for mechanism ``m`` without number ``body``: later bodies count one less.

    If the joint that it duplicates is one of that body, the first joint is duplicated instead.
    """
    split = form.split - (form.split > body + 1)
    duplicate = form.plain.duplicate
    if duplicate and body in (m.connections[duplicate - 1].i, m.connections[duplicate - 1].j):
        duplicate = 1
    return replace(form, split=split, plain=replace(form.plain, duplicate=duplicate))


def _renumber_duplicate(form: Form, left: int, joint: int) -> Form:
    """Return the form after joint number ``joint`` is removed and ``left`` joints remain.

    The joint that it duplicates, counted from 1, is renumbered, or replaced if it is the one removed.
    """
    duplicate = form.plain.duplicate
    duplicate = min(max(duplicate - (duplicate > joint), 1), left) if duplicate else 0
    return replace(form, plain=replace(form.plain, duplicate=duplicate))


def _stop_body(b: RandomBody) -> RandomBody:
    """Return the body without velocities."""
    return replace(b, velocity=ZERO, spin=ZERO)


def _align_body(b: RandomBody) -> RandomBody:
    """Return the body with its axes along those of space."""
    return replace(b, turn=ZERO)


def _simplify_mass(b: RandomBody) -> RandomBody:
    """Return the body with a mass of 1 kg and the inertia of a ball."""
    return replace(b, mass=1.0, inertia=BALL)


def _move_body_to(place: Vec) -> Callable[[RandomBody], RandomBody]:
    """Return a function that moves a body's C to ``place`` [m]."""
    return lambda b: replace(b, place=place)


def _round_vector(x: Vec, digits: int) -> Vec:
    """Return a vector rounded to a number of significant digits; tiny components become 0."""
    a, b, c = (float(f"{v:.{digits}g}") if abs(v) > 1e-12 else 0.0 for v in x)
    return a, b, c


def _round_numbers(m: RandomMechanism, digits: int) -> RandomMechanism:
    """Return the mechanism with all numbers rounded to ``digits`` significant digits, its step to one."""
    return replace(
        m,
        bodies=tuple(_round_body(b, digits) for b in m.bodies),
        connections=tuple(_round_joint(c, digits) for c in m.connections),
        springs=tuple(_round_spring(s, digits) for s in m.springs),
        gravity=_round_vector(m.gravity, digits),
        dt=float(f"{m.dt:.1g}"),
    )


def _round_body(b: RandomBody, digits: int) -> RandomBody:
    """Return the body with all numbers rounded to ``digits`` significant digits."""
    J = b.inertia
    return RandomBody(
        float(f"{b.mass:.{digits}g}"),
        (_round_vector(J[0], digits), _round_vector(J[1], digits), _round_vector(J[2], digits)),
        _round_vector(b.place, digits),
        _round_vector(b.turn, digits),
        _round_vector(b.velocity, digits),
        _round_vector(b.spin, digits),
    )


def _round_joint(c: RandomJoint, digits: int) -> RandomJoint:
    """Return the joint with its points and axis rounded to ``digits`` significant digits."""
    return replace(
        c, point=_round_vector(c.point, digits), axis=_round_vector(c.axis, digits), far=_round_vector(c.far, digits)
    )


def _round_spring(s: Spring, digits: int) -> Spring:
    """Return the spring with its points and numbers rounded to ``digits`` significant digits."""
    points = {"point_i": _round_vector(s.point_i, digits), "point_j": _round_vector(s.point_j, digits)}
    numbers = {name: float(f"{getattr(s, name):.{digits}g}") for name in ("stiffness", "rest", "damping")}
    return replace(s, **points, **numbers)  # type: ignore[arg-type]
