"""The one iteration and the one stepper of pairs, on equations whose solutions are known."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mbsbench.harness.base.iteration import FAILED, GO_ON, SETTLED, STALE, iterate
from mbsbench.harness.base.tableaux import DOPRI5, DOPRI853, evaluate_stages

SLOW = 0.1


def correct(s, i, stale):
    """Correct x towards the root of x^2 = 2, with a new slope where it is stale; return the size of the correction."""
    assert stale == s.slow
    if stale:
        s.slope, s.slopes = 2.0 * s.x, s.slopes + 1
    change = (2.0 - s.x * s.x) / s.slope
    s.x, s.sweeps = s.x + change, i + 1
    return abs(change)


def classify(s, i, size, last):
    """Ask for a new slope where a correction is not much smaller than the last."""
    s.slow = size > SLOW * last
    if not math.isfinite(size):
        return FAILED
    if size < 1e-15:
        return SETTLED
    return STALE if s.slow else GO_ON


def start(x=1.0):
    """Return an iteration that starts at x, with a poor slope."""
    return SimpleNamespace(x=x, slope=4.0, slopes=0, slow=False)


def test_an_iteration_settles_and_its_slope_is_renewed_where_it_is_slow():
    """The first slope is poor: kept, it gains one digit in three sweeps."""
    s = start()
    assert iterate(s, correct, classify, 20)
    assert s.x == pytest.approx(math.sqrt(2.0), abs=1e-15)
    assert 1 <= s.slopes < s.sweeps < 12, (s.slopes, s.sweeps)


def test_an_iteration_ends_where_it_fails_and_where_sweeps_end():
    assert not iterate(start(), correct, classify, 3)
    s = start(math.inf)
    assert not iterate(s, correct, classify, 20) and s.sweeps == 1


def take_step(pair, t, h, start, rate):
    """Return the state after a step of h [s] from ``start`` at t."""
    slopes, x = np.full((len(pair.b), len(start)), np.nan), start

    def combine(s, weights, n, h):
        nonlocal x
        x = start + h * weights[:n] @ slopes[:n]

    def slope(s, t, i):
        slopes[i] = rate(t, x)

    evaluate_stages(None, pair, t, h, 0, combine, slope)
    return x


@pytest.mark.parametrize("pair", [DOPRI5, DOPRI853], ids=["dopri5", "dopri853"])
def test_stages_integrate_powers_of_time_up_to_their_order(pair):
    """Of x' = k t^(k-1) a step of any length is exact for k up to the order, and not beyond."""
    t, h = 0.3, 0.7
    for k in range(1, pair.order + 2):
        x = take_step(pair, t, h, np.array([t**k]), lambda t, x, k=k: k * t ** (k - 1))
        error = abs(x[0] - (t + h) ** k)
        assert (error < 1e-14) == (k <= pair.order), (k, error)


@pytest.mark.parametrize(("pair", "h"), [(DOPRI5, 0.2), (DOPRI853, 0.8)], ids=["dopri5", "dopri853"])
def test_stages_of_an_oscillator_are_of_the_order_of_the_pair(pair, h):
    """States enter the slopes: the error of a step falls by 2^(order + 1) when it is halved."""
    ends = [take_step(pair, 0.0, x, np.array([1.0, 0.0]), lambda t, x: (x[1], -x[0])) for x in (h, 0.5 * h)]
    true = [(math.cos(x), -math.sin(x)) for x in (h, 0.5 * h)]
    errors = np.linalg.norm(np.subtract(ends, true), axis=1)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(pair.order + 1, abs=0.6)
