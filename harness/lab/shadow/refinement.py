"""Refine states at the ends of segments until the true flow connects them: the true motion nearest to a computed one.

First the gaps are closed, by damped Gauss-Newton steps of smallest correction (error-oriented damping, Deuflhard 2004,
sect. 4.4); then the motion is moved along the true ones to the nearest, which minimises the sum of squares. No shift of
time is allowed: states are compared at the same times. The search for the nearest stops early (``NEAREST``,
``LEAST_GAIN``): RATTLE on the chain at 1e-3 s over 20 s has an rms distance of 0.693 mm, of 0.684 mm with bounds a
hundredth and a tenth as large. Both are true motions, and bound the distance of the nearest from above.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ...base.iteration import FAILED, GO_ON, SETTLED, STALE, iterate
from .corrections import Continuity, Frames
from .equations import FlowEquations
from .flow import ROUGH, TOLERANCE, integrate_flow, transport_changes

CLOSED = 1e-10  # [m] in the metric: largest gap of a closed motion
TANGENTS = 4  # number of directions along which tangents cost about as much as a correction
ASTRAY = 64  # most steps of a segment, where a regular motion takes 24: one that takes more is not near the given one
PROJECTIONS = 4  # Newton steps onto the joints, each of which doubles the correct digits: 1e-1 becomes 1e-16
# six halvings of a correction: each costs a flow and gains half as much, fewer give up sooner
LEAST_DAMPING = 1 / 64
# least factor of a correction, and share of it by which the next one is smaller at least
DAMPED, UNDAMPED = (LEAST_DAMPING, 1 / 8), (1.0, 1 / 2)
MOST_ITERATIONS = 20  # corrections: more follow gaps that close slowly, fewer give up on motions that have a shadow
MOST_TANGENTS = 10  # most computations of tangents to close gaps; generalised alpha on the chain over 20 s takes 9
MOST_APPROACHES = 6  # most steps: the distance of the nearest is bounded from above wherever the search stops
NEAREST = 1e-1  # relative to the distance: a step whose square is negligible
LEAST_GAIN = 1e-3  # relative to the distance: the least gain of a step
NEARLY = 1e-4  # relative to the distance: gaps allowed during the search for the nearest motion


@dataclass
class Corrections:
    """Corrections that close gaps: their tangents, and what is known of the next one.

    Those with ``rough`` are undamped, and have known tangents alone; they end where these do not halve them.
    """

    linear: Continuity | None = None  # conditions from known tangents
    rough: bool = False
    tangents: int = MOST_TANGENTS  # that may still be computed
    z: Float[np.ndarray, "nodes m"] | None = None  # the next correction
    fall: float = np.inf  # ratio of its size to that of the last one


class Refinement:
    """The nodes of a motion, refined towards a true one.

    ``frames`` are those of the last linearisation, in which corrections and gaps are expressed.
    """

    def __init__(
        self, E: FlowEquations, t: Float[np.ndarray, " nodes"], given: Float[np.ndarray, "nodes ny"], tau: float
    ) -> None:
        """Begin with the states ``given`` at times ``t`` [s], with closed loops; ``tau`` [s] weighs velocities."""
        self.E, self.t, self.given, self.tau, self.iterations = E, t, given, tau, 0
        self._h = np.diff(t)
        w = 0.5 * (np.append(self._h, 0.0) + np.insert(self._h, 0, 0.0))
        self._w = w / np.sum(w)
        self._steps = [*np.ones((2, len(self._h)), dtype=np.int64)]  # of the flow in each segment; the second are rough
        self._set_nodes(given)
        self.frames = Frames.compute(E, t, self.y, tau)

    def _set_nodes(self, y: np.ndarray, rough: bool = False) -> None:
        """Set the nodes to ``y``, with closed loops, and compute the jumps of the true flow from node to node.

        With ``rough`` the flow has the wider tolerance of intermediate iterations.
        """
        for _ in range(PROJECTIONS):
            y = self.E.project(self.t, y)
        self.y = y
        tolerance = ROUGH if rough else TOLERANCE
        ends = integrate_flow(self.E, self.t[:-1], self._h, y[:-1], self._steps[rough], tolerance, ASTRAY)
        self.jumps = ends - y[1:]

    def _linearise(self) -> Continuity:
        """Compute bases and tangents at the nodes; return the conditions on corrections that close the gaps."""
        self.frames = Frames.compute(self.E, self.t, self.y, self.tau)
        directions = np.swapaxes(self.frames.basis[:-1], 1, 2)
        Y = transport_changes(self.E, self.t[:-1], self._h, self.y[:-1], directions, self._steps[False])
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

    def close_gaps(self, linear: Continuity | None = None) -> bool:
        """Close the gaps by corrections of the nodes; return whether that succeeded.

        ``linear`` are conditions from known tangents, which saves computing the first ones. False also where the
        mechanism is singular.
        """
        try:
            return self._close_gaps(Corrections(linear))
        except np.linalg.LinAlgError:  # raised where the mechanism is singular
            return False

    def _close_gaps(self, c: Corrections) -> bool:
        """Close the gaps by at least one correction of the given motion, and return whether that succeeded.

        Without a correction an accurate motion would be its own shadow. Raise LinAlgError where the mechanism is
        singular.
        """
        if self.iterations and self._is_closed(c):
            return True
        return np.isfinite(self.gap) and iterate(c, self._correct, self._classify, MOST_ITERATIONS)

    def _correct(self, c: Corrections, i: int, stale: bool) -> float:
        """Correct the nodes once, and return the largest gap that is left [m].

        The correction is halved until the next one is smaller by enough; the gap is infinite where the least damping
        does not suffice. Tangents that are missing or ``stale`` are computed first. The index ``i`` is unused.
        """
        if c.linear is None or stale:
            c.linear, c.tangents, c.z = self._linearise(), c.tangents - 1, None
        self.iterations += not c.rough
        z = c.linear.find_least_corrections(-self.gaps) if c.z is None else c.z
        size, move, y, steps = c.linear.measure_size(z), self.frames.move(z), self.y, self._steps[c.rough]
        damping, least, gain = (1.0, *(UNDAMPED if c.rough else DAMPED))
        while damping >= least:
            self._steps[c.rough] = steps.copy()  # a motion that went astray took many steps
            self._set_nodes(y + damping * move, c.rough)
            if self._is_closed(c):
                return self.gap
            if np.isfinite(self.gap):
                c.z = c.linear.find_least_corrections(-self.gaps)
                after = c.linear.measure_size(c.z)
                if after <= (1.0 - gain * damping) * size:
                    c.fall = after / size
                    return self.gap
            damping *= 0.5
        return np.inf

    def _classify(self, c: Corrections, i: int, size: float, last: float) -> int:
        """Return whether the gaps, of which the largest is ``size`` [m], are closed, cannot be closed, or remain.

        The codes are those of ``iterate``: if gaps remain, STALE asks for new tangents where these pay. ``i`` and
        ``last`` are unused.
        """
        if not np.isfinite(size):
            return FAILED
        if self._is_closed(c):
            return SETTLED
        corrections = np.log(CLOSED / size) / np.log(c.fall)  # that are left with these tangents
        if c.rough or (c.z is not None and TANGENTS * corrections < c.z.shape[1]):
            return GO_ON
        return STALE if c.tangents else FAILED

    def _is_closed(self, c: Corrections) -> bool:
        """Return whether the largest gap is below ``CLOSED`` or, for ``rough``, ``NEARLY`` times the distance."""
        if not c.rough or c.linear is None:
            return self.gap < CLOSED
        return self.gap < max(CLOSED, NEARLY * self._measure_distance(c.linear))

    def _measure_distance(self, linear: Continuity) -> float:
        """Return the distance [m] of the nodes from the given motion, in the metric."""
        return linear.measure_size(self.frames.measure(self.y - self.given))

    def approach_nearest(self) -> None:
        """Move a closed motion towards the nearest true one; restore it if the gaps cannot be closed again."""
        before = self.y
        linear = self._search_nearest()
        self._set_nodes(self.y)
        if not self.close_gaps(linear):
            self._set_nodes(before)

    def _search_nearest(self) -> Continuity | None:
        """Approach the nearest motion by conjugate directions; return the last linearised conditions, or None.

        They are returned if they hold at the nodes where the search stops, which saves computing them again.
        """
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
            while not (after := self._close_after_move(linear, y + damping * direction)) < before:
                damping *= 0.5
                if damping < LEAST_DAMPING:
                    self._set_nodes(y)
                    return linear
            if before - after < LEAST_GAIN * before:
                return None
            bend = after**2 - before**2 + 2.0 * damping * slope  # curvature of the square along the step, a parabola
            damping = min(1.0, slope * damping**2 / bend) if bend > 0.0 else 1.0
        return None

    def _close_after_move(self, linear: Continuity, y: np.ndarray) -> float:
        """Move the nodes to ``y`` and close the gaps by undamped corrections with the conditions ``linear``.

        Return the distance [m] from the given motion; infinite where gaps remain: the caller must then place the motion
        anew. Counts an iteration.
        """
        steps = self._steps[True].copy()
        self._set_nodes(y, rough=True)
        self.iterations += 1
        if self._close_gaps(Corrections(linear, rough=True)):
            return self._measure_distance(linear)
        self._steps[True] = steps  # a motion that went astray took many steps
        return np.inf
