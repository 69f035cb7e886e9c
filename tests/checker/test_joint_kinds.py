"""The checker's rows of every kind of joint, and its springs, are those of the library, at arbitrary states."""

import numpy as np
import pytest

from mbsbench.harness.mechanics import motion
from mbsbench.harness.mechanics.joints import KINDS as SORTS
from mbsbench.harness.mechanics.state import States

from ..solvers.arbitrary_joints import KINDS, MOVING, one_joint
from ..solvers.arbitrary_joints import moving_rows as moving_joints
from ..solvers.arbitrary_systems import arbitrary, linkage
from .test_check_bundle import checker

FLIPPED = ("joint_u", "joint_n", "joint_s_i", "joint_length", "joint_motion")  # of each kind, one decides
SEEDS = 3


def numbers_of(system, start):
    """The numbers of a bundle."""
    plain = {key: np.array(a) for key, a in vars(system).items() if isinstance(a, np.ndarray) and a.dtype != object}
    plain |= {f"start_{key}": getattr(start, key) for key in ("r", "R", "v", "Omega")}
    return {key: plain[key] if key in plain else getattr(system, key) for key in checker.SHAPES}


def kinds_of(system):
    return np.array([str(SORTS[k]) for k in system.joint_sort])


def compare(system, numbers=None):
    """The largest difference of norms of rows, of their rates and of energies from the library's."""
    worst = 0.0
    for seed in range(SEEDS):
        state = arbitrary(system, seed)
        given = numbers or numbers_of(system, state)
        bodies = [a.reshape(system.nb, -1) for a in (state.r, state.R, state.v, state.Omega)]
        row = np.concatenate([[0.4], np.concatenate(bodies, axis=1).ravel(), [0.0]])[None]
        with np.errstate(all="ignore"):
            found = checker.System(given, kinds_of(system), np.arange(system.nb)).measure(row)
        one = States(state.r[None], state.R[None], state.v[None], state.Omega[None], np.array([0.4]))
        metres = np.ones(system.nrows)
        metres[system.turning_rows] = np.max(system.gyration)
        phi, rate = motion.constraint(system, one)[0], motion.constraint_rate(system, one)[0]
        for key, expected in (
            ("phi", np.linalg.norm(phi)), ("phi_dot", np.linalg.norm(rate)),
            ("gap", np.linalg.norm(motion.measure_gaps(system, one)[0] * metres)),
            ("gap_rate", np.linalg.norm(rate * metres)),
            ("E", motion.kinetic_energy(system, one)[0] + motion.potential_energy(system, one)[0]),
        ):  # fmt: skip
            worst = max(worst, abs(found[key][0] - expected) / (1.0 + abs(expected)))
    return worst


def system_of(kind, *, ground):
    return (one_joint(kind, ground=ground)[0]) if kind in KINDS else moving_joints(kind, ground=ground)


@pytest.mark.parametrize("ground", [False, True], ids=["two bodies", "ground"])
@pytest.mark.parametrize("kind", [*KINDS, *MOVING])
def test_rows_of_every_kind_are_the_library_s(kind, ground):
    """From the page alone: phi, its rate, and the gap, with nothing left unchecked; a flipped sign shows."""
    system = system_of(kind, ground=ground)
    assert compare(system) < 1e-11
    numbers = numbers_of(system, arbitrary(system, 0))
    seen = []
    for key in FLIPPED:
        flipped = numbers[key].copy()
        flipped[..., :1] *= -1.0
        seen.append(compare(system, numbers | {key: flipped}))
    assert max(seen) > 1e-3


def test_every_kind_that_a_bundle_can_name_is_compared():
    assert {str(kind) for kind in SORTS} == {str(kind) for kind in (*KINDS, *MOVING)}


def test_energies_of_springs_are_the_library_s():
    """Springs and springs of torsion; half as stiff, they show."""
    system = linkage(springs=True)
    assert compare(system) < 1e-11
    numbers = numbers_of(system, arbitrary(system, 0))
    for key in ("spring_k", "torsion_k"):
        if numbers[key].size:
            assert compare(system, numbers | {key: 0.5 * numbers[key]}) > 1e-3
