"""MJCF and URDF as the public writes them: flags, looks that other parts name, locked joints, words of other tools."""

import importlib.util

import numpy as np
import pytest

from mbsbench import accelerations
from mbsbench.harness.formats.mechanisms import mechanism_files, mujoco_flags
from mbsbench.tests.comparing import assert_close

from .test_mechanism_files import written

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="mujoco is an optional extra: make test-engines"
)

WHEEL = """<mujoco><option gravity="0 0 0"><flag {flag}/></option><worldbody><site name="wall"/>
<body name="wheel"><joint name="pin" axis="0 0 1" stiffness="4" damping="0.5"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><site name="rim" pos="1 0 0"/></body></worldbody>
<tendon><spatial stiffness="3" damping="1" springlength=".5"><site site="rim"/><site site="wall"/></spatial></tendon>
</mujoco>"""
BAR = '<inertial pos="0.5 0 0" mass="1" diaginertia="0.001 0.0833 0.0833"/>'
FALL = 9.81 * 0.5 / (0.0833 + 0.25)  # of the bar from level: m g l / (I + m l^2)
INERTIAL = """<inertial><origin xyz="0.5 0 0"/><mass value="1"/>
<inertia ixx="0.001" iyy="0.0833" izz="0.0833" ixy="0" ixz="0" iyz="0"/></inertial>"""
ROBOT = f"""<robot name="r"><link name="base"/><link name="upper">{INERTIAL}</link><link name="lower">{INERTIAL}</link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="1 0 0"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0" effort="0" velocity="0"/></joint></robot>"""


def rates(path, **start):
    problem = mechanism_files.read_mechanism(path).problem(**start)
    return accelerations(problem.system, problem.initial).Omega_dot


@pytest.mark.parametrize(
    ("flag", "expected"),
    [
        ("contact", -4 * 0.5 - 0.5),
        ("spring", -0.5),
        ("damper", -4 * 0.5),
        ("constraint", -4 * 0.5 - 0.5),
    ],
)
def test_flags_switch_springs_and_dampers_off(tmp_path, flag, expected):
    """-(k theta + c omega) / J of what is on; the tendon keeps its length."""
    path = written(tmp_path, WHEEL.format(flag=f'{flag}="disable"'))
    assert_close(rates(path, qpos=(0.5,), qvel=(1.0,)), [[0.0, 0.0, expected]], atol=1e-12)
    system = mechanism_files.read_mechanism(path).system()
    on = (flag != "spring", flag != "damper")
    assert [float(np.sum(a)) != 0.0 for a in (system.spring_k, system.spring_c)] == [*on]


def test_no_flag_of_mujoco_is_in_no_list():
    """A flag of a later version that is set is refused by its name."""
    import mujoco

    known = {*mujoco_flags.OFF, *mujoco_flags.READ, *mujoco_flags.WITHOUT_EFFECT}
    theirs = mujoco.mjtDisableBit.__members__, mujoco.mjtEnableBit.__members__
    assert {k.removeprefix("mjDSBL_") for k in theirs[0] if k.startswith("mjDSBL_")} <= known
    assert {k.removeprefix("mjENBL_") for k in theirs[1] if k.startswith("mjENBL_")} <= {*mujoco_flags.ENABLED}


def test_looks_are_left_out_with_what_refers_to_them(tmp_path):
    """Materials of sites and tendons, meshes named by contact pairs and sensors; none of the files is there."""
    text = f"""<mujoco><asset><texture name="t" type="2d" file="t.png"/><material name="red" texture="t"/>
    <mesh name="finger" file="finger.stl"/><hfield name="hills" file="hills.png" size="1 1 1 1"/></asset>
    <worldbody><geom name="hill" type="hfield" hfield="hills"/><site name="wall" material="red"/><body name="bar">
    <joint axis="0 1 0"/>{BAR}<site name="tip" pos="1 0 0" material="red"/><geom name="pad" type="mesh" mesh="finger"/>
    <geom name="box" type="box" mesh="finger"/></body></worldbody>
    <contact><pair geom1="hill" geom2="pad"/><pair geom1="hill" geom2="box"/></contact>
    <tendon><spatial material="red"><site site="tip"/><site site="wall"/></spatial></tendon>
    <sensor><touch site="tip"/><distance geom1="hill" geom2="pad"/></sensor></mujoco>"""
    assert_close(rates(written(tmp_path, text)), [[0.0, FALL, 0.0]], atol=1e-12)


def test_included_files_are_found_where_mujoco_finds_them(tmp_path):
    """Beside the file that includes them; all of them are part of the digest."""
    (tmp_path / "sub").mkdir()
    top = written(tmp_path, '<mujoco><!-- <include file="none.xml"/> --><include file="sub/a.xml"/></mujoco>')
    a = written(tmp_path, "<mujocoinclude><include file='b.xml'/></mujocoinclude>", "sub/a.xml")
    bar = f'<worldbody><body><joint axis="0 1 0"/>{BAR}</body></worldbody>'
    b = written(tmp_path, f"<mujocoinclude>{bar}</mujocoinclude>", "sub/b.xml")
    assert mechanism_files.list_files(top) == (top, a, b)
    assert_close(rates(top), [[0.0, FALL, 0.0]], atol=1e-12)


def test_limits_that_lock_a_joint_of_a_urdf_fix_it(tmp_path):
    """Two bars become one: moments of inertia by Steiner about the shoulder. Blanks may be before the declaration."""
    path = written(tmp_path, '\n\n<?xml version="1.0"?>\n' + ROBOT)
    about = 2 * 0.0833 + 0.5**2 + 1.5**2
    assert_close(rates(path), [[0.0, 9.81 * 2.0 / about, 0.0]], atol=1e-12)


def test_words_of_other_tools_are_named(tmp_path):
    """Extensions, transmissions, and a joint without limits, which is free."""
    text = ROBOT.replace('lower="0" upper="0"', "").replace("</robot>", '<gazebo/><transmission name="t"/></robot>')
    omitted = mechanism_files.read_mechanism(written(tmp_path, text)).omitted
    assert {*omitted} == {
        "extensions for Gazebo",
        "transmissions",
        "joints without lower and upper limit, which are free here",
    }


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('lower="0" upper="0"', 'lower=".3" upper=".3"', "supported at 0 only (got 0.3)"),
        ('lower="0" upper="0"', 'lower="1" upper="0"', "lower must be at most upper (got 1, 0)"),
        ('<axis xyz="0 1 0"/></joint>', '<axis xyz="0 1 0"/><spring k="1"/></joint>', "<spring>: not supported"),
        ('<origin xyz="0.5', '<origin quat="1 0 0 0" xyz="0.5', "<origin>: attribute 'quat' is not supported"),
        ('<limit lower="0" upper="0" effort="0" velocity="0"/>', '<mimic joint="shoulder"/>', "coupled to 'shoulder'"),
        ('<link name="base"/>', '<xacro:arm/><link name="base"/>', "a macro of xacro; expand the file first"),
        (f'<link name="upper">{INERTIAL}', '<link name="upper">', "<link name='upper'>: joint 'shoulder'"),
        (
            'iyy="0.0833" izz="0.0833"',
            'iyy="0.0833" izz="0.5"',
            "the largest by 0.416 more than the other two together",
        ),
        ('ixx="0.001"', 'ixx="-0.001"', "<inertia>: no rigid body has the inertia of 'upper'"),
    ],
)
def test_a_refused_element_of_a_urdf_is_named_with_its_line(tmp_path, before, after, words):
    """In terms of URDF, not of MuJoCo's own format, and in one line."""
    assert before in ROBOT
    text = ROBOT.replace(before, after, 1)
    text = text.replace('type="revolute"', 'type="continuous"') if "upper" in words and "link" in words else text
    with pytest.raises(ValueError, match=r"^line ") as error:
        mechanism_files.read_mechanism(written(tmp_path, text))
    assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("joints", ["slide/1 0 0,slide/0 1 0", "hinge/0 1 0,hinge/0 1 0"])
def test_joints_that_make_no_kind_name_the_remedy(tmp_path, joints):
    """And the remedy is read: one joint a body."""
    tags = [
        f'<joint type="{t}" axis="{a}" pos="{k} 0 0"/>'
        for k, (t, a) in enumerate(x.split("/") for x in joints.split(","))
    ]
    world = "<mujoco><worldbody>{}</worldbody></mujoco>"
    with pytest.raises(ValueError, match="give each a body of its own, with mass and inertia, one within the other"):
        mechanism_files.read_mechanism(written(tmp_path, world.format(f'<body name="a">{"".join(tags)}{BAR}</body>')))
    nested = f'<body name="a">{tags[0]}{BAR}<body name="b">{tags[1]}{BAR}</body></body>'
    assert len(mechanism_files.read_mechanism(written(tmp_path, world.format(nested))).system().mass) == 2
