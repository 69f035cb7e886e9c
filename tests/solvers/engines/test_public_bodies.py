"""Bodies of MJCF and URDF as the public writes them: shapes, rods and plates, bodies at rest, starts of loops."""

import importlib.util

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench import accelerations, make_problem
from mbsbench.harness.catalogue import registry
from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.formats.motions import omissions
from mbsbench.tests.comparing import assert_close

from .test_mechanism_files import written
from .test_public_files import BAR, FALL, INERTIAL, rates

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="mujoco is an optional extra: make test-engines"
)


@pytest.fixture(autouse=True)
def own_catalogue(monkeypatch):
    """Files of one name in many folders."""
    for known in ("_plugin_files", "_plugin_problems", "_plugin_solvers"):
        monkeypatch.setattr(registry, known, type(getattr(registry, known))())


ARM = f"""<robot name="r"><link name="base">{{base}}</link><link name="arm">{INERTIAL}{{arm}}</link>
<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>{{more}}</robot>"""
FIXED = '<joint name="{0}_f" type="fixed"><parent link="arm"/><child link="{0}"/></joint><link name="{0}">{1}</link>'
INERTIA = '<inertia ixx="{}" iyy="{}" izz="{}" ixy="{}" ixz="{}" iyz="{}"/>'
BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
WORLD = "<mujoco><worldbody>{}</worldbody>{}</mujoco>"
PEER = f'<body name="peer" pos="0 1 0"><freejoint/>{BAR}</body>'
UP = '<inertial pos="0 0 0.5" mass="1" diaginertia="0.0833 0.0833 0.001"/>'
PARALLELOGRAM = f"""<body name="crank"><joint axis="0 1 0"/>{UP}<body name="rod" pos="0 0 1"><joint axis="0 1 0"/>{BAR}
</body></body><body name="rocker" pos="1 0 0"><joint axis="0 1 0"/>{UP}</body>"""
JOIN = '<equality><connect name="P" body1="rod" body2="rocker" anchor="1 0 0"/></equality>'


def arm(tmp_path, base="", of_arm="", more=""):
    return written(tmp_path, ARM.format(base=base, arm=of_arm, more=more))


def six(J):
    return INERTIA.format(*(repr(float(J[i, j])) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))))


@pytest.mark.parametrize(
    "shape",
    [
        BALL,
        '<collision><geometry><box size="0 0 0"/></geometry></collision>',
        '<visual><geometry><mesh filename="arm.dae"/></geometry></visual>',
        "<collision><geometry/></collision>",
    ],
)
def test_shapes_of_a_urdf_have_no_mass_and_need_not_be_there(tmp_path, shape):
    """A link without an inertial has none, whatever it looks like: the bar falls as without it."""
    path = arm(tmp_path, of_arm=shape, more=FIXED.format("tip", shape))
    assert mechanism_files.read_mechanism(path).system().mass.tolist() == [1.0]
    assert_close(rates(path), [[0.0, FALL, 0.0]], atol=1e-12)


def test_a_link_without_mass_keeps_its_inertia(tmp_path):
    """A rotor of 0 kg and 0.05 kg m2 on the bar: m g l / (I + 0.05 + m l^2)."""
    rotor = f'<inertial><mass value="0"/>{INERTIA.format(0.05, 0.05, 0.05, 0, 0, 0)}</inertial>'
    path = arm(tmp_path, more=FIXED.format("rotor", rotor))
    assert_close(rates(path), [[0.0, 9.81 * 0.5 / (0.0833 + 0.05 + 0.25), 0.0]], atol=1e-12)


def test_inertias_of_links_that_rest_do_not_matter(tmp_path):
    """The base has numbers that no rigid body has."""
    base = f'<inertial><mass value="1"/>{INERTIA.format(1, 1, 9, 0, 0, 0)}</inertial>'
    assert_close(rates(arm(tmp_path, base=base)), [[0.0, FALL, 0.0]], atol=1e-12)


@pytest.mark.parametrize("moments", [(1, 2, 3), (0.1, 0.7, 0.8), (0, 1, 1), (0, 0, 0), (1, 2, 2.5)])
def test_rods_plates_and_point_masses_pass_in_any_direction(tmp_path, moments):
    """Rounding adds to the largest moment or takes from the least; MuJoCo's compiler has no slack, a rigid body has."""
    for seed in range(8):
        R = Rotation.random(random_state=seed).as_matrix() if seed else np.eye(3)
        J = R @ np.diag(moments) @ R.T
        text = f'<origin rpy="0.3 0.2 0.1"/><mass value="1"/>{six(J)}'
        free = f'<link name="b"><inertial>{text}</inertial></link><joint name="f" type="floating">'
        robot = f'<robot name="r"><link name="a"/>{free}<parent link="a"/><child link="b"/></joint></robot>'
        full = " ".join(repr(float(J[i, j])) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        body = f'<body><freejoint/><inertial pos="0 0 0" mass="1" fullinertia="{full}"/></body>'
        turn = Rotation.from_euler("xyz", (0.3, 0.2, 0.1)).as_matrix()
        for path, Q in ((written(tmp_path, robot), turn), (written(tmp_path, WORLD.format(body, "")), np.eye(3))):
            system = mechanism_files.read_mechanism(path).system()
            assert_close(system.inertia[0], Q @ J @ Q.T, rtol=0.0, atol=1e-12 * max(1, *moments))


def test_equal_limits_are_said_and_a_robot_at_rest_names_them(tmp_path):
    """One of two joints is locked: the source says so; with both nothing moves."""
    limit = '<limit lower="0" upper="0" effort="1" velocity="1"/></joint>'
    hinge = '<joint name="k" type="revolute"><parent link="arm"/><child link="hand"/>' + limit
    path = arm(tmp_path, more=f'<link name="hand">{INERTIAL}</link>{hinge}')
    assert "joints fixed by equal limits: 1" in mechanism_files.read_mechanism(path).doc
    text = path.read_text().replace("continuous", "revolute").replace('"0 1 0"/></joint>', f'"0 1 0"/>{limit}')
    with pytest.raises(ValueError, match=r"nothing in it can move: limits that are equal and 0 lock its joints \(2\)"):
        mechanism_files.read_mechanism(written(tmp_path, text))


def test_a_urdf_of_one_link_says_how_to_free_it(tmp_path):
    """Its first link is fixed to the ground, as in every reader of URDF."""
    with pytest.raises(ValueError, match=r"nothing in it can move: its first link is fixed.*floating"):
        mechanism_files.read_mechanism(written(tmp_path, f'<robot name="r"><link name="b">{INERTIAL}</link></robot>'))


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('xyz="0.5 0 0"', 'xyz="0.5 0"', "<origin>: xyz must be three numbers (got '0.5 0')"),
        ('xyz="0.5 0 0"', 'xyz="0.5 0 zero"', "<origin>: xyz must be a finite number (got 'zero')"),
        ('value="1"', 'value="nan"', "<mass>: value must be a finite number"),
        (' ixy="0"', "", "<inertia>: expected attribute 'ixy'"),
        (' ixy="0"', ' ixy="0" iyx="1"', "<inertia>: iyx must be ixy (got 1, 0)"),
        ('<mass value="1"/>', "", "<inertial>: expected mass and inertia (got no mass)"),
        ('<parent link="base"/>', "", "<joint name='j'>: expected <parent link=.../>"),
        ('<parent link="base"/>', '<parent link="bass"/>', "its parent, 'bass', is no link of the file"),
        ('type="continuous"', 'type="hinge"', "type must be one of revolute, prismatic, continuous, fixed, floating"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><axis xyz="1 0 0"/>', "<axis>: expected one in its joint (got 2)"),
        ('<link name="base">', '<link name="arm"/><link name="base">', "expected a unique name (got 'arm')"),
        (
            "</robot>",
            FIXED.format("base", "").partition("<link")[0] + "</robot>",
            "expected one link without a parent (got none)",
        ),
        ('<link name="base">', '<link name="loose"/><link name="base">', "without a parent (got loose, base)"),
    ],
)
def test_what_no_urdf_may_have_is_said_in_its_own_words(tmp_path, before, after, words):
    """With the line, and in one."""
    path = arm(tmp_path)
    text = path.read_text()
    assert before in text
    with pytest.raises(ValueError, match=r"^line ") as error:
        mechanism_files.read_mechanism(written(tmp_path, text.replace(before, after, 1)))
    assert words in str(error.value) and "\n" not in str(error.value)


def test_words_of_simulators_are_named_or_passed_over(tmp_path):
    """Gains, springs of traits, switches; nothing of them changes the motion of the rest."""
    more = '<dynamics damping="0" D="1" K="7000"/><controller_gains Kp="1"/><traits spring_k="2"/></joint>'
    path = arm(tmp_path, of_arm=f"<gravity>0</gravity>{BALL}")
    text = path.read_text().replace("</joint>", more).replace('name="j"', 'name="j" dont_collapse="true"')
    assert {*mechanism_files.read_mechanism(written(tmp_path, text)).omitted} == {
        "attributes D of dynamics",
        "attributes K of dynamics",
        "controllers",
        "traits of joints",
        "flags of gravity",
        "colliding geoms",
    }


def test_a_floating_joint_may_leave_any_link_that_rests(tmp_path):
    """One fixed to the first, too; the place is that of both joints."""
    joint = '<joint name="{0}" type="{1}"><origin xyz="0 0 1"/><parent link="{2}"/><child link="{3}"/></joint>'
    first, second = joint.format("f", "floating", "base", "b"), joint.format("g", "fixed", "base", "shelf")
    links = f'<link name="base"/><link name="b">{INERTIAL}</link>'
    path = written(tmp_path, f'<robot name="r">{links}{first}</robot>')
    assert_close(mechanism_files.read_mechanism(path).problem().initial.r, [[0.5, 0.0, 1.0]])
    text = f'<robot name="r">{links}<link name="shelf"/>{second}{first.replace("base", "shelf")}</robot>'
    assert_close(mechanism_files.read_mechanism(written(tmp_path, text)).problem().initial.r, [[0.5, 0.0, 2.0]])


def test_mocap_bodies_stand_still(tmp_path):
    """A bar on a connect to one is a pendulum, and the body itself is none."""
    hand = '<body name="hand" mocap="true"><geom name="grip" size=".1"/></body>'
    bar = f'<body name="bar"><freejoint/>{BAR}</body>'
    join = '<equality><connect body1="bar" body2="hand" anchor="0 0 0"/></equality>'
    path = written(tmp_path, WORLD.format(hand + bar, join))
    assert mechanism_files.read_mechanism(path).omitted["mocap bodies, which stand still here"] == 1
    assert_close(rates(path), [[0.0, FALL, 0.0]], atol=1e-9)


def test_a_weld_that_has_no_torque_is_a_point(tmp_path):
    """Its scale of torques is 0: the bar swings about the anchor, and is held with any other scale."""
    for scale, expected in (("0", FALL), ("0.5", 0.0)):
        weld = f'<equality><weld body1="world" body2="bar" torquescale="{scale}" anchor="0 0 0"/></equality>'
        path = written(tmp_path, WORLD.format(f'<body name="bar"><freejoint/>{BAR}</body>', weld))
        assert_close(rates(path), [[0.0, expected, 0.0]], atol=1e-9)


def test_an_equality_within_one_body_holds_or_is_refused(tmp_path):
    """Parts of one rigid body that fit add nothing."""
    tip = '<body name="tip" pos="1 0 0"><geom size=".1" mass="0"/></body>'
    parts = f'<body name="bar"><joint axis="0 1 0"/>{BAR}{tip}</body>'
    weld = '<equality><weld body1="bar" body2="tip"{}/></equality>'
    assert_close(rates(written(tmp_path, WORLD.format(parts, weld.format("")))), [[0.0, FALL, 0.0]], atol=1e-12)
    with pytest.raises(ValueError, match="it joins 'bar' to itself"):
        mechanism_files.read_mechanism(written(tmp_path, WORLD.format(parts, weld.format(' relpose="2 0 0 1 0 0 0"'))))


@pytest.mark.parametrize("given", [(3.0, 0.0, 0.0), (0.0, 0.0, 2.0), (-1.5, 0.0, -1.5)])
def test_velocities_given_of_a_loop_hold_and_the_others_follow(tmp_path, given):
    """A parallelogram of sides 1 m: crank and rocker turn alike, the rod not at all."""
    problem = make_problem(str(written(tmp_path, WORLD.format(PARALLELOGRAM, JOIN), "loop.xml")), qvel=given)
    rate = max(given, key=abs)
    assert_close(problem.initial.Omega, [[0, rate, 0], [0, 0, 0], [0, rate, 0]], atol=1e-9)
    assert_close(problem.initial.v, [[0.5 * rate, 0, 0], [rate, 0, 0], [0.5 * rate, 0, 0]], atol=1e-9)


def test_velocities_that_a_loop_forbids_and_open_loops_are_refused(tmp_path):
    """Crank and rocker against each other; a crank turned alone, open by 1 - cos + sin of it.

    What printed digits leave open is closed.
    """
    path = str(written(tmp_path, WORLD.format(PARALLELOGRAM, JOIN), "loop.xml"))
    with pytest.raises(ValueError, match="qvel: the loops allow no such rates; give fewer, and 0 for the others"):
        make_problem(path, qvel=(1.0, 0.0, -1.0))
    with pytest.raises(ValueError, match=r"joint 'P' is open at the start by 0.602 .*give qpos that closes its loops"):
        make_problem(path, qpos=(0.5, 0.0, 0.0))
    sites = PARALLELOGRAM.replace(f"{BAR}", f'{BAR}<site name="a" pos="1.1 0 0"/>')
    sites = sites[: -len("</body>")] + '<site name="b" pos="0 0 1"/></body>'
    text = WORLD.format(sites, '<equality><connect name="P" site1="a" site2="b"/></equality>')
    moved = make_problem(str(written(tmp_path, text, "open.xml")))
    assert "joint 'P' is open at the start by 0.1 m and moved onto its loops" in moved.source
    assert_close(make_problem(path, qpos=(0.50001, -0.5, 0.5)).initial.Omega, 0.0)


def test_a_file_that_has_changed_is_read_again(tmp_path):
    """Also where a file that it includes has; another file of this name is told which one has it."""
    text = WORLD.format(f"<body><joint/>{BAR}</body>", "")
    part = written(tmp_path, text.replace("mujoco>", "mujocoinclude>"), "part.xml")
    path = str(written(tmp_path, '<mujoco><include file="part.xml"/></mujoco>', "changing.xml"))
    assert make_problem(path).system.mass.tolist() == [1.0]
    part.write_text(part.read_text().replace('mass="1"', 'mass="2"'))
    assert make_problem(path).system.mass.tolist() == [2.0]
    (tmp_path / "other").mkdir()
    other = str(written(tmp_path, text, "other/changing.xml"))
    with pytest.raises(ValueError, match=r"the name 'changing' is taken by .*changing.xml; rename this file"):
        make_problem(other)


@pytest.mark.parametrize("name", ["balanceinertia", "boundmass", "boundinertia", "settotalmass"])
def test_what_changes_masses_of_a_urdf_unseen_is_refused(tmp_path, name):
    """MuJoCo's compiler would scale or raise what the links state."""
    value = "true" if name == "balanceinertia" else "0.7"
    more = f'<mujoco><compiler {name}="{value}"/></mujoco>'
    with pytest.raises(ValueError, match=f"attribute '{name}' changes masses or inertias that the links state"):
        mechanism_files.read_mechanism(arm(tmp_path, more=more)).system()


def test_a_body_too_small_for_the_compiler_is_refused_and_made_no_rod(tmp_path):
    """Moments of 1e-15, 5e-15 and 5.5e-15 kg m2 in a full inertia: the least would be taken for zero."""
    J = np.diag([1e-15, 5e-15, 5.5e-15])
    turn = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).as_matrix()
    J = turn @ J @ turn.T
    full = " ".join(repr(float(J[i, j])) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    body = f'<body name="b"><freejoint/><inertial pos="0 0 0" mass="1e-9" fullinertia="{full}"/></body>'
    with pytest.raises(ValueError, match="inertia"):
        mechanism_files.read_mechanism(written(tmp_path, WORLD.format(body, ""), "tiny.xml")).system()


@pytest.mark.parametrize(
    ("sleep", "expected"), [("enable", {"bodies asleep at the start, which move here": 2}), ("disable", {})]
)
def test_bodies_asleep_at_the_start_are_named(tmp_path, sleep, expected):
    """MuJoCo keeps a tree with sleep="init" at rest, even in the air, until something touches it; here it falls.

    So https://mujoco.readthedocs.io/en/stable/XMLreference.html#body-sleep and computation, "Sleeping islands".
    """
    body = f'<body name="a" sleep="init"><freejoint/>{BAR}<body name="b" pos="1 0 0"><joint/>{BAR}</body></body>'
    text = WORLD.format(body + PEER, f'<option><flag sleep="{sleep}"/></option>')
    mechanism = mechanism_files.read_mechanism(written(tmp_path, text))
    assert mechanism.omitted == expected
    assert all(map(omissions.ACTS.search, mechanism.omitted))
    problem = mechanism.problem()
    assert_close(accelerations(problem.system, problem.initial).v_dot[-1], (0.0, 0.0, -9.81), atol=1e-12)


@pytest.mark.parametrize(
    ("flag", "expected"), [("", {"colliding geoms": 2}), ('<option><flag contact="disable"/></option>', {})]
)
def test_geoms_that_a_pair_lets_touch_are_named(tmp_path, flag, expected):
    """A pair collides whatever the bits of its geoms: https://mujoco.readthedocs.io/en/stable/XMLreference.html#contact-pair."""
    geoms = (f'<geom name="{name}" size=".1" contype="0" conaffinity="0" mass="0"/>' for name in ("x", "y"))
    bodies = "".join(f"<body><freejoint/>{BAR}{geom}</body>" for geom in geoms)
    text = WORLD.format(bodies, f'<contact><pair geom1="x" geom2="y"/></contact>{flag}')
    assert mechanism_files.read_mechanism(written(tmp_path, text)).omitted == expected
