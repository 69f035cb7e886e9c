"""Define rods hung one from the other in a plane, as exact numbers: chain, grid (a row is a rod), cart pendulum."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import flint
import numpy as np
from jaxtyping import Float

from ....problems.exact import planar
from ....problems.four_bar_grid import make_grid_states
from ...mechanics.state import States
from .series import C, PlaneMechanism, PreciseState, S, X

SPARE = 32  # further bits in the evaluation of functions
ONE, NONE = Fraction(1), Fraction(0)


@dataclass(frozen=True)
class Rod:
    """A rod with its centre of mass at ``centre`` [m] from its upper end and ``inertia`` [kg m2] about that."""

    mass: Fraction
    length: Fraction
    centre: Fraction
    inertia: Fraction


@dataclass(frozen=True)
class Rods:
    """A chain of rods from the origin, or from a cart on OX; the end of the last one may be fixed on OX."""

    rods: tuple[Rod, ...]
    gravity: Fraction  # [m/s2] along -y
    cart: Fraction | None = None  # [kg]
    end: Fraction | None = None  # [m]

    def make_mechanism(self) -> PlaneMechanism:
        """Return the bodies and their constraint rows: two, x and y, for each joint, and two that guide a cart."""
        k0 = int(self.cart is not None)
        rows: list[dict[int, tuple[Fraction, ...]]] = []
        for k in range(len(self.rods) + (self.end is not None)):
            for lane in range(2):
                ends = {}
                if k:
                    above = self.rods[k - 1]
                    ends[k0 + k - 1] = _make_factors(above.length - above.centre, ONE, lane)
                elif self.cart is not None:
                    ends[0] = _make_factors(NONE, ONE, lane)
                if k < len(self.rods):
                    ends[k0 + k] = _make_factors(-self.rods[k].centre, -ONE, lane)
                rows.append(ends)
        mass, inertia = [r.mass for r in self.rods], [r.inertia for r in self.rods]
        if self.cart is not None:
            rows += [{0: (NONE, ONE, NONE, NONE)}, {0: (NONE, NONE, NONE, ONE)}]
            mass, inertia = [self.cart, *mass], [ONE, *inertia]
        return PlaneMechanism(mass, inertia, rows, self.gravity)

    def state(self, q: list[flint.arb], u: list[flint.arb], t: int, bits: int) -> PreciseState:
        """Return the state at ``t`` [2^-bits s], in units of 2^-bits, from coordinates q and rates u.

        They are the angles of the rods to OX [rad], after x [m] of the cart where there is one.
        """
        with flint.ctx.workprec(bits + SPARE):
            zero = flint.arb(0)
            x, y, v_x, v_y = zero, zero, zero, zero
            values, rates = [], []
            if self.cart is not None:
                x, v_x, q, u = q[0], u[0], q[1:], u[1:]
                values.append([x, zero, flint.arb(1), zero])
                rates.append([v_x, zero, zero, zero])
            for rod, angle, w in zip(self.rods, q, u, strict=True):
                s, c = angle.sin_cos()
                near, whole = _to_ball(rod.centre), _to_ball(rod.length)
                values.append([x + near * c, y + near * s, c, s])
                rates.append([v_x - near * w * s, v_y + near * w * c, -w * s, w * c])
                x, y, v_x, v_y = x + whole * c, y + whole * s, v_x - whole * w * s, v_y + whole * w * c
            return PreciseState(
                t, *([[_to_fixed_point(a, bits) for a in body] for body in part] for part in (values, rates))
            )

    def find_coordinates(self, p: PreciseState, bits: int) -> tuple[list[flint.arb], list[flint.arb]]:
        """Return q and u from a state in units of 2^-bits: the inverse of ``state``, with angles in (-pi, pi]."""
        q, u = [], []
        with flint.ctx.workprec(bits + SPARE):
            for b, (values, rates) in enumerate(zip(p.X, p.V, strict=True)):
                (x, _, c, s), (v, _, c_dot, s_dot) = (
                    [_from_fixed_point(a, bits) for a in part] for part in (values, rates)
                )
                at_cart = b == 0 and self.cart is not None
                q.append(x if at_cart else flint.arb.atan2(s, c))
                u.append(v if at_cart else c * s_dot - s * c_dot)
        return q, u


@dataclass(frozen=True)
class RodProblem:
    """A problem of the catalogue, with its default parameters, as rods from an exact start."""

    rods: Rods
    start: Callable[[], tuple[list[flint.arb], list[flint.arb]]]  # q, u in the precision of the context
    bodies: Callable[[Float[np.ndarray, "nt nb 4"], Float[np.ndarray, "nt nb 4"]], States]  # x, y, c, s; their rates
    lost: int  # approximate loss of bits per second by chaos, by which the number of bits decreases with time


def _make_chain() -> RodProblem:
    """Return the recipe of the problem ``chain``: fifteen bars with both ends fixed."""
    bar = _make_bar(ONE, Fraction("0.3048"))

    def start() -> tuple[list[flint.arb], list[flint.arb]]:
        """Return the start of three static spans: tan(angle) = lever a, five cosines sum to 3 (problems/chain.py)."""
        a = flint.arb(1)
        for _ in range(12):  # each Newton step doubles the correct digits
            cosines = [1 / (1 + (lever * a) ** 2).sqrt() for lever in (1, 2)]
            slope = -2 * sum(lever**2 * a * c**3 for lever, c in zip((1, 2), cosines, strict=True))
            a = (a - (1 + 2 * sum(cosines) - 3) / slope).mid()
        return [(lever * a).atan() for lever in (-2, -1, 0, 1, 2)] * 3, [flint.arb(0)] * 15

    return RodProblem(Rods((bar,) * 15, Fraction("9.81"), end=9 * bar.length), start, _convert_bars, 7)


def _make_cart_pendulum() -> RodProblem:
    """Return the recipe of the problem ``cart_pendulum``: two bars below a cart, at rest."""
    bar = _make_bar(Fraction(1, 2), Fraction(1, 2))
    nothing = [flint.arb(0)] * 3
    return RodProblem(Rods((bar, bar), Fraction("9.81"), cart=ONE), lambda: (nothing, nothing), _convert_bars, 3)


def _make_four_bar_grid() -> RodProblem:
    """Return the recipe of ``four_bar_grid``: each row, six uprights and five bars of 1 kg, moves as one rod."""
    upright, across = Fraction(6), Fraction(5)
    mass = upright + across
    centre = (upright / 2 + across) / mass
    inertia = upright / 3 + across - mass * centre**2

    def start() -> tuple[list[flint.arb], list[flint.arb]]:
        """Return the angles and rates at the start: all rows hang, the top one turns."""
        return [-flint.arb.pi() / 2] * 5, [2 * flint.arb.pi() / 3] + [flint.arb(0)] * 4

    def bodies(X: np.ndarray, V: np.ndarray) -> States:
        """Return the motion of all bars from that of the rods."""
        rate = X[:, :, C] * V[:, :, S] - X[:, :, S] * V[:, :, C]
        return make_grid_states(np.arctan2(X[:, :, C], -X[:, :, S]), rate, 5, 1.0)

    return RodProblem(Rods((Rod(mass, ONE, centre, inertia),) * 5, Fraction("9.81")), start, bodies, 3)


def _convert_bars(X: np.ndarray, V: np.ndarray) -> States:
    """Return the motion of all bodies from x, y, c, s (nt, nb, 4) and their rates, with the frames of ``planar``.

    A cart lies along OX.
    """
    rate = X[:, :, C] * V[:, :, S] - X[:, :, S] * V[:, :, C]
    return planar.make_planar_states(X[:, :, :2], np.arctan2(X[:, :, S], X[:, :, C]), V[:, :, :2], rate)


RECIPES = {"chain": _make_chain, "cart_pendulum": _make_cart_pendulum, "four_bar_grid": _make_four_bar_grid}


def _make_bar(mass: Fraction, length: Fraction) -> Rod:
    """Return a homogeneous bar of this mass [kg] and length [m]."""
    return Rod(mass, length, length / 2, mass * length**2 / 12)


def _make_factors(along: Fraction, sign: Fraction, lane: int) -> tuple[Fraction, ...]:
    """Return the factors of a body's (x, y, c, s) for the coordinate of one of its points, times ``sign``.

    The point is ``along`` [m] the axis from the centre; ``lane`` is 0 for its x and 1 for its y.
    """
    factors = [NONE] * 4
    factors[X + lane], factors[C + lane] = sign, sign * along
    return tuple(factors)


def _to_ball(a: Fraction) -> flint.arb:
    """Return an exact number as a ball, in the precision of the context."""
    return flint.arb(flint.fmpq(a.numerator, a.denominator))


def _to_fixed_point(a: flint.arb, bits: int) -> int:
    """Return the middle of a ball in units of 2^-bits, rounded down."""
    m, e = (int(part) for part in a.mid().man_exp())
    shift = e + bits
    return m << shift if shift >= 0 else m >> -shift


def _from_fixed_point(a: int, bits: int) -> flint.arb:
    """Return ``a`` units of 2^-bits as a ball, in the precision of the context."""
    return flint.arb(a) / flint.arb(2) ** bits
