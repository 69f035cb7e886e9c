"""Integrate the true flow over many short segments at once, by DOP853 with as many equal steps in each as it needs."""

import numpy as np
from jaxtyping import Float, Int

from ....solvers.formulations.methods.tableaux import DOPRI853
from .equations import FlowEquations
from .lanes import pack_lanes, unpack_lanes

TOLERANCE = 1e-12  # error of a step, relative to 1 + |y|
ROUGH = 1e-9  # the same for intermediate iterations
COARSER = 10  # steps of the flow for one of its tangents, whose error is then about 1e-5 instead of 1e-12
MOST_STEPS = 512  # steps in a segment
TOGETHER = 2**15  # numbers of tangents processed together, of which a step has twelve


def integrate_flow(
    E: FlowEquations,
    t: Float[np.ndarray, " n"],
    h: Float[np.ndarray, " n"],
    y: Float[np.ndarray, "n ny"],
    steps: Int[np.ndarray, " n"],
    tolerance: float = TOLERANCE,
    most: int = MOST_STEPS,
) -> Float[np.ndarray, "n ny"]:
    """Integrate from the states ``y`` at t to t + h [s], doubling ``steps`` in place; return the states there.

    ``steps`` of each segment are doubled, up to ``most``, until the error of a step is below ``tolerance``. States are
    NaN where that is not reached.
    """
    out, left = np.full_like(y, np.nan), np.arange(len(y))
    while len(left):
        again = []
        for n in np.unique(steps[left]):
            own = left[steps[left] == n]
            z, error = _march(E, t[own], h[own] / n, y[own], int(n))
            bad = ~(error < tolerance)
            out[own[~bad]] = z[~bad]
            again.append(own[bad])
        left = np.concatenate(again)
        left = left[steps[left] < most]
        steps[left] *= 2
    return out


def transport_changes(
    E: FlowEquations,
    t: Float[np.ndarray, " n"],
    h: Float[np.ndarray, " n"],
    y: Float[np.ndarray, "n ny"],
    Y: Float[np.ndarray, "n m ny"],
    steps: Int[np.ndarray, " n"],
) -> Float[np.ndarray, "n m ny"]:
    """Return the small changes of the states at t + h [s] that the changes ``Y`` of those at t cause.

    ``steps`` are those that ``integrate_flow`` needed.
    """
    few, lanes = -(-steps // COARSER), pack_lanes(Y)
    size = max(1, TOGETHER // lanes[0].size)
    for n in np.unique(few):
        group = np.flatnonzero(few == n)
        for own in np.array_split(group, -(-len(group) // size)):
            lanes[own] = _transport_steps(E, t[own], h[own] / n, y[own], lanes[own], int(n))
    return unpack_lanes(lanes, Y.shape[1])


def _march(E: FlowEquations, t: np.ndarray, h: np.ndarray, y: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return y after n steps of h [s] of DOP853, and the largest error of a step, relative to 1 + |y|."""
    c, a, b, e = DOPRI853.c, DOPRI853.a, DOPRI853.b, DOPRI853.error
    K = np.empty((len(b) + 1, *y.shape))
    K[0] = E.evaluate_rate(t, y)
    worst = np.zeros(len(y))
    with np.errstate(all="ignore"):
        for step in range(n):
            at = t + step * h
            for i in range(1, len(b)):
                K[i] = E.evaluate_rate(at + c[i] * h, y + h[:, None] * np.tensordot(a[i, :i], K[:i], 1))
            y = y + h[:, None] * np.tensordot(b, K[:-1], 1)
            K[-1] = E.evaluate_rate(at + h, y)
            first, second = (np.mean((np.tensordot(x, K, 1) / (1.0 + np.abs(y))) ** 2, axis=1) for x in e)
            norm = np.abs(h) * first / np.sqrt(first + 0.01 * second)
            worst = np.maximum(worst, np.where(first > 0.0, norm, first))
            K[0] = K[-1]
    return y, worst


def _transport_steps(
    E: FlowEquations, t: np.ndarray, h: np.ndarray, y: np.ndarray, Y: np.ndarray, n: int
) -> np.ndarray:
    """Return the changes ``Y`` after n steps of h [s] along the motion from y, by the variational equations."""
    c, a, b = DOPRI853.c, DOPRI853.a, DOPRI853.b
    K, D = np.empty((len(b), *y.shape)), np.empty((len(b), *Y.shape))
    for step in range(n):
        at = t + step * h
        for i in range(len(b)):
            y_i = y + h[:, None] * np.tensordot(a[i, :i], K[:i], 1)
            Y_i = Y + h[:, None, None, None] * np.tensordot(a[i, :i], D[:i], 1)
            K[i], D[i] = E.evaluate_rate(at + c[i] * h, y_i), E.evaluate_tangent(at + c[i] * h, y_i, Y_i)
        y = y + h[:, None] * np.tensordot(b, K, 1)
        Y = Y + h[:, None, None, None] * np.tensordot(b, D, 1)
    return Y
