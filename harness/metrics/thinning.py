"""Which rows of a long run to keep, so that a series file stays small and shows every peak."""

import numpy as np
from jaxtyping import Float, Int

MAX_ROWS = 100_000
MAX_FRAMES = 2_000


def rows_to_keep(nt: int, *peaks: Float[np.ndarray, " nt"], at_most: int = MAX_ROWS) -> Int[np.ndarray, " kept"]:
    """All rows if ``nt <= at_most``, else per bucket its first and the ones where each of ``peaks`` is largest."""
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


def frames_to_keep(t: Float[np.ndarray, " nt"], at_most: int = MAX_FRAMES) -> Int[np.ndarray, " nf"]:
    """Rows nearest to equal spacing in time, first and last among them: what a drawing needs."""
    if len(t) <= at_most:
        return np.arange(len(t))
    wanted = np.linspace(t[0], t[-1], at_most)
    return np.unique(np.append(np.minimum(np.searchsorted(t, wanted), len(t) - 1), (0, len(t) - 1)))
