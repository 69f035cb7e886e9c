"""The checker's rows of every kind of joint, and its springs, are those of the library, at arbitrary states."""

from functools import partial

import numpy as np
import pytest

from mbsbench.harness.judge.metrics.reactions import compute_loads_on_bodies
from mbsbench.harness.lab.bundle.contents import FORCES, _add_forces
from mbsbench.harness.mechanics import motion
from mbsbench.harness.mechanics.index1 import solve_index_1
from mbsbench.harness.mechanics.joints import KINDS as SORTS
from mbsbench.harness.mechanics.state import States

from ..solvers.arbitrary_joints import KINDS, MOVING, one_joint
from ..solvers.arbitrary_joints import moving_rows as moving_joints
from ..solvers.arbitrary_systems import arbitrary
from .test_check_bundle import checker

FLIPPED = ("u", "n", "s_i", "length", "motion")  # of each kind, one decides
SEEDS = 3
LOOSER = 1e-4  # of accelerations, whose rates of phi_dot are differences: these agree to 1e-7


def problem_of(system, start, **changes):
    """The problem that a bundle would describe, as the checker reads it, with changed numbers."""
    arrays = {key: np.array(a) for key, a in vars(system).items() if isinstance(a, np.ndarray) and a.dtype != object}
    arrays |= {"gravity": system.gravity, "gyration": system.gyration}
    arrays |= {f"start_{key}": getattr(start, key) for key in ("r", "R", "v", "Omega")}
    kinds = [str(SORTS[k]) for k in system.joint_sort] + [force for force in FORCES for _ in arrays[f"{force}_i"]]
    numbers = {key: np.array(a).tolist() for key, a in _add_forces(arrays).items()} | changes
    reference = {"kind": "none", "route": "", "horizon_s": 0.0}
    head = {"t_end_s": 1.0, "literal_start": False, "not_serialised": [], "invariants": [], "joint_kinds": kinds}
    return checker.Problem(head | {"reference": reference, "numbers": numbers}, None, "problem")


def compare(system, change=None):
    """The largest difference of norms of rows, of their rates and of energies from the library's."""
    worst = 0.0
    for seed in range(SEEDS):
        state = arbitrary(system, seed)
        bodies = [a.reshape(system.nb, -1) for a in (state.r, state.R, state.v, state.Omega)]
        row = np.concatenate([[0.4], np.concatenate(bodies, axis=1).ravel(), [0.0]])[None]
        with np.errstate(all="ignore"):
            q = problem_of(system, state)
            if change is not None:
                change(q)
            found = q.measure_series(row, q.all_bodies)
        one = States(state.r[None], state.R[None], state.v[None], state.Omega[None], np.array([0.4]))
        worst = max(worst, compare_accelerations(q, row, system, one))
        metres = np.ones(system.nrows)
        metres[system.turning_rows] = np.max(system.gyration)
        phi, rate = motion.constraint(system, one)[0], motion.constraint_rate(system, one)[0]
        for key, expected in (
            ("phi", np.linalg.norm(phi)),
            ("phi_dot", np.linalg.norm(rate)),
            ("gap", np.linalg.norm(motion.measure_gaps(system, one)[0] * metres)),
            ("gap_rate", np.linalg.norm(rate * metres)),
            ("E", motion.kinetic_energy(system, one)[0] + motion.potential_energy(system, one)[0]),
        ):
            worst = max(worst, abs(found[key][0] - expected) / (1.0 + abs(expected)))
    return worst


def compare_accelerations(q, row, system, one):
    """The largest relative difference of accelerations, of the joints' loads, and of loads of given reactions."""
    if len(system.user_i):
        return 0.0
    expected = solve_index_1(system, one)
    given = np.linspace(-1.0, 2.0, system.nrows)[None]
    with np.errstate(all="ignore"):
        pairs = [*zip(q.accelerate(row), (expected.a, expected.load), strict=True)]
        pairs.append(
            (
                np.einsum("tr,trbk->tbk", given, q.differentiate(row)[:, q.row_is_joint]),
                compute_loads_on_bodies(system, given, one),
            )
        )
    return max(LOOSER * np.max(np.abs(a - b)) / (1.0 + np.max(np.abs(b))) for a, b in pairs)


def system_of(kind, *, ground):
    return (one_joint(kind, ground=ground)[0]) if kind in KINDS else moving_joints(kind, ground=ground)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("ground", [False, True], ids=["two bodies", "ground"])
@pytest.mark.parametrize("kind", [*KINDS, *MOVING])
def test_rows_of_every_kind_are_the_library_s(kind, ground):
    """From the page alone: phi, its rate, and the gap, with nothing left unchecked; a flipped sign shows."""
    system = system_of(kind, ground=ground)
    assert compare(system) < 1e-11
    seen = [compare(system, partial(flip, key=key)) for key in FLIPPED]
    assert max(seen) > 1e-3


def flip(q, key):
    vars(q)[key][..., :1] *= -1.0


def test_every_kind_that_a_bundle_can_name_is_compared():
    assert {str(kind) for kind in SORTS} == {str(kind) for kind in (*KINDS, *MOVING)}


@pytest.mark.parametrize("kind", FORCES)
def test_forces_are_the_library_s(kind):
    """Springs, springs of torsion and loads; half as strong, they show."""
    system = moving_joints("knife edge")
    assert compare(system) < 1e-11 and compare(system, partial(weaken, kind=kind)) > 1e-6


def weaken(q, kind):
    assert kind in q.kinds
    q.k[q.kinds == kind] *= 0.5
    if kind == "load":
        q.row_is_load = 0.5 * q.row_is_load
