"""Integrate the true flow over many short segments at once, by DOP853 with as many equal steps in each as it needs."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ...base.tableaux import DOPRI853, evaluate_stages
from .equations import FlowEquations
from .lanes import pack_lanes, unpack_lanes

TOLERANCE = 1e-12  # error of a step, relative to 1 + |y|
ROUGH = 1e-9  # the same for intermediate iterations
COARSER = 10  # steps of the flow for one of its tangents, whose error is then about 1e-5 instead of 1e-12
MOST_STEPS = 512  # steps in a segment
TOGETHER = 2**15  # numbers of tangents processed together, of which a step has twelve

Arrays = list[np.ndarray]


def integrate_flow(
    E: FlowEquations,
    t: Float[np.ndarray, " n"],
    h: Float[np.ndarray, " n"],
    y: Float[np.ndarray, "n ny"],
    steps: Int[np.ndarray, " n"],
    tolerance: float = TOLERANCE,
    most: int = MOST_STEPS,
) -> Float[np.ndarray, "n ny"]:
    """Return the states at t + h [s] by integration from the states ``y`` at t; increase ``steps`` in place.

    The number of steps of each segment, ``steps``, is doubled, up to ``most``, until the error of a step is below
    ``tolerance``. States are NaN where that is not reached.
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

    ``steps`` are those that ``integrate_flow`` needed for each segment; one in ``COARSER`` is taken here.
    """
    few, lanes = -(-steps // COARSER), pack_lanes(Y)
    size = max(1, TOGETHER // lanes[0].size)
    for n in np.unique(few):
        group = np.flatnonzero(few == n)
        for own in np.array_split(group, -(-len(group) // size)):
            lanes[own] = _transport_steps(E, t[own], h[own] / n, y[own], lanes[own], int(n))
    return unpack_lanes(lanes, Y.shape[1])


def _march(E: FlowEquations, t: np.ndarray, h: np.ndarray, y: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return y after n steps of h [s] of DOP853, and the largest estimated error of a step, relative to 1 + |y|."""
    K = np.empty((len(DOPRI853.b) + 1, *y.shape))
    K[0] = E.evaluate_rate(t, y)
    worst = np.zeros(len(y))
    with np.errstate(all="ignore"):
        for step in range(n):
            at = t + step * h
            (y,) = _take_stages(lambda t, y: [E.evaluate_rate(t, y)], at, h, [y], [K], 1)
            K[-1] = E.evaluate_rate(at + h, y)
            first, second = (np.mean((np.tensordot(x, K, 1) / (1.0 + np.abs(y))) ** 2, axis=1) for x in DOPRI853.error)
            norm = np.abs(h) * first / np.sqrt(first + 0.01 * second)
            worst = np.maximum(worst, np.where(first > 0.0, norm, first))
            K[0] = K[-1]
    return y, worst


def _transport_steps(
    E: FlowEquations, t: np.ndarray, h: np.ndarray, y: np.ndarray, Y: np.ndarray, n: int
) -> np.ndarray:
    """Return the changes ``Y`` after n steps of h [s] along the motion from y, by the variational equations."""
    rate = lambda t, y, Y: [E.evaluate_rate(t, y), E.evaluate_tangent(t, y, Y)]  # noqa: E731
    slopes = [np.empty((len(DOPRI853.b), *part.shape)) for part in (y, Y)]
    for step in range(n):
        y, Y = _take_stages(rate, t + step * h, h, [y, Y], slopes)
    return Y


def _take_stages(
    rate: Callable[..., Arrays], t: np.ndarray, h: np.ndarray, parts: Arrays, slopes: Arrays, first: int = 0
) -> Arrays:
    """Evaluate the stages of a step of DOP853 from the ``first`` on into ``slopes``; return the state at its end.

    A state is a list of arrays, ``parts``, of which ``rate(t, *parts)`` returns the rates; ``slopes`` has those of each
    stage, for each part.
    """
    steps, state = [h.reshape(-1, *[1] * (x.ndim - 1)) for x in parts], parts

    def combine_slopes(s: None, weights: np.ndarray, n: int, h: np.ndarray) -> None:
        """Set the state to the parts at the start and h times the weighted sum of the first n slopes."""
        nonlocal state
        sums = (np.tensordot(weights[:n], K[:n], 1) for K in slopes)
        state = [x + step * total for x, step, total in zip(parts, steps, sums, strict=True)]

    def store_slopes(s: None, t: np.ndarray, i: int) -> None:
        """Store the slopes of the state at t as those of stage i."""
        for K, found in zip(slopes, rate(t, *state), strict=True):
            K[i] = found

    evaluate_stages(None, DOPRI853, t, h, first, combine_slopes, store_slopes)
    return state
