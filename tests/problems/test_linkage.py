"""The linkage behind chain and grid: its two formulations, and its certificate against extended precision."""

from collections.abc import Callable

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.reference.extrapolation import gbs_adaptive
from mbsbench.problems import chain, four_bar_grid
from mbsbench.problems.exact.certification import CertifiedMotion
from mbsbench.problems.exact.linkage import Linkage, make_rates_by_angles, make_rates_by_nodes

EXTENDED_CORRECTION = 1e-17  # of each step of the check


@pytest.mark.parametrize("held", [False, True], ids=["free", "held"])
def test_angles_and_nodes_accelerate_alike(held: bool) -> None:
    """The same rods and masses, two sets of equations without a term in common, at random states."""
    random = np.random.default_rng(11)
    n = 7
    for _ in range(20):
        angle = random.uniform(-np.pi, np.pi, n)
        M, H = random.uniform(0.5, 2.0, (2, n))
        free = Linkage(M, H, 0.7, 9.81)
        link = Linkage(M, H, 0.7, 9.81, tuple(free.nodes(angle)[-1])) if held else free
        rate = random.standard_normal(n)
        if held:  # no velocity of the held node
            across = np.stack((-np.sin(angle), np.cos(angle)))
            rate -= across.T @ np.linalg.solve(across @ across.T, across @ rate)
        y = np.concatenate((angle, rate))
        a = make_rates_by_angles(link)(y)[n:]
        along, across = np.stack((np.cos(angle), np.sin(angle)), 1), np.stack((-np.sin(angle), np.cos(angle)), 1)
        expected = 0.7 * np.cumsum(a[:, None] * across - (rate**2)[:, None] * along, axis=0)
        got = make_rates_by_nodes(link)(link.convert_to_nodes(y)[None]).reshape(2, -1, 2)[1]
        assert np.max(np.abs(got - expected[: link.free])) < 1e-11 * (1.0 + np.max(np.abs(expected)))


Certified = Callable[[], tuple[CertifiedMotion, Linkage]]


def of_chain() -> tuple[CertifiedMotion, Linkage]:
    p = make_problem("chain")
    return p.reference_from(p.initial), p.reference_from.args[0]


def of_grid() -> tuple[CertifiedMotion, Linkage]:
    p = make_problem("four_bar_grid", {"release": "all_rows"})
    return p.reference_from(p.initial), Linkage(np.full(5, 6.0), np.full(5, 5.0), 1.0, 9.81)


def check(motion: CertifiedMotion, link: Linkage, t_end: float) -> None:
    start = link.convert_to_nodes(motion.orbit.y[0].astype(np.longdouble))
    for t, y in gbs_adaptive(make_rates_by_nodes(link, np.longdouble), start, t_end, EXTENDED_CORRECTION, 1e-3):
        angle = motion.orbit(np.array([t], dtype=float))[0, : link.n]
        gap = link.nodes(angle)[: link.free] - y.reshape(2, -1, 2)[0].astype(float)
        assert np.max(np.linalg.norm(gap, axis=1)) <= motion.error(np.array([t], dtype=float))[0]


@pytest.mark.parametrize("of", [of_chain, of_grid])
def test_the_certificate_holds_in_extended_precision(of: Certified) -> None:
    """Node positions with 19 digits, over the first snap of the chain (0.48 s): within the stated bound."""
    motion, link = of()
    check(motion, link, 0.6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "sought", "least"), [(of_chain, 8.0, 5.0), (of_grid, 20.0, 15.0)], ids=["chain", "all_rows"]
)
def test_the_certificate_holds_to_its_horizon(
    of: Certified, sought: float, least: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through all of the chaos; the horizon reaches what docs/decisions/references.md says, to a rounding's luck."""
    monkeypatch.setattr(chain, "SOUGHT", sought)
    monkeypatch.setattr(four_bar_grid, "SOUGHT", sought)
    motion, link = of()
    assert motion.horizon > least
    check(motion, link, motion.horizon)


def test_times_beyond_the_certificate_are_refused() -> None:
    """With the numbers, not with an extrapolated motion."""
    motion, _ = of_chain()
    with pytest.raises(ValueError, match="covers 0"):
        motion.states(np.array([motion.horizon + 0.1]))
