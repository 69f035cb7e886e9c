"""The cost of a step may grow with the bodies a little faster than they do."""

import pytest

from mbsbench.harness.judge.cost import judge_growth
from mbsbench.harness.results.findings import Verdict


@pytest.mark.parametrize(("power", "verdict"), [(1.0, Verdict.MET), (1.4, Verdict.MET), (2.0, Verdict.OPEN)])
def test_growth_is_fitted_to_the_longest_chains(power, verdict):
    """Faster growth is a property of the solver, not a fault; the shortest chain is left out of four."""
    bodies = [6, 12, 20, 48]
    seconds = [1.0, *(1e-3 * n**power for n in bodies[1:])]
    found = judge_growth("cost", bodies, seconds)
    assert found.verdict is verdict and found.words.endswith(f"n^{power:.1f}")
