"""Ball arithmetic (Arb): every number carries a radius within which the exact result of its formula is proved to lie.

A float64 number enters exactly. A start's R is a rotation up to rounding only: the rotation nearest to it is meant.
"""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np
from flint import acb, arb, ctx
from jaxtyping import Float

BITS = 1000  # square roots at double zeros halve the digits, several times over
POLAR_STEPS = 9  # each doubles the digits, from the 15 of float64
Vector = list[arb]
Matrix = list[list[arb]]  # rows
Quaternion = list[arb]  # w, x, y, z
P = ParamSpec("P")
T = TypeVar("T")


class TooWide(ArithmeticError):
    """A ball that holds everything: a start too near a motion of another kind."""


def in_balls(function: Callable[P, T]) -> Callable[P, T]:
    """Run ``function`` at ``BITS`` of precision."""

    @wraps(function)
    def precise(*args: P.args, **kwargs: P.kwargs) -> T:
        with ctx.workprec(BITS):
            return function(*args, **kwargs)

    return precise


def vector(a: Float[np.ndarray, " n"]) -> Vector:
    """The float64 numbers, exactly."""
    return [arb(float(x)) for x in a]


def dot(a: Vector, b: Vector) -> arb:
    """a . b"""
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def cross(a: Vector, b: Vector) -> Vector:
    """a x b"""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def norm(a: Vector) -> arb:
    """|a|"""
    return root(dot(a, a))


def scale_vector(a: Vector, factor: arb) -> Vector:
    """``factor`` a"""
    return [factor * x for x in a]


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B"""
    return [[dot(row, column) for column in transpose(B)] for row in A]


def transpose(A: Matrix) -> Matrix:
    """A^T"""
    return [list(column) for column in zip(*A, strict=True)]


def apply_matrix(A: Matrix, b: Vector) -> Vector:
    """A b"""
    return [dot(row, b) for row in A]


def root(x: arb) -> arb:
    """The square root of a number that is known not to be negative, though its ball may reach below zero."""
    if not x.is_finite():
        raise TooWide
    if x.lower() > 0:
        return x.sqrt()
    return arb(0).union(x.upper().sqrt())


def sign(x: arb) -> int:
    """1 or -1 where proved, 0 where the ball holds zero."""
    return 1 if x > 0 else -1 if x < 0 else 0


def nearest_rotation(R: Float[np.ndarray, "3 3"]) -> Matrix:
    """The orthogonal polar factor, by Newton and Schulz: X (3 - X^T X)/2; its distance is below |X^T X - 1|."""
    X = [vector(row) for row in R]
    for _ in range(POLAR_STEPS):
        gram = product(transpose(X), X)
        X = product(X, [[(3 * (i == j) - gram[i][j]) / 2 for j in range(3)] for i in range(3)])
    gap = [x - int(i == j) for i, row in enumerate(product(transpose(X), X)) for j, x in enumerate(row)]
    off = arb(0, norm(gap).upper())
    if not off.upper() < 1e-50:
        raise ValueError("the start's R is no rotation; give an orthogonal matrix")
    return [[x + off for x in row] for row in X]


def frame_about(axis: Vector) -> Matrix:
    """A rotation whose third column is the direction of ``axis``."""
    e = scale_vector(axis, 1 / norm(axis))
    k = int(np.argmin([abs(float(x)) for x in e]))
    a = cross(e, [arb(int(i == k)) for i in range(3)])
    a = scale_vector(a, 1 / norm(a))
    return transpose([a, cross(e, a), e])


def quaternion(R: Matrix) -> Quaternion:
    """One of the two of a rotation, by its largest component."""
    t = [float(R[i][i]) for i in range(3)]
    if sum(t) > 0:
        w = (1 + R[0][0] + R[1][1] + R[2][2]).sqrt() / 2
        return [w, *((R[k][j] - R[j][k]) / (4 * w) for j, k in ((1, 2), (2, 0), (0, 1)))]
    i = int(np.argmax(t))
    j, k = (i + 1) % 3, (i + 2) % 3
    x = (1 + R[i][i] - R[j][j] - R[k][k]).sqrt() / 2
    q = [(R[k][j] - R[j][k]) / (4 * x), arb(0), arb(0), arb(0)]
    q[1 + i], q[1 + j], q[1 + k] = x, (R[i][j] + R[j][i]) / (4 * x), (R[i][k] + R[k][i]) / (4 * x)
    return q


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """a b"""
    v = [a[0] * y + b[0] * x + z for x, y, z in zip(a[1:], b[1:], cross(a[1:], b[1:]), strict=True)]
    return [a[0] * b[0] - dot(a[1:], b[1:]), *v]


def conjugate(q: Quaternion) -> Quaternion:
    """q*"""
    return [q[0], *(-x for x in q[1:])]


def to_extended(x: arb) -> np.longdouble:
    """A number of at most 64 bits within an ulp of the middle of the ball."""
    if not x.is_finite():
        raise TooWide
    total, rest = np.longdouble(0.0), x.mid()
    for _ in range(3):
        part = float(rest)
        total, rest = total + np.longdouble(part), rest - part
    return total


def extended_complex(x: acb) -> np.clongdouble:
    """Both parts ``extended``."""
    return np.clongdouble(to_extended(x.real)) + np.clongdouble(1j) * to_extended(x.imag)


def bound(x: arb) -> float:
    """A float64 number above ``x`` in absolute value."""
    return float(np.nextafter(float(abs(x).upper()), np.inf))


def largest_radius(numbers: Sequence[arb]) -> float:
    """The largest radius of some balls."""
    return max((bound(x - x.mid()) for x in numbers), default=0.0)
