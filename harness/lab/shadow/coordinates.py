"""Compute joint coordinates from poses and velocities of bodies without correcting them: loops may be open."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ...mechanics.joint_tree import Limb, Tree
from ...mechanics.state import States


def compute_coordinates(tree: Tree, s: States) -> Float[np.ndarray, "nt ny"]:
    """Return the joint coordinates and their rates (q, u) of a motion at all times, by the joints of the tree alone.

    Joints that close loops are not used. Angles and quaternions are continuous from row to row.
    """
    nt, nb = s.r.shape[:2]
    q, u = np.zeros((nt, tree.nq)), np.zeros((nt, tree.nu))
    R = np.broadcast_to(np.eye(3), (nt, nb + 1, 3, 3)).copy()  # the last row is the ground
    omega, P, v = (np.zeros((nt, nb + 1, 3)) for _ in range(3))
    R[:, :-1] = tree.base @ s.R @ np.swapaxes(tree.frames, 1, 2)
    omega[:, :-1] = np.einsum("bij,tbj->tbi", tree.frames, s.Omega)
    omega[:, :-1] = np.einsum("tbij,tbj->tbi", R[:, :-1], omega[:, :-1])
    # P and v are position and velocity of the point of each body at its joint; R and omega its rotation, all in space
    for limb in tree.limbs:
        b, p, ns = limb.body, limb.parent, len(limb.slides)
        to_C = R[:, b] @ limb.centre
        P[:, b] = s.r[:, b] @ tree.base.T - to_C
        v[:, b] = s.v[:, b] @ tree.base.T - np.cross(omega[:, b], to_C)
        L = P[:, b] - P[:, p]
        q_own, u_own = q[:, limb.q_at : limb.q_at + limb.sizes[0]], u[:, limb.u_at : limb.u_at + limb.sizes[1]]
        q_own[:, :ns] = (np.einsum("tji,tj->ti", R[:, p], L) - limb.arm) @ limb.slides.T
        speed = v[:, b] - v[:, p] - np.cross(omega[:, p], L)
        u_own[:, :ns] = np.einsum("tji,tj->ti", R[:, p], speed) @ limb.slides.T
        if limb.ball:
            q_own[:, ns:] = _compute_quaternions(R[:, b])
            u_own[:, ns:] = omega[:, b]
        elif len(limb.turns):
            _write_hinge_angles(limb, np.swapaxes(R[:, p], 1, 2) @ R[:, b], q_own[:, ns:])
            relative = np.einsum("tji,tj->ti", R[:, p], omega[:, b] - omega[:, p])
            u_own[:, ns:] = _compute_hinge_rates(limb, q_own[:, ns:], relative)
    return np.hstack((q, u))


def _compute_quaternions(R: np.ndarray) -> np.ndarray:
    """Return quaternions (nt, 4), scalar first, with signs continuous from row to row, and scalar >= 0 at the start."""
    out = Rotation.from_matrix(R).as_quat(scalar_first=True)
    flips = np.sign(np.sum(out[1:] * out[:-1], axis=1))
    first = 1.0 if out[0, 0] >= 0.0 else -1.0
    return out * (first * np.cumprod(np.concatenate(([1.0], np.where(flips < 0.0, -1.0, 1.0)))))[:, None]


def _write_hinge_angles(limb: Limb, R: np.ndarray, out: np.ndarray) -> None:
    """Write the angles [rad] of a limb's one or two hinges into ``out`` (nt, 1 or 2), continuous from row to row.

    They follow from its rotations ``R`` (nt, 3, 3) relative to its parent: R = exp(q_1 hat(a_1)) exp(q_2 hat(a_2)).
    """
    if len(limb.turns) == 2:
        first, second = limb.turns
        out[:, 0] = _measure_angle(first, second, R @ second)
        R = np.swapaxes(Rotation.from_rotvec(out[:, :1] * first).as_matrix(), 1, 2) @ R
    normal = np.linalg.svd(limb.turns[-1][None])[2][1]
    out[:, -1] = _measure_angle(limb.turns[-1], normal, R @ normal)
    out[:] = np.unwrap(out, axis=0)


def _measure_angle(axis: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the angles [rad] about ``axis`` from the direction ``start`` to the directions ``end`` (nt, 3)."""
    start = start - (start @ axis) * axis
    return np.arctan2(end @ np.cross(axis, start), end @ start)


def _compute_hinge_rates(limb: Limb, q: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return the rates [rad/s] of a limb's one or two hinges by least squares.

    ``q`` are its angles [rad], ``omega`` (nt, 3) is its angular velocity relative to its parent, in the parent's frame.
    """
    axes = np.broadcast_to(limb.turns, (len(q), *limb.turns.shape)).copy()
    if len(limb.turns) == 2:
        axes[:, 1] = Rotation.from_rotvec(q[:, :1] * limb.turns[0]).apply(limb.turns[1])
    return np.einsum("tij,tj->ti", np.linalg.pinv(np.swapaxes(axes, 1, 2)), omega)
