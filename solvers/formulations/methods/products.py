"""Products and motions that several methods share (compiled)."""

from ..compiled.algebra import turned_by
from ..compiled.entries import inner, run


@inner
def set_rates(k):
    """x := A w"""
    run(k.slips)
    for a in range(len(k.x)):
        k.x[a] = -k.x[a] - k.slip[a]


@inner
def add_scaled(share, x, y):
    """y += share x, arrays (n,)."""
    for a in range(len(x)):
        y[a] += share * x[a]


@inner
def move(r0, R0, change, r, R):
    """r, R := r0 + change_r, R0 exp(change_theta), change (nb, 6)."""
    for b in range(len(change)):
        for a in range(3):
            r[b, a] = r0[b, a] + change[b, a]
        turned_by(R0[b], change[b, 3], change[b, 4], change[b, 5], R[b])
