"""Tableaux of symplectic steps with constraints: Gauss with Lobatto, and RATTLE."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

DEPTH = 4  # steps before by which a step is estimated
DEGREE = 7  # of the polynomial of such an estimate, at most


class Tableau(NamedTuple):
    """Stages (q_i, p_i) at c h and rows at ``nodes`` h, the first at the start and the last at the end of a step::

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

    def estimates(self) -> tuple[Float[np.ndarray, "d s ds"], Float[np.ndarray, "d n dm"]]:
        """First estimates of stages, and of lam at all nodes but the last, as weights of those of k steps before.

        By k - 1; where stages collocate, of one polynomial through two steps, or one of lam; else of one for each.
        """
        s, m = len(self.c), len(self.nodes)
        stages, rows = np.zeros((DEPTH, s, DEPTH, s)), np.zeros((DEPTH, m - 1, DEPTH, m))
        for k in range(DEPTH):
            past = np.arange(-k - 1.0, 0.0)
            if self.collocates:
                past = past[-2:]
                of = (past[:, None] + self.c).ravel()
                weights = extrapolation(of, self.c, min(len(of) - 1, DEGREE))
                stages[k, :, DEPTH - len(past) :] = weights.reshape(s, -1, s)
                rows[k, :, -1] = extrapolation(self.nodes - 1.0, self.nodes[:-1], m - 1)
            else:
                each = extrapolation(past, np.zeros(1), k)[0, :, None]
                stages[k, :, DEPTH - k - 1 :] = each * np.eye(s)[:, None]
                rows[k, :, DEPTH - k - 1 :] = each * np.eye(m)[:-1, None]
        return stages.reshape(DEPTH, s, -1), rows.reshape(DEPTH, m - 1, -1)


def gauss_lobatto(s: int) -> Tableau:
    """Gauss collocation, rows at the s + 1 nodes of Lobatto: order 2 s (Jay 2007)."""
    x, w = legendre.leggauss(s)
    P = legendre.legvander(x, s - 1)
    ends = np.concatenate(([-1.0], np.sort(legendre.legroots(legendre.legder(np.eye(s + 1)[s]))), [1.0]))

    def integrals(to: np.ndarray) -> np.ndarray:
        """From -1 of the polynomials that are 1 at one node of Gauss and 0 at the others; half of them."""
        V = legendre.legvander(to, s)
        below = np.concatenate((-np.ones((len(to), 1)), V[:, : s - 1]), axis=1)
        return 0.25 * (V[:, 1 : s + 1] - below) @ P.T * w

    a, a_node, b = integrals(x), integrals(ends), 0.5 * w
    a_node[0], a_node[-1] = 0.0, b
    b_row = 1.0 / (s * (s + 1) * legendre.legval(ends, np.eye(s + 1)[s]) ** 2)
    a_row = np.ascontiguousarray(b_row * (1.0 - a_node.T / b[:, None]))
    return Tableau(2 * s, True, 0.5 * (1.0 + x), a, a, b, 0.5 * (1.0 + ends), a_node, a_row, b_row)


def rattle() -> Tableau:
    """Lobatto IIIA and IIIB of two stages (Hairer, Lubich, Wanner 2006, VII.1.4)."""
    ends, half, first = np.array([0.0, 1.0]), np.full(2, 0.5), np.array([[0.5, 0.0], [0.5, 0.0]])
    to_end = np.array([[0.0, 0.0], [0.5, 0.5]])
    return Tableau(2, False, ends, to_end, first, half, ends, to_end, first, half)


def extrapolation(of: np.ndarray, to: np.ndarray, degree: int) -> Float[np.ndarray, "n m"]:
    """Values at ``to`` of the polynomial through those at ``of``, or closest to them, by its values there."""
    middle, half = 0.5 * (of.max() + of.min()), 0.5 * (of.max() - of.min()) or 1.0
    V, W = (legendre.legvander((x - middle) / half, degree) for x in (of, to))
    out: np.ndarray = W @ np.linalg.pinv(V)
    return out
