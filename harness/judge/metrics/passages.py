"""Find singular poses that a motion passes, where branches of a linkage meet; they become a note on the run, no law.

Where the constraint rows lose rank, as in a parallelogram that folds flat, the mechanism may continue on another
branch: constraints and energy hold on either. There the least nonzero singular value of the constraint Jacobian falls
to zero, along a V that is much wider than the passage itself. It is evaluated at some rows of a run, and refined
between them around its lowest minima.
"""

import numpy as np
from jaxtyping import Float

from ...mechanics.loops import has_loops
from ...mechanics.motion import list_jacobian_parts
from ...mechanics.state import States
from ...mechanics.system import MultibodySystem
from ...mechanics.types import PASSAGE
from .rows import interpolate_rows

# "Half" and "twice": tried on 1, 2 and 4 four-bar cells with 6 passages each, and on a grid, Bennett's and Bricard's
# linkages without. Where nothing else is said, neither changes the passages found, nor their times by more than 2e-6 s.
SAMPLES, FEWEST = 200, 20  # most and fewest rows examined; systems that allow fewer are not examined
PRODUCTS = 2e7  # bound on nrows^2 6 nb, summed over the rows examined; half: one passage of 4 cells is missed
PLACES = 24  # most minima that are refined between rows
EACH = 8  # rows examined per minimum that is refined; twice: one passage of 4 cells is missed
# each zoom narrows the interval to a quarter. At 3 zooms two passages of 18 are found, at 14 all; at 4 points none, at
# 18 all.
ZOOMS, POINTS = 7, 9
STEEP = 2.0  # largest ratio of a minimum to the fall towards it for a V; a smooth minimum keeps more
FLAT = 1e-3  # share of the median below which a value counts as zero: interpolated poses have errors
INDEPENDENT = 1e-6, 1e-2  # share of the largest value above which one counts for the rank: at the start, and elsewhere
TOLD = 3  # most times that a note names


def list_passages(system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States) -> list[str]:
    """Return a note on the singular poses that a motion passes, in words, as a list of one; empty if it passes none.

    The note has the times of the first ``TOLD`` of them.
    """
    times = find_passage_times(system, t, s)
    if not times:
        return []
    told = ", ".join(f"{x:.4g}" for x in times[:TOLD]) + (", ..." if len(times) > TOLD else "")
    pose, first = ("a singular pose", "that") if len(times) == 1 else ("singular poses", "the first")
    begin, end = PASSAGE
    return [f"{begin}{pose} at t = {told} s{end}: its motion after {first} is one of several"]


def find_passage_times(system: MultibodySystem, t: Float[np.ndarray, " nt"], s: States) -> list[float]:
    """Return the times [s] of singular poses that a motion passes: where A loses rank that it has elsewhere.

    The criterion is the least singular value of A that is nonzero elsewhere, at recorded rows of the motion; around
    each deep minimum it is refined between rows. Empty if no joint closes a loop, since the rows of a tree keep their
    rank, if the motion is not finite, and for systems so large that too few rows can be examined.
    """
    n = min(SAMPLES, len(t), int(PRODUCTS / max(1.0, 6.0 * system.nb * system.nrows**2)))
    if not has_loops(system) or n < min(FEWEST, len(t)) or len(t) < 3:
        return []
    if not all(np.all(np.isfinite(a)) for a in (t, s.r, s.R, s.v, s.Omega)):
        return []
    k = np.unique(np.linspace(0, len(t) - 1, n).round().astype(int))
    values = compute_singular_values(system, s.at(k))
    at_start, most = INDEPENDENT
    rank = int(np.sum(values[0] > at_start * values[0, 0]))
    rank = max(rank, int(np.median(np.sum(values > most * values[:, :1], axis=1))))
    least = values[:, rank - 1]
    middle = float(np.median(least))
    here, fall = least[1:-1], np.maximum(least[:-2], least[2:]) - least[1:-1]
    lowest = np.flatnonzero((here <= least[:-2]) & (here <= least[2:]) & (here < STEEP * fall)) + 1
    places = np.sort(lowest[np.argsort(least[lowest])][: min(PLACES, n // EACH)])
    if len(places) == 0:
        return []
    low, high, every = t[k[places - 1]], t[k[places + 1]], np.arange(len(places))
    for _ in range(ZOOMS):
        x = np.linspace(low, high, POINTS, axis=1)
        between = compute_singular_values(system, interpolate_rows(t, s, x.ravel()))[:, rank - 1].reshape(x.shape)
        best = np.argmin(between, axis=1)
        low, high = x[every, np.maximum(best - 1, 0)], x[every, np.minimum(best + 1, POINTS - 1)]
    return [float(a) for a in x[every, best][between[every, best] < FLAT * middle]]


def compute_singular_values(system: MultibodySystem, s: States) -> Float[np.ndarray, "nt k"]:
    """Return the singular values of A at each time, the largest first, with scaled rows and columns.

    As in ``jacobian.scale_jacobian``, rows have unit length and rotations count in m/s, by the radius of gyration.
    Values are the roots of the eigenvalues of A A^T or A^T A, whichever matrix is smaller, and thus accurate to 1e-8 of
    the largest only.
    """
    A = np.zeros((len(s), system.nrows, system.nb, 6))
    for body, rows, translation, rotation in list_jacobian_parts(system, s):
        A[:, rows, body] += np.concatenate((translation, rotation), axis=-1)
    A[..., 3:] /= system.gyration[:, None]
    rows = A.reshape(len(s), system.nrows, 6 * system.nb)
    length = np.linalg.norm(rows, axis=2, keepdims=True)
    rows /= np.where(length > 0.0, length, 1.0)
    B = np.swapaxes(rows, 1, 2)
    squares = np.linalg.eigvalsh(rows @ B if system.nrows <= 6 * system.nb else B @ rows)
    return np.sqrt(np.maximum(squares[:, ::-1], 0.0))
