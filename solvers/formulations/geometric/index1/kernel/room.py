"""Room for one evaluation, and how its functions are compiled."""

from typing import NamedTuple

import numpy as np

from ...arrays import Model
from ...vectors import INNER
from ..blocks import WIDTH, Blocks, analyse

HOT = {**INNER, "forceinline": True}
FUSED = {**HOT, "fastmath": {"contract"}}  # products and sums in one rounding: linear algebra


class Kernel(NamedTuple):
    """Room for one evaluation. Rows of X, gamma, lam are those of phi; velocities (nb, 6) as in ``State``."""

    t: np.ndarray  # (1,) [s], to be set before rows and forces are evaluated
    r: np.ndarray  # (nb, 3)
    R: np.ndarray  # (nb, 3, 3)
    v: np.ndarray  # (nb, 6)
    v_dot: np.ndarray  # (nb, 6)
    force: np.ndarray  # (nb, 6): applied force [space], torque about C [body], gyroscopic term included
    X: np.ndarray  # (nj, 2, WIDTH, 3)
    Y: np.ndarray  # (nj, 2, WIDTH, 3): X J^-1
    way: np.ndarray  # (nj, WIDTH, 3): f of each row, 0 for axis rows
    L: np.ndarray  # (nblocks, WIDTH, WIDTH): S, then its factor; diagonal entries inverted, 0 for a redundant row
    gamma: np.ndarray  # (nrows,)
    phi: np.ndarray  # (nrows,)
    slip: np.ndarray  # (nrows,) phi_t of moving rows: A v + phi_t = 0
    lam: np.ndarray  # (nrows,) reaction conjugate to phi
    rhs: np.ndarray  # (nrows,)
    diagonal: np.ndarray  # (nrows,) of S, what its pivots are compared with
    line: np.ndarray  # (6, 3) of a spring
    change: (
        np.ndarray
    )  # (nb, 6) of v_dot, while lent inertia is taken back; the angular accelerations that it is sought by
    spun: np.ndarray  # (nb, 3)
    left: np.ndarray  # (nb, 3)
    toward: np.ndarray  # (nb, 3)


def empty_kernel(model: Model) -> tuple[Kernel, Blocks]:
    """Arrays and analysis of a system."""
    blocks = analyse(model)
    nb, nj, nr = len(model.mass), len(model.body), int(model.row[-1])
    way = np.zeros((nj, WIDTH, 3))
    way[model.pins > 0, :3] = np.eye(3)
    room = Kernel(
        t=np.zeros(1), slip=np.zeros(nr),
        r=np.zeros((nb, 3)), R=np.zeros((nb, 3, 3)), v=np.zeros((nb, 6)), v_dot=np.zeros((nb, 6)),
        force=np.zeros((nb, 6)), X=np.zeros((nj, 2, WIDTH, 3)), Y=np.zeros((nj, 2, WIDTH, 3)), way=way,
        L=np.zeros((len(blocks.other), WIDTH, WIDTH)), gamma=np.zeros(nr), phi=np.zeros(nr), lam=np.zeros(nr),
        rhs=np.zeros(nr), diagonal=np.zeros(nr), line=np.zeros((6, 3)), change=np.zeros((nb, 6)),
        spun=np.zeros((nb, 3)), left=np.zeros((nb, 3)), toward=np.zeros((nb, 3)),
    )  # fmt: skip
    return room, blocks
