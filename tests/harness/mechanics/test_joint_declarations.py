"""Declarations of joints: incomplete ones are refused, chosen rows keep their numbers, pictures and tables agree."""

import dataclasses
from importlib.machinery import SourceFileLoader
from typing import Any

import numpy as np
import pytest

from mbsbench import State, States, TimeFunction, constraint_jacobian
from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.consistency import InconsistentStart, check_start
from mbsbench.harness.mechanics.joints import DECLARED, Joint, JointKind
from mbsbench.harness.mechanics.system import GROUND, Load, RigidBody, SpringDamper, assemble
from mbsbench.harness.results.environment import ROOT
from mbsbench.problems.random_mechanism import draw_closed_joint
from mbsbench.tests.comparing import assert_same

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
)
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
    assert names == ("joint 0, row 2", "joint 0, row 0", "joint 1")
    with pytest.raises(ValueError, match="joint 1: length must be"):
        assemble(body, [first, Joint(0, (0, 0, 0), kind="distance")])
    with pytest.raises(ValueError, match="joint 1: expected body i"):
        assemble(body, [first, Joint(3, (0, 0, 0))])


@pytest.mark.parametrize("kind", [k for k in KINDS if k != JointKind.DISTANCE])
def test_all_rows_of_a_joint_one_by_one_are_the_joint(kind: JointKind) -> None:
    """One space of A: the same motion. Point rows are along the axes of j there, along those of space in the joint."""
    bodies, random = [RigidBody(1.0, np.eye(3))] * 2, np.random.default_rng(5)
    r, R = random.standard_normal((2, 3)), so3.exp(random.standard_normal((2, 3)))
    joint = draw_closed_joint(kind, 0, 1, (r, R), random)
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
        assert_same(constraint_jacobian(fewer, state).toarray(), B[1:])


def test_pictures_and_tables_of_the_manual_are_those_of_the_declarations() -> None:
    """As ``make joints`` draws and writes them: an arrow for each freedom."""
    draws: Any = SourceFileLoader("draw_joints", str(ROOT / "docs" / "draw_joints.py")).load_module()
    for kind in draws.list_drawn_kinds():
        assert (ROOT / "docs" / "images" / "joints" / draws.name_file(kind)).is_file(), "make joints"
        drawn = draws.draw_picture(kind)
        assert drawn.count('stroke-width="2"') == 6 - sum(kind.count)
        assert (ROOT / "docs" / "images" / "joints" / draws.name_file(kind)).read_text(encoding="utf-8") == drawn, (
            "make joints"
        )
    text = (ROOT / "docs" / "joints-and-forces.md").read_text(encoding="utf-8")
    assert draws.fill_page(text) == text, "docs/joints-and-forces.md lags behind the declarations: make joints"


def test_a_load_on_the_ground_is_refused() -> None:
    """It would move nothing."""
    with pytest.raises(ValueError, match="load 0: expected a body in 0"):
        assemble([RigidBody(1.0, np.eye(3))], loads=[Load(GROUND)])


def test_every_kind_has_its_number() -> None:
    """Kept files name kinds by number: they are 0, 1, 2, ... without gap."""
    assert [one.number for one in DECLARED.values()] == list(range(len(DECLARED)))


def test_a_point_of_two_numbers_is_named() -> None:
    """The part, counted as the user does, the name of its argument, and what was given."""
    body = [RigidBody(1.0, np.eye(3))]
    for parts, words in (
        (
            {"joints": [Joint(0, (0, 0, 0)), Joint(0, (-0.5, 0), name="pin")]},
            r"joint 'pin': s_i must be three .*-0.5",
        ),
        ({"joints": [Joint(0, (0, 0, 0), axis_i=(0, 0, 1), axis_j=(0, 1))]}, r"joint 0: axis_j must be three numbers"),
        ({"springs": [SpringDamper(0, "x", -1, (0, 0, 0), 1.0, 0.1)]}, r"spring 0: p_i must be three .* \(got x\)"),
        ({"loads": [Load(0, force=(1.0,))]}, r"load 0: force must be three numbers \(got \(1.0,\)\)"),
        ({"gravity": (0.0, -9.81)}, r"gravity must be three numbers"),
    ):
        with pytest.raises(ValueError, match=words):
            assemble(body, **parts)


def test_an_open_joint_says_what_is_open() -> None:
    """A distance, or an angle of the axes, beside the number of the row."""
    body = [RigidBody(1.0, np.eye(3))]
    start = State(np.array([[0.5, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    axis = (0.0, np.sin(0.3), np.cos(0.3))
    for joint, words in (
        (Joint(0, (-0.4, 0, 0)), r"its points are 0.1 m apart\)"),
        (Joint(0, (-0.5, 0, 0), axis_i=(0, 0, 1), axis_j=axis), r"its axes, as lines, differ by 17.19 deg\)"),
        (Joint(0, (-0.5, 0, 0), axis_i=(0, 0, 1), axis_j=(0, 0, 1)), None),
    ):
        system = assemble(body, [joint])
        if words is None:
            check_start(system, start)
        else:
            with pytest.raises(InconsistentStart, match=words):
                check_start(system, start)
