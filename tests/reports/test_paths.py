"""The path of a point that a problem observes, its exact one beside it, and both in a moving picture."""

import numpy as np
import pytest

from mbsbench.harness.results.series import Series
from mbsbench.reports.mechanism.paths import longest, path_of


def circling(rate: float, horizon: float, t_end: float = 2.0, unit: str = "m") -> Series:
    """A point E on a circle at ``rate`` [rad/s]; exactly it goes at 1 rad/s, which is known to ``horizon`` [s]."""
    t = np.linspace(0.0, t_end, 401)

    def place(kind: str, w: float) -> dict[str, np.ndarray]:
        return dict(zip((f"{kind}_E_{a}" for a in "xyz"), (np.cos(w * t), np.sin(w * t), 0 * t), strict=True))

    exact = {k: np.where(t <= horizon, v, np.nan) for k, v in place("ref", 1.0).items()}
    return Series({"t": t, **place("obs", rate), **exact}, (), (), (), {f"obs_E_{a}": unit for a in "xyz"}, {})


def test_a_path_ends_with_its_reference():
    """Beyond the horizon nothing exact is drawn; before it, it is the reference and not the run."""
    path = path_of(circling(1.3, 1.0))
    assert path is not None and path.name == "E"
    t = np.array([0.0, 0.5, 1.0, 1.5])
    exact = path.exact_at(t)
    assert len(exact) == 3
    np.testing.assert_allclose(exact[:, 0], np.cos(t[:3]), atol=1e-4)
    np.testing.assert_allclose(path.own_at(t)[:, 1], np.sin(1.3 * t), atol=1e-4)


def test_of_several_runs_the_longest_reference_counts():
    short, whole = path_of(circling(1.0, 2.0, t_end=0.4)), path_of(circling(1.0, 1.8))
    found = longest([short, None, whole])
    assert found is whole and longest([None]) is None


@pytest.mark.parametrize("unit", ["rad", ""])
def test_what_is_no_place_is_no_path(unit):
    """Three components in another unit, a rate for one, are not drawn in space."""
    assert path_of(circling(1.0, 2.0, unit=unit)) is None and path_of(None) is None
