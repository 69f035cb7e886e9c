"""Estimate trend and random walk in block means, with intervals: line, Brownian motion and white noise, by likelihood.

Block means of equal length tau are y = a + b t + W + e, W the mean over a block of a Brownian motion of variance
sigma^2 t, e independent of variance s^2. For each ratio lambda = sigma^2 tau / s^2 the line is generalised least
squares and b is Student's t; since lambda is unknown, everything is averaged over it with the weight of its restricted
likelihood, uniformly in log lambda. A line through a wandering curve thus has an adequately wide interval (ordinary
least squares and Newey and West's correction are far too optimistic there), and without wandering little is lost.
``still`` is the probability of lambda = 0 if that and lambda > 0 are equally likely beforehand. The tests measure how
often the intervals contain the truth.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import bisect
from scipy.special import chdtrc, stdtr

from ...order import LEVEL

TAIL = 0.5 - 0.5 * LEVEL  # probability outside the interval, on either side
FEWEST = 8  # least number of blocks: six degrees of freedom
RATIOS = np.concatenate(([0.0], np.logspace(-3.0, 4.0, 57)))  # values of lambda
PRIOR = 1.0 / (len(RATIOS) - 1)  # prior weight of each ratio above zero


@dataclass(frozen=True)
class Trend:
    """Slope [unit/s] and random walk [unit/sqrt(s)], each with the ends of its 95 % interval.

    ``still`` is the probability that there is no random walk.
    """

    slope: float
    low: float
    high: float
    walk: float
    walk_low: float
    walk_high: float
    still: float


def fit_trend(y: Float[np.ndarray, " blocks"], tau: float) -> Trend:
    """Fit slope and random walk, with their intervals, to the means ``y`` over consecutive blocks of ``tau`` [s] each.

    A random walk whose absence is at all probable (5 %) is reported as 0. Raise ValueError if there are fewer than
    ``FEWEST`` blocks.
    """
    n = len(y)
    if n < FEWEST:
        raise ValueError(f"at least {FEWEST} blocks are needed (got {n})")
    size = float(np.max(np.abs(y - np.mean(y))))
    if size == 0.0:
        return Trend(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    scaled = (y - np.mean(y)) / size
    free = n - 2
    solve, information, log_det = _make_least_squares(n)
    beta = np.einsum("lpn,n->lp", solve, scaled)
    rest = scaled - beta[:, 0, None] - beta[:, 1, None] * _center_blocks(n)
    precision = _invert_covariances(n)
    rss = np.maximum(np.einsum("ln,lnm,lm->l", rest, precision, rest), 1e-300)
    weight = -0.5 * log_det - 0.5 * free * np.log(rss)
    weight = np.exp(weight - np.max(weight))
    still = float(weight[0] / (weight[0] + PRIOR * np.sum(weight[1:])))
    weight[0] = 0.0  # intervals allow for a walk, however small: a wrong "none" would make them too narrow
    weight /= np.sum(weight)
    s2 = rss / free
    spread = np.sqrt(s2 * information)
    unit = size / tau

    def slope_below(x: float) -> float:
        """Return the probability that the slope is below ``x`` (in scaled units)."""
        return float(np.sum(weight * stdtr(free, (x - beta[:, 1]) / spread)))

    reach = float(np.max(np.abs(beta[:, 1]) + 60.0 * spread))
    low, high = (_find_root(slope_below, -reach, reach, p) for p in (TAIL, 1.0 - TAIL))
    walks = np.sqrt(RATIOS * rss)  # times 1/sqrt(chi2)

    def walk_below(x: float) -> float:
        """Return the probability that the random walk is below ``x`` (in scaled units)."""
        with np.errstate(divide="ignore", over="ignore"):
            part = np.where(walks > 0.0, chdtrc(free, (walks / max(x, 1e-300)) ** 2), 1.0)
        return float(np.sum(weight * part))

    most = float(np.max(walks)) + 1e-300
    walk_low, walk, walk_high = (_find_root(walk_below, 0.0, most, p) for p in (TAIL, 0.5, 1.0 - TAIL))
    if still >= 1.0 - LEVEL:
        walk_low = walk = 0.0
    root = size / math.sqrt(tau)
    slope = float(np.sum(weight * beta[:, 1]))
    return Trend(slope * unit, low * unit, high * unit, walk * root, walk_low * root, walk_high * root, still)


def _center_blocks(n: int) -> Float[np.ndarray, " n"]:
    """Return the middles of ``n`` blocks relative to their mean, in units of a block."""
    return np.arange(n) - 0.5 * (n - 1)


@cache
def _invert_covariances(n: int) -> Float[np.ndarray, "ratios n n"]:
    """Return the inverse covariance of ``n`` block means for each ratio in ``RATIOS``, in units of s^2."""
    k = np.arange(n)
    first = np.minimum(k[:, None], k[None])
    brownian = first + np.where(k[:, None] == k[None], 1.0 / 3.0, 0.5)  # means over blocks of min(s, t)
    return np.linalg.inv(np.eye(n) + RATIOS[:, None, None] * brownian)


@cache
def _make_least_squares(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the generalised least squares of a line through ``n`` block means, for each ratio in ``RATIOS``.

    The three arrays are the estimator (X^T P X)^-1 X^T P, (ratios, 2, n); the variance of the slope, in units of s^2;
    and ln|S| + ln|X^T P X|. P = S^-1 is the precision, and X has the columns 1 and time, in blocks.
    """
    X = np.stack((np.ones(n), _center_blocks(n)), axis=1)
    P = _invert_covariances(n)
    normal = np.einsum("np,lnm,mq->lpq", X, P, X)
    inverse = np.linalg.inv(normal)
    solve = np.einsum("lpq,nq,lnm->lpm", inverse, X, P)
    log_det = -np.linalg.slogdet(P)[1] + np.linalg.slogdet(normal)[1]
    return solve, inverse[:, 1, 1], log_det


def _find_root(rising: Callable[[float], float], low: float, high: float, value: float) -> float:
    """Return the argument between ``low`` and ``high`` at which the function ``rising`` has ``value``, by bisection."""
    return float(bisect(lambda x: rising(x) - value, low, high, xtol=1e-300, disp=False))
