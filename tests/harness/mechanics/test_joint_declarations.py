"""Declarations of joints: incomplete ones are refused, chosen rows keep their numbers, pictures and tables agree."""

import dataclasses
from importlib.machinery import SourceFileLoader
from typing import Any

import numpy as np
import pytest

from mbsbench import State, States, TimeFunction, constraint_jacobian
from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.joints import DECLARED, Joint, JointKind
from mbsbench.harness.mechanics.system import GROUND, Load, RigidBody, assemble
from mbsbench.harness.results.environment import ROOT
from mbsbench.problems.random_mechanism import closed_joint

from ...solvers.arbitrary_joints import KINDS

ROUNDING = 1e-11


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"kind": "hinge"}, "kind must be one of"),
        ({"kind": "distance"}, "length must be finite and > 0 m"),
        ({"kind": "prismatic", "axis_i": (1, 0, 0), "axis_j": (1, 0, 0)}, "needs across_i and across_j"),
        ({"kind": "point on plane"}, "needs axis_j"),
        ({"kind": "cylindrical", "axis_j": (1, 0, 0)}, "give the axis in both bodies"),
        ({"kind": "spherical", "axis_i": (1, 0, 0), "axis_j": (1, 0, 0)}, "has no axis"),
        ({"kind": "distance", "length": 1.0, "rows": (0,)}, "cannot be chosen"),
        ({"kind": "distance", "length": 1.0, "rows": 1}, "cannot be chosen"),
        ({"kind": "driven position", "axis_j": (1, 0, 0)}, "needs a motion"),
        ({"kind": "spherical", "motion": TimeFunction()}, "takes no motion"),
        ({"kind": "driven distance"}, "needs a motion"),
        ({"kind": "driven distance", "axis_j": (1, 0, 0), "motion": TimeFunction((1,))}, "has no axis"),
        ({"kind": "knife edge"}, "needs axis_i"),
        ({"kind": "rolling disc", "axis_i": (1, 0, 0), "axis_j": (0, 0, 1)}, "length must be finite and > 0"),
        ({"kind": "driven position", "axis_j": (1, 0, 0), "motion": TimeFunction((1, 2, 3, 4, 5))}, "up to"),
    ],
)  # fmt: skip
def test_an_incomplete_joint_is_refused(given, said) -> None:
    with pytest.raises(ValueError, match=said):
        assemble([RigidBody(1.0, np.eye(3))], [Joint(0, (0, 0, 0), **given)])


@pytest.mark.parametrize("rows", [(0, 3), (-1,), (0, 0), (), 1, (1.0,), (True,), "01", ((0,),), np.array([0.0])])
def test_rows_that_are_none_are_refused(rows: Any) -> None:
    """By the number of the joint as it was given, also behind one that was taken apart."""
    first = Joint(0, (0, 0, 0), rows=(0, 1))
    with pytest.raises(ValueError, match=r"joint 1: rows must be distinct whole numbers from 0 to 2 \(got "):
        assemble([RigidBody(1.0, np.eye(3))], [first, dataclasses.replace(first, rows=rows)])


def test_joints_behind_chosen_rows_keep_their_numbers() -> None:
    body, first = [RigidBody(1.0, np.eye(3))], Joint(0, (0, 0, 0), rows=np.array([2, 0]))
    names = assemble(body, [first, Joint(0, (0.1, 0, 0))]).joint_names
    assert names == ("joint 1, row 2", "joint 1, row 0", "joint 2")
    with pytest.raises(ValueError, match="joint 1: length must be"):
        assemble(body, [first, Joint(0, (0, 0, 0), kind="distance")])
    with pytest.raises(ValueError, match="part 1: expected body i"):
        assemble(body, [first, Joint(3, (0, 0, 0))])


@pytest.mark.parametrize("kind", [k for k in KINDS if k != JointKind.DISTANCE])
def test_all_rows_of_a_joint_one_by_one_are_the_joint(kind: JointKind) -> None:
    """One space of A: the same motion. Point rows are along the axes of j there, along those of space in the joint."""
    bodies, random = [RigidBody(1.0, np.eye(3))] * 2, np.random.default_rng(5)
    r, R = random.standard_normal((2, 3)), so3.exp(random.standard_normal((2, 3)))
    joint = closed_joint(kind, 0, 1, (r, R), random)
    v = random.standard_normal((2, 2, 3))
    state = State(r, R, v[0], v[1])
    whole = assemble(bodies, [joint])
    single = assemble(bodies, [dataclasses.replace(joint, rows=range(whole.nrows))])
    assert np.max(np.abs(motion.constraint(single, States.one(state)))) < ROUNDING
    A, B = (constraint_jacobian(s, state).toarray() for s in (whole, single))
    ranks = [np.linalg.matrix_rank(rows, tol=1e-9) for rows in (A, B, np.concatenate((A, B)))]
    assert ranks == [len(A)] * 3
    if whole.nrows > 1:
        fewer = assemble(bodies, [dataclasses.replace(joint, rows=range(1, whole.nrows))])
        assert np.array_equal(constraint_jacobian(fewer, state).toarray(), B[1:])


def test_pictures_and_tables_of_the_manual_are_those_of_the_declarations() -> None:
    """As ``make joints`` draws and writes them: an arrow for each freedom."""
    draws: Any = SourceFileLoader("draw_joints", str(ROOT / "docs" / "draw_joints.py")).load_module()
    for kind in draws.drawn():
        drawn = draws.picture(kind)
        assert drawn.count('stroke-width="2"') == 6 - sum(kind.count)
        assert (ROOT / "docs" / "images" / "joints" / draws.name(kind)).read_text(encoding="utf-8") == drawn
    text = (ROOT / "docs" / "joints-and-forces.md").read_text(encoding="utf-8")
    assert draws.page(text) == text


def test_a_load_on_the_ground_is_refused() -> None:
    """It would move nothing."""
    with pytest.raises(ValueError, match="load 0: expected a body in 0"):
        assemble([RigidBody(1.0, np.eye(3))], loads=[Load(GROUND)])


def test_every_kind_has_its_number() -> None:
    """Kept files name kinds by number: they are 0, 1, 2, ... without gap."""
    assert [one.number for one in DECLARED.values()] == list(range(len(DECLARED)))
