"""Integrate plane mechanisms by Taylor series in multiple precision, in two formulations.

A body has its centre (x, y) and the direction (c, s) of an axis; rows are linear in these four: J X = const.

    angles      theta_dot_dot = (-s Q_c + c Q_s) / I,  c_dot = -s w, s_dot = c w
    directors   I e_dot_dot = Q_e + mu e, mu = -e . Q_e - I |e_dot|^2, which keeps e = (c, s) of unit length

with Q = J^T lam; J X_dot_dot = 0 gives lam, order by order, by one factor of J W J^T in each step. Numbers are
integers, in units of 2^-bits; time is in units of about the step, so that coefficients decrease and those of high order
are short. Such series follow motions for longer than doubles can.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from operator import mul
from typing import Any

GUARD = 24  # bits below the truncation error of a step
# order per bit, near the cheapest, log(2) / 2, since work grows as its square and steps as 2^(-bits/order)
ORDER = 0.35
LAST = 7  # coefficients before the last: by symmetry most of them may vanish
LOOSE = 5, 4  # unit of time relative to the last step, by which the next may be longer
FORMULATIONS = ("angles", "directors")
X, Y, C, S = range(4)
Series = list[int]
Rows = Sequence[Mapping[int, tuple[Fraction, ...]]]  # by body: factors of its x, y, c, s


def march_by_series(
    state: Any, t: Any, t_end: Any, wanted: Sequence[Any], expand: Callable[..., Any], evaluate: Callable[..., Any]
) -> Iterator[tuple[Any, bool]]:
    """Integrate from ``state`` at ``t``; yield (state, True) at each time wanted, (state, False) at the ends of steps.

    The last step passes ``t_end``, which may be before ``t``. ``expand(state, t)`` makes the series and returns how far
    it reaches, ``evaluate(t, time)`` returns the value at ``time`` of the series about ``t``.
    """
    sign, left = 1 if t_end >= t else -1, list(wanted)
    while left or sign * (t_end - t) > 0:
        length = expand(state, t)
        while left and sign * (left[0] - t) <= length:
            yield evaluate(t, left.pop(0)), True
        state = evaluate(t, t + sign * length)
        t += sign * length
        yield state, False


@dataclass(frozen=True)
class PlaneMechanism:
    """Rigid bodies in a plane, each with a unit vector (c, s); the constraint rows have full rank."""

    mass: Sequence[Fraction]  # [kg]
    inertia: Sequence[Fraction]  # [kg m2] about the centres
    rows: Rows  # [m]
    gravity: Fraction  # [m/s2] along -y


@dataclass(frozen=True)
class PreciseState:
    """A state in units of 2^-bits: the time [s]; x, y [m] and c, s of each body; their rates [m/s], [1/s]."""

    t: int
    X: Sequence[Sequence[int]]
    V: Sequence[Sequence[int]]


class PlaneFlow:
    """Integrate from a state; the truncation error of a step is about 2^(GUARD - bits)."""

    def __init__(self, mechanism: PlaneMechanism, formulation: str, bits: int) -> None:
        """Prepare the numbers of ``mechanism`` in units of 2^-bits; raise ValueError for an unknown formulation."""
        if formulation not in FORMULATIONS:
            raise ValueError(f"formulation must be {' or '.join(FORMULATIONS)} (got {formulation})")
        self.mechanism, self.bits, self.order = mechanism, bits, int(ORDER * bits)
        self._expand = self._extend_by_angles if formulation == "angles" else self._extend_by_directors
        self._rows = [
            [(b, k, self._to_fixed(a)) for b, r in row.items() for k, a in enumerate(r) if a] for row in mechanism.rows
        ]
        self._light = [self._to_fixed(1 / m) for m in mechanism.mass]
        self._agile = [self._to_fixed(1 / i) for i in mechanism.inertia]
        self._inertia = [self._to_fixed(i) for i in mechanism.inertia]
        self.unit = self._to_fixed(Fraction(1, 64))  # [s]

    def _to_fixed(self, a: Fraction) -> int:
        """Return ``a`` in units of 2^-bits, rounded down."""
        return (a.numerator << self.bits) // a.denominator

    def march(self, state: PreciseState, t_end: int, at: Sequence[int] = ()) -> Iterator[tuple[PreciseState, bool]]:
        """Integrate from ``state``; yield (state, True) at each time in ``at`` and (state, False) at the end of a step.

        Times are in units of 2^-bits s; those in ``at`` increase. The last step ends at ``t_end`` or later.
        """
        series, h = list[list[Series]](), 0

        def expand(state: PreciseState, t: int) -> int:
            """Make the series of all bodies about the state, and return the length of the step [2^-bits s]."""
            nonlocal series, h
            series = self._expand_state(state)
            h = self._choose_step(series)
            return h

        if t_end <= state.t:
            return
        wanted = [t for t in at if t > state.t]
        evaluate = lambda t, time: self._evaluate(series, t, time)  # noqa: E731  of the present series
        for found, asked in march_by_series(state, state.t, t_end, wanted, expand, evaluate):
            if not asked:
                self.unit = h * LOOSE[0] // LOOSE[1]
            yield found, asked

    def _expand_state(self, state: PreciseState) -> list[list[Series]]:
        """Factor the rows at ``state``; return the Taylor coefficients of x, y, c, s of each body, time in ``unit``."""
        B, unit = self.bits, self.unit
        start = [[[x, v * unit >> B] for x, v in zip(X, V, strict=True)] for X, V in zip(state.X, state.V, strict=True)]
        self._pull = -self._to_fixed(self.mechanism.gravity) * unit * unit >> 2 * B
        self._factor_rows(start)
        return self._expand(start)

    def _choose_step(self, series: list[list[Series]]) -> int:
        """Return the step [2^-bits s] whose last term is about 2^(GUARD - bits), from the ``LAST`` highest orders."""
        p, h = self.order, self.unit
        sizes = {k: max(abs(a[k]) for body in series for a in body).bit_length() for k in (0, *range(p - LAST, p + 1))}
        for k in range(p - LAST, p + 1):
            if sizes[k] > 1:
                # size of the last coefficient in a geometric series through the k-th
                last = sizes[0] + (sizes[k] - sizes[0]) * p / k
                h = min(h, int(self.unit * 2.0 ** ((GUARD - last) / p)))
        return h

    def _evaluate(self, series: list[list[Series]], begin: int, t: int) -> PreciseState:
        """Return the state at ``t`` from the series about ``begin``, both [2^-bits s], by Horner's rule."""
        B = self.bits
        u = ((t - begin) << B) // self.unit
        values, rates = [], []
        for body in series:
            X, V = [], []
            for a in body:
                x = v = 0
                for coefficient in reversed(a):
                    v = (v * u >> B) + x
                    x = (x * u >> B) + coefficient
                X.append(x)
                V.append((v << B) // self.unit)
            values.append(X)
            rates.append(V)
        return PreciseState(t, values, rates)

    def _factor_rows(self, start: list[list[Series]]) -> None:
        """Factor J W J^T at ``start`` into L D L^T by rows; store inverse pivots and nonzero entries of L."""
        B = self.bits
        across = [(-b[S][0], b[C][0]) for b in start]
        slopes = []  # slopes of a row along x, y and the angle of its bodies
        for row in self._rows:
            own: dict[tuple[int, int], int] = {}
            for b, k, a in row:
                key, factor = (b, min(k, C)), a if k < C else a * across[b][k - C] >> B
                own[key] = own.get(key, 0) + factor
            slopes.append(own)
        self._L: list[dict[int, int]] = []
        self._inverse: list[int] = []
        pivots: list[int] = []
        for i, own in enumerate(slopes):
            weighted = {key: a * (self._light if key[1] < C else self._agile)[key[0]] >> B for key, a in own.items()}
            U: dict[int, int] = {}
            for j in range(i + 1):
                entry = sum(a * slopes[j][key] for key, a in weighted.items() if key in slopes[j]) >> B
                below = self._L[j] if j < i else {n: (u * self._inverse[n]) >> B for n, u in U.items()}
                entry -= sum(u * below[n] for n, u in U.items() if n in below) >> B
                if j == i:
                    self._L.append(below)
                    pivots.append(entry)
                    self._inverse.append((1 << 2 * B) // entry)
                elif entry:
                    U[j] = entry
        self._above = [[(j, L[i]) for j, L in enumerate(self._L) if i in L] for i in range(len(self._L))]

    def _solve_rows(self, b: list[int]) -> list[int]:
        """Return lam with J W J^T lam = b, by the factor of the step; ``b`` is overwritten."""
        B = self.bits
        for i, L in enumerate(self._L):
            if L:
                b[i] -= sum(a * b[j] for j, a in L.items()) >> B
        b = [x * p >> B for x, p in zip(b, self._inverse, strict=True)]
        for i in reversed(range(len(b))):
            if self._above[i]:
                b[i] -= sum(a * b[j] for j, a in self._above[i]) >> B
        return b

    def _solve_reactions(self, known: list[list[int]]) -> list[list[int]]:
        """Return the forces Q = J^T lam on each body for which J X_dot_dot = 0, at one order of the series.

        ``known`` is the part of X_dot_dot without these forces, at the same order.
        """
        B = self.bits
        lam = self._solve_rows([-sum(a * known[b][k] for b, k, a in row) >> B for row in self._rows])
        Q = [[0, 0, 0, 0] for _ in known]
        for row, force in zip(self._rows, lam, strict=True):
            for b, k, a in row:
                Q[b][k] += a * force
        return [[q >> B for q in own] for own in Q]

    def _advance(self, series: list[list[Series]], k: int, known: list[list[int]], Q: list[list[int]]) -> None:
        """Append coefficient k + 2 of x, y, c, s of each body, from X_dot_dot: its ``known`` part plus W Q."""
        B, n = self.bits, (k + 1) * (k + 2)
        for body, a, q, light, agile in zip(series, known, Q, self._light, self._agile, strict=True):
            c, s = body[C][0], body[S][0]
            turn = ((c * q[S] - s * q[C]) >> B) * agile >> B
            body[X].append((a[X] + (light * q[X] >> B)) // n)
            body[Y].append((a[Y] + (light * q[Y] >> B)) // n)
            body[C].append((a[C] - (s * turn >> B)) // n)
            body[S].append((a[S] + (c * turn >> B)) // n)

    def _extend_by_angles(self, series: list[list[Series]]) -> list[list[Series]]:
        """Extend the series of all bodies to full order by the formulation ``angles``."""
        B = self.bits
        rate = [[(b[C][0] * b[S][1] - b[S][0] * b[C][1]) >> B] for b in series]
        force: list[tuple[Series, Series]] = [([], []) for _ in series]
        for k in range(self.order - 1):
            known, turns = [], []
            for body, w, (q_c, q_s), agile in zip(series, rate, force, self._agile, strict=True):
                c, s, back = body[C], body[S], w[::-1]
                turn = (_convolve(c, q_s[::-1]) - _convolve(s, q_c[::-1]) >> B) * agile >> B
                turns.append(turn)
                known.append(
                    [
                        0,
                        0 if k else self._pull,
                        ((k + 1) * -_convolve(s, back) - s[0] * turn) >> B,
                        ((k + 1) * _convolve(c, back) + c[0] * turn) >> B,
                    ]
                )
            Q = self._solve_reactions(known)
            self._advance(series, k, known, Q)
            for body, w, own, q, turn, agile in zip(series, rate, force, Q, turns, self._agile, strict=True):
                w.append((turn + ((body[C][0] * q[S] - body[S][0] * q[C] >> B) * agile >> B)) // (k + 1))
                own[0].append(q[C])
                own[1].append(q[S])
        return series

    def _extend_by_directors(self, series: list[list[Series]]) -> list[list[Series]]:
        """Extend the series of all bodies to full order by the formulation ``directors``."""
        B = self.bits
        force: list[tuple[Series, Series]] = [([], []) for _ in series]
        stretch: list[Series] = [[] for _ in series]  # mu
        rates = [([b[C][1]], [b[S][1]]) for b in series]
        for k in range(self.order - 1):
            known, half = [], []
            for body, (q_c, q_s), mu, (c_dot, s_dot), agile, inertia in zip(
                series, force, stretch, rates, self._agile, self._inertia, strict=True
            ):
                c, s = body[C], body[S]
                square = _convolve_with_itself(c_dot) + _convolve_with_itself(s_dot)
                own = -(_convolve(c, q_c[::-1]) + _convolve(s, q_s[::-1]) + (inertia * square >> B)) >> B
                half.append(own)
                back = mu[::-1]
                e_c, e_s = (_convolve(e, back) + e[0] * own >> B for e in (c, s))
                known.append([0, 0 if k else self._pull, e_c * agile >> B, e_s * agile >> B])
            Q = self._solve_reactions(known)
            self._advance(series, k, known, Q)
            for body, own, mu, q, part, (c_dot, s_dot) in zip(series, force, stretch, Q, half, rates, strict=True):
                mu.append(part - ((body[C][0] * q[C] + body[S][0] * q[S]) >> B))
                own[0].append(q[C])
                own[1].append(q[S])
                c_dot.append((k + 2) * body[C][k + 2])
                s_dot.append((k + 2) * body[S][k + 2])
        return series


def _convolve(a: Series, back: Series) -> int:
    """Return the sum of a_j b_n-j over j = 1 ... n, which leaves out a_0 b_n; ``back`` is b in reverse."""
    return sum(map(mul, islice(a, 1, None), back))


def _convolve_with_itself(a: Series) -> int:
    """Return the sum of a_j a_n-j over j = 0 ... n, where a_n is the last of ``a``."""
    n = len(a)
    total = 2 * sum(map(mul, islice(a, n // 2), reversed(a)))
    return total + a[n // 2] ** 2 if n % 2 else total
