"""Scores of clouds of numbers whose law is known."""

import numpy as np
import pytest
from scipy.stats import norm

from mbsbench.harness.lab.ensemble.scores import compute_score, count_ranks, score_against_truth

RANDOM = np.random.default_rng(5)


def test_crps_of_a_gaussian_is_its_closed_form():
    """CRPS(N(0, s), y) = s (z (2 Phi(z) - 1) + 2 phi(z) - 1/sqrt(pi)); n quantiles are off by O(s/n)."""
    n, s = 20_000, 0.7
    x = s * norm.ppf((np.arange(n) + 0.5) / n)
    for y in (-1.0, 0.0, 0.3, 5.0):
        z = y / s
        exact = s * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi))
        assert compute_score(x, np.array([y]))[0] == pytest.approx(exact, abs=5.0 * s / n)


def test_crps_is_its_definition_and_the_energy_score_of_a_line():
    """E|x - y| - E|x - x'|/2 by all pairs; in one dimension the norm is the absolute value."""
    x, y = 3.0 + RANDOM.standard_normal(40), 3.0 + RANDOM.standard_normal(30)
    pairs = np.sum(np.abs(x[:, None] - x)) / (len(x) * (len(x) - 1))
    by_hand = np.mean(np.abs(x[:, None] - y)) - 0.5 * pairs
    assert compute_score(x, y)[0] == pytest.approx(by_hand, rel=1e-12)
    assert compute_score(x[:, None], y[:, None])[0] == pytest.approx(by_hand, rel=1e-12)


def test_the_order_of_members_does_not_matter():
    """Members have no names."""
    x, y = RANDOM.standard_normal((50, 3)), RANDOM.standard_normal((60, 3))
    mixed, drawn = RANDOM.permutation(x), RANDOM.permutation(y)
    assert compute_score(mixed, drawn)[0] == pytest.approx(compute_score(x, y)[0], rel=1e-12)
    assert compute_score(mixed[:, 0], drawn[:, 0])[0] == pytest.approx(compute_score(x[:, 0], y[:, 0])[0], rel=1e-12)
    a, b = (count_ranks(p[:, 0], q[:, 0]) for p, q in ((x, y), (mixed, drawn)))
    np.testing.assert_array_equal(a.counts, b.counts)


def test_p_values_of_perfect_clouds_are_uniform():
    """Of 200 pairs of clouds of one law, 5 % fall below 0.05: 10 +- 3.1, here within 4 sigma; excesses average 0."""
    draws = [RANDOM.standard_normal((2, 60)) for _ in range(200)]
    ranks = np.array([count_ranks(x, y).p for x, y in draws])
    assert np.sum(ranks < 0.05) <= 22
    assert abs(np.mean(ranks) - 0.5) < 4.0 * 0.289 / np.sqrt(len(draws))
    found = [score_against_truth(x, y, seed=1) for x, y in draws[:30]]
    excess = np.array([s.excess for s in found])
    assert abs(np.mean(excess)) < 4.0 * np.std(excess) / np.sqrt(len(excess))
    assert np.sum([s.p < 0.05 for s in found]) <= 7


def test_a_shift_and_a_wrong_spread_are_detected():
    """300 members see half a standard deviation, and half or twice the spread, which leave U and hill shapes."""
    y = RANDOM.standard_normal(300)
    for x in (RANDOM.standard_normal(300) + 0.5, 0.5 * RANDOM.standard_normal(300), 2.0 * RANDOM.standard_normal(300)):
        assert score_against_truth(x, y, seed=1).p < 0.001
        assert count_ranks(x, y).p < 1e-4
    narrow = count_ranks(0.5 * RANDOM.standard_normal(300), y).counts
    assert narrow[0] + narrow[-1] > 4.0 * narrow[len(narrow) // 2]


def test_equal_numbers_are_shared_out_among_ranks():
    """A quantity that is 0 in every motion shows nothing: flat ranks, no excess, p = 1."""
    x, y = np.zeros(100), np.zeros(100)
    assert count_ranks(x, y).p > 0.999
    assert score_against_truth(x, y, seed=1) == (0.0, 0.0, 0.0, 1.0)


def test_the_scores_are_those_of_scoringrules():
    """A second opinion, where that package is installed."""
    rules = pytest.importorskip("scoringrules")
    x, y = RANDOM.standard_normal((50, 4)), RANDOM.standard_normal((20, 4))
    fair = np.mean([rules.crps_ensemble(v, x[:, 0], estimator="fair") for v in y[:, 0]])
    assert compute_score(x[:, 0], y[:, 0])[0] == pytest.approx(fair, rel=1e-9)
