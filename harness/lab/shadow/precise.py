"""Compute motions in 80 or 113 bits by the Taylor series of a mechanism's tape in joint coordinates.

``python -m mbsbench.harness.lab.shadow.precise chain 2 --bits 113 --out chain.npz`` writes the motion, rounded to
doubles, as ``mbsbench referee`` and ``shadow`` read it. Its error is ten times the largest difference so far, in r [m]
and R, from a run with longer steps of lower order. The equations are those of the generated code. The motion is that of
the numbers on the tape, which are doubles: sums and products of a problem's data are rounded, as if the data were.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from ...base.generated import GeneratedFunction
from ...catalogue.offers import find_offer
from ...catalogue.registry import make_problem
from ...mechanics.joint_expressions import JointExpressions
from ...mechanics.joint_tree import build_spanning_tree
from ...mechanics.state import State, States
from ...mechanics.system import MultibodySystem
from ...mechanics.types import Problem
from ...results.npz import write_npz
from .series import march_by_series
from .taylor import Sums, TaylorSeries, split_doubles, sum_exactly

TOLERANCE = {80: 2.0**-64, 113: 2.0**-112}
LOOSER, SAFETY = 2.0**4, 10.0  # factor on the tolerance of the second run; error relative to their difference
LAST = 7  # coefficients before the last: by symmetry most may vanish, as for a pendulum that starts from rest
CLOSING = 4  # Newton steps to close loops at the start, each of which doubles the correct digits


def round_states(times: Sequence[Fraction], poses: Sequence[Sums]) -> States:
    """Return the ``poses`` of ``PreciseFlow.compute_poses`` at these ``times`` [s] as states, rounded to doubles."""
    x = np.array(poses)[:, :, 0]
    nb = x.shape[1] // 18
    r, R, V = x[:, : 3 * nb], x[:, 3 * nb : 12 * nb], x[:, 12 * nb :].reshape(-1, nb, 6)
    t = np.array([float(t) for t in times])
    return States(r.reshape(-1, nb, 3), R.reshape(-1, nb, 3, 3), V[..., :3].copy(), V[..., 3:].copy(), t)


class PreciseFlow:
    """Integrate a system in joint coordinates y; a state is (t, y) as sums of doubles."""

    def __init__(self, system: MultibodySystem, start: State, bits: int, tolerance: float | None = None) -> None:
        """Prepare the series; ``tolerance`` is that of a step, relative to the largest coordinate or 1.

        Raise ValueError where no code can be generated.
        """
        import casadi as ca

        tree = build_spanning_tree(system, start)
        e: JointExpressions = find_offer("expressions").write(system, tree)
        self.rows = e.rows
        self.tolerance = TOLERANCE[bits] if tolerance is None else tolerance
        self.order = math.ceil(1.0 - 0.5 * math.log(self.tolerance))
        inputs = [e.t, e.y]
        self._rate = TaylorSeries(GeneratedFunction(inputs, [ca.SX(1), e.rate]), bits, self.order, rates=True)
        self._close = TaylorSeries(GeneratedFunction(inputs, [e.closed]), bits)
        self._poses = TaylorSeries(GeneratedFunction(inputs, [ca.densify(a) for a in (e.r, e.R, e.V)]), bits)
        parts = np.zeros((1 + len(tree.start), 3))
        parts[1:, 0] = tree.start
        parts[0] = split_doubles(Fraction(start.t))
        for _ in range(CLOSING):
            parts = self.close_loops(parts)
        self.start: Sums = parts
        self.steps = 0

    def close_loops(self, x: Sums) -> Sums:
        """Return the state x after one Newton step towards closed loops and unit quaternions."""
        return np.concatenate((x[:1], self._close.evaluate(x)))

    def compute_poses(self, x: Sums) -> Sums:
        """Return r, R by rows, then (v, Omega) by bodies, of the state x, as one column of sums of doubles."""
        return self._poses.evaluate(x)

    def march(self, times: Sequence[Fraction]) -> Iterator[Sums]:
        """Yield the states at ``times`` [s], integrated from the start; decreasing times are integrated backwards."""

        def expand(x: Sums, t: Fraction) -> Fraction:
            """Expand the series about the state x at time t [s], which is set exactly; return the step [s]."""
            x[0] = split_doubles(t)
            self._rate.expand(x)
            self.steps += 1
            return self._choose_step()

        evaluate = lambda t, time: self.close_loops(self._rate.sum_series(time - t))  # noqa: E731
        steps = march_by_series(self.start, sum_exactly(self.start[0]), times[-1], times, expand, evaluate)
        yield from (x for x, asked in steps if asked)

    def _choose_step(self) -> Fraction:
        """Return the length [s] of the next step: the estimated radius of convergence over a little more than e^2.

        Source: Jorba and Zou, Sect. 3.2. Raise ArithmeticError if the series is not finite.
        """
        p, scale = self.order, max(1.0, self._rate.find_largest_coefficient(0))
        radius = min(
            (max(self._rate.find_largest_coefficient(k), 1e-300) / scale) ** (-1.0 / k) for k in range(p - LAST, p + 1)
        )
        if not 0.0 < radius < math.inf:
            raise ArithmeticError("the series is not finite: a pivot is lost")
        return Fraction(radius * math.exp(-2.0 - 0.7 / (p - 1)))


def measure_difference(a: Sums, b: Sums) -> float:
    """Return the largest difference of two states or poses, given as sums of doubles whose leading ones are close."""
    return float(np.max(np.abs(np.sum(a - b, axis=1))))


def make_precise_motion(
    problem: Problem, t_end: Fraction, bits: int, rows: int
) -> tuple[States, np.ndarray, PreciseFlow]:
    """Return a motion at ``rows`` even times up to ``t_end`` [s], its error up to each time, and its flow.

    The error is ``SAFETY`` times the largest difference, in r [m] and R, from a second run with longer steps. Raise
    ArithmeticError if the motion does not stay finite.
    """
    times = [k * t_end / (rows - 1) for k in range(rows)]
    flow, rough = (PreciseFlow(problem.system, problem.initial, bits, TOLERANCE[bits] * c) for c in (1, LOOSER))
    poses, difference, of_pose = [], [0.0], slice(12 * problem.system.nb)
    for x, y in zip(flow.march(times), rough.march(times), strict=True):
        poses.append(flow.compute_poses(x))
        # ``np.maximum`` propagates a NaN
        difference.append(
            np.maximum(difference[-1], measure_difference(poses[-1][of_pose], rough.compute_poses(y)[of_pose]))
        )
    if not np.isfinite(difference[-1]):
        raise ArithmeticError("the motion is no longer finite: give a shorter time")
    return round_states(times, poses), SAFETY * np.array(difference[1:]), flow


def main() -> None:
    """Run the command of the module: write the motion of a problem, with its error, as an NPZ file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problem", help="name of a problem, or a mechanism's file")
    parser.add_argument("t_end", help="[s], as 2, 0.5 or 1/3")
    parser.add_argument("--bits", type=int, choices=list(TOLERANCE), default=80)
    parser.add_argument("--problem-set", metavar="K=V", action="append", default=[], help="problem parameter")
    parser.add_argument("--rows", type=int, default=1001, help="of the file, even in time (default: 1001)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.npz")
    arguments = parser.parse_args()
    try:
        t_end = Fraction(arguments.t_end)
        if arguments.rows < 2 or t_end <= 0:
            raise ValueError(f"give at least 2 rows and a time above 0 (got {arguments.rows}, {arguments.t_end})")
        problem = make_problem(arguments.problem, dict(pair.partition("=")[::2] for pair in arguments.problem_set))
        states, error, flow = make_precise_motion(problem, t_end, arguments.bits, arguments.rows)
        t, *parts = states.times, states.r, states.R, states.v, states.Omega
        # rounding of the poses to doubles
        stored = error + 0.5 * np.spacing(max(np.max(np.abs(part)) for part in parts[:2]))
        write_npz(arguments.out, dict(zip(("t", "r", "R", "v", "Omega", "error"), (t, *parts, stored), strict=True)))
    except (ArithmeticError, OSError, ValueError) as reason:
        parser.error(str(reason))
    sys.stdout.write(
        f"{arguments.out}: {t[-1]:g} s in {flow.steps} steps of order {flow.order}, error {error[-1]:.1e}, "
        f"{time.process_time():.1f} s of CPU\n"
    )


if __name__ == "__main__":
    main()
