"""Rows that close the loops of a tree: S = J H^-1 J^T by one sweep per row, and its dense factor (compiled)."""

from typing import Any

from ..compiled.algebra import clear, multiply
from ..compiled.entries import compile_inline, compile_separately, run
from .sweeps import set_rate
from .twists import cross


@compile_inline
def add_row(s: Any, c: Any, a: int, x: float) -> None:
    """Add the wrench of closing row ``a`` with the multiplier ``x`` to ``load`` of both its bodies' limbs, about P."""
    for e in range(2):
        body = c.body[c.joint[a], e]
        if body < 0:
            continue
        l, sign = c.limb[body], x * (1.0 - 2.0 * e)
        f0, f1, f2 = sign * c.way[a, 0], sign * c.way[a, 1], sign * c.way[a, 2]
        n0, n1, n2 = multiply(s.R[body], x * c.X[e, a, 0], x * c.X[e, a, 1], x * c.X[e, a, 2])
        m0, m1, m2 = cross(s.c[l, 0], s.c[l, 1], s.c[l, 2], f0, f1, f2)
        load = s.load[l]
        load[0] += n0 + m0
        load[1] += n1 + m1
        load[2] += n2 + m2
        load[3] += f0
        load[4] += f1
        load[5] += f2


@compile_separately
def rate_rows(s: Any, c: Any, motion: Any) -> None:
    """Set ``rates`` of all closing rows to J V, with V the limbs' ``motion``: velocities or accelerations."""
    for j in range(len(c.body)):
        first, last = c.row[j], c.row[j + 1]
        for a in range(first, last):
            c.rates[a] = 0.0
        for e in range(2):
            body = c.body[j, e]
            if body < 0:
                continue
            l, sign = c.limb[body], 1.0 - 2.0 * e
            w = s.rate[body]
            set_rate(s, l, motion[l], w)
            for a in range(first, last):
                c.rates[a] += sign * (c.way[a, 0] * w[0] + c.way[a, 1] * w[1] + c.way[a, 2] * w[2]) + (
                    c.X[e, a, 0] * w[3] + c.X[e, a, 1] * w[4] + c.X[e, a, 2] * w[5]
                )


@compile_separately
def couple_rows(s: Any, c: Any) -> None:
    """Set ``Y`` to H^-1 J^T, the response to each row in use, and the lower half of ``S`` to J H^-1 J^T."""
    m = len(c.kept)
    clear(s.effort)
    for k in range(m):
        clear(s.load)
        add_row(s, c, c.kept[k], 1.0)
        run(s.responding)
        for i in range(len(s.found)):
            c.Y[k, i] = s.found[i]
        rate_rows(s, c, s.response)
        for j in range(k, m):
            c.S[j, k] = c.rates[c.kept[j]]


@compile_separately
def factor_closing(s: Any, c: Any) -> float:
    """Compute the responses and S, and factorise S = L D L^T in place, with 1/D on the diagonal.

    Return the least pivot relative to its value where the order of rows was found, at most 1; 1 without rows.
    """
    m, least = len(c.kept), 1.0
    if m > 0:
        couple_rows(s, c)
    for k in range(m):
        pivot = c.S[k, k]
        least = min(least, pivot / c.value[k])
        inverse = 1.0 / pivot
        c.S[k, k] = inverse
        for i in range(m - 1, k, -1):
            ratio = c.S[i, k] * inverse
            for j in range(k + 1, i + 1):
                c.S[i, j] -= ratio * c.S[j, k]
            c.S[i, k] = ratio
    return least


@compile_separately
def solve_closing(c: Any) -> None:
    """Replace ``mu`` by the solution x of S x = mu, with the factor of S."""
    m = len(c.kept)
    for i in range(m):
        x = c.mu[i]
        for j in range(i):
            x -= c.S[i, j] * c.mu[j]
        c.mu[i] = x
    for i in range(m - 1, -1, -1):
        x = c.mu[i] * c.S[i, i]
        for j in range(i + 1, m):
            x -= c.S[j, i] * c.mu[j]
        c.mu[i] = x


@compile_inline
def add_response(c: Any, x: Any) -> None:
    """Add Y^T mu to ``x``: the response of velocities, or accelerations, to the multipliers of the rows in use."""
    for k in range(len(c.kept)):
        for i in range(len(x)):
            x[i] += c.mu[k] * c.Y[k, i]


@compile_inline
def store_multipliers(c: Any, out: Any) -> None:
    """Set ``out`` to the multipliers ``mu`` in the cut joints' order of rows, 0 for rows left out.

    ``rates`` is overwritten.
    """
    clear(c.rates)
    for k in range(len(c.kept)):
        c.rates[c.kept[k]] = c.mu[k]
    for a in range(len(c.place)):
        out[a] = c.rates[c.place[a]]
