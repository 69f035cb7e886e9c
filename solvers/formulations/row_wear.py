"""A check, at a few microseconds, whether the rows that a code keeps approach dependence, and a search for better ones.

Rows kept once may become dependent where all rows together do not; the constraints then seem to lose rank, and a code
that passes the place integrates with a joint open. The sine of the angle between each row and the span of those before
it is monitored, in the metric of ``even_jacobian``: that of the masses changes as slender bodies turn.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from .assembly import Assembly, Batch
from .layout import Layout
from .rank import better_rows
from .saddle import InverseMass, Saddle
from .symbolic import jacobian_element
from .system_elements import jacobian_pattern, rows_by_kind

WORN = 0.5  # share of a row's sine at the choice, at which the choice is made again
LARGEST = 100  # rows of phi that are monitored: beyond it singular values cost as much as hundreds of steps


class RowWear:
    """The kept rows of ``layout`` along a motion; where none are redundant there is nothing to choose or monitor."""

    def __init__(self, layout: Layout) -> None:
        watched = 0 < layout.k < layout.system.nrows <= LARGEST
        self._layout, self._steps, self._limit = layout, 0, WORN
        self._sines, self._first = Sines(layout) if watched else None, np.zeros(0)

    def better_rows(self, pu: Float[np.ndarray, " n"], t: float, every: int) -> Int[np.ndarray, " k"] | None:
        """Return more independent constraint rows at an accepted step, or None while the kept ones serve.

        They are searched for if the sine of a row's angle is below half of that at the choice. After a search the limit
        is half of the least sine then, until the rows recover. One of ``every`` steps is checked: a check costs some 9
        us, of small mechanisms a sixth of a step of IDA. ``pu`` begins with (p, u), ``t`` is in s.
        """
        turn, self._steps = self._steps % every, self._steps + 1
        if self._sines is None or turn:
            return None
        at, sines = self._layout, self._sines.at(pu, t)
        if not len(self._first):
            self._first = sines
        left = float((sines / self._first).min())
        if left > self._limit:
            self._limit = min(WORN, max(WORN * left, self._limit))
            return None
        self._limit = WORN * left
        p, u = pu[at.p].reshape(1, at.system.nb, -1), pu[at.u].reshape(1, at.system.nb, 6)
        kept = better_rows(at.system, replace(at.chart.states(p, u)[0], t=t), at.kept)
        return None if kept is at.kept else kept


class Sines:
    """Sines of the angles between each kept row and the span of those before it, all velocities in m/s."""

    def __init__(self, layout: Layout) -> None:
        s = layout.system
        even = replace(s, mass=np.ones(s.nb), inertia=np.eye(3) * s.gyration[:, None, None] ** 2)
        layout = Layout(even, layout.chart, layout.kept)
        pattern, place = jacobian_pattern(layout)
        batches, used = [], 0
        for of in rows_by_kind(layout):
            entries = slice(used, used := used + 12 * of.rows.size)
            z, out = np.concatenate((of.ends.z, of.ends.t), axis=1), place[entries].reshape(len(of.rows), -1)
            batches.append(Batch(jacobian_element(of.kind, layout.chart), of.numbers, z, of.ends.w, out))
        self._rows = rows = Assembly(layout, batches, pattern.nnz, differentiable=False)
        right = np.zeros(layout.n_u), np.zeros(layout.k)
        self._saddle = Saddle(layout, pattern, InverseMass(layout, rows.y), rows.out[:-1], *right)
        self._pu, self._size = rows.y[: layout.lam.start], layout.lam.start

    def at(self, pu: Float[np.ndarray, " n"], t: float) -> Float[np.ndarray, " k"]:
        """Return the sine of each kept row's angle with the span of those before it, in the order of a band.

        After a row that depends on those before it they are meaningless.
        """
        self._pu[:], self._rows.t[0] = pu[: self._size], t
        self._rows.evaluate.run()
        return self._saddle.sines()
