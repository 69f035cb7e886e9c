"""User forces (``mechanics.user_forces``), called by address (compiled)."""

from .algebra import turn_rotation
from .entries import call_law, compile_inline, compile_separately

DIFFERENCE = 1e-5  # step of central differences: rounding and truncation are 1e-10


def add_user_forces(k):
    """Add the forces and torques of the users' laws to ``k.force``, with torques transformed from space to the body."""
    u = k.users
    for i in range(len(u.body)):
        set_law_input(k, u, i)
        call_law(u.law[i], k.t[0], u.state, u.load)
        for e in range(2):
            b = u.body[i, e]
            if b < 0:
                continue
            for a in range(3):
                k.force[b, a] += u.load[e, a]
                for c in range(3):
                    k.force[b, 3 + a] += k.R[b, c, a] * u.load[2 + e, c]


@compile_inline
def set_law_input(k, u, i):
    """Set ``u.state``, the input of law ``i``: r, R, v, Omega of both bodies; zero and R = I for the ground.

    ``k`` is the kernel, ``u`` its ``UserForces``.
    """
    x = u.state
    for e in range(2):
        b = u.body[i, e]
        for a in range(3):
            x[3 * e + a] = k.r[b, a] if b >= 0 else 0.0
            x[24 + 3 * e + a] = k.v[b, a] if b >= 0 else 0.0
            x[30 + 3 * e + a] = k.v[b, 3 + a] if b >= 0 else 0.0
            for c in range(3):
                x[6 + 9 * e + 3 * a + c] = k.R[b, a, c] if b >= 0 else 1.0 * (a == c)


def add_user_slopes(k):
    """Add the derivatives of the users' loads by pose and by velocity to ``k.by_pose`` and ``k.by_rate``.

    Each is a matrix (6, 6) for a pair of bodies of ``k.pair``, the load of the first by the motion of the second, by
    central differences of step ``DIFFERENCE``.
    """
    u = k.users
    for i in range(len(u.body)):
        for p in range(len(k.pair)):
            for e in range(2):
                for o in range(2):  # the end that moves
                    if u.body[i, e] == k.pair[p, 0] and u.body[i, o] == k.pair[p, 1]:
                        for c in range(6):
                            for side in range(2):
                                _add_slope(k, u, i, e, o, c, side, k.by_pose[p], k.by_rate[p])


@compile_separately
def _add_slope(k, u, i, e, o, c, side, by_pose, by_rate):
    """Add one side of the central difference to column ``c`` of both slopes (6, 6) of law ``i``.

    The load is that of end ``e``, with coordinate or velocity ``c`` of end ``o`` raised (``side`` 0) or lowered (1).
    """
    h = DIFFERENCE * (1.0 - 2.0 * side)
    set_law_input(k, u, i)
    if c < 3:
        u.state[3 * o + c] += h
    else:
        R = u.state[6 + 9 * o : 15 + 9 * o].reshape(3, 3)
        turn_rotation(R, h * (c == 3), h * (c == 4), h * (c == 5), R)
    _add_column(k, u, i, e, o, c, side, by_pose, 0.5 / h)
    set_law_input(k, u, i)
    if c < 3:
        u.state[24 + 3 * o + c] += h
    else:
        u.state[30 + 3 * o + c - 3] += h
    _add_column(k, u, i, e, o, c, side, by_rate, 0.5 / h)


@compile_separately
def _add_column(k, u, i, e, o, c, side, K, weight):
    """Add ``weight`` times the load of end ``e`` by law ``i``, with the torque in the body, to column ``c`` of K.

    The law is evaluated at ``u.state``.
    """
    call_law(u.law[i], k.t[0], u.state, u.load)
    for a in range(3):
        K[a, c] += weight * u.load[e, a]
        for q in range(3):
            K[3 + a, c] += weight * u.state[6 + 9 * e + 3 * q + a] * u.load[2 + e, q]
