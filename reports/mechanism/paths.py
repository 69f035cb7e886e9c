"""The path of a point that a problem observes, beside its exact one: what a moving picture traces."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...harness.results.series import Series

KINDS = ("obs", "ref")


@dataclass(frozen=True)
class PointPath:
    """Of the point ``name``; ``exact`` ends at the horizon of the reference."""

    name: str
    t: Float[np.ndarray, " nt"]
    own: Float[np.ndarray, "nt 3"]
    exact_t: Float[np.ndarray, " ne"]
    exact: Float[np.ndarray, "ne 3"]

    def exact_at(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "m 3"]:
        """At those of ``t`` that are not beyond the horizon."""
        return _between(t[t <= self.exact_t[-1]], self.exact_t, self.exact)

    def own_at(self, t: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """At ``t``, held where the run ended."""
        return _between(t, self.t, self.own)


def path_of(series: Series | None) -> PointPath | None:
    """The first point with the observables ``<point>_x``, ``_y``, ``_z`` in metres and their reference."""
    if series is None:
        return None
    for name in (n.removesuffix("_x") for n in series.named("obs_") if n.endswith("_x")):
        columns = [f"{name}_{axis}" for axis in "xyz"]
        if all(f"{kind}_{c}" in series and series.units.get(f"obs_{c}") == "m" for c in columns for kind in KINDS):
            own, exact = (np.stack([series[f"{kind}_{c}"] for c in columns], axis=1).astype(float) for kind in KINDS)
            known, whole = (np.isfinite(a).all(axis=1) for a in (exact, own))
            if known.any() and whole.any():
                return PointPath(name, series["t"][whole], own[whole], series["t"][known], exact[known])
    return None


def longest(paths: Iterable[PointPath | None]) -> PointPath | None:
    """The one whose exact motion is known to the latest time."""
    return max((p for p in paths if p is not None), key=lambda p: float(p.exact_t[-1]), default=None)


def _between(t: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(t, known, column) for column in values.T], axis=1)
