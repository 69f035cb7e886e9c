"""A cheap check whether the constraint rows in use approach dependence, and a search for better ones.

Rows chosen at one pose may become dependent later although all rows together do not; the constraints then seem to lose
rank, and an integrator that passes that pose continues with a joint open. The check monitors the sine of the angle
between each row and the span of those before it, in the metric of ``scale_jacobian``: that of the masses changes as
slender bodies turn.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from .assembly import Assembly, Batch
from .layout import Layout
from .rank import find_better_rows
from .saddle import InverseMass, Saddle
from .symbolic import make_jacobian_element
from .system_elements import find_jacobian_pattern, iterate_joint_kinds

# share of a row's sine at the choice, at which the choice is made again. On two of Bennett's linkages half takes 0 to
# 18 % more evaluations, twice from 8 % fewer to 11 % more; three other mechanisms keep their bits.
WORN = 0.5
LARGEST = 100  # rows of phi that are monitored: beyond it singular values cost as much as hundreds of steps


class RowWear:
    """A monitor of the kept rows of ``layout`` along a motion; it does nothing where no row is redundant."""

    def __init__(self, layout: Layout) -> None:
        watched = 0 < layout.k < layout.system.nrows <= LARGEST
        self._layout, self._steps, self._limit = layout, 0, WORN
        self._sines, self._first = Sines(layout) if watched else None, np.zeros(0)

    def find_better_rows(self, pu: Float[np.ndarray, " n"], t: float, every: int) -> Int[np.ndarray, " k"] | None:
        """Check the rows in use at an accepted step; return more independent rows, or None to keep the present ones.

        Only one of ``every`` calls checks: a check takes some 9 us, for small mechanisms a sixth of a step of IDA. Rows
        are searched for when the sine of a row's angle has fallen to ``WORN`` times its value at the first check. After
        a vain search the limit is ``WORN`` times the ratio then found, until the rows recover. ``pu`` begins with
        (p, u); ``t`` is in s.
        """
        turn, self._steps = self._steps % every, self._steps + 1
        if self._sines is None or turn:
            return None
        at, sines = self._layout, self._sines.compute_sines(pu, t)
        if not len(self._first):
            self._first = sines
        left = float((sines / self._first).min())
        if left > self._limit:
            self._limit = min(WORN, max(WORN * left, self._limit))
            return None
        self._limit = WORN * left
        p, u = pu[at.p].reshape(1, at.system.nb, -1), pu[at.u].reshape(1, at.system.nb, 6)
        kept = find_better_rows(at.system, replace(at.chart.states(p, u)[0], t=t), at.kept)
        return None if kept is at.kept else kept


class Sines:
    """Evaluation of the sines between each kept row and the span of those before it, with all velocities in m/s."""

    def __init__(self, layout: Layout) -> None:
        """Assemble A of ``layout`` for a system of unit masses whose bodies have their own radii of gyration."""
        s = layout.system
        even = replace(s, mass=np.ones(s.nb), inertia=np.eye(3) * s.gyration[:, None, None] ** 2)
        layout = Layout(even, layout.chart, layout.kept)
        pattern, place = find_jacobian_pattern(layout)
        batches, used = [], 0
        for of in iterate_joint_kinds(layout):
            entries = slice(used, used := used + 12 * of.rows.size)
            z, out = np.concatenate((of.ends.z, of.ends.t), axis=1), place[entries].reshape(len(of.rows), -1)
            batches.append(Batch(make_jacobian_element(of.kind, layout.chart), of.numbers, z, of.ends.w, out))
        self._rows = rows = Assembly(layout, batches, pattern.nnz, differentiable=False)
        right = np.zeros(layout.n_u), np.zeros(layout.k)
        self._saddle = Saddle(layout, pattern, InverseMass(layout, rows.y), rows.out[:-1], *right)
        self._pu, self._size = rows.y[: layout.lam.start], layout.lam.start

    def compute_sines(self, pu: Float[np.ndarray, " n"], t: float) -> Float[np.ndarray, " k"]:
        """Return the sine of the angle between each kept row and the span of those before it, in the order of the band.

        ``pu`` begins with (p, u); ``t`` is in s. Sines after a row that depends on those before it are meaningless.
        """
        self._pu[:], self._rows.t[0] = pu[: self._size], t
        self._rows.evaluate.run()
        return self._saddle.compute_sines()
