"""Group bodies of a MuJoCo model into ours, and correct inertias that its compiler refuses because of rounding."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from ...mechanics.added_inertia import NONE

NO_INERTIA = 2e-15  # [kg m2] in place of zero: MuJoCo's compiler requires more than 1e-15
ROUNDED = 1e-9  # relative to the largest principal moment: excess by rounding in a plate


def group_bodies(m: Any) -> Int[np.ndarray, " bodies"]:
    """Return for each body the index of the first body of its rigid group: 0 for the ground.

    Mocap bodies belong to the ground here.
    """
    out = np.array(m.body_weldid)
    for b in np.flatnonzero(m.body_mocapid >= 0):
        out[out == b] = 0
    return out


def correct_inertia(mj: Any, body: Any) -> None:
    """Change the inertia of a MuJoCo spec's ``body`` in place, where rounding alone makes the compiler refuse it.

    These are rods, plates and point masses: moments of 0 become ``NO_INERTIA``, and the largest moment is reduced to
    the sum of the others. Inertias that are valid, or wrong by more than rounding, stay as they are.
    """
    if not body.explicitinertial:
        return
    if np.isnan(body.fullinertia[0]):
        moments, largest = np.array(body.inertia), int(np.argmax(body.inertia))
        others = np.delete(np.where(moments == 0.0, NO_INERTIA, moments), largest)
        if _is_physical_inertia(moments):
            moments[largest] = max(min(moments[largest], np.sum(others)), NO_INERTIA)
        body.inertia = np.where(moments == 0.0, NO_INERTIA, moments)
        return
    xx, yy, zz, xy, xz, yz = body.fullinertia
    moments, axes = np.linalg.eigh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    enough = moments[0] > NO_INERTIA and moments[0] + moments[1] > moments[2] * (1.0 + ROUNDED)
    # of a body so small, moments are no rounding
    tiny = np.any((moments > NONE * moments[2]) & (moments <= NO_INERTIA))
    if enough or tiny or not _is_physical_inertia(moments):
        return  # the compiler accepts or refuses it as it is
    a, b = (x if x > NONE * moments[2] and x > NO_INERTIA else NO_INERTIA for x in moments[:2])
    turn, out = np.zeros(4), np.zeros(4)
    mj.mju_mat2Quat(turn, (axes * np.linalg.det(axes)).ravel())
    mj.mju_mulQuat(out, np.array(body.iquat), turn)
    body.fullinertia = np.full(6, np.nan)
    body.inertia, body.iquat = [a, b, max(min(moments[2], a + b), b)], out


def _is_physical_inertia(moments: Float[np.ndarray, "3"]) -> bool:
    """Return whether principal moments are those of a mass distribution (a + b >= c >= 0), to within rounding."""
    a, b, c = np.sort(moments)
    return bool(a >= -NONE * c and c <= (a + b) * (1.0 + ROUNDED))
