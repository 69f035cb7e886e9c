"""Messages name a part by the user's name, else by its number, counted from 0."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.formats.motions import columns
from mbsbench.harness.mechanics.forces import Load, TorsionSpring
from mbsbench.harness.mechanics.joints import Joint
from mbsbench.harness.mechanics.naming import name_body, name_joint, name_part
from mbsbench.harness.mechanics.system import GROUND, RigidBody, assemble

BODY = RigidBody(1.0, np.eye(3))


def test_a_part_is_named_by_its_name_else_by_its_number():
    assert [name_part("body", 2, name) for name in ("left leg", "", None)] == ["body 'left leg'", "body 2", "body 2"]


def test_parts_without_names_keep_the_number_they_were_given():
    """The user counts joints as listed; chosen rows and a renumbered presentation move them, not their numbers."""
    hinge = Joint(0, (0, 0, 0))
    system = assemble([BODY, dataclasses.replace(BODY, name="leg")], [dataclasses.replace(hinge, rows=(0, 1)), hinge])
    assert [name_body(system, b) for b in (GROUND, 0, 1)] == ["the ground", "body 0", "body 'leg'"]
    assert [name_joint(system, k) for k in range(3)] == ["joint 0, row 0", "joint 0, row 1", "joint 1"]
    turned = dataclasses.replace(system, body_names=system.body_names[::-1])
    assert [name_body(turned, b) for b in (0, 1)] == ["body 'leg'", "body 0"]


def test_a_wrong_body_is_named_as_a_wrong_joint_is():
    """Both counted from 0; they were counted from 1 and from 0."""
    with pytest.raises(ValueError, match="body 1: mass must be"):
        assemble([BODY, dataclasses.replace(BODY, mass=-1.0)])
    with pytest.raises(ValueError, match="body 'leg': mass must be"):
        assemble([BODY, dataclasses.replace(BODY, mass=-1.0, name="leg")])
    with pytest.raises(ValueError, match="joint 1: expected body i"):
        assemble([BODY], [Joint(0, (0, 0, 0)), Joint(3, (0, 0, 0))])


@pytest.mark.parametrize(
    ("parts", "named"),
    [
        ({"joints": [Joint(0, (0, 0, np.nan), name="pin")]}, "joint 'pin': s_i must be finite"),
        ({"loads": [Load(0, force=(0, np.inf, 0))]}, "load 0: force must be finite"),
        ({"gravity": (0, 0, np.nan)}, "the system: gravity must be finite"),
        (
            {"torsions": [TorsionSpring(0, (1, 0, 0), rest_angle=np.nan)]},
            "torsion 0: rest_angle must be a finite number",
        ),
    ],
)
def test_a_number_that_is_not_finite_is_named_with_its_part(parts, named):
    """The arrays of all parts together would only know that one of them has it."""
    with pytest.raises(ValueError, match=named):
        assemble([BODY], **parts)


@pytest.mark.parametrize("stem", ["body", "body_"])
@pytest.mark.parametrize("first", [0, 1])
def test_columns_of_a_file_may_count_from_0_or_from_1(first, stem):
    """``body1`` is the second body of a file with a ``body0``, else the first; names of bodies count from 0."""
    names = tuple(f"body {b}" for b in range(3))
    expected = [f"{stem}{b + first}_r_{c}" for b in range(3) for c in "xyz"]
    keys, _ = columns._find_columns(columns.QUANTITIES["r"], names, set(expected))
    assert keys == expected
