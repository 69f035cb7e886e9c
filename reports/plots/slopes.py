"""Add slope triangles to plots of error against step: find the whole orders, and place triangles in free space.

All is computed in the plot's own logarithms, from 0 to 1 across the data, so that a page and a printed figure agree.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from .spec import Plot, Trace, Triangle

NEAR = 0.2  # distance from a whole order within which a ladder's slopes follow it
LEAST = 3  # least number of consecutive runs for an order
APART = 1.05  # least ratio of neighbouring steps for a slope
WIDTHS = (0.2, 0.16, 0.12, 0.09, 0.06)  # fractions of the plot; the widest that fits is used
TALLEST = 0.35  # largest height, fraction of the plot; a steep triangle is narrower
CLEAR = 0.04  # clearance around a triangle, fraction of the plot: a marker and a half
DIGIT_X, DIGIT_Y = 0.05, 0.085  # fraction of the plot: room for the digits at the legs
GRID = 33  # trial places along each side
DENSE = 0.01  # fraction of the plot: distance between points of a line
BELOW = 0.6  # fraction of the plot: how far below all data a triangle may be placed
ZERO = 20.0  # zeros are drawn this many times below the smallest positive value

Points = np.ndarray  # (n, 2), fractions of the plot


def find_order(x: np.ndarray, y: np.ndarray) -> int:
    """Return the whole order that the longest sequence of neighbouring slopes of a ladder follows; 0 for none.

    ``x`` are steps and ``y`` errors. Pairs that are not positive, and steps nearly equal to the one before, are left
    out; fewer than ``LEAST`` runs have no order.
    """
    good = (x > 0.0) & (y > 0.0) & np.isfinite(x) & np.isfinite(y)
    at = np.argsort(x[good])
    x, y = x[good][at], y[good][at]
    kept = [k for k in range(len(x)) if k == 0 or x[k] > APART * x[k - 1]]
    if len(kept) < LEAST:
        return 0
    slopes = np.diff(np.log(y[kept])) / np.diff(np.log(x[kept]))
    best, longest = 0, LEAST - 2
    for order in range(1, round(max(slopes.max(), 0.0)) + 1):
        length = 0
        for slope in slopes:
            length = length + 1 if abs(slope - order) <= NEAR else 0
            if length > longest:
                best, longest = order, length
    return best


def add_triangles(plot: Plot, orders: Iterable[tuple[int, Trace]]) -> Plot:
    """Return the plot with a triangle for each positive order, near a trace of that order.

    ``orders`` holds pairs of an order and a trace. A plot without an extent along both axes is returned as it is.
    """
    owners: dict[int, list[Trace]] = {}
    for order, trace in orders:
        if order > 0:
            owners.setdefault(order, []).append(trace)
    frame = _Frame(plot.traces)
    if not owners or not frame.is_plane:
        return plot
    taken = [frame.sample_trace(t) for t in plot.traces]
    out = []
    for order in sorted(owners):
        near = np.concatenate([frame.sample_trace(t) for t in owners[order]])
        triangle = frame.place_triangle(order, np.concatenate(taken), near)
        out.append(triangle)
        taken.append(frame.cover_triangle(triangle))
    return replace(plot, triangles=tuple(out))


class _Frame:
    """The logarithms of a plot's axes, scaled to 0 to 1 over the data."""

    def __init__(self, traces: Sequence[Trace]) -> None:
        """Set the frame around the positive, finite values of the traces; zeros lie ``ZERO`` times below."""
        self.low, self.size = np.zeros(2), np.zeros(2)
        for k, key in enumerate(("x", "y")):
            all_ = np.concatenate([np.asarray(getattr(t, key), dtype=float) for t in traces] or [np.zeros(0)])
            good = all_[np.isfinite(all_) & (all_ > 0.0)]
            if len(good):
                least = good.min() / (ZERO if np.any(all_ == 0.0) else 1.0)
                self.low[k], self.size[k] = np.log(least), np.log(good.max() / least)

    @property
    def is_plane(self) -> bool:
        """True if the values span more than one point along both axes, so that slopes exist."""
        return bool(np.all(self.size > 0.0))

    def sample_trace(self, trace: Trace) -> Points:
        """Return the points of a trace and, if it has a line, points densely along it, as fractions of the plot."""
        with np.errstate(divide="ignore"):
            logs = np.log(np.array([trace.x, trace.y], dtype=float)).T
        uv = (np.maximum(logs, self.low) - self.low) / self.size
        uv = uv[np.all(np.isfinite(uv), axis=1)]
        if "lines" not in trace.mode or len(uv) < 2:
            return uv
        return np.concatenate(
            [
                a + (b - a) * np.linspace(0.0, 1.0, int(np.max(np.abs(b - a)) / DENSE) + 2)[:, None]
                for a, b in itertools.pairwise(uv)
            ]
        )

    def place_triangle(self, order: int, drawn: Points, own: Points) -> Triangle:
        """Return the widest triangle that overlaps no point of ``drawn``, as near as possible to the points ``own``.

        These are of the traces with its order. If there is no room between the data, it is placed below them.
        """
        for bottom in (0.0, -BELOW):
            for width in WIDTHS:
                width = min(width, TALLEST * self.size[1] / (order * self.size[0]))
                found = self._find_free_corner(order, width, drawn, own, bottom)
                if found is not None:
                    return self._make_triangle(order, width, found)
        return self._make_triangle(order, width, np.array([0.5, -BELOW]))  # far below all data

    def _find_free_corner(
        self, order: int, width: float, drawn: Points, own: Points, bottom: float
    ) -> np.ndarray | None:
        """Return the lower left corner of the triangle that is nearest to ``own`` and free; None if there is none.

        It is free if no point of ``drawn`` is near the triangle. Corners of a grid from ``bottom`` upwards are tried.
        """
        height = order * width * self.size[0] / self.size[1]
        right, top = 1.0 - width - DIGIT_X, 1.0 - height
        u, v = np.meshgrid(np.linspace(0.0, right, GRID), np.linspace(bottom + DIGIT_Y, top, GRID))
        corners = np.column_stack([u.ravel(), v.ravel()])
        free = np.concatenate(
            [
                ~np.any(_find_covered(drawn - some[:, None], width, height), axis=1)
                for some in np.array_split(corners, GRID)  # bounds the memory
            ]
        )
        if not np.any(free):
            return None
        centres = corners[free] + np.array([width, height]) * (2.0 / 3.0, 1.0 / 3.0)
        distance = np.min(np.hypot(*(centres[:, None, :] - own[None, ::5, :]).transpose(2, 0, 1)), axis=1)
        return corners[free][int(np.argmin(distance))]

    def _make_triangle(self, order: int, width: float, corner: np.ndarray) -> Triangle:
        """Return the triangle of slope ``order`` and ``width`` (fraction of the plot) at a corner, in plot units."""
        x0, y0 = np.exp(self.low + corner * self.size)
        x1 = float(np.exp(self.low[0] + (corner[0] + width) * self.size[0]))
        return Triangle(order, (float(x0), x1), (float(y0), float(y0 * (x1 / x0) ** order)))

    def cover_triangle(self, triangle: Triangle) -> Points:
        """Return a grid of points that covers a triangle and its digits."""
        a, b = ((np.log(k) - self.low) / self.size for k in zip(triangle.x, triangle.y, strict=True))
        u, v = np.meshgrid(np.linspace(a[0], b[0] + DIGIT_X, 12), np.linspace(a[1] - DIGIT_Y, b[1], 12))
        return np.column_stack([u.ravel(), v.ravel()])


def _find_covered(points: Points, width: float, height: float) -> np.ndarray:
    """Return the mask of points, relative to the lower left corner, in the triangle, at its digits, or too close."""
    u, v = points[..., 0], points[..., 1]
    inside = (u > -CLEAR) & (u < width + DIGIT_X) & (v > -DIGIT_Y) & (v < height + CLEAR)
    return inside & (v < (u * height / width) + CLEAR * (1.0 + height / width))
