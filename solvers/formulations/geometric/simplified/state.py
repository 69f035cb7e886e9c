"""Arrays of the simplified method, and where it applies."""

from typing import NamedTuple

import numpy as np

from ..arrays import Model
from ..choices import Settings
from ..index1.blocks import Blocks
from ..index1.kernel import Kernel, empty_kernel

DEPTH = 4  # past steps from which the next one is extrapolated


class Lean(NamedTuple):
    """State of the march and room for one step; suffix 0: its start. Arms and unit torques are in space."""

    model: Model
    blocks: Blocks
    k: Kernel  # r, R, v: the start between steps, the estimate of the end within
    r0: np.ndarray  # (nb, 3)
    R0: np.ndarray  # (nb, 3, 3)
    v0: np.ndarray  # (nb, 6)
    known: np.ndarray  # (nb, 6) the part of w that the end does not change
    w: np.ndarray  # (nb, 6) impulses in space, then velocities
    spin: np.ndarray  # (nb, 3) R Omega
    arm: np.ndarray  # (nj, 2, 3)
    b0: np.ndarray  # (nj, 2, 3) arm0 + B arm_dot0
    a: np.ndarray  # (nj, 2, 3) unit torques of the axis rows
    a0: np.ndarray  # (nj, 2, 3) a + B a_dot at the start
    f_bar: np.ndarray  # (nj, 3) of the point rows; others have none under gravity
    f_bar0: np.ndarray  # (nj, 3)
    nu: np.ndarray  # (nrows,)
    nu_start: np.ndarray  # (nrows,)
    acceleration: np.ndarray  # (DEPTH, nb, 6) means over the last steps, in turn; the newest in ``newest(past[0])``
    impulse: np.ndarray  # (DEPTH, nrows) (nu1 - nu0) / dt of these steps
    middle: np.ndarray  # (DEPTH,) [s] their middles
    weight: np.ndarray  # (DEPTH,) theirs in the estimate of the next step
    past: np.ndarray  # (2,) int: steps known of the past, whether ``k.L`` is a factor
    rank: np.ndarray  # (2,) int: of the rows, at the start and at the last factor
    log_det: np.ndarray  # (2,) ``log_determinant`` at the last factor, and its change there


def empty_lean(model: Model) -> Lean:
    """Room for a system."""
    k, blocks = empty_kernel(model)
    nb, nj, nrows = len(model.mass), len(model.body), int(model.row[-1])
    return Lean(
        model=model, blocks=blocks, k=k, r0=np.zeros((nb, 3)), R0=np.zeros((nb, 3, 3)), v0=np.zeros((nb, 6)),
        known=np.zeros((nb, 6)), w=np.zeros((nb, 6)), spin=np.zeros((nb, 3)), arm=np.zeros((nj, 2, 3)),
        b0=np.zeros((nj, 2, 3)), a=np.zeros((nj, 2, 3)), a0=np.zeros((nj, 2, 3)), f_bar=np.zeros((nj, 3)),
        f_bar0=np.zeros((nj, 3)), nu=np.zeros(nrows), nu_start=np.zeros(nrows), acceleration=np.zeros((DEPTH, nb, 6)),
        impulse=np.zeros((DEPTH, nrows)), middle=np.zeros(DEPTH), weight=np.zeros(DEPTH),
        past=np.zeros(2, dtype=np.int64), rank=np.zeros(2, dtype=np.int64), log_det=np.zeros(2),
    )  # fmt: skip


def applies(settings: Settings, model: Model) -> bool:
    """Whether this method solves the step that ``settings`` describe."""
    plain = not (settings.corrective or settings.carry_sigma or settings.penalty.nested)
    gravity_alone = len(model.spring_body) == 0 and len(model.load_body) == 0
    return plain and settings.simplified == 1 and gravity_alone and bool(np.all(model.pins))
