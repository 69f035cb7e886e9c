"""User forces (``mechanics.user_forces``), called by address (compiled)."""

from .entries import call_law, inner


def add_user_forces(k):
    """``k.force`` += what the laws give, torques in the body."""
    u = k.users
    for i in range(len(u.body)):
        read_state(k, u, i)
        call_law(u.law[i], k.t[0], u.state, u.load)
        for e in range(2):
            b = u.body[i, e]
            if b < 0:
                continue
            for a in range(3):
                k.force[b, a] += u.load[e, a]
                for c in range(3):
                    k.force[b, 3 + a] += k.R[b, c, a] * u.load[2 + e, c]


@inner
def read_state(k, u, i):
    """What law ``i`` reads of the state: r, R, v, Omega of both bodies, of the ground none and R = I."""
    x = u.state
    for e in range(2):
        b = u.body[i, e]
        for a in range(3):
            x[3 * e + a] = k.r[b, a] if b >= 0 else 0.0
            x[24 + 3 * e + a] = k.v[b, a] if b >= 0 else 0.0
            x[30 + 3 * e + a] = k.v[b, 3 + a] if b >= 0 else 0.0
            for c in range(3):
                x[6 + 9 * e + 3 * a + c] = k.R[b, a, c] if b >= 0 else 1.0 * (a == c)
