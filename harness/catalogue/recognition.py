"""Joints and forces recognised from numbers: poses, velocities and accelerations of bodies in many states.

Seen from body j, body i has the rotation Q and its C is at d. A pair of bodies has, over all states::

    a point in common      d + Q s_i = s_j             an axis in common      Q a_i = a_j
    normal axes            a_j . Q a_i = 0             a distance             |d - s_j| = L  (point masses)

What these leave free is a kind of joint. Joints are added, those of most rows first, as long as each of them takes a
freedom away. Forces are those of gravity and of springs and dampers, of joints and of point masses on one line, that
explain the accelerations.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..mechanics.jacobian import even_jacobian
from ..mechanics.joints import ROWS, Joint, JointKind
from ..mechanics.joints.frames import normals_of
from ..mechanics.state import State
from ..mechanics.system import GROUND, RigidBody, SpringDamper, TorsionSpring, assemble
from .mechanism import BEHIND, NEAR

ROUNDING = 1e-12  # of sums, of the size of their terms
RANK = 1e-7  # of the largest singular value of rows of length one


@dataclass(frozen=True)
class Sample:
    """A state, the twists that the joints allow, and its accelerations."""

    state: State
    twists: Float[np.ndarray, "n d"]  # (r_dot [space], Omega [body]) of each body
    acceleration: Float[np.ndarray, "nb 6"]


@dataclass(frozen=True)
class Forces:
    """Gravity, and springs with dampers."""

    gravity: Float[np.ndarray, " 3"]
    springs: tuple[SpringDamper, ...]
    torsions: tuple[TorsionSpring, ...]


def find_joints(bodies: Sequence[RigidBody], samples: Sequence[Sample]) -> tuple[list[Joint], list[Joint]]:
    """Joints that leave the bodies no other freedom than the samples have, and all that hold; or ValueError."""
    masses = [not np.any(b.inertia) for b in bodies]
    known = [j for i in range(len(bodies)) for k in range(GROUND, i) for j in _find_joints(bodies, samples, i, k)]
    chosen, rank = list[Joint](), 0
    holding = [j for j in known if j.j == GROUND or j.sort != JointKind.ON_LINE or not masses[j.j]]
    for joint in sorted(holding, key=lambda j: -sum(ROWS[j.sort])):
        if (more := _rank(bodies, [*chosen, joint], samples[1])) > rank:
            chosen, rank = [*chosen, joint], more
    free = 6 * len(bodies) - 3 * sum(masses) - samples[1].twists.shape[1]
    if rank != free:
        joints = ", ".join(f"{j.sort} {j.name}" for j in chosen) or "none"
        raise ValueError(f"its bodies have {free - rank} restrictions more than the joints found ({joints}); of "
                         "velocities alone, or of joints of no kind here")  # fmt: skip
    return chosen, known


def find_forces(bodies: Sequence[RigidBody], joints: Sequence[Joint], samples: Sequence[Sample]) -> Forces:
    """Forces that give the accelerations of the samples, or ValueError; ``joints``: those that may have springs."""
    from scipy.optimize import nnls

    needed, columns, terms = [], [], 0.0  # terms: what the forces needed are the sum of
    turning = [j for j in joints if j.sort in (JointKind.REVOLUTE, JointKind.CYLINDRICAL)]
    sliding = [j for j in joints if j.sort in (JointKind.PRISMATIC, JointKind.CYLINDRICAL, JointKind.ON_LINE)]
    for one in samples:
        inertia = _inertia_forces(bodies, one).ravel()
        needed.append(one.twists.T @ inertia)
        terms = max(terms, float(np.max(np.abs(one.twists).T @ np.abs(inertia), initial=0.0)))
        found = [np.array([[*(b.mass * e), 0.0, 0.0, 0.0] for b in bodies]) for e in np.eye(3)]
        for j in turning:
            angle, rate, push = _measure_angle(j, one.state, samples[0].state)
            found += [push, -angle * push, -rate * push]
        for j in sliding:
            way, rate, push = _slide(j, one.state, samples[0].state)
            found += [push, -way * push, -rate * push]
        columns.append(np.array([one.twists.T @ f.ravel() for f in found]).T)
    A, b = np.concatenate(columns), np.concatenate(needed)
    rounding = ROUNDING * terms
    if np.max(np.abs(b), initial=0.0) <= rounding:  # it moves by its inertia alone
        return Forces(np.zeros(3), (), ())
    signed = [0, 1, 2, *range(3, A.shape[1], 3)]  # stiffness and damping are never negative
    size = np.linalg.norm(A, axis=0)
    size[size < NEAR * np.max(size, initial=0.0)] = np.inf
    both = np.concatenate((A / size, -(A / size)[:, signed]), axis=1)
    rough = nnls(both, b, maxiter=100 * both.shape[1])[0]
    rough[signed] -= rough[A.shape[1] :]
    used = np.abs(rough[: A.shape[1]]) > NEAR * np.max(np.abs(rough), initial=0.0)
    pushes = np.arange(3, A.shape[1], 3)
    points = {b for b, body in enumerate(bodies) if not np.any(body.inertia)}
    rests = used[pushes + 1] & np.array([j.j not in points for j in (*turning, *sliding)], dtype=bool)
    by_gravity = used.copy()
    by_gravity[:3], by_gravity[pushes] = True, rests
    for some in (by_gravity, used) if np.any(used[pushes] & ~rests) else (used,):  # pushes that gravity may replace
        x = np.zeros(A.shape[1])
        x[some] = np.linalg.lstsq((A / size)[:, some], b, rcond=None)[0] / size[some]
        missing = np.abs(A @ x - b)
        explained = np.max(missing) <= max(NEAR * np.max(np.abs(b)), rounding)
        if explained:
            break
    if not explained:
        raise ValueError("its forces are not gravity and linear springs and dampers of joints alone "
                         f"({np.max(missing) / np.max(np.abs(b)):.2g} of the largest is left)")  # fmt: skip
    parts = x[3:].reshape(-1, 3)
    torsions = [_torsion(j, samples[0].state, *p) for j, p in zip(turning, parts, strict=False) if np.any(p)]
    springs = [_between_points(j, samples, *p) if j.j in points else _spring(j, *p)
               for j, p in zip(sliding, parts[len(turning) :], strict=True) if np.any(p)]  # fmt: skip
    return Forces(x[:3], tuple(springs), tuple(torsions))


def _find_joints(bodies: Sequence[RigidBody], samples: Sequence[Sample], i: int, j: int) -> Iterator[Joint]:
    """Joints that hold between two bodies; a point mass is taken for i."""
    from scipy.linalg import null_space

    if j != GROUND and np.any(bodies[i].inertia) and not np.any(bodies[j].inertia):
        i, j = j, i
    ends = [(_pose(s.state, i), _pose(s.state, j)) for s in samples]
    Q = np.array([R_j.T @ R_i for (_, R_i), (_, R_j) in ends])
    d = np.array([R_j.T @ (r_i - r_j) for (r_i, _), (r_j, R_j) in ends])
    name = f"{bodies[j].name if j != GROUND else 'ground'}-{bodies[i].name}"
    if not np.any(bodies[i].inertia):
        point = j != GROUND and not np.any(bodies[j].inertia)
        yield from (Joint(i, np.zeros(3), j, name=name, **kind) for kind in _of_point(d, point))
        return
    none = np.zeros(3)
    axes = null_space(np.concatenate([np.hstack((q, -np.eye(3))) for q in Q]), rcond=NEAR).T
    s_i, s_j, met = _meet(Q, d, np.eye(3))
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
            ways, size, _ = np.linalg.svd((d - d[0]).T, full_matrices=False)
            if size[1] < NEAR * size[0]:
                u = normals_of(ways[:, 0])[0]
                yield Joint(i, none, j, d[0], Q[0].T @ ways[:, 0], ways[:, 0], name, JointKind.PRISMATIC, Q[0].T @ u, u)
                return
            if size[2] < NEAR * size[0]:
                yield Joint(i, none, j, d[0], None, ways[:, 2], name, JointKind.ON_PLANE)
            for a, b in ((0, 1), (0, 2), (1, 2)):
                yield Joint(i, none, j, none, Q[0].T[:, a], np.eye(3)[b], name, JointKind.NORMAL)
        case 1, False:
            a_i, a_j = axes[0, :3], axes[0, 3:]
            across = normals_of(a_j / np.linalg.norm(a_j))
            s_i, s_j, met = _meet(Q, d, across)
            if met:
                length = np.linalg.norm(a_j)
                yield Joint(i, s_i, j, s_j, a_i / length, a_j / length, name, JointKind.CYLINDRICAL)
                return
            if np.ptp(d @ a_j) < NEAR * np.max(np.abs(d)):
                yield Joint(i, none, j, d[0], None, a_j, name, JointKind.ON_PLANE)
            for n in across:
                yield Joint(i, none, j, none, a_i, n, name, JointKind.NORMAL)


def _of_point(d: Float[np.ndarray, "nt 3"], point: bool) -> Iterator[dict[str, Any]]:
    """Joints of a point mass that is at ``d``, seen from a body or from another ``point``.

    Two point masses on one line have that of springs between them, which holds neither.
    """
    ways, size, _ = np.linalg.svd((d - d[0]).T, full_matrices=False)
    far = np.max(np.abs(d))
    if point and NEAR * far < size[0] and np.linalg.norm(np.cross(d, ways[:, 0]), axis=1).max() < NEAR * far:
        yield {"s_j": np.zeros(3), "axis_j": ways[:, 0], "kind": JointKind.ON_LINE}
        return
    if not point and size[0] <= NEAR * far:
        yield {"s_j": d[0], "kind": JointKind.SPHERICAL}
    elif not point and size[1] < NEAR * size[0]:
        yield {"s_j": d[0], "axis_j": ways[:, 0], "kind": JointKind.ON_LINE}
    else:
        if not point and size[2] < NEAR * size[0]:
            yield {"s_j": d[0], "axis_j": ways[:, 2], "kind": JointKind.ON_PLANE}
        squares = np.sum(d * d, axis=1)  # = 2 d . s + L^2 - s . s
        A = np.ones((len(d), 1)) if point else np.column_stack((np.ones(len(d)), 2.0 * d))
        x = np.linalg.lstsq(A, squares, rcond=NEAR)[0]
        if np.max(np.abs(A @ x - squares)) < NEAR * far * far:
            s = np.concatenate((x[1:], np.zeros(3)))[:3]
            yield {"s_j": s, "length": float(np.sqrt(x[0] + s @ s)), "kind": JointKind.DISTANCE}


def _meet(Q: np.ndarray, d: np.ndarray, ways: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """s_i and s_j with ways (d + Q s_i - s_j) = 0, and whether there are any."""
    A = np.concatenate([ways @ np.hstack((q, -np.eye(3))) for q in Q])
    b = -(d @ ways.T).ravel()
    x = np.linalg.lstsq(A, b, rcond=NEAR)[0]
    return x[:3], x[3:], bool(np.max(np.abs(A @ x - b)) <= NEAR * (np.max(np.abs(d)) + np.max(np.abs(x))))


def _pose(s: State, b: int) -> tuple[np.ndarray, np.ndarray]:
    return (np.zeros(3), np.eye(3)) if b == GROUND else (s.r[b], s.R[b])


def _rank(bodies: Sequence[RigidBody], joints: Sequence[Joint], one: Sample) -> int:
    A = even_jacobian(assemble(bodies, joints), one.state).toarray()
    size = np.linalg.svd(A, compute_uv=False)
    return int(np.sum(size > RANK * size[0]))


def _inertia_forces(bodies: Sequence[RigidBody], one: Sample) -> Float[np.ndarray, "nb 6"]:
    """M a, and what turns the spin: a rigid body's m r_ddot, J Omega_dot + Omega x J Omega."""
    out = np.zeros((len(bodies), 6))
    for b, (body, a, Omega) in enumerate(zip(bodies, one.acceleration, one.state.Omega, strict=True)):
        out[b] = [*(body.mass * a[:3]), *(body.inertia @ a[3:] + np.cross(Omega, body.inertia @ Omega))]
    return out


def _measure_angle(joint: Joint, s: State, start: State) -> tuple[float, float, Float[np.ndarray, "nb 6"]]:
    """Angle of i about the axis since the start, its rate, and a torque of 1 N m about it on i, in body frames."""
    (_, R_i), (_, R_j) = _pose(s, joint.i), _pose(s, joint.j)
    axis, e, u = _across(joint, start)
    now = R_j.T @ R_i @ u
    push = np.zeros((s.nb, 6))
    push[joint.i, 3:] = R_i.T @ R_j @ axis
    rate = push[joint.i, 3:] @ s.Omega[joint.i]
    if joint.j != GROUND:
        push[joint.j, 3:] = -axis
        rate -= axis @ s.Omega[joint.j]
    return float(np.arctan2(now @ np.cross(axis, e), now @ e)), float(rate), push


def _slide(joint: Joint, s: State, start: State) -> tuple[float, float, Float[np.ndarray, "nb 6"]]:
    """Way of i along the axis, its rate, and a force of 1 N along it on i."""
    (r_i, R_i), (r_j, R_j) = _pose(s, joint.i), _pose(s, joint.j)
    way = np.asarray(joint.axis_j)
    axis = R_j @ way
    point = r_i + R_i @ joint.s_i
    push = np.zeros((s.nb, 6))
    push[joint.i] = [*axis, *np.cross(joint.s_i, R_i.T @ axis)]
    if joint.j != GROUND:
        push[joint.j] = [*(-axis), *np.cross(R_j.T @ (point - r_j), -way)]
    rate = float(np.sum(push * np.concatenate((s.v, s.Omega), axis=1)))
    return float(axis @ (point - r_j - R_j @ joint.s_j)), rate, push


def _across(joint: Joint, start: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    axis = np.asarray(joint.axis_j)
    axis = axis / np.linalg.norm(axis)
    e = normals_of(axis)[0]
    return axis, e, _pose(start, joint.i)[1].T @ _pose(start, joint.j)[1] @ e


def _torsion(joint: Joint, start: State, push: float, k: float, c: float) -> TorsionSpring:
    axis, e, u = _across(joint, start)
    rest = _rest(joint, push, k)
    return TorsionSpring(joint.i, u, joint.j, axis, e, k, rest, c, round(-rest / (2.0 * np.pi)))


def _spring(joint: Joint, push: float, k: float, c: float) -> SpringDamper:
    rest = _rest(joint, push, k)
    far = BEHIND * (1.0 + abs(rest))
    behind = np.asarray(joint.s_j) - far * np.asarray(joint.axis_j)
    return SpringDamper(joint.i, joint.s_i, joint.j, behind, k, far + rest, c)


def _between_points(joint: Joint, samples: Sequence[Sample], push: float, k: float, c: float) -> SpringDamper:
    """Of two point masses on one line, which have no point beside their own."""
    ways, rest = [_slide(joint, one.state, one.state)[0] for one in samples], _rest(joint, push, k)
    side = np.sign(ways[0])
    if rest and np.any(np.sign(ways) != side):
        raise ValueError(f"the spring of {joint.name} has a length at rest, and its point masses pass each other")
    return SpringDamper(joint.i, joint.s_i, joint.j, joint.s_j, k, side * rest, c)


def _rest(joint: Joint, push: float, k: float) -> float:
    if push and not k:
        raise ValueError(f"a constant push along or about the axis of {joint.name}: gravity, springs and dampers only")
    return push / k if k else 0.0
