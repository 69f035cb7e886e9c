"""SDFormat becomes the system that Drake makes of it, loops included; what is not supported is named with its line."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbsbench import State, accelerations, make_problem
from mbsbench.harness.catalogue.registry import load_plugin
from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.formats.mechanisms.links import LinkMechanism
from mbsbench.tests.comparing import assert_close, assert_same

INERTIAL = """<inertial>{pose}<mass>{m}</mass><inertia><ixx>.02</ixx><ixy>.001</ixy><ixz>-.002</ixz><iyy>.03</iyy>
<iyz>.003</iyz><izz>.025</izz></inertia></inertial>"""
# a tree with every kind of joint that Drake has, its places given in as many ways as there are
FRAMES = f"""<sdf version="1.9"><world name="w"><gravity>1 2 -9</gravity><model name="tree">
<pose>.1 .2 .3 .1 .2 .3</pose>
<frame name="shelf" attached_to="arm"><pose degrees="true">0 .1 .2 30 40 50</pose></frame>
<frame name="tip" attached_to="shelf"><pose rotation_format="quat_xyzw">.3 0 0  0 0 .6 .8</pose></frame>
<link name="arm"><pose>0 0 1 .3 .2 .1</pose>{INERTIAL.format(m=2, pose="<pose>.01 .02 .03 .1 .2 .3</pose>")}</link>
<link name="slide"><pose relative_to="tip">.1 0 0 0 .4 0</pose>{INERTIAL.format(m=1, pose="")}</link>
<link name="knee"><pose relative_to="slide">0 .5 0 0 0 0</pose>{INERTIAL.format(m=1, pose="<pose>0 0 .2 0 0 0</pose>")}
</link><link name="ball"><pose relative_to="hip">.1 .1 .1 0 0 0</pose>{INERTIAL.format(m=0.5, pose="")}</link>
<link name="glued"><pose relative_to="ball"/>{INERTIAL.format(m=0.5, pose="<pose>.1 0 0 0 0 0</pose>")}</link>
<frame name="hip"><pose>1 1 1 0 0 1</pose></frame>
<joint name="A" type="revolute"><parent>world</parent><child>arm</child><pose>.1 0 -.2 0 .3 0</pose>
  <axis><xyz expressed_in="__model__">0 1 .5</xyz><limit><lower>-2</lower><upper>2</upper></limit>
  <dynamics><damping>.2</damping></dynamics></axis></joint>
<joint name="B" type="prismatic"><parent>tip</parent><child>slide</child><pose relative_to="arm">.1 .1 .1 0 0 0</pose>
  <axis><xyz expressed_in="tip">1 0 1</xyz><dynamics><damping>.3</damping></dynamics></axis></joint>
<joint name="C" type="universal"><parent>slide</parent><child>knee</child><pose>0 -.2 0 .1 0 0</pose>
  <axis><xyz>1 0 0</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint>
<joint name="D" type="ball"><parent>knee</parent><child>ball</child><pose>-.1 0 0 0 0 0</pose></joint>
<joint name="E" type="fixed"><parent>ball</parent><child>glued</child></joint></model></world></sdf>"""
LINK = '<link name="{0}"><pose>{1} 0 0 0</pose><inertial><mass>20</mass><inertia><ixx>1</ixx><iyy>27</iyy><izz>27</izz>'
LINK += "</inertia></inertial></link>"
HINGE = (
    '<joint name="{0}" type="revolute"><parent>{1}</parent><child>{2}</child><pose relative_to="{2}">{3} 0 0 0</pose>'
)
HINGE += "<axis><xyz>0 1 0</xyz></axis></joint>"
# the four-bar linkage of Drake's examples/multibody/four_bar (links of 4 m on a base of 2 m, 20 kg each)
LOOP = "".join(
    (
        '<sdf version="1.9"><model name="four_bar">',
        LINK.format("crank", "0 0 2"),
        LINK.format("coupler", "1 0 4"),
        LINK.format("rocker", "2 0 2"),
        HINGE.format("A", "world", "crank", "0 0 -2"),
        HINGE.format("B", "crank", "coupler", "-1 0 0"),
        HINGE.format("C", "world", "rocker", "0 0 -2"),
        HINGE.format("D", "coupler", "rocker", "0 0 2").replace("revolute", "ball"),
        "</model></sdf>",
    )
)


def written(folder: Path, text: str, name: str = "model.sdf") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def drake_plant(path: Path, gravity):
    """Drake's plant of a file, its weld of loops left to the caller."""
    pytest.importorskip("pydrake", reason="drake is compared with where it is installed")
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(path))
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


def drake_motion(plant, context, m: LinkMechanism) -> tuple[State, np.ndarray]:
    """Drake's state and accelerations of our bodies' centres of mass."""
    rows, rates = [], []
    for link in m.links:
        body = plant.GetBodyByName(link.name)
        X, V = plant.EvalBodyPoseInWorld(context, body), plant.EvalBodySpatialVelocityInWorld(context, body)
        a = plant.EvalBodySpatialAccelerationInWorld(context, body)
        home = plant.EvalBodyPoseInWorld(plant.CreateDefaultContext(), body).rotation().matrix()
        R = X.rotation().matrix() @ home.T @ link.C.R  # ours has the axes of the inertia in the file
        p = X.rotation().matrix() @ body.CalcCenterOfMassInBodyFrame(context)
        w, alpha = V.rotational(), a.rotational()
        rows.append((X.translation() + p, R, V.translational() + np.cross(w, p), R.T @ w))
        spin = a.translational() + np.cross(alpha, p) + np.cross(w, np.cross(w, p))
        rates.append(np.concatenate((spin, R.T @ alpha)))
    return State(*(np.array(x) for x in zip(*rows, strict=True))), np.array(rates)


def public(name: str) -> Path:
    """A model of Drake's own, in its package."""
    spec = importlib.util.find_spec("pydrake")
    if spec is None:
        pytest.skip("drake is compared with where it is installed")
    return next(Path(str(spec.origin)).parent.rglob(name))


@pytest.mark.parametrize("name", ["Acrobot.sdf", "transcendesk55inch.sdf", "planar_gripper.sdf", "frames"])
def test_accelerations_are_those_of_drake(tmp_path, name):
    """Its recursions in joint coordinates and our rows in absolute ones, at a random state: to 1e-10."""
    m = mechanism_files.read_mechanism(written(tmp_path, FRAMES) if name == "frames" else public(name))
    assert isinstance(m, LinkMechanism)
    plant, context = drake_plant(m.path, m.gravity)
    random = np.random.default_rng(2)
    q = np.array(plant.GetPositions(context)) + 0.5 * random.standard_normal(plant.num_positions())
    for body in map(plant.get_body, plant.GetFloatingBaseBodies()):
        start = body.floating_positions_start()
        q[start : start + 4] /= np.linalg.norm(q[start : start + 4])
    plant.SetPositions(context, q)
    plant.SetVelocities(context, random.standard_normal(plant.num_velocities()))
    state, expected = drake_motion(plant, context, m)
    ours = accelerations(m.system(), state)
    both = np.hstack((ours.v_dot, ours.Omega_dot))
    assert np.max(np.abs(both - expected)) < 1e-10 * np.max(np.abs(expected))


def test_a_loop_moves_as_drakes_tree_with_the_loop_s_rows(tmp_path):
    """Drake reads no loops: its matrices of the tree, and rows of its own Jacobians where the loop is cut."""
    m = mechanism_files.read_mechanism(written(tmp_path, LOOP))
    problem = make_problem(str(m.path), {"rates": "1.5,0,0", "t_end": 0.1})
    cut = LOOP[: LOOP.index('<joint name="D"')] + "</model></sdf>"
    plant, context = drake_plant(written(tmp_path, cut, "cut.sdf"), m.gravity)
    from pydrake.multibody.tree import JacobianWrtVariable

    frames = [plant.GetFrameByName(n) for n in ("coupler", "rocker")]
    points, world = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 2.0])), plant.world_frame()
    plant.SetVelocities(context, np.array([1.5, -1.5, 1.5]))  # a parallelogram: the coupler does not turn
    rows = [
        plant.CalcJacobianTranslationalVelocity(context, JacobianWrtVariable.kV, f, p, world, world)
        for f, p in zip(frames, points, strict=True)
    ]
    bias = [
        plant.CalcBiasTranslationalAcceleration(context, JacobianWrtVariable.kV, f, p, world, world).ravel()
        for f, p in zip(frames, points, strict=True)
    ]
    G, M = rows[0] - rows[1], plant.CalcMassMatrix(context)
    f = plant.CalcGravityGeneralizedForces(context) - plant.CalcBiasTerm(context)
    a = np.linalg.lstsq(
        np.block([[M, G.T], [G, np.zeros((3, 3))]]), np.concatenate((f, bias[1] - bias[0])), rcond=1e-12
    )[0]
    ours = accelerations(problem.system, problem.initial)
    assert_close(problem.initial.Omega[:, 1], [1.5, 0.0, 1.5], atol=1e-12)
    assert_close(ours.Omega_dot[:, 1], np.cumsum(a[:3]) * [1, 1, 0] + [0, 0, a[2]], rtol=0, atol=1e-10)


def test_frames_and_axes_mean_the_same_however_they_are_written(tmp_path):
    """A pose relative to a frame and that of the model; an axis in another frame; degrees, quaternions."""
    plain = f"""<sdf version="1.9"><model name="m"><link name="a"><pose>1 0 0 0 0 1.5707963267948966</pose>
    {INERTIAL.format(m=1, pose="<pose>0 0 .5 0 0 0</pose>")}</link>
    <joint name="j" type="revolute"><parent>world</parent><child>a</child><axis><xyz>1 0 0</xyz></axis></joint>
    </model></sdf>"""
    other = plain.replace("<pose>1 0 0 0 0 1.5707963267948966</pose>", '<pose relative_to="f">0 -1 0 0 0 0</pose>')
    other = other.replace("<xyz>1 0 0", '<xyz expressed_in="__model__">0 1 0')
    other = other.replace(
        '<link name="a">', '<frame name="f"><pose degrees="true">0 0 0 0 0 90</pose></frame><link name="a">'
    )
    starts = [
        mechanism_files.read_mechanism(written(tmp_path, text, f"{k}.sdf")).problem()
        for k, text in enumerate((plain, other))
    ]
    assert_close(starts[0].initial.r, starts[1].initial.r, atol=1e-15)
    rates = [accelerations(p.system, p.initial).Omega_dot for p in starts]
    assert_close(*rates, atol=1e-13)


def test_rates_that_a_loop_does_not_allow_are_refused(tmp_path):
    m = mechanism_files.read_mechanism(written(tmp_path, LOOP))
    with pytest.raises(ValueError, match="the loops allow no such rates"):
        m.problem(rates=(1.0, 1.0, 1.0))


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('type="prismatic"', 'type="screw"', "<joint name='B'>: type must be one of revolute"),
        ("<axis2><xyz>0 1 0", "<axis2><xyz>1 1 0", "<joint name='C'>: the axes of a universal joint must be normal"),
        ("<parent>tip</parent>", "<parent>top</parent>", "<joint name='B'>: no link, joint or frame 'top'"),
        ('<link name="glued">', '<include/><link name="glued">', "<include>: not supported within model"),
        ("<mass>2</mass>", "<mass>heavy</mass>", "<mass>: mass must be 1 finite number (got 'heavy')"),
        ("<xyz>1 0 0</xyz></axis>", "<xyz>1 0 inf</xyz></axis>", "<xyz>: xyz must be 3 finite numbers (got '1 0 inf')"),
        (
            '<link name="glued">',
            '<link name="ball"/><link name="glued">',
            "<link name='ball'>: links, joints and frames",
        ),
        ("<xyz>1 0 0</xyz></axis>", '<xyz>1 0 0</xyz><mimic joint="A"/></axis>', "<mimic>: not supported within axis"),
        (
            "<xyz>1 0 0</xyz></axis>",
            '<xyz>1 0 0</xyz></axis><x:mimic joint="A"/>',
            "changes which motions are possible",
        ),
        ('<link name="glued">', '<x:ball_constraint/><link name="glued">', "<x:ball_constraint>: an extension that"),
        (
            '<link name="glued">',
            '<link name="glued"><x:deformable_properties/>',
            "<x:deformable_properties>: an extension",
        ),
        ('<frame name="hip">', '<frame name="hip" attached_to="ball">', "its pose is relative to itself"),
        ('<sdf version="1.9">', '<sdf version="9.9">', "<sdf>: version must be 1.3 to 1.12 (got '9.9')"),
        ("<gravity>1 2 -9</gravity>", "<physics><gravity>1 2 -9</gravity></physics>", "in version 1.9 gravity"),
        ("<ixx>.02</ixx>", "<ixx>.02</ixx><ixi>1</ixi>", "<ixi>: not supported within inertia"),
        ("<lower>-2</lower>", "<lower>-2</lower><soft>1</soft>", "<soft>: not supported within limit"),
        ("<lower>-2</lower>", "<lower>3</lower>", "<limit>: lower must be at most upper (got 3, 2)"),
        (
            "<lower>-2</lower>",
            "<lower>2</lower>",
            "<limit>: limits that lock the joint are supported for one axis, at 0 only",
        ),
        (
            '<link name="glued">',
            '<link name="glued" frozen="1">',
            "attribute 'frozen' is not supported; expected name",
        ),
        ("<pose>.1 0 -.2 0 .3 0", '<pose frame="tip">.1 0 -.2 0 .3 0', "version 1.7 has relative_to"),
        ("<gravity>1", "<wrap/><gravity>1", "<wrap>: not supported within world"),
    ],
)
def test_a_refused_element_is_named_with_its_line(tmp_path, before, after, words):
    """In one line, which also has the file."""
    assert before in FRAMES
    text = FRAMES.replace(before, after, 1)
    with pytest.raises(ValueError, match=r"plugin .*refused.sdf: line") as error:
        load_plugin(written(tmp_path, text, "refused.sdf"))
    said = str(error.value)
    assert words in said and "\n" not in said
    line, tag = said.split("line ")[1].split(">")[0].split(": ")
    assert tag.split()[0] in text.splitlines()[int(line) - 1]


def test_a_point_mass_that_a_joint_turns_is_refused():
    """Drake's own cart and pole: 1e-20 kg m2 stand for none, by which absolute coordinates cannot divide."""
    with pytest.raises(ValueError, match="body 'Pole' has no inertia about"):
        mechanism_files.read_mechanism(public("cart_pole.sdf")).problem()


def test_a_model_at_rest_in_free_fall_has_gravity_of_the_format(tmp_path):
    """A model without a world: the format's default is 9.8 m/s2, not 9.81."""
    text = f'<sdf version="1.9"><model name="m"><link name="a">{INERTIAL.format(m=1, pose="")}</link></model></sdf>'
    problem = mechanism_files.read_mechanism(written(tmp_path, text)).problem()
    assert_close(accelerations(problem.system, replace(problem.initial)).v_dot, [[0.0, 0.0, -9.8]])


BAR = """<sdf version="VERSION"><model name="m"><link name="bar"><pose>0 0 0 0 0 1.5707963267948966</pose>
<inertial><pose>.4 0 0 0 0 0</pose><mass>1</mass>
<inertia><ixx>.02</ixx><iyy>.25</iyy><izz>.25</izz></inertia></inertial></link>
<joint name="pin" type="revolute"><parent>world</parent><child>bar</child><axis><xyz>1 0 0</xyz></axis></joint>
</model></sdf>"""


@pytest.mark.parametrize("version", ["1.3", "1.4", "1.5", "1.7"])
def test_the_version_says_whose_directions_axes_are(tmp_path, version):
    """Up to 1.4 those of the model: the bar, along its y, falls at g m l / (I + m l^2); later its own, along which not.

    The step from 1.4 to 1.5 in SDFormat's own converter is ``use_parent_model_frame``.
    """
    problem = mechanism_files.read_mechanism(written(tmp_path, BAR.replace("VERSION", version))).problem()
    rate = np.linalg.norm(accelerations(problem.system, problem.initial).Omega_dot)
    assert_close(rate, 9.8 * 0.4 / (0.25 + 0.16) if version < "1.5" else 0.0, atol=1e-12)


def test_gravity_within_physics_is_that_of_old_versions(tmp_path):
    """Up to 1.5; two that differ are refused."""
    world = (
        '<sdf version="1.5"><world name="w"><physics type="ode"><gravity>0 0 -1.62</gravity></physics>{}</world></sdf>'
    )
    model = BAR[BAR.index("<model") : BAR.index("</sdf>")]
    m = mechanism_files.read_mechanism(written(tmp_path, world.format(model)))
    assert_same(m.problem().system.gravity, [0.0, 0.0, -1.62])
    with pytest.raises(ValueError, match="the world has another gravity"):
        mechanism_files.read_mechanism(written(tmp_path, world.format("<gravity>0 0 -9.8</gravity>" + model)))


def test_limits_that_lock_a_joint_fix_it(tmp_path):
    """Two bars of 1 kg and 1 m in line, welded by limits of 0: one bar of 2 m about its end, 3 g / (2 l)."""
    bar = (
        '<link name="{0}"><pose>{1} 0 0 0 0 0</pose><inertial><pose>.5 0 0 0 0 0</pose><mass>1</mass><inertia><ixx>.001'
    )
    bar += "</ixx><iyy>{2}</iyy><izz>{2}</izz></inertia></inertial></link>"
    pin = '<joint name="to_{1}" type="revolute"><parent>{0}</parent><child>{1}</child><axis><xyz>0 1 0</xyz>{2}</axis>'
    pin += "</joint>"
    locked = "<limit><lower>0</lower><upper>0</upper></limit>"
    parts = [bar.format(n, x, 1 / 12) for n, x in (("upper", 0), ("lower", 1))]
    parts += [pin.format("world", "upper", ""), pin.format("upper", "lower", locked)]
    text = f'<sdf version="1.7"><model name="m">{"".join(parts)}</model></sdf>'
    problem = mechanism_files.read_mechanism(written(tmp_path, text)).problem()
    rates = accelerations(problem.system, problem.initial).Omega_dot[:, 1]
    assert_close(rates, 9.8 * 1.5 / 2.0, atol=1e-12)
    assert "joints fixed by equal limits: 1" in problem.source


def test_what_changes_no_motion_is_passed_over_or_named(tmp_path):
    """Blanks before the declaration; extensions with a prefix, wind, solver settings."""
    text = BAR.replace("VERSION", "1.7").replace("<model", '<model xmlns:x="u" x:kind="a"', 1)
    text = text.replace("<link", "<enable_wind>true</enable_wind><x:note/><link", 1)
    text = text.replace("<parent>", "<physics><ode><erp>.1</erp></ode></physics><parent>")
    m = mechanism_files.read_mechanism(written(tmp_path, '\n\n<?xml version="1.0"?>' + text))
    assert {*m.omitted} == {"wind", "elements x:note", "attributes x:kind", "solver settings of joints"}
