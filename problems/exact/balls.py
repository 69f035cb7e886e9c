"""Compute in ball arithmetic (Arb): each number has a radius within which the exact result is proved to lie.

A float64 number enters exactly. A start's R is a rotation only up to rounding: the nearest rotation is used.
"""

from collections.abc import Callable, Sequence
from functools import wraps
from typing import ParamSpec, TypeVar

import numpy as np
from flint import acb, arb, ctx
from jaxtyping import Float

BITS = 1000  # square roots at double zeros halve the digits several times
POLAR_STEPS = 9  # each step doubles the digits, from the 15 of float64
Vector = list[arb]
Matrix = list[list[arb]]  # rows
Quaternion = list[arb]  # w, x, y, z
P = ParamSpec("P")
T = TypeVar("T")


class BallTooWide(ArithmeticError):
    """A ball without a finite bound: the start is too near a motion of another kind."""


def run_in_balls(function: Callable[P, T]) -> Callable[P, T]:
    """Wrap ``function`` such that its ball arithmetic has ``BITS`` of precision, and return the wrapper."""

    @wraps(function)
    def precise(*args: P.args, **kwargs: P.kwargs) -> T:
        """Call the function at ``BITS`` of precision."""
        with ctx.workprec(BITS):
            return function(*args, **kwargs)

    return precise


def to_balls(a: Float[np.ndarray, " n"]) -> Vector:
    """Return float64 numbers as balls of radius zero."""
    return [arb(float(x)) for x in a]


def dot(a: Vector, b: Vector) -> arb:
    """Return a . b."""
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def norm(a: Vector) -> arb:
    """Return |a|."""
    return find_root(dot(a, a))


def scale_vector(a: Vector, factor: arb) -> Vector:
    """Return ``factor`` a."""
    return [factor * x for x in a]


def product(A: Matrix, B: Matrix) -> Matrix:
    """Return A B."""
    return [[dot(row, column) for column in transpose(B)] for row in A]


def transpose(A: Matrix) -> Matrix:
    """Return A^T."""
    return [list(column) for column in zip(*A, strict=True)]


def apply_matrix(A: Matrix, b: Vector) -> Vector:
    """Return A b."""
    return [dot(row, b) for row in A]


def find_root(x: arb) -> arb:
    """Return the square root of a number that is known not to be negative, although its ball may extend below zero.

    The ball of the root then begins at zero. Raise BallTooWide if the ball of ``x`` is not finite.
    """
    if not x.is_finite():
        raise BallTooWide
    if x.lower() > 0:
        return x.sqrt()
    return arb(0).union(x.upper().sqrt())


def sign(x: arb) -> int:
    """Return 1 or -1 if proved, 0 if the ball contains zero."""
    return 1 if x > 0 else -1 if x < 0 else 0


def find_nearest_rotation(R: Float[np.ndarray, "3 3"]) -> Matrix:
    """Return the rotation nearest to R, its orthogonal polar factor, by Newton-Schulz steps X (3 - X^T X)/2.

    The balls are widened by |X^T X - 1|, which bounds the distance of the last X from it. Raise ValueError if R is no
    rotation up to rounding.
    """
    X = [to_balls(row) for row in R]
    for _ in range(POLAR_STEPS):
        gram = product(transpose(X), X)
        X = product(X, [[(3 * (i == j) - gram[i][j]) / 2 for j in range(3)] for i in range(3)])
    gap = [x - int(i == j) for i, row in enumerate(product(transpose(X), X)) for j, x in enumerate(row)]
    off = arb(0, norm(gap).upper())
    if not off.upper() < 1e-50:
        raise ValueError("the start's R is no rotation; give an orthogonal matrix")
    return [[x + off for x in row] for row in X]


def make_frame_about(axis: Vector) -> Matrix:
    """Return a rotation matrix whose third column is the direction of ``axis``; the others are arbitrary."""
    e = scale_vector(axis, 1 / norm(axis))
    k = int(np.argmin([abs(float(x)) for x in e]))
    a = cross(e, [arb(int(i == k)) for i in range(3)])
    a = scale_vector(a, 1 / norm(a))
    return transpose([a, cross(e, a), e])


def convert_to_quaternion(R: Matrix) -> Quaternion:
    """Return one of the two unit quaternions of a rotation, computed from w or else its largest component."""
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
    """Return the quaternion product a b."""
    v = [a[0] * y + b[0] * x + z for x, y, z in zip(a[1:], b[1:], cross(a[1:], b[1:]), strict=True)]
    return [a[0] * b[0] - dot(a[1:], b[1:]), *v]


def conjugate(q: Quaternion) -> Quaternion:
    """Return the conjugate q*, which is the inverse of a unit quaternion."""
    return [q[0], *(-x for x in q[1:])]


def to_extended(x: arb) -> np.longdouble:
    """Return the midpoint of a ball as a long double, to an ulp; raise BallTooWide if the ball is not finite.

    The significand of a long double has 64 bits on x86, 53 to 113 elsewhere.
    """
    if not x.is_finite():
        raise BallTooWide
    total, rest = np.longdouble(0.0), x.mid()
    for _ in range(3):  # parts of 53 bits, of which three hold any of these significands
        part = float(rest)
        total, rest = total + np.longdouble(part), rest - part
    return total


def round_to_extended(x: acb) -> np.clongdouble:
    """Return the midpoint of a complex ball, both parts as ``to_extended`` rounds them."""
    return np.clongdouble(to_extended(x.real)) + np.clongdouble(1j) * to_extended(x.imag)


def bound_above(x: arb) -> float:
    """Return a float64 number above |x|."""
    return float(np.nextafter(float(abs(x).upper()), np.inf))


def largest_radius(numbers: Sequence[arb]) -> float:
    """Return the largest radius of the balls."""
    return max((bound_above(x - x.mid()) for x in numbers), default=0.0)
