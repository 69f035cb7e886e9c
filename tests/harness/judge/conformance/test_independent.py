"""Requirements that know the motion without asking the problem or the solver, and orders on errors that are given."""

import dataclasses
import math

import numpy as np
import pytest

from mbsbench import JointKind, make_problem, solve
from mbsbench.harness.judge.conformance.ladders import check_order
from mbsbench.harness.judge.conformance.laws import Subject, check_computed_reference, check_invariants
from mbsbench.harness.judge.conformance.solver import EASY
from mbsbench.harness.judge.conformance.trials import Evidence, check_moments
from mbsbench.harness.results.records import RunRecord

HINGE = make_problem(*EASY["easy hinge"])


def moments(factor: np.ndarray):
    """The finding where each row of the reactions is multiplied by its ``factor``."""
    run = solve(HINGE, "radau_index1", rtol=1e-8)
    assert run.series is not None
    series = dataclasses.replace(
        run.series, arrays={**run.series.arrays, "frame_reaction": factor * run.series["frame_reaction"]}
    )
    return check_moments(Evidence("rtol", 5.0, {"easy hinge": run.record}, {"easy hinge": series}))


@pytest.mark.parametrize("rows", [slice(0, 0), slice(3, 5), slice(0, 3)], ids=["none", "axis rows", "point rows"])
def test_a_turned_sign_of_axis_rows_is_found(rows):
    """Euler's equation of a body on a skew hinge, whose axis rows carry as much as the arms of its point rows."""
    assert HINGE.system.joint_kind(0) == JointKind.REVOLUTE
    factor = np.ones(5)
    factor[rows] = -1.0
    found = moments(factor)
    assert found.is_tested and found.holds == (rows == slice(0, 0)), found


@pytest.mark.parametrize(("share", "holds"), [(1.0, True), (1.0 + 1e-6, False)])
def test_a_reference_of_another_system_is_found(share, holds):
    """The exact motion under a gravity that is off by a millionth keeps all joints, its own energy and its start."""
    subject, right = Subject("heavy_top"), make_problem("heavy_top", {"t_end": 1.0})
    gravity = dataclasses.replace(right.system, gravity=share * right.system.gravity)
    vars(subject)["problem"] = dataclasses.replace(right, system=gravity)
    vars(subject)["reference"] = right.reference()
    found = check_computed_reference(subject)
    assert found.is_tested and found.holds == holds, found


def test_invariants_are_tested_without_a_reference_of_the_problem_s_own():
    """Along the computed motion: one that is none is found."""
    subject, top = Subject("heavy_top"), make_problem("heavy_top", {"t_end": 0.5})
    vars(subject)["problem"], vars(subject)["reference"] = top, None
    assert check_invariants(subject).holds
    (first, *_) = top.invariants
    odd = dataclasses.replace(first, of=lambda s: s.Omega[:, 0, 0])
    vars(subject)["problem"] = dataclasses.replace(top, invariants=(odd,))
    assert not check_invariants(subject).holds


def measured(errors: list[float], order: float = 4.0):
    """The finding on a solver of fixed steps with these errors at halved steps."""
    runs = {
        f"finer {k}": RunRecord(
            status="success",
            claimed="success",
            dt_s=0.5**k,
            length_scale_m=1.0,
            position_error_max_m=e,
            orientation_error_max_rad=0.0,
        )
        for k, e in enumerate(errors)
    }
    return check_order(Evidence("dt", order, runs, {}))


def test_a_floor_of_newton_iterations_is_no_lower_order():
    """Fourth order down to 1e-10, where corrections end; the floor is above rounding."""
    found = measured([1e-6, 1e-6 / 16.0, 3e-10, 2.5e-10])
    assert found.holds and found.value == pytest.approx(math.log2(1e-6 / 16.0 / 3e-10), rel=1e-12)


def test_an_error_that_stays_far_above_such_a_floor_is_a_missing_term():
    """The first halving is of the declared order, then nothing helps."""
    found = measured([1e-2, 1e-2 / 16.0, 5e-4, 4.9e-4])
    assert not found.holds and found.value < 0.1


def test_a_slow_solver_is_called_slow():
    """Runs that their wall limit ended say nothing about signs."""
    runs = {f"finer {k}": RunRecord(status="stalled", claimed="stalled", cpu_limit_s=20.0) for k in range(4)}
    found = check_order(Evidence("dt", 2.0, runs, {}))
    assert not found.holds and "too slow" in found.remedy and "20 s" in found.remedy
