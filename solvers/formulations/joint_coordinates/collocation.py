"""Tableaux of symplectic steps with constraints: Gauss with Lobatto, and RATTLE.

Nodes are computed to 2^-``BITS``, and all derived coefficients in fractions that are rounded once: the same bits on
every machine, whatever linear algebra library it has.
"""

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

BITS = 90  # bits of a node: 37 more than a float has
DEPTH = 4  # earlier steps from which a step is estimated
# degree of the polynomial of such an estimate, at most. Of six runs of gauss_joint half takes -2 to 18 % more sweeps,
# with most on a chain; twice is the same, since the steps before give no more points.
DEGREE = 7


class CollocationTableau(NamedTuple):
    """A tableau of stages (q_i, p_i) at c h, with rows at ``nodes`` h, the first at the start, the last at the end.

        q_i = q_0 + h sum a_ij q_dot_j,   p_i = p_0 + h sum a_p_ij p_dot_j - h sum a_row_ij G^T lam_j
        q at node i = q_0 + h sum a_node_ij q_dot_j,   weights b and b_row at the end

    Symplectic: b_i a_p_ij + b_j a_ji = b_i b_j, b_i a_row_ij + b_row_j a_node_ji = b_i b_row_j.
    """

    order: int
    collocates: bool  # stages lie on one polynomial in time
    c: Float[np.ndarray, " s"]
    a: Float[np.ndarray, "s s"]
    a_p: Float[np.ndarray, "s s"]
    b: Float[np.ndarray, " s"]
    nodes: Float[np.ndarray, " m"]
    a_node: Float[np.ndarray, "m s"]
    a_row: Float[np.ndarray, "s m"]
    b_row: Float[np.ndarray, " m"]

    def compute_estimate_weights(self) -> tuple[Float[np.ndarray, "d s ds"], Float[np.ndarray, "d n dm"]]:
        """Return two arrays of weights, by which stages and lam of earlier steps are extrapolated to the next step.

        Index k - 1 of the first axis is for k earlier steps, up to ``DEPTH``; lam of the last node is not estimated.
        For collocation, one polynomial passes through the stages of the last two steps, and one through lam of the last
        step; else there is one for each stage and node.
        """
        s, m = len(self.c), len(self.nodes)
        stages, rows = np.zeros((DEPTH, s, DEPTH, s)), np.zeros((DEPTH, m - 1, DEPTH, m))
        for k in range(DEPTH):
            past = np.arange(-k - 1.0, 0.0)
            if self.collocates:
                past = past[-2:]
                of = (past[:, None] + self.c).ravel()
                weights = compute_extrapolation_weights((*of,), (*self.c,), min(len(of) - 1, DEGREE))
                stages[k, :, DEPTH - len(past) :] = weights.reshape(s, -1, s)
                rows[k, :, -1] = compute_extrapolation_weights((*self.nodes - 1.0,), (*self.nodes[:-1],), m - 1)
            else:
                each = compute_extrapolation_weights((*past,), (0.0,), k)[0, :, None]
                stages[k, :, DEPTH - k - 1 :] = each * np.eye(s)[:, None]
                rows[k, :, DEPTH - k - 1 :] = each * np.eye(m)[:-1, None]
        return stages.reshape(DEPTH, s, -1), rows.reshape(DEPTH, m - 1, -1)

    def invert_newton_matrix(self) -> Float[np.ndarray, "n n"]:
        """Return C^-1, by which Newton's method corrects lam of all nodes but the last.

        C is a_node a_row without its first row and last column: the derivative of q at the nodes by lam.
        """
        at, by = ([[Fraction(x) for x in row] for row in a.tolist()] for a in (self.a_node[1:], self.a_row[:, :-1]))
        C = [
            [sum((x * y for x, y in zip(row, column, strict=True)), ZERO) for column in zip(*by, strict=True)]
            for row in at
        ]
        return _round_fractions(_solve(C, _make_identity(len(C))))


@cache
def make_gauss_lobatto_tableau(s: int) -> CollocationTableau:
    """Return the tableau of Gauss collocation with ``s`` stages, and rows at Lobatto's s + 1 nodes (Jay 2007).

    Its order is 2 s. The result is kept for the next call.
    """
    P = _list_legendre(s)
    x = _find_roots(P[s])
    slope = _differentiate(P[s])
    ends = [Fraction(-1), *_find_roots(slope), Fraction(1)]
    b = [1 / ((1 - z * z) * _evaluate_polynomial(slope, z) ** 2) for z in x]
    b_row = [1 / (s * (s + 1) * _evaluate_polynomial(P[s], z) ** 2) for z in ends]

    def integrate_basis(to: list[Fraction]) -> Exact:
        """Return half the integrals, from -1 to each point of ``to``, of the Lagrange polynomials on Gauss's nodes."""
        known = [
            [
                sum(
                    (
                        _evaluate_polynomial(_integrate_polynomial(P[k]), z)
                        * (k + Fraction(1, 2))
                        * _evaluate_polynomial(P[k], node)
                        for k in range(s)
                    ),
                    ZERO,
                )
                for node in x
            ]
            for z in to
        ]
        return [[value * weight for value, weight in zip(row, b, strict=True)] for row in known]

    a, a_node = integrate_basis(x), integrate_basis(ends)
    a_row = [[w * (1 - a_node[j][i] / b[i]) for j, w in enumerate(b_row)] for i in range(s)]
    c, nodes = ([(1 + z) / 2 for z in of] for of in (x, ends))
    rounded = _round_fractions(a)
    return CollocationTableau(
        2 * s,
        True,
        _round_fractions([c])[0],
        rounded,
        rounded,
        _round_fractions([b])[0],
        _round_fractions([nodes])[0],
        _round_fractions(a_node),
        _round_fractions(a_row),
        _round_fractions([b_row])[0],
    )


def make_rattle_tableau() -> CollocationTableau:
    """Return the tableau of RATTLE: Lobatto IIIA and IIIB of two stages (Hairer, Lubich, Wanner 2006, VII.1.4)."""
    ends, half, first = np.array([0.0, 1.0]), np.full(2, 0.5), np.array([[0.5, 0.0], [0.5, 0.0]])
    to_end = np.array([[0.0, 0.0], [0.5, 0.5]])
    return CollocationTableau(2, False, ends, to_end, first, half, ends, to_end, first, half)


@cache
def compute_extrapolation_weights(
    of: tuple[float, ...], to: tuple[float, ...], degree: int
) -> Float[np.ndarray, "n m"]:
    """Return weights (n, m) that convert values at the m points ``of`` to values at the n points ``to``.

    They evaluate the polynomial of degree ``degree`` through the values; by least squares if there are more points.
    """
    V, W = ([[Fraction(x) ** k for k in range(degree + 1)] for x in points] for points in (of, to))
    columns = list(zip(*V, strict=True))
    normal = [[sum((x * y for x, y in zip(a, b, strict=True)), ZERO) for b in columns] for a in columns]
    fitted = _solve(normal, [list(column) for column in columns])  # coefficients as functions of values
    return _round_fractions(
        [
            [sum((w * row[k] for w, row in zip(powers, fitted, strict=True)), ZERO) for k in range(len(of))]
            for powers in W
        ]
    )


Exact = list[list[Fraction]]
ZERO = Fraction(0)


def _round_fractions(rows: Exact) -> np.ndarray:
    """Return fractions as a read-only array of floats, each rounded once."""
    out = np.array([[float(x) for x in row] for row in rows])
    out.flags.writeable = False
    return out


def _make_identity(n: int) -> Exact:
    """Return the identity matrix of size n in fractions."""
    return [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]


def _solve(A: Exact, B: Exact) -> Exact:
    """Return A^-1 B by exact Gauss elimination in fractions; any nonzero pivot will do."""
    n = len(A)
    rows = [[*a, *b] for a, b in zip(A, B, strict=True)]
    for k in range(n):
        pivot = next(i for i in range(k, n) if rows[i][k])
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in range(n):
            if i != k and rows[i][k]:
                rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]


def _list_legendre(s: int) -> list[list[Fraction]]:
    """Return the coefficients of Legendre's polynomials of degrees 0 to ``s``, each with the lowest power first."""
    P = [[Fraction(1)], [ZERO, Fraction(1)]]
    for k in range(1, s):
        up, low = [ZERO, *P[k]], [*P[k - 1], ZERO, ZERO]
        P.append([((2 * k + 1) * x - k * y) / (k + 1) for x, y in zip(up, low, strict=True)])
    return P


def _evaluate_polynomial(p: Sequence[Fraction], x: Fraction) -> Fraction:
    """Return the value at ``x`` of the polynomial with coefficients ``p``, lowest power first."""
    out = ZERO
    for a in reversed(p):
        out = out * x + a
    return out


def _differentiate(p: Sequence[Fraction]) -> list[Fraction]:
    """Return the coefficients of the derivative of the polynomial ``p``, lowest power first."""
    return [k * a for k, a in enumerate(p)][1:]


def _integrate_polynomial(p: Sequence[Fraction]) -> list[Fraction]:
    """Return the coefficients of the integral from -1 of the polynomial ``p``, lowest power first."""
    rest = [ZERO, *(a / (k + 1) for k, a in enumerate(p))]
    return [-_evaluate_polynomial(rest, Fraction(-1)), *rest[1:]]


def _find_roots(p: Sequence[Fraction]) -> list[Fraction]:
    """Return the roots of the polynomial ``p`` in ascending order, to 2^-``BITS``, by Newton's method with deflation.

    All roots have to be simple, real and in (-1, 1); found roots are divided out (Maehly).
    """
    slope, found = _differentiate(p), list[Fraction]()
    for _ in range(len(p) - 1):
        x, step = Fraction(1), Fraction(1)
        while abs(step) > Fraction(1, 2**BITS):
            f = _evaluate_polynomial(p, x)
            step = f / (_evaluate_polynomial(slope, x) - f * sum((1 / (x - z) for z in found), ZERO))
            x = Fraction(math.floor((x - step) * 2 ** (BITS + 8) + Fraction(1, 2)), 2 ** (BITS + 8))
        found.append(x)
    return found[::-1]
