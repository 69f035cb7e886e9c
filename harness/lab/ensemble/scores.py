"""Score clouds by the scores of weather forecasting (Gneiting, Raftery, J. Amer. Statist. Assoc. 102, 2007).

    CRPS = E|x - y| - E|x - x'|/2, x and x' different members of a cloud, y a draw of the truth

The energy score is the same with Euclidean norms; smaller is better for both. Weights, one row for each weighting, give
the scores of all permutations of members and draws in one pass.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist
from scipy.stats import chi2

# chi-squared holds from about five in a bin, and ten scatter by a third; more bins see finer shapes less surely
MOST_BINS, LEAST_IN_A_BIN = 20, 10
DEALS = 1999  # permutations behind a p-value: one of 0.05 is known to 0.005 (half: 0.007, twice: 0.0035)
Points = Float[np.ndarray, " n"] | Float[np.ndarray, "n d"]
Weights = Float[np.ndarray, "rows n"]


class Score(NamedTuple):
    """A score, its excess over that of the truth itself, and the excess to expect by chance."""

    score: float
    excess: float  # unbiased estimate of half the energy distance of the two laws: 0 on average for a perfect solver
    chance: float  # a perfect solver stays below in 95 of 100 cases
    p: float  # probability of an excess so large by chance


class Ranks(NamedTuple):
    """Counts of the draws' ranks among the members, and the chi-squared test that they are uniform."""

    counts: Float[np.ndarray, " bins"]
    statistic: float  # chi-square over its degrees of freedom
    p: float


def compute_score(
    x: Points, y: Points, w: Weights | None = None, u: Weights | None = None
) -> Float[np.ndarray, " rows"]:
    """Return the CRPS, or for points (n, d) the energy score, of members ``x`` against draws ``y`` of the truth.

    ``w`` weights members and ``u`` draws, one row for each weighting, and a score is returned for each row. Without
    weights all members and draws count alike.
    """
    w = np.ones((1, len(x))) if w is None else w
    return _compute_mean_distance(x, y, w, np.ones((1, len(y))) if u is None else u) - _compute_half_distance(x, w)


def score_against_truth(x: Points, y: Points, seed: int) -> Score:
    """Return the score of members ``x`` against draws ``y`` of the truth, with a permutation test.

    ``DEALS`` permutations, drawn with ``seed``, exchange members and draws; for a perfect solver all of them have the
    same score on average.
    """
    both, n = np.concatenate((x, y)), len(x)
    # weights of members, a row for each deal: the first is as computed; draws have the others
    deals = np.zeros((1 + DEALS, len(both)))
    deals[0, :n] = 1.0
    random = np.random.default_rng(seed)
    for row in deals[1:]:
        row[random.permutation(len(both))[:n]] = 1.0
    excess = compute_score(both, both, deals, 1.0 - deals) - _compute_half_distance(both, 1.0 - deals)
    noise = 1e-12 * float(np.max(np.abs(both), initial=0.0))  # differences by rounding do not order equal clouds
    p = float(np.mean(excess >= excess[0] - noise))
    return Score(float(compute_score(x, y)[0]), float(excess[0]), float(np.quantile(excess[1:], 0.95)), p)


def count_ranks(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " m"]) -> Ranks:
    """Count the ranks of draws ``y`` among members ``x``, and test by chi-squared that they are uniform.

    A draw that equals members is spread over its possible ranks. Both are samples, so counts vary more than multinomial
    ones: by (n + m + 1) / (n + 2), their Dirichlet law.
    """
    n, m, x = len(x), len(y), np.sort(x)
    low, high = np.searchsorted(x, y, "left"), np.searchsorted(x, y, "right")
    fraction = 1.0 / (high - low + 1)
    slots = np.zeros(n + 2)  # changes of the count from rank to rank
    np.add.at(slots, low, fraction)
    np.add.at(slots, high + 1, -fraction)
    bins = max(2, min(MOST_BINS, m // LEAST_IN_A_BIN))
    of_slot = np.arange(n + 1) * bins // (n + 1)
    counts = np.bincount(of_slot, np.cumsum(slots)[:-1], bins)
    expected = m * np.bincount(of_slot, minlength=bins) / (n + 1)
    statistic = float(np.sum((counts - expected) ** 2 / expected)) * (n + 2) / (n + m + 1)
    return Ranks(counts, statistic / (bins - 1), float(chi2.sf(statistic, bins - 1)))


def _compute_mean_distance(x: Points, y: Points, w: Weights, u: Weights) -> np.ndarray:
    """Return E|x - y| for each row of the weights ``w`` of x and ``u`` of y.

    For numbers it takes O(n log n) operations once and then O(n) a row.
    """
    if x.ndim > 1:
        total = np.sum((w @ cdist(x, y)) * u, axis=1)
    else:
        # sum_i w_i |x_i - y| from the sums of w_i and w_i x_i over the x_i below y
        order, middle = np.argsort(x, kind="stable"), np.mean(y)
        w, x, y = w[:, order], x[order] - middle, y - middle
        below, sums = (np.pad(np.cumsum(a, axis=1), ((0, 0), (1, 0))) for a in (w, w * x))
        k = np.searchsorted(x, y)
        total = np.sum(u * (y * (2.0 * below[:, k] - below[:, -1:]) + sums[:, -1:] - 2.0 * sums[:, k]), axis=1)
    return np.asarray(total / (np.sum(w, axis=1) * np.sum(u, axis=1)))


def _compute_half_distance(x: Points, w: Weights) -> np.ndarray:
    """Return E|x - x'|/2 over different members, for each row of weights, which are 0 or 1."""
    n = np.sum(w, axis=1)
    if x.ndim > 1:
        total = 0.5 * np.sum((w @ cdist(x, x)) * w, axis=1)
    else:
        order = np.argsort(x, kind="stable")
        w, x = w[:, order], x[order] - np.mean(x)
        total = np.sum(w * (x * np.cumsum(w, axis=1) - np.cumsum(w * x, axis=1)), axis=1)
    return np.asarray(total / (n * (n - 1.0)))
