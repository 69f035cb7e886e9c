"""Requirements that know the motion without asking the problem or the solver: moments of joints, references."""

import dataclasses

import numpy as np
import pytest

from mbsbench.api import solve
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.conformance.laws import Subject, check_independent, check_invariants
from mbsbench.harness.conformance.solver import EASY
from mbsbench.harness.conformance.trials import Evidence, check_moments
from mbsbench.harness.mechanics.joints import JointKind

HINGE = make_problem(*EASY["easy hinge"])


def moments(factor: np.ndarray):
    """What is found where each row of the reactions is multiplied by its ``factor``."""
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
    found = check_independent(subject)
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
