"""Products and motions that several methods use (compiled)."""

from ..compiled.algebra import turn_rotation
from ..compiled.entries import compile_inline, run


@compile_inline
def set_rates(k):
    """Set ``k.x`` := A w, the rates of the constraint rows at the velocities ``k.w``, without phi_t."""
    run(k.slips)  # x := -(A w + phi_t), as a right-hand side of S
    for a in range(len(k.x)):
        k.x[a] = -k.x[a] - k.slip[a]


@compile_inline
def add_scaled(weight, x, y):
    """Add ``weight`` times x to y, both arrays (n,)."""
    for a in range(len(x)):
        y[a] += weight * x[a]


@compile_inline
def displace_poses(r0, R0, change, r, R):
    """Set the poses r, R := r0 + change_r, R0 exp(hat(change_theta)), with ``change`` (nb, 6) in m and rad."""
    for b in range(len(change)):
        for a in range(3):
            r[b, a] = r0[b, a] + change[b, a]
        turn_rotation(R0[b], change[b, 3], change[b, 4], change[b, 5], R[b])
