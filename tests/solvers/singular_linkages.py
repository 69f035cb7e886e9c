"""Planar linkages of one freedom that pass singular positions, with motions in one angle: a branch and an energy."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mbsbench import Joint, assemble
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.mechanics.types import Problem
from mbsbench.problems.exact.planar import AXIS, OZ, make_planar_states, make_slender_bar

AXIAL, GRAVITY = 1e-4, 9.81


class Passing(NamedTuple):
    """A problem, and its branch: all centres (nt, nb, 2) from the angle of the first bar."""

    problem: Problem
    centres: Callable[[np.ndarray], np.ndarray]


def _passing(
    name: str, bars: list, joints: list, centres: Callable, turns: Sequence[float], start: tuple[float, float]
) -> Passing:
    """``turns`` of each bar for one of the first, whose angle and rate at the start are given."""
    angle, rate = np.array([start[0]]), start[1]
    step = 1e-6
    slope = (centres(angle + step) - centres(angle - step)) / (2.0 * step)  # to 1e-11: a start may be off by 1e-9
    turned = np.array([turns]) * angle[:, None]
    s = make_planar_states(centres(angle), turned, rate * slope, rate * np.array([turns]))
    system = assemble(bars, joints, (0.0, -GRAVITY, 0.0))
    problem = Problem(name, system, s[0], t_end=4.0, dt=1e-3, section="", source="")
    return Passing(problem, centres)


def parallel_bars(crank: float, couplers: Sequence[float], rate: float) -> Passing:
    """Cranks of one length, their ends joined by couplers as long as the ground: in line twice a turn."""
    feet, n = np.concatenate(([0.0], np.cumsum(couplers))), len(couplers)
    bars = [make_slender_bar(1.0 + 0.3 * k, crank, AXIAL, f"crank {k}") for k in range(n + 1)]
    bars += [make_slender_bar(0.7 + 0.2 * k, b, AXIAL, f"coupler {k}") for k, b in enumerate(couplers)]
    low, high = (-0.5 * crank, 0.0, 0.0), (0.5 * crank, 0.0, 0.0)
    joints = [Joint(k, low, GROUND, (float(x), 0.0, 0.0), AXIS, OZ) for k, x in enumerate(feet)]
    for k, b in enumerate(couplers):
        joints += [Joint(n + 1 + k, (0.5 * e * b, 0.0, 0.0), k + (e > 0), high, AXIS, AXIS) for e in (-1.0, 1.0)]

    def centres(angle: np.ndarray) -> np.ndarray:
        up = crank * np.stack((np.cos(angle), np.sin(angle)), axis=-1)[:, None]
        along = np.concatenate((feet, 0.5 * (feet[1:] + feet[:-1])))
        share = np.repeat((0.5, 1.0), (n + 1, n))
        return up * share[:, None] + np.stack((along, 0.0 * along), axis=-1)

    return _passing(
        f"parallel bars {crank:g} {list(couplers)}",
        bars,
        joints,
        centres,
        np.repeat((1.0, 0.0), (n + 1, n)).tolist(),
        (0.5 * np.pi, rate),
    )


def folding_crank(length: float, rate: float) -> Passing:
    """Crank and rod of one length, the rod's end on OX: where both stand upright the rod may as well turn with it."""
    bars = [make_slender_bar(m, length, AXIAL, name) for m, name in ((1.0, "crank"), (0.8, "rod"), (0.5, "slider"))]
    low, half, x, O = (-0.5 * length, 0.0, 0.0), (0.5 * length, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    joints = [
        Joint(0, low, GROUND, O, AXIS, OZ),
        Joint(1, low, 0, half, AXIS, AXIS),
        Joint(1, half, 2, O, AXIS, AXIS),
        Joint(2, O, GROUND, O, x, x, "guide", "prismatic", AXIS, OZ),
    ]

    def centres(angle: np.ndarray) -> np.ndarray:
        c, s = length * np.cos(angle), length * np.sin(angle)
        return np.stack(
            [np.stack(p, axis=-1) for p in ((0.5 * c, 0.5 * s), (1.5 * c, 0.5 * s), (2.0 * c, 0.0 * s))], axis=1
        )

    return _passing(f"folding crank {length:g}", bars, joints, centres, [1.0, -1.0, 0.0], (0.3, rate))


def branch_error(of: Passing, s: States) -> float:
    """[m] how far bodies are from where the first one's angle has them."""
    angle = np.arctan2(s.R[:, 0, 1, 0], s.R[:, 0, 0, 0])
    return float(np.max(np.linalg.norm(s.r[:, :, :2] - of.centres(angle), axis=2)))


LINKAGES = (
    parallel_bars(0.3, [1.0], 9.0), parallel_bars(1.0, [0.25], -3.0), parallel_bars(0.5, [0.7, 0.2], 2.0),
    parallel_bars(2.0, [0.5, 0.5, 1.3, 0.4], 1.0), folding_crank(0.4, 8.0), folding_crank(1.0, -5.0),
)  # fmt: skip
