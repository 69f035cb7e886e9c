"""Select the rows of a long run to store, so that its series file stays small and shows every peak."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ...mechanics.state import States

# rows of scalars in a file: more make it larger, fewer hide what lies between; the peaks are always kept
MAX_ROWS = 100_000
# poses, 18 numbers a body, so fewer than rows: more make files larger, fewer make drawn motions jump
MAX_FRAMES = 2_000
BLOCK, BODIES = 4096, 2**18  # rows at a time at most, and rows times bodies
# share of the frames that is spread evenly in time. Chords of a top's 300 frames are 3 % nearer to the path at half,
# and as near at twice.
EVEN = 0.2
FEWEST = 120  # fewest frames, even of a straight motion; half, twice: only runs of fewer rows than that change


def choose_rows(nt: int, *peaks: Float[np.ndarray, " nt"], at_most: int = MAX_ROWS) -> Int[np.ndarray, " kept"]:
    """Return the rows of a series of ``nt`` rows to store: all if ``nt <= at_most``, else some of equal buckets.

    Of each bucket the first row is stored, and for each series in ``peaks`` the row where |series| is largest; so is
    the last row of all.
    """
    if nt <= at_most:
        return np.arange(nt)
    buckets = at_most // (1 + len(peaks))
    starts = np.linspace(0, nt, buckets, endpoint=False).astype(np.int64)
    kept = [starts, np.array([nt - 1])]
    bucket = np.searchsorted(starts, np.arange(nt), side="right") - 1
    for peak in peaks:
        size = np.nan_to_num(np.abs(peak), nan=np.inf)
        order = np.lexsort((-size, bucket))  # by bucket, the largest first
        kept.append(order[np.searchsorted(bucket[order], np.arange(buckets))])
    return np.unique(np.concatenate(kept))


def choose_frames(
    t: Float[np.ndarray, " nt"],
    states: Callable[[slice], States],
    size: float,
    at_most: int = MAX_FRAMES,
    near: float = 0.0,
) -> Int[np.ndarray, " nf"]:
    """Return the rows that a drawing needs: both ends, a fifth evenly in time, the rest dense where paths are curved.

    ``states`` returns the states of a slice of rows; ``size`` [m] of a body turns a rotation into a displacement. At
    most about ``at_most`` rows are returned; with ``near`` > 0, only as many as keep chords within ``near * size`` of
    the path, and at least ``FEWEST``. A chord over n rows is off the path by n^2 / 4 times the distance of a row from
    the chord between its neighbours, so that the sum of the square roots of these distances gives the number of chords.
    """
    if len(t) <= (at_most if near == 0.0 else FEWEST):
        return np.arange(len(t))
    block = max(1, min(BLOCK, BODIES // states(slice(1)).nb))
    rows = (slice(k - 1, k + block + 1) for k in range(1, len(t) - 1, block))
    bent = np.concatenate([_measure_chord_error(t[k], states(k), size) for k in rows])
    chords = np.convolve(np.sqrt(bent), (0.5, 0.5))
    if near > 0.0:
        needed = float(np.sum(chords)) / (2.0 * np.sqrt(near * size)) / (1.0 - EVEN)
        at_most = int(np.clip(needed, FEWEST, at_most)) + 1
    measure = EVEN * np.diff(t) / (t[-1] - t[0]) + (1.0 - EVEN) * chords / max(float(np.sum(chords)), 1e-300)
    along = np.append(0.0, np.cumsum(measure))
    kept = np.searchsorted(along, np.linspace(0.0, along[-1], at_most))
    return np.unique(np.append(np.minimum(kept, len(t) - 1), (0, len(t) - 1)))


def _measure_chord_error(t: np.ndarray, s: States, size: float) -> Float[np.ndarray, " n"]:
    """Return, for each inner row, the largest distance [m] of a body from the chord between the rows before and after.

    A rotation counts with the arm ``size`` [m], which is also the largest distance returned.
    """
    u = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None, None]
    with np.errstate(all="ignore"):  # a motion may have blown up
        r = s.r[1:-1] - (1.0 - u) * s.r[:-2] - u * s.r[2:]
        R = s.R[1:-1] - (1.0 - u[..., None]) * s.R[:-2] - u[..., None] * s.R[2:]
        off = np.max(np.linalg.norm(r, axis=-1) + size * np.linalg.norm(R, axis=(-2, -1)), axis=1)
    return np.minimum(np.nan_to_num(off, nan=size), size)
