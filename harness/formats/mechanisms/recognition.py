"""Recognise joints and forces from numbers: poses, velocities and accelerations of bodies in many states.

Seen from body j, body i has the rotation Q, and its C is at d. A pair of bodies has, in all states::

    a point in common      d + Q s_i = s_j             an axis in common      Q a_i = a_j
    normal axes            a_j . Q a_i = 0             a distance             |d - s_j| = L  (point masses)

The freedoms that these leave determine the kind of joint. Joints are added, those with most rows first, as long as each
of them removes a degree of freedom. Forces are those of gravity and of springs and dampers, of joints and of point
masses on one line, that explain the accelerations.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ...mechanics.jacobian import scale_jacobian
from ...mechanics.joints import ROWS, Joint, JointKind
from ...mechanics.joints.frames import choose_normals
from ...mechanics.state import State
from ...mechanics.system import GROUND, RigidBody, SpringDamper, TorsionSpring, assemble
from .mechanism import BEHIND, NEAR

ROUNDING = 1e-12  # rounding of sums, relative to the size of their terms
RANK = 1e-7  # singular values of rows of unit length, relative to the largest, below which rows are dependent


@dataclass(frozen=True)
class Sample:
    """A state of the bodies, the twists that the joints allow there, and the accelerations."""

    state: State
    twists: Float[np.ndarray, "n d"]  # a column for each freedom: (r_dot [space], Omega [body]) of each body
    acceleration: Float[np.ndarray, "nb 6"]  # (r_ddot [space], Omega_dot [body])


@dataclass(frozen=True)
class Forces:
    """The recognised forces: gravity [m/s2, space], and linear and torsional springs with dampers."""

    gravity: Float[np.ndarray, " 3"]
    springs: tuple[SpringDamper, ...]
    torsions: tuple[TorsionSpring, ...]


def find_joints(bodies: Sequence[RigidBody], samples: Sequence[Sample]) -> tuple[list[Joint], list[Joint]]:
    """Return joints that leave the bodies exactly the freedom of the samples, and all joints that hold.

    The second list also has joints that follow from others, which the first leaves out. Raise ValueError if the samples
    have less freedom than all joints leave.
    """
    masses = [not np.any(b.inertia) for b in bodies]
    known = [j for i in range(len(bodies)) for k in range(GROUND, i) for j in _find_pair_joints(bodies, samples, i, k)]
    chosen, rank = list[Joint](), 0  # ranks are those at the second sample: a start may be singular
    holding = [j for j in known if j.j == GROUND or j.sort != JointKind.ON_LINE or not masses[j.j]]
    for joint in sorted(holding, key=lambda j: -sum(ROWS[j.sort])):
        if (more := _compute_rank(bodies, [*chosen, joint], samples[1])) > rank:
            chosen, rank = [*chosen, joint], more
    free = 6 * len(bodies) - 3 * sum(masses) - samples[1].twists.shape[1]
    if rank != free:
        joints = ", ".join(f"{j.sort} {j.name}" for j in chosen) or "none"
        raise ValueError(
            f"its bodies have {free - rank} constraints more than the joints found ({joints}): constraints on "
            "velocities alone, or joints of kinds that are not supported"
        )
    return chosen, known


def find_forces(bodies: Sequence[RigidBody], joints: Sequence[Joint], samples: Sequence[Sample]) -> Forces:
    """Return gravity, springs and dampers that give the accelerations of the samples; raise ValueError if none do.

    Springs and dampers are searched along or about the axes of ``joints``. Their coefficients solve the projected
    equations of motion of all samples, first without negative stiffness or damping, which shows the forces that are
    needed, then by least squares for these alone.
    """
    from scipy.optimize import nnls

    needed, columns, terms = [], [], 0.0  # terms: size of the summands of the forces
    # columns: gravity along X, Y, Z; then of each joint a constant load, stiffness and damping
    turning = [j for j in joints if j.sort in (JointKind.REVOLUTE, JointKind.CYLINDRICAL)]
    sliding = [j for j in joints if j.sort in (JointKind.PRISMATIC, JointKind.CYLINDRICAL, JointKind.ON_LINE)]
    for one in samples:
        inertia = _compute_inertia_forces(bodies, one).ravel()
        needed.append(one.twists.T @ inertia)
        terms = max(terms, float(np.max(np.abs(one.twists).T @ np.abs(inertia), initial=0.0)))
        found = [np.array([[*(b.mass * e), 0.0, 0.0, 0.0] for b in bodies]) for e in np.eye(3)]
        for j in turning:
            angle, rate, wrenches = _measure_angle(j, one.state, samples[0].state)
            found += [wrenches, -angle * wrenches, -rate * wrenches]
        for j in sliding:
            displacement, rate, wrenches = _measure_displacement(j, one.state, samples[0].state)
            found += [wrenches, -displacement * wrenches, -rate * wrenches]
        columns.append(np.array([one.twists.T @ f.ravel() for f in found]).T)
    A, b = np.concatenate(columns), np.concatenate(needed)
    rounding = ROUNDING * terms
    if np.max(np.abs(b), initial=0.0) <= rounding:  # no applied force: it moves by its inertia only
        return Forces(np.zeros(3), (), ())
    of_any_sign = [0, 1, 2, *range(3, A.shape[1], 3)]  # gravity and constants; stiffness and damping are >= 0
    size = np.linalg.norm(A, axis=0)
    size[size < NEAR * np.max(size, initial=0.0)] = np.inf
    signed_columns = np.concatenate((A / size, -(A / size)[:, of_any_sign]), axis=1)
    estimate = nnls(signed_columns, b, maxiter=100 * signed_columns.shape[1])[0]
    estimate[of_any_sign] -= estimate[A.shape[1] :]
    used = np.abs(estimate[: A.shape[1]]) > NEAR * np.max(np.abs(estimate), initial=0.0)
    constants = np.arange(3, A.shape[1], 3)
    points = {b for b, body in enumerate(bodies) if not np.any(body.inertia)}
    with_rest = used[constants + 1] & np.array([j.j not in points for j in (*turning, *sliding)], dtype=bool)
    by_gravity = used.copy()
    by_gravity[:3], by_gravity[constants] = True, with_rest
    # gravity may explain what looks like a constant force
    for some in (by_gravity, used) if np.any(used[constants] & ~with_rest) else (used,):
        x = np.zeros(A.shape[1])
        x[some] = np.linalg.lstsq((A / size)[:, some], b, rcond=None)[0] / size[some]
        missing = np.abs(A @ x - b)
        explained = np.max(missing) <= max(NEAR * np.max(np.abs(b)), rounding)
        if explained:
            break
    if not explained:
        raise ValueError(
            "its forces are not gravity and linear springs and dampers of joints alone, which are supported "
            f"(unexplained: {np.max(missing) / np.max(np.abs(b)):.2g} of the largest)"
        )
    parts = x[3:].reshape(-1, 3)
    torsions = [
        _make_torsion_spring(j, samples[0].state, *p) for j, p in zip(turning, parts, strict=False) if np.any(p)
    ]
    springs = [
        _make_point_spring(j, samples, *p) if j.j in points else _make_line_spring(j, *p)
        for j, p in zip(sliding, parts[len(turning) :], strict=True)
        if np.any(p)
    ]
    return Forces(x[:3], tuple(springs), tuple(torsions))


def _find_pair_joints(bodies: Sequence[RigidBody], samples: Sequence[Sample], i: int, j: int) -> Iterator[Joint]:
    """Yield the joints that hold between bodies i and j (j may be GROUND) in all samples.

    Their kind follows from the number of common axes, and from whether a point is common. If one body is a point mass,
    it becomes i.
    """
    from scipy.linalg import null_space

    if j != GROUND and np.any(bodies[i].inertia) and not np.any(bodies[j].inertia):
        i, j = j, i
    ends = [(_find_pose(s.state, i), _find_pose(s.state, j)) for s in samples]
    Q = np.array([R_j.T @ R_i for (_, R_i), (_, R_j) in ends])
    d = np.array([R_j.T @ (r_i - r_j) for (r_i, _), (r_j, R_j) in ends])
    name = f"{bodies[j].name if j != GROUND else 'ground'}-{bodies[i].name}"
    if not np.any(bodies[i].inertia):
        other_is_point = j != GROUND and not np.any(bodies[j].inertia)
        yield from (Joint(i, np.zeros(3), j, name=name, **kind) for kind in _propose_point_joints(d, other_is_point))
        return
    none = np.zeros(3)
    # rows (a_i, a_j) with Q a_i = a_j in all samples
    axes = null_space(np.concatenate([np.hstack((q, -np.eye(3))) for q in Q]), rcond=NEAR).T
    s_i, s_j, met = _find_meeting_points(Q, d, np.eye(3))
    match len(axes), met:
        case 3, True:
            e = np.eye(3)
            yield Joint(i, none, j, d[0], e[2], Q[0] @ e[2], name, JointKind.FIXED, e[0], Q[0] @ e[0])
        case 1, True:
            yield Joint(i, s_i, j, s_j, axes[0, :3], axes[0, 3:], name, JointKind.REVOLUTE)
        case 0, True:
            normal = null_space(Q.transpose(0, 2, 1).reshape(-1, 9), rcond=NEAR).T  # a_i Q^T a_j
            sides, size, others = np.linalg.svd(normal[0].reshape(3, 3)) if len(normal) == 1 else (none, none + 1, none)
            if size[1] < NEAR * size[0]:
                yield Joint(i, s_i, j, s_j, sides[:, 0], others[0], name, JointKind.UNIVERSAL)
            else:
                yield Joint(i, s_i, j, s_j, name=name)
        case 3, False:
            directions, size, _ = np.linalg.svd((d - d[0]).T, full_matrices=False)
            if size[1] < NEAR * size[0]:
                axis, u = directions[:, 0], choose_normals(directions[:, 0])[0]
                yield Joint(i, none, j, d[0], Q[0].T @ axis, axis, name, JointKind.PRISMATIC, Q[0].T @ u, u)
                return
            if size[2] < NEAR * size[0]:
                yield Joint(i, none, j, d[0], None, directions[:, 2], name, JointKind.ON_PLANE)
            for a, b in ((0, 1), (0, 2), (1, 2)):
                yield Joint(i, none, j, none, Q[0].T[:, a], np.eye(3)[b], name, JointKind.NORMAL)
        case 1, False:
            a_i, a_j = axes[0, :3], axes[0, 3:]
            across = choose_normals(a_j / np.linalg.norm(a_j))
            s_i, s_j, met = _find_meeting_points(Q, d, across)
            if met:
                length = np.linalg.norm(a_j)
                yield Joint(i, s_i, j, s_j, a_i / length, a_j / length, name, JointKind.CYLINDRICAL)
                return
            if np.ptp(d @ a_j) < NEAR * np.max(np.abs(d)):
                yield Joint(i, none, j, d[0], None, a_j, name, JointKind.ON_PLANE)
            for n in across:
                yield Joint(i, none, j, none, a_i, n, name, JointKind.NORMAL)


def _propose_point_joints(d: Float[np.ndarray, "nt 3"], other_is_point: bool) -> Iterator[dict[str, Any]]:
    """Yield keywords of ``Joint`` for a point mass at positions ``d`` [m], seen from a body or from another point mass.

    ``other_is_point`` says that it is seen from a point mass. Two point masses that stay on one line get a joint for
    springs between them, which constrains neither.
    """
    directions, size, _ = np.linalg.svd((d - d[0]).T, full_matrices=False)
    far = np.max(np.abs(d))
    moves = NEAR * far < size[0]
    if other_is_point and moves and np.linalg.norm(np.cross(d, directions[:, 0]), axis=1).max() < NEAR * far:
        yield {"s_j": np.zeros(3), "axis_j": directions[:, 0], "kind": JointKind.ON_LINE}
        return
    if not other_is_point and size[0] <= NEAR * far:
        yield {"s_j": d[0], "kind": JointKind.SPHERICAL}
    elif not other_is_point and size[1] < NEAR * size[0]:
        yield {"s_j": d[0], "axis_j": directions[:, 0], "kind": JointKind.ON_LINE}
    else:
        if not other_is_point and size[2] < NEAR * size[0]:
            yield {"s_j": d[0], "axis_j": directions[:, 2], "kind": JointKind.ON_PLANE}
        squares = np.sum(d * d, axis=1)  # = 2 d . s + L^2 - s . s
        A = np.ones((len(d), 1)) if other_is_point else np.column_stack((np.ones(len(d)), 2.0 * d))
        x = np.linalg.lstsq(A, squares, rcond=NEAR)[0]
        if np.max(np.abs(A @ x - squares)) < NEAR * far * far:
            s = np.concatenate((x[1:], np.zeros(3)))[:3]
            yield {"s_j": s, "length": float(np.sqrt(x[0] + s @ s)), "kind": JointKind.DISTANCE}


def _find_meeting_points(
    Q: Float[np.ndarray, "nt 3 3"], d: Float[np.ndarray, "nt 3"], directions: Float[np.ndarray, "k 3"]
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Return points s_i and s_j (3 each, from C, in the body's axes) that coincide along ``directions`` of body j.

    In each sample Q turns body i's axes into those of j, and ``d`` [m] is the vector from C of j to C of i in j's axes.
    The points solve directions (d + Q s_i - s_j) = 0 in all samples by least squares; where they are not unique, they
    are the shortest solution. The flag says whether they solve it within ``NEAR``.
    """
    A = np.concatenate([directions @ np.hstack((q, -np.eye(3))) for q in Q])
    b = -(d @ directions.T).ravel()
    x = np.linalg.lstsq(A, b, rcond=NEAR)[0]
    return x[:3], x[3:], bool(np.max(np.abs(A @ x - b)) <= NEAR * (np.max(np.abs(d)) + np.max(np.abs(x))))


def _find_pose(s: State, b: int) -> tuple[np.ndarray, np.ndarray]:
    """Return position of C and rotation of body ``b``; zero and the identity for the ground."""
    return (np.zeros(3), np.eye(3)) if b == GROUND else (s.r[b], s.R[b])


def _compute_rank(bodies: Sequence[RigidBody], joints: Sequence[Joint], one: Sample) -> int:
    """Return the rank of the constraint rows of ``joints`` at the state of the sample ``one``."""
    A = scale_jacobian(assemble(bodies, joints), one.state).toarray()
    size = np.linalg.svd(A, compute_uv=False)
    return int(np.sum(size > RANK * size[0]))


def _compute_inertia_forces(bodies: Sequence[RigidBody], one: Sample) -> Float[np.ndarray, "nb 6"]:
    """Return mass times acceleration with the gyroscopic torque of each body: force [N, space] and torque [N m, body].

    These are m r_ddot and J Omega_dot + Omega x J Omega.
    """
    out = np.zeros((len(bodies), 6))
    for b, (body, a, Omega) in enumerate(zip(bodies, one.acceleration, one.state.Omega, strict=True)):
        out[b] = [*(body.mass * a[:3]), *(body.inertia @ a[3:] + np.cross(Omega, body.inertia @ Omega))]
    return out


def _measure_angle(joint: Joint, s: State, start: State) -> tuple[float, float, Float[np.ndarray, "nb 6"]]:
    """Return the angle [rad] of i about the axis since the start, its rate, and the wrenches of a torque of 1 N m on i.

    They have a row (force in space, torque in the body's frame) for each body; j has the opposite torque.
    """
    (_, R_i), (_, R_j) = _find_pose(s, joint.i), _find_pose(s, joint.j)
    axis, e, u = _choose_directions(joint, start)
    now = R_j.T @ R_i @ u
    wrenches = np.zeros((s.nb, 6))
    wrenches[joint.i, 3:] = R_i.T @ R_j @ axis
    rate = wrenches[joint.i, 3:] @ s.Omega[joint.i]
    if joint.j != GROUND:
        wrenches[joint.j, 3:] = -axis
        rate -= axis @ s.Omega[joint.j]
    return float(np.arctan2(now @ np.cross(axis, e), now @ e)), float(rate), wrenches


def _measure_displacement(joint: Joint, s: State, start: State) -> tuple[float, float, Float[np.ndarray, "nb 6"]]:
    """Return the displacement [m] of i along the axis, its rate, and the wrenches of a force of 1 N along it on i.

    The displacement is that of the joint's points. ``start`` is unused: the signature and the wrenches are those of
    ``_measure_angle``.
    """
    (r_i, R_i), (r_j, R_j) = _find_pose(s, joint.i), _find_pose(s, joint.j)
    direction = np.asarray(joint.axis_j)
    axis = R_j @ direction
    point = r_i + R_i @ joint.s_i
    wrenches = np.zeros((s.nb, 6))
    wrenches[joint.i] = [*axis, *np.cross(joint.s_i, R_i.T @ axis)]
    if joint.j != GROUND:
        wrenches[joint.j] = [*(-axis), *np.cross(R_j.T @ (point - r_j), -direction)]
    rate = float(np.sum(wrenches * np.concatenate((s.v, s.Omega), axis=1)))
    return float(axis @ (point - r_j - R_j @ joint.s_j)), rate, wrenches


def _choose_directions(joint: Joint, start: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the unit axis and a unit normal to it, in the frame of j, and that normal at the start in that of i."""
    axis = np.asarray(joint.axis_j)
    axis = axis / np.linalg.norm(axis)
    e = choose_normals(axis)[0]
    return axis, e, _find_pose(start, joint.i)[1].T @ _find_pose(start, joint.j)[1] @ e


def _make_torsion_spring(joint: Joint, start: State, constant: float, k: float, c: float) -> TorsionSpring:
    """Return the spring about the joint's axis with torque constant - k angle - c rate [N m] on i.

    The angle [rad] is 0 at the start. Raise ValueError for a constant torque without stiffness.
    """
    axis, e, u = _choose_directions(joint, start)
    rest = _find_rest(joint, constant, k)
    return TorsionSpring(joint.i, u, joint.j, axis, e, k, rest, c, round(-rest / (2.0 * np.pi)))


def _make_line_spring(joint: Joint, constant: float, k: float, c: float) -> SpringDamper:
    """Return the spring along the joint's axis with force constant - k displacement - c rate [N] on i.

    Force and displacement [m], that of ``_measure_displacement``, are positive along ``axis_j``. The spring begins at a
    point of the axis ``far`` [m] behind that of j, so that its length, far + displacement, stays positive. Raise
    ValueError for a constant force without stiffness.
    """
    rest = _find_rest(joint, constant, k)
    far = BEHIND * (1.0 + abs(rest))
    behind = np.asarray(joint.s_j) - far * np.asarray(joint.axis_j)
    return SpringDamper(joint.i, joint.s_i, joint.j, behind, k, far + rest, c)


def _make_point_spring(joint: Joint, samples: Sequence[Sample], constant: float, k: float, c: float) -> SpringDamper:
    """Return the spring of two point masses on one line with force constant - k displacement - c rate [N] on i.

    It joins the masses themselves, which have no other points. Raise ValueError if it has a rest length above 0
    and the masses pass each other, and for a constant force without stiffness.
    """
    coordinates = [_measure_displacement(joint, one.state, one.state)[0] for one in samples]
    rest = _find_rest(joint, constant, k)
    side = np.sign(coordinates[0])
    if rest and np.any(np.sign(coordinates) != side):
        raise ValueError(
            f"the spring of joint {joint.name!r} has a rest length above 0, and its point masses pass each other"
        )
    return SpringDamper(joint.i, joint.s_i, joint.j, joint.s_j, k, side * rest, c)


def _find_rest(joint: Joint, constant: float, k: float) -> float:
    """Return the coordinate x [m or rad] where the load constant - k x vanishes; 0 without a load.

    Raise ValueError for a constant load without stiffness, which no spring has.
    """
    if constant and not k:
        raise ValueError(f"a constant load at joint {joint.name!r} is not supported; gravity, springs and dampers are")
    return constant / k if k else 0.0
