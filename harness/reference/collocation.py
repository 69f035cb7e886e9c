"""Integrate stiff motions by Radau IIA collocation: implicit, L-stable, of order 2 s - 1 at the ends of s stages.

Z = h A f(y + Z) is solved by simplified Newton steps in the eigenvectors of A^-1 (Hairer, Wanner, Solving ODEs II,
IV.8). Jacobians are differences: they decide how fast the iteration converges, not what to. A step is as long as the
highest Legendre coefficient of its polynomial allows, so that its interior is as exact as its ends. Some solvers under
test use the same family, with three stages on other equations, and none of this code.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float
from numpy.polynomial.legendre import legvander
from scipy.special import roots_jacobi

from .extrapolation import Rate

SWEEPS = 12  # most Newton steps
SLOW = 0.05  # ratio of corrections above which the next step gets a new Jacobian: less pays Jacobians, more pays sweeps
ROUNDING = 1e-11  # relative to the units: smaller corrections that no longer shrink are rounding
# change of an entry for the Jacobian, in its unit: this steers the iteration alone, not what it converges to
DIFFERENCE = 1e-7


class Step(NamedTuple):
    """A step from ``t`` [s] of length ``h`` [s], with y(t + x h) = y + evaluate_nested_basis(x, s) F."""

    t: float
    h: float
    y: Float[np.ndarray, " ny"]
    F: Float[np.ndarray, "s ny"]

    def states(self, x: Float[np.ndarray, " nx"]) -> Float[np.ndarray, "nx ny"]:
        """Return the states (nx, ny) at fractions ``x`` of the step, 0 to 1; beyond 1 they extrapolate."""
        out: np.ndarray = self.y + evaluate_nested_basis(x, len(self.F)) @ self.F
        return out

    @property
    def end(self) -> Float[np.ndarray, " ny"]:
        """The state at the end of the step."""
        out: np.ndarray = self.y + self.F[0]
        return out


class Method(NamedTuple):
    """The constants of Radau IIA with s stages, and the eigenvectors of A^-1, one of each conjugate pair."""

    nodes: Float[np.ndarray, " s"]
    inverse: Float[np.ndarray, "s s"]  # A^-1
    values: Complex[np.ndarray, " m"]  # eigenvalues of A^-1
    to: Complex[np.ndarray, "m s"]  # from stages to eigenvectors
    back: Complex[np.ndarray, "s m"]  # from eigenvectors to stages: take the real part
    polynomial: Float[np.ndarray, "s s"]  # takes Z to F


def evaluate_nested_basis(x: Float[np.ndarray, " nx"], s: int) -> Float[np.ndarray, "nx s"]:
    """Return x, x (1 - x), x^2 (1 - x), ... at the points ``x`` as ``s`` columns: the basis of DOP853's interpolant."""
    return np.cumprod(np.stack([x if k % 2 == 0 else 1.0 - x for k in range(s)], axis=1), axis=1)


@cache
def make_radau(s: int) -> Method:
    """Return the constants of Radau IIA with ``s`` stages.

    The inner nodes are the zeros of a Jacobi polynomial; A integrates Legendre polynomials.
    """
    x = np.append(roots_jacobi(s - 1, 1.0, 0.0)[0], 1.0)
    P = legvander(x, s)
    before = np.concatenate((-np.ones((s, 1)), P[:, :-2]), axis=1)  # P_-1 such that the first integral is x + 1
    integrals = (P[:, 1:] - before) / (2.0 * np.arange(s) + 1.0)
    inverse, nodes = 2.0 * P[:, :-1] @ np.linalg.inv(integrals), 0.5 * (x + 1.0)
    values, T = np.linalg.eig(inverse)
    upper = values.imag >= 0.0  # one eigenvalue of each conjugate pair
    back = T[:, upper] * np.where(values[upper].imag > 0.0, 2.0, 1.0)
    return Method(
        nodes, inverse, values[upper], np.linalg.inv(T)[upper], back, np.linalg.inv(evaluate_nested_basis(nodes, s))
    )


def estimate_jacobian(
    f: Rate, y: Float[np.ndarray, " ny"], units: Float[np.ndarray, " ny"]
) -> Float[np.ndarray, "ny ny"]:
    """Return the Jacobian df/dy at ``y`` by forward differences of ``DIFFERENCE`` times the ``units`` (scales) of y.

    ``f`` takes stacked states. Columns of entries with an infinite unit (time) are zero: their stages are known.
    """
    known = np.isfinite(units)
    change = DIFFERENCE * units[known]
    rates = f(y + np.concatenate((np.zeros((1, len(y))), np.diag(np.where(known, DIFFERENCE * units, 0.0))[known])))
    J = np.zeros((len(y), len(y)))
    J[:, known] = (rates[1:] - rates[0]).T / change
    return J


@dataclass
class Collocation:
    """The integration of the autonomous y_dot = f(y), with its last step, step size and Jacobian.

    A further call of ``steps`` continues with these; its start may differ by rounding from the end of the last step.
    """

    f: Rate
    begin: Callable[[], None] = lambda: None  # called before each step
    s: int = 7  # stages
    next_h: float = np.inf  # [s]
    past: Step | None = None  # the last step, which predicts the next stages
    J: np.ndarray | None = None  # Jacobian in use; None to compute a new one

    def steps(
        self, y: Float[np.ndarray, " ny"], span: float, tolerance: float, units: Float[np.ndarray, " ny"]
    ) -> Iterator[Step]:
        """Yield the accepted steps from the state ``y`` over ``span`` [s]; times are counted from its start.

        The highest Legendre coefficient of a step stays below ``tolerance`` times ``units``, the scales of y's entries.
        Raises ArithmeticError if a step would be shorter than 1e-9 of the span.
        """
        method, t, solved, inverse = make_radau(self.s), 0.0, 0.0, np.zeros(0)
        while t < span:
            self.begin()
            left = max(1, int(np.ceil((span - t) / self.next_h - 1e-3)))
            h = (span - t) / left
            past, guess = self.past, np.zeros((self.s, len(y)))
            if past is not None:
                guess = past.states(1.0 + method.nodes * h / past.h) - past.end
            fresh = self.J is None
            if self.J is None:
                self.J = estimate_jacobian(self.f, y + guess[self.s // 2], units)
            if fresh or abs(h - solved) > 1e-6 * h:
                inverse, solved = np.linalg.inv(method.values[:, None, None] / h * np.eye(len(y)) - self.J), h
            scale = np.where(np.isfinite(units), units, h)
            Z, shrink = self._iterate_stages(y, h, inverse, guess, tolerance, scale)
            F = method.polynomial @ Z
            size = float(np.max(np.abs(F[-1]) / scale)) / comb(2 * self.s, self.s) / tolerance
            factor = min(2.0, 0.9 * max(size, 1e-300) ** (-1.0 / self.s))
            if shrink < 1.0 and size <= 1.0:
                self.past = Step(t, h, y, F)
                yield self.past
                t, y = (t + h if left > 1 else span), self.past.end
                self.next_h = self.next_h if 0.9 < factor < 1.3 else h * factor
                self.J = None if shrink > SLOW else self.J
            elif shrink < 1.0:
                self.next_h = h * max(0.2, factor)
            else:
                self.next_h, self.J = (0.5 * h, self.J) if fresh else (self.next_h, None)
            if self.next_h < 1e-9 * span:
                raise ArithmeticError(f"no step meets the tolerance (coefficient {size:.3g} times as large)")

    def _iterate_stages(
        self, y: np.ndarray, h: float, inverse: np.ndarray, Z: np.ndarray, tolerance: float, units: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Iterate the stages Z (s, ny) of a step from the guess ``Z``; return them and the slowest rate of convergence.

        ``inverse`` holds the inverse matrix of a Newton step for each eigenvector (m, ny, ny). The rate is the largest
        ratio of a correction to the one before; it is infinite if the iteration does not converge.
        """
        method, slowest, before = make_radau(self.s), 0.0, np.inf
        for _ in range(SWEEPS):
            gap = self.f(y + Z) - method.inverse @ Z / h
            change = (method.back @ np.matmul(inverse, (method.to @ gap)[..., None])[..., 0]).real
            Z, size = Z + change, float(np.max(np.abs(change) / units))
            if size <= 0.01 * tolerance or (size < ROUNDING and size > 0.5 * before):
                return Z, slowest
            slowest, before = max(slowest, size / before), size
            if not slowest < 1.0:
                break
        return Z, np.inf
