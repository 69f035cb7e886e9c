"""Refine states at the ends of segments until the true flow connects them: the true motion nearest to a computed one.

First the gaps are closed, by damped Gauss-Newton steps of smallest correction (error-oriented damping, Deuflhard 2004,
sect. 4.4); then the motion is moved along the true ones to the nearest, which minimises the sum of squares. No shift of
time is allowed: states are compared at the same times. The search for the nearest stops early (``NEAREST``,
``SETTLED``): RATTLE on the chain at 1e-3 s over 20 s has an rms distance of 0.693 mm, of 0.684 mm with bounds a
hundredth and a tenth as large. Both are true motions, and bound the distance of the nearest from above.
"""

import numpy as np
from jaxtyping import Float

from .corrections import Continuity, Frames
from .equations import FlowEquations
from .flow import ROUGH, TOLERANCE, integrate_flow, transport_changes

CLOSED = 1e-10  # [m] in the metric: largest gap of a closed motion
TANGENTS = 4  # number of directions along which tangents cost about as much as a correction
ASTRAY = 64  # most steps of a segment, where a regular motion takes 24: one that takes more is not near the given one
PROJECTIONS = 4  # Newton steps onto the joints, each of which doubles the correct digits: 1e-1 becomes 1e-16
# six halvings of a correction: each costs a flow and gains half as much, fewer give up sooner
LEAST_DAMPING = 1 / 64
MOST_ITERATIONS = 20  # corrections: more follow gaps that close slowly, fewer give up on motions that have a shadow
MOST_TANGENTS = 10  # most computations of tangents to close gaps; generalised alpha on the chain over 20 s takes 9
MOST_APPROACHES = 6  # most steps: the distance of the nearest is bounded from above wherever the search stops
NEAREST = 1e-1  # relative to the distance: a step whose square is negligible
SETTLED = 1e-3  # relative to the distance: the least gain of a step
NEARLY = 1e-4  # relative to the distance: gaps allowed during the search for the nearest motion


class Refinement:
    """The nodes of a motion, refined towards a true one.

    ``frames`` are those of the last linearisation, in which corrections and gaps are expressed.
    """

    def __init__(
        self, E: FlowEquations, t: Float[np.ndarray, " nodes"], given: Float[np.ndarray, "nodes ny"], tau: float
    ) -> None:
        self.E, self.t, self.given, self.tau, self.iterations = E, t, given, tau, 0
        self._h = np.diff(t)
        w = 0.5 * (np.append(self._h, 0.0) + np.insert(self._h, 0, 0.0))
        self._w = w / np.sum(w)
        self._steps, self._rough = np.ones((2, len(self._h)), dtype=np.int64)
        self._set_nodes(given)
        self.frames = Frames.compute(E, t, self.y, tau)

    def _set_nodes(self, y: np.ndarray, rough: bool = False) -> None:
        """Set the nodes to ``y``, with closed loops, and compute the jumps of the true flow from node to node.

        With ``rough`` the flow has the wider tolerance of intermediate iterations.
        """
        for _ in range(PROJECTIONS):
            y = self.E.project(self.t, y)
        self.y = y
        how = (self._rough, ROUGH) if rough else (self._steps, TOLERANCE)
        ends = integrate_flow(self.E, self.t[:-1], self._h, y[:-1], *how, ASTRAY)
        self.jumps = ends - y[1:]

    def _linearise(self) -> Continuity:
        """Compute bases and tangents at the nodes; return the conditions on corrections that close the gaps."""
        self.frames = Frames.compute(self.E, self.t, self.y, self.tau)
        directions = np.swapaxes(self.frames.basis[:-1], 1, 2)
        Y = transport_changes(self.E, self.t[:-1], self._h, self.y[:-1], directions, self._steps)
        return Continuity(self.frames.coordinates[1:] @ np.swapaxes(Y, 1, 2), self._w)

    @property
    def gaps(self) -> Float[np.ndarray, "n m"]:
        """The jumps between segments, in coordinates of the bases at their ends [m]."""
        return np.einsum("kij,kj->ki", self.frames.coordinates[1:], self.jumps)

    @property
    def gap(self) -> float:
        """The largest gap between segments [m]; infinite where the flow fails."""
        largest = float(np.max(np.linalg.norm(self.gaps, axis=1)))
        return largest if np.isfinite(largest) else np.inf

    def close(self, linear: Continuity | None = None) -> bool:
        """Close the gaps by corrections of the nodes; return whether that succeeded.

        ``linear`` are conditions from known tangents, which saves computing the first ones.
        """
        try:
            return np.isfinite(self.gap) and self._close(linear)
        except np.linalg.LinAlgError:  # raised where the mechanism is singular
            return False

    def _close(self, linear: Continuity | None) -> bool:
        """Close the gaps by at least one correction, and return whether they are below ``CLOSED``.

        Without a correction an accurate motion would be its own shadow. Raise LinAlgError where the mechanism is
        singular.
        """
        left = MOST_TANGENTS
        for _ in range(MOST_ITERATIONS):
            if (self.iterations and self.gap < CLOSED) or not np.isfinite(self.gap) or (linear is None and left == 0):
                break
            if linear is None:
                linear, left = self._linearise(), left - 1
            self.iterations += 1
            z = linear.find_least_corrections(-self.gaps)
            size, after, y, steps, damping = linear.measure_size(z), np.inf, self.y, self._steps, 1.0
            while damping == 1.0 or not (after <= (1.0 - damping / 4.0) * size or self.gap < CLOSED):
                if damping < LEAST_DAMPING:
                    return False
                self._steps = steps.copy()  # a motion that went astray took many steps
                self._set_nodes(y + damping * self.frames.move(z))
                after = (
                    linear.measure_size(linear.find_least_corrections(-self.gaps)) if np.isfinite(self.gap) else np.inf
                )
                damping *= 0.5
            corrections = np.log(CLOSED / max(self.gap, CLOSED)) / np.log(after / size) if after < size else np.inf
            linear = linear if TANGENTS * corrections < z.shape[1] else None  # new tangents would cost more
        return self.gap < CLOSED

    def approach(self) -> None:
        """Move a closed motion towards the nearest true one; restore it if the gaps cannot be closed again."""
        before = self.y
        linear = self._approach()
        self._set_nodes(self.y)
        if not self.close(linear):
            self._set_nodes(before)

    def _approach(self) -> Continuity | None:
        """Approach the nearest motion by conjugate directions; return the last conditions if valid at the nodes."""
        damping, direction, last = 1.0, np.zeros_like(self.y), np.inf
        for _ in range(MOST_APPROACHES):
            linear = self._linearise()
            away = self.frames.measure(self.y - self.given)
            along = linear.find_least_corrections(linear.apply(away)) - away
            before, steepest, y = linear.measure_size(away), linear.measure_size(along), self.y
            if steepest < NEAREST * before:
                return linear
            conjugate = self.frames.measure(direction)
            conjugate -= linear.find_least_corrections(linear.apply(conjugate))
            z = along + (steepest / last) ** 2 * conjugate
            slope = -linear.product(away, z)
            if not slope > 0.0:
                z, slope = along, steepest**2
            direction, last = self.frames.move(z), steepest
            while not (after := self._step(linear, y + damping * direction)) < before:
                damping *= 0.5
                if damping < LEAST_DAMPING:
                    self._set_nodes(y)
                    return linear
            if before - after < SETTLED * before:
                return None
            bend = after**2 - before**2 + 2.0 * damping * slope  # curvature of the square along the step, a parabola
            damping = min(1.0, slope * damping**2 / bend) if bend > 0.0 else 1.0
        return None

    def _step(self, linear: Continuity, y: np.ndarray) -> float:
        """Move to the motion ``y`` and close its gaps between pieces by Newton steps of ``linear``.

        Return the distance [m] from the given motion; infinite where gaps remain: the caller must then place the motion
        anew. Counts an iteration.
        """
        steps = self._rough.copy()
        self._set_nodes(y, rough=True)
        self.iterations += 1
        last = np.inf
        while self.gap >= max(CLOSED, NEARLY * linear.measure_size(self.frames.measure(self.y - self.given))):
            z = linear.find_least_corrections(-self.gaps)
            if not linear.measure_size(z) < 0.5 * last:
                self._rough = steps  # keep the steps, as in ``_close``
                return np.inf
            last = linear.measure_size(z)
            self._set_nodes(self.y + self.frames.move(z), rough=True)
        return linear.measure_size(self.frames.measure(self.y - self.given))
