"""DOP853 as expressions: the error of a step, and all stages of a step of a small mechanism in one function.

Tolerances are ``rtol (1 + |x|)`` for slides and velocities, vectors by their length, ``rtol`` for angles and half of it
for quaternions.
"""

import casadi as ca
import numpy as np

from ....harness.base.generated import GeneratedFunction
from ....harness.base.tableaux import DOPRI853, evaluate_stages
from ....harness.mechanics.joint_tree import Tree

NOTHING = 1e-300  # makes an error of zero 0, not 0/0


def write_measure(tree: Tree) -> GeneratedFunction:
    """Return the function that computes the error of a step over its tolerances, a root mean square.

    Its inputs are (t, h, rtol), y at the start and at the end, and both error estimates divided by h.
    """
    n = tree.nq + tree.nu
    given, start, y, sums = ca.SX.sym("given", 3), ca.SX.sym("start", n), ca.SX.sym("y", n), ca.SX.sym("sums", 2 * n)
    first = second = ca.SX(0)
    for low, high, angle in list_tolerance_blocks(tree):
        a, b, x, z = start[low:high], y[low:high], sums[low:high], sums[n + low : n + high]
        scale = 0.5 * angle if angle else 1.0 + ca.sqrt(ca.fmax(ca.dot(a, a), ca.dot(b, b)))
        weight = 1.0 / (scale * scale)
        first, second = first + weight * ca.dot(x, x), second + weight * ca.dot(z, z)
    error = given[1] * first / (given[2] * ca.sqrt((first + 0.01 * second) * n + NOTHING))
    return GeneratedFunction([given, start, y, sums], [error])


def write_step(accelerate: GeneratedFunction, measure: GeneratedFunction) -> GeneratedFunction:
    """Return the function of a whole step: (t, h, rtol), start, its slope -> y at the end, error, least pivot.

    ``accelerate`` is (t, y) -> y_dot, least pivot; ``measure`` that of ``write_measure``.
    """
    f, error = (ca.Function("f", x.inputs, x.outputs) for x in (accelerate, measure))
    n = accelerate.inputs[1].numel()
    given, start, first = ca.SX.sym("given", 3), ca.SX.sym("start", n), ca.SX.sym("first", n)
    y, slopes, least = start, [first], ca.SX(1)

    def combine_slopes(weights: np.ndarray) -> ca.SX:
        """Return the sum of the slopes so far times these weights."""
        terms = [w * slope for w, slope in zip(weights.tolist(), slopes, strict=False) if w]
        return sum(terms[1:], terms[0])

    def combine(s: None, weights: np.ndarray, n: int, h: ca.SX) -> None:
        """Set y to the start plus ``h`` times the weighted sum of the slopes so far."""
        nonlocal y
        y = start + h * combine_slopes(weights)

    def append_slope(s: None, t: ca.SX, i: int) -> None:
        """Append the slope at y and ``t``, and include its pivot in the least one."""
        nonlocal least
        found, pivot = f(t, y)
        slopes.append(found)
        least = ca.fmin(least, pivot)

    evaluate_stages(None, DOPRI853, given[0], given[1], 1, combine, append_slope)
    sums = ca.vertcat(*(combine_slopes(row) for row in DOPRI853.error))
    return GeneratedFunction([given, start, first], [y, error(given, start, y, sums), least])


def list_tolerance_blocks(tree: Tree) -> list[tuple[int, int, int]]:
    """Return (first, last + 1, kind) of each block of y that has one tolerance.

    The tolerance of kind 0, slides and velocities, is rtol (1 + |block|); that of kind 1, a quaternion, is rtol / 2;
    that of kind 2, an angle, is rtol.
    """
    out: list[tuple[int, int, int]] = []
    for limb in tree.limbs:
        for at, kind in ((limb.q_at, 2), (tree.nq + limb.u_at, 0)):
            ns, n = len(limb.slides), limb.sizes[0 if kind else 1]
            out += [(at, at + ns, 0)] if limb.ball and ns else [(at + k, at + k + 1, 0) for k in range(ns)]
            out += [(at + ns, at + n, kind // 2)] if limb.ball else [(at + k, at + k + 1, kind) for k in range(ns, n)]
    return out
