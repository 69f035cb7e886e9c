"""Drift is taken apart into the parts it was made of, and the stated intervals hold them as often as they say."""

import math

import numpy as np
import pytest

from mbsbench.harness.judge.law import MATTERS
from mbsbench.harness.judge.metrics.periods import find_periods
from mbsbench.harness.judge.metrics.thinning import choose_rows
from mbsbench.harness.judge.referee.certificates.drift import split_energy_error, split_error
from mbsbench.harness.judge.referee.certificates.trend import FEWEST, fit_trend
from mbsbench.tests.factories import make_series

PERIOD, PERIODS, STEPS = 2.0, 300, 40


def swinging(trend=0.0, walk=0.0, swing=1.0, noise=0.0, seed=0, slow=0.0, steps=STEPS):
    """An energy error over 300 periods, its observable, and its times."""
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, PERIODS * PERIOD, PERIODS * steps + 1)
    dt = t[1]
    wander = walk * math.sqrt(dt) * np.concatenate(([0.0], np.cumsum(random.standard_normal(len(t) - 1))))
    phase = 2.0 * np.pi * t / PERIOD
    e = swing * np.cos(2.0 * phase + 0.3) + 0.3 * swing * np.sin(phase) + trend * t + wander
    e = e + noise * random.standard_normal(len(t)) + slow * np.sin(2.0 * np.pi * t / (4.7 * PERIOD))
    return t, e - e[0], np.sin(phase)


def parts(t, e, observable):
    return split_error(t, e, find_periods(t, {"a": observable}))


def test_a_pure_oscillation_has_neither_trend_nor_walk():
    """Whole periods leave nothing: the interval of the trend is a millionth of the swing."""
    a = parts(*swinging(swing=2.0))
    exact = 0.5 * np.ptp(
        2.0 * np.cos(2.0 * np.linspace(0, 2 * np.pi, 4000) + 0.3) + 0.6 * np.sin(np.linspace(0, 2 * np.pi, 4000))
    )
    assert a.oscillation == pytest.approx(exact, rel=0.01)
    assert a.trend.low <= 0.0 <= a.trend.high or abs(a.trend.slope) * a.span < 1e-6
    assert max(abs(a.trend.low), abs(a.trend.high)) * a.span < 1e-3 * a.oscillation
    assert a.trend.walk * math.sqrt(a.span) < 1e-3 * a.oscillation


def test_a_trend_under_an_oscillation_a_thousand_times_its_change_a_period_is_found():
    """trend = 5e-4 of the swing a second, 0.3 of it over the run."""
    a = parts(*swinging(trend=-5e-4, noise=0.01))
    assert a.trend.low <= -5e-4 <= a.trend.high
    assert a.trend.high < 0.0
    assert a.trend.walk_low == 0.0


def test_a_random_walk_is_found_and_is_no_trend():
    """It ends anywhere; the line through it is told from nothing in 5 of 100 cases only."""
    a = parts(*swinging(walk=0.05, seed=3))
    assert a.trend.walk_low <= 0.05 <= a.trend.walk_high
    assert a.trend.still < 0.05
    assert a.trend.low <= 0.0 <= a.trend.high


def test_a_trend_and_a_walk_are_distinguished():
    """Both seen in every one of eight runs, and in seven at least within both intervals."""
    held = 0
    for seed in range(5, 13):
        d = parts(*swinging(trend=0.02, walk=0.05, seed=seed)).trend
        assert d.low > 0.0
        assert d.still < 0.05
        held += d.low <= 0.02 <= d.high and d.walk_low <= 0.05 <= d.walk_high
    assert held >= 7


def test_a_beat_of_a_few_periods_is_no_walk():
    """Blocks of several periods average it out."""
    a = parts(*swinging(slow=0.2, noise=0.01))
    assert max(abs(a.trend.low), abs(a.trend.high)) * a.span < MATTERS * a.oscillation


def test_thinning_that_keeps_extremes_moves_nothing():
    """A mean of the kept rows would: they are the peaks."""
    t, e, o = swinging(trend=2e-4, noise=0.001, steps=5 * STEPS)
    whole = parts(t, e, o)
    keep = choose_rows(len(t), e, np.abs(e) ** 2, at_most=len(t) // 3)
    assert len(keep) < 0.5 * len(t)
    thin = parts(t[keep], e[keep], o[keep])
    assert abs(thin.trend.slope - whole.trend.slope) < 1e-6
    assert thin.trend.low <= 2e-4 <= thin.trend.high
    assert thin.oscillation == pytest.approx(whole.oscillation, rel=0.05)


@pytest.mark.parametrize(
    ("trend", "walk", "noise"),
    [(0.0, 0.0, 1.0), (0.2, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 1.0, 1.0), (0.5, 1.0, 0.3), (0.0, 0.1, 1.0)],
    ids=["noise", "trend", "walk", "walk and noise", "trend and walk", "weak walk"],
)
def test_intervals_hold_the_truth_as_often_as_they_say(trend, walk, noise):
    """95 % are stated; 100 trials of 40 blocks give 88 % and more (3 standard errors are 6.5 %)."""
    random = np.random.default_rng(11)
    held_trend, held_walk, seen = [], [], []
    for _ in range(100):
        steps = walk / math.sqrt(20.0) * random.standard_normal(800)
        y = trend * np.arange(40) + np.cumsum(steps).reshape(40, 20).mean(axis=1) + noise * random.standard_normal(40)
        d = fit_trend(y, 1.0)
        held_trend.append(d.low <= trend <= d.high)
        held_walk.append(d.walk_low <= walk <= d.walk_high)
        seen.append(d.walk_low > 0.0)
    assert np.mean(held_trend) >= 0.88
    assert np.mean(held_walk) >= 0.88
    if walk == 0.0:
        assert np.mean(seen) <= 0.05
    if walk == 1.0 and noise < 1.0:
        assert np.mean(seen) > 0.9


def test_ordinary_least_squares_would_have_promised_too_much():
    """Why the likelihood: the usual interval of a line through a walk holds the truth in a third of cases at best."""
    random = np.random.default_rng(2)
    held = []
    for _ in range(200):
        y = np.cumsum(random.standard_normal(800) / math.sqrt(20.0)).reshape(40, 20).mean(axis=1)
        x = np.arange(40) - 19.5
        slope = x @ y / (x @ x)
        rest = y - y.mean() - slope * x
        half = 2.02 * math.sqrt(rest @ rest / 38.0 / (x @ x))
        held.append(abs(slope) <= half)
    assert np.mean(held) < 0.35


def test_nothing_at_all_has_no_drift():
    """An energy error that is exactly zero."""
    d = fit_trend(np.zeros(20), 1.0)
    assert (d.slope, d.low, d.high, d.walk_high, d.still) == (0.0, 0.0, 0.0, 0.0, 1.0)
    with pytest.raises(ValueError, match=f"at least {FEWEST}"):
        fit_trend(np.zeros(FEWEST - 1), 1.0)


def test_the_period_is_that_of_the_most_regular_observable():
    """A drifting or a chaotic one counts no periods; noise makes no extra crossings."""
    t, e, o = swinging()
    random = np.random.default_rng(0)
    noisy = o + 0.02 * random.standard_normal(len(t))
    a = split_energy_error(
        make_series(
            t, energy_error=e, obs_chaos=np.cumsum(random.standard_normal(len(t))), obs_swing=noisy, obs_still=0.0 * t
        )
    )
    assert a is not None
    assert PERIODS - 25 <= a.periods <= PERIODS
    assert a.span / a.periods == pytest.approx(PERIOD, rel=1e-3)
    assert split_energy_error(make_series(t, energy_error=e, obs_still=0.0 * t)) is None
    assert split_energy_error(make_series(t[:800], energy_error=e[:800], obs_swing=o[:800])) is None
    assert split_energy_error(make_series(t, energy_error=np.where(t > 100.0, np.nan, e), obs_swing=o)) is None
