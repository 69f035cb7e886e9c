"""The positions of all unknowns in y = (p, u, lam): body by body, then the constraint rows in use.

Elements read y through index arrays. Known quantities are constants stored after y: the ground's coordinates, its zero
velocity, one zero for the multiplier of a dropped row, and the time. The accelerations w = u_dot are followed by the
ground's, which are zero.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ...harness.mechanics.system import GROUND, MultibodySystem
from .charts import Chart


@dataclass(frozen=True)
class Layout:
    """Sizes and indices of y (n) = p (n_p), u (n_u), lam (k), where lam belongs to the ``kept`` rows of phi."""

    system: MultibodySystem
    chart: Chart
    kept: Int[np.ndarray, " k"]

    @property
    def n_p(self) -> int:
        """Number of coordinates of all bodies."""
        return self.system.nb * self.chart.size

    @property
    def n_u(self) -> int:
        """Number of velocities of all bodies, six each."""
        return self.system.nb * 6

    @property
    def k(self) -> int:
        """Number of kept constraint rows, and of multipliers."""
        return len(self.kept)

    @property
    def n(self) -> int:
        """Number of unknowns y = (p, u, lam)."""
        return self.n_p + self.n_u + self.k

    @property
    def p(self) -> slice:
        """Slice of y with the coordinates of all bodies."""
        return slice(0, self.n_p)

    @property
    def u(self) -> slice:
        """Slice of y with the velocities of all bodies."""
        return slice(self.n_p, self.n_p + self.n_u)

    @property
    def lam(self) -> slice:
        """Slice of y with the multipliers of the kept rows."""
        return slice(self.n_p + self.n_u, self.n_p + self.n_u + self.k)

    @property
    def constants(self) -> Float[np.ndarray, " c"]:
        """Constants stored after y: p and u of the ground, a zero for dropped multipliers, and the time, here 0."""
        return np.concatenate((self.chart.at_rest, np.zeros(8)))

    @property
    def time(self) -> int:
        """Index of the time in y followed by its constants."""
        return self.n + self.chart.size + 7

    def index_bodies(self, b: Int[np.ndarray, " m"]) -> Int[np.ndarray, "m s"]:
        """Return the indices in y of (p, u) of the bodies ``b``; those of the ground point to the constants after y."""
        size, ground = self.chart.size, (b == GROUND)[:, None]
        p = np.where(ground, self.n + np.arange(size), b[:, None] * size + np.arange(size))
        u = np.where(ground, self.n + size + np.arange(6), self.n_p + b[:, None] * 6 + np.arange(6))
        return np.concatenate((p, u), axis=1)

    def index_velocities(self, b: Int[np.ndarray, " m"]) -> Int[np.ndarray, "m 6"]:
        """Return the indices in w of the accelerations u_dot of the bodies ``b``; the ground's follow all others."""
        return np.where((b == GROUND)[:, None], self.n_u + np.arange(6), b[:, None] * 6 + np.arange(6))

    def index_rows(self, rows: Int[np.ndarray, "m r"]) -> Int[np.ndarray, "m r"]:
        """Return the index of each of these ``rows`` of phi among the kept rows; -1 for a dropped row."""
        place = np.full(self.system.nrows, -1)
        place[self.kept] = np.arange(self.k)
        return place[rows]

    def index_multipliers(self, rows: Int[np.ndarray, "m r"]) -> Int[np.ndarray, "m r"]:
        """Return the indices in y of the multipliers of these ``rows`` of phi.

        A dropped row gets the index of the constant zero stored after y.
        """
        place = self.index_rows(rows)
        return np.where(place < 0, self.n + self.chart.size + 6, self.lam.start + place)

    def all_rows(self, lam: Float[np.ndarray, " k"]) -> Float[np.ndarray, " nrows"]:
        """Return the multipliers ``lam`` of the kept rows as a vector over all rows, zero on the dropped ones."""
        out = np.zeros(self.system.nrows)
        out[self.kept] = lam
        return out


@dataclass(frozen=True)
class StabilisedLayout(Layout):
    """The layout of y = (p, u, lam, eta), with eta the second multipliers of stabilised index 2."""

    @property
    def n(self) -> int:
        """Number of unknowns y = (p, u, lam, eta)."""
        return super().n + self.k

    @property
    def eta(self) -> slice:
        """Slice of y with the second multipliers, those of the velocity rows A u = 0."""
        return slice(self.lam.stop, self.n)
