"""MJCF and URDF become the system that MuJoCo makes of them: accelerations, mass matrix and energies agree."""

import importlib.util
import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from mbsbench import JointKind, States, StepControl, load, make_problem
from mbsbench.cli.__main__ import main
from mbsbench.harness.catalogue import plugins, registry
from mbsbench.harness.catalogue.codes import digest_code
from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.formats.mechanisms.mechanism import CompiledMechanism, OmittedContents
from mbsbench.harness.mechanics.cut_trees.tree import build_spanning_tree
from mbsbench.harness.mechanics.dynamics import accelerations
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.results.environment import ROOT
from mbsbench.solvers.engines import mujoco as engine
from mbsbench.solvers.engines.export.model_check import SAME, EngineModel, measure_differences
from mbsbench.tests.comparing import assert_close

from .systems import PROBLEMS

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="mujoco is an optional extra: make test-engines"
)

BOX = '<geom type="box" size=".03 .02 .2" pos="0.02 .2 0"/>'
TREE = f"""<mujoco><option gravity="1 0 -9.81"/><worldbody>
<body name="a" pos="0 0 1" euler="20 10 5">
  <joint type="slide" axis="1 0 0"/><joint axis="1 0 0" pos="0 0 .1"/>{BOX}
  <body name="b" pos="0 0 -.6"><joint type="ball"/>{BOX}<body name="welded" pos=".1 0 0" euler="30 0 0">{BOX}</body>
    <body name="c" pos=".3 .1 -.2"><joint axis="0 1 0" pos=".01 0 0"/><joint axis="1 0 0" pos=".01 0 0"/>{BOX}
      <body name="d" pos="0 .5 0"><joint axis="0 1 1" pos="0 .1 0"/>{BOX}</body></body></body></body>
<body name="walker" pos="1 1 1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
  <joint axis="0 1 0" pos="0 0 .1"/>{BOX}<body name="foot"><joint axis="0 1 0" pos="0 0 -.3"/>{BOX}</body></body>
<body name="ship" pos="0 3 0"><freejoint/>{BOX}
  <body pos=".1 .2 .3" euler="0 10 0"><joint type="slide" axis="1 1 0"/>{BOX}</body></body>
<body name="bead" pos="2 0 0"><joint type="slide" axis="1 2 0"/><joint type="ball" pos="0 .1 0"/>{BOX}</body>
<body name="puck" pos="3 0 0"><joint type="slide" axis="1 2 0"/><joint type="slide" axis="0 1 1"/>
  <joint type="ball" pos="0 .1 0"/>{BOX}</body>
<body name="gimbals" pos="4 0 0"><joint axis="1 0 0"/><joint axis="0 1 0"/><joint axis="0 0 1"/>{BOX}</body>
</worldbody></mujoco>"""
LOOPS = f"""<mujoco><worldbody><site name="wall" pos="1 0 1"/>
<body name="crank" pos="0 0 1"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/>
  <body name="rod" pos=".3 0 0"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .5 0 .1" size=".02"/>
    <site name="end" pos=".5 0 .1"/></body></body>
<body name="rocker" pos=".8 0 .6"><joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 .5" size=".02"/></body>
<body name="blob" pos=".9 .3 1.1"><freejoint/>{BOX}</body>
<body name="held" pos="0 2 0"><freejoint/>{BOX}</body></worldbody>
<equality><connect body1="rod" body2="rocker" anchor=".5 0 .1"/>
  <connect body1="rod" body2="rocker" anchor=".5 .1 .1"/>
  <weld body1="rocker" body2="blob"/><connect body1="held" anchor=".1 .3 .2"/>
  <connect body1="rod" body2="held" anchor="1 2 3" active="false"/></equality>
<tendon><spatial stiffness="30" damping=".5" springlength=".2"><site site="end"/><site site="wall"/></spatial></tendon>
</mujoco>"""
SLENDER = """<mujoco><option gravity="1 0 -9.81"/><worldbody>
<body name="rod"><joint axis="0 1 .3"/><inertial pos=".3 0 0" mass="1" diaginertia="0 .03 .03"/>{bob}
</body></worldbody></mujoco>"""
BOB = (
    '<body name="bob" pos=".6 0 0"><joint axis="1 1 0"/><inertial pos="0 .2 .1" mass=".5" diaginertia="0 0 0"/></body>'
)
SPRUNG = f"""<mujoco><option gravity="1 0 -9.81"/><worldbody>
<body name="a" pos="0 0 1" euler="20 10 5"><joint name="hinge" axis="1 .2 0" pos="0 0 .1" stiffness="7" springref="20"
    damping=".3" armature=".02" ref="5"/>{BOX}
  <body name="b" pos="0 0 -.6"><joint type="slide" axis="1 0 1" stiffness="30" springref=".2" damping=".4"/>{BOX}
    <body name="c" pos=".3 .1 -.2"><joint axis="0 1 .5" stiffness="3" damping=".1"/>{BOX}</body></body></body>
<body name="roller" pos="1 0 0"><joint type="slide" axis="1 1 0" stiffness="20" damping=".5"/>
  <joint axis="1 1 0" pos="0 .1 0" stiffness="2" springref="-30" damping=".2"/>{BOX}</body>
<body name="bead" pos="2 0 0"><joint type="slide" axis="1 2 0" stiffness="9" springref=".3" damping=".2"/>
  <joint type="ball" pos="0 .1 0"/>{BOX}</body>
<body name="walker" pos="1 1 1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
  <joint axis="0 1 0" pos="0 0 .1" stiffness="4" damping=".3" armature=".05"/>{BOX}</body>
</worldbody></mujoco>"""
ROBOT = """<robot name="r"><link name="base"/>
<link name="upper"><inertial><origin xyz="0 .02 .1" rpy=".1 .2 .3"/><mass value="2"/>
    <inertia ixx=".03" iyy=".04" izz=".05" ixy=".001" ixz="0" iyz="-.002"/></inertial>
  <collision><geometry><mesh filename="package://nowhere/upper.stl"/></geometry></collision></link>
<link name="tip"><inertial><origin xyz="0 0 .01"/><mass value=".1"/>
    <inertia ixx=".001" iyy=".001" izz=".001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><mass value="1"/>
    <inertia ixx=".01" iyy=".02" izz=".015" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
  <origin xyz="0 0 .5" rpy=".2 0 0"/></joint>
<joint name="elbow" type="prismatic"><parent link="upper"/><child link="lower"/><axis xyz="1 1 0"/>
  <origin xyz="0 0 .4"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="glue" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0 0 .2" rpy="0 .3 0"/></joint>
</robot>"""


def written(folder: Path, text: str, name: str = "") -> Path:
    path = folder / (name or ("robot.urdf" if "<robot" in text else "model.xml"))
    path.write_text(text)
    return path


def theirs(m: CompiledMechanism, qpos, qvel) -> EngineModel:
    """MuJoCo's own matrices at a state, with its Jacobians of our bodies' centres of mass."""
    mj, model, data = m.mj, m.model, m.mj.MjData(m.model)
    model.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONTACT
    model.opt.jacobian = mj.mjtJacobian.mjJAC_DENSE
    data.qpos[:], data.qvel[:] = qpos, qvel
    mj.mj_forward(model, data)
    mj.mj_energyPos(model, data)
    mj.mj_energyVel(model, data)
    M = np.zeros((model.nv, model.nv))
    mj.mj_fullM(model, data, M)
    T, bias = [], []
    for root in m.roots:
        parts = np.flatnonzero(model.body_weldid == root)
        r = np.average(data.xipos[parts], axis=0, weights=model.body_mass[parts])
        R = data.xmat[root].reshape(3, 3)
        J, J_dot = np.zeros((2, 2, 3, model.nv))
        mj.mj_jac(model, data, *J, r, root)
        mj.mj_jacDot(model, data, *J_dot, r, root)
        T += [J[0], R.T @ J[1]]
        bias.append(np.concatenate((J_dot[0] @ qvel, R.T @ (J_dot[1] @ qvel))))  # R'^T omega = -Omega x Omega = 0
    still = mj.MjData(model)
    still.qpos[:] = qpos
    mj.mj_forward(model, still)
    potential, kinetic = map(float, data.energy)
    G = data.efc_J.reshape(-1, model.nv)[: data.nefc]
    return EngineModel(np.concatenate(T), M, still.qfrc_smooth, kinetic, potential, np.array(bias), data.qfrc_smooth, G)


def moving(m: CompiledMechanism):
    """Coordinates off the reference (of a tree), and velocities that keep loops closed."""
    mj, model, random = m.mj, m.model, np.random.default_rng(1)
    qpos, qvel = np.array(model.qpos0), random.standard_normal(model.nv)
    if model.neq:
        rows = theirs(m, qpos, 0.0 * qvel).constraints
        qvel -= np.linalg.pinv(rows, rcond=1e-9) @ rows @ qvel
    else:
        mj.mj_integratePos(model, qpos, random.standard_normal(model.nv), 0.4)
    return qpos, qvel


MODELS = {"tree": TREE, "loops": LOOPS, "urdf": ROBOT, "slender": SLENDER.format(bob=""), "sprung": SPRUNG}


def test_a_point_mass_that_a_joint_turns_is_refused(tmp_path):
    """It would be singular in absolute coordinates; the line names the body and the axis."""
    m = mechanism_files.read_mechanism(written(tmp_path, SLENDER.format(bob=BOB)))
    with pytest.raises(ValueError, match=r"body 'bob' has no inertia about \("):
        m.problem(qpos=(0.1, 0.2), qvel=(0.3, 0.4))


@pytest.mark.parametrize("name", MODELS)
def test_the_system_is_the_one_mujoco_makes(tmp_path, name):
    """Two derivations: MuJoCo's recursions in joint coordinates, ours in absolute ones with constraint rows.

    Springs, dampers and armatures of joints are its own, as forces, masses and energies, at rest and moving.
    """
    m = mechanism_files.read_mechanism(written(tmp_path, MODELS[name]))
    qpos, qvel = moving(m)
    made = m.problem(qpos=tuple(qpos), qvel=tuple(qvel))
    model = theirs(m, qpos, qvel)
    found = measure_differences(made, model)
    assert max(found.values()) < SAME, found
    if name == "sprung":
        assert not {OmittedContents.STIFFNESS, OmittedContents.DAMPING, OmittedContents.ARMATURE} & {*m.omitted}
        assert len(made.system.torsion_k) == 4 and len(made.system.spring_k) == 3
        ours, data = accelerations(made.system, made.initial), m.mj.MjData(m.model)
        data.qpos[:], data.qvel[:] = qpos, qvel
        m.mj.mj_forward(m.model, data)
        expected = (model.T @ data.qacc).reshape(-1, 6) + model.bias
        both = np.concatenate((ours.v_dot, ours.Omega_dot), axis=1)
        assert np.max(np.abs(both - expected)) < 1e-9 * np.max(np.abs(expected))


WELDED, LOADED = {"sliding", "jointed", "jointed_otherwise"}, {"loaded", "loaded_in_time"}
UNKNOWN = {"guided", "tilting", "rolling"}  # MuJoCo has no such joints


@pytest.mark.parametrize("name", sorted({*PROBLEMS} - WELDED - LOADED - UNKNOWN))
def test_our_own_problems_come_back(name):
    """Handed to MuJoCo and read from its compiled model (XML has six digits): loops, springs, revolute joints.

    But for welded bodies, which come back as one, and for loads, which are actuators, that the reader leaves out.
    """
    made, mj = PROBLEMS[name](), engine.import_package("mujoco")
    tree = build_spanning_tree(made.system, made.initial)
    m = CompiledMechanism(
        "again", Path(), "", mj, engine._make_spec(mj, engine.MuJoCo(), made, tree, 1e-3).compile(), {}
    )
    again = m.problem(qpos=tuple(tree.start), qvel=tuple(tree.start_velocity))
    order = [int(name.split()[1]) for name in again.system.body_names]
    assert_close(again.initial.v, made.initial.v[order], atol=1e-12)
    assert_close(again.system.mass, made.system.mass[order])
    assert len(again.system.spring_k) == len(made.system.spring_k)
    assert max(measure_differences(again, theirs(m, tree.start, tree.start_velocity)).values()) < SAME


def test_loops_have_no_row_twice(tmp_path):
    """Two connects of the same bodies are one revolute joint: five rows, not six of rank five."""
    system = mechanism_files.read_mechanism(written(tmp_path, LOOPS)).system()
    kinds = [system.joint_kind(k) for k in range(system.nj)]
    assert kinds.count(JointKind.REVOLUTE) == 4 and kinds.count(JointKind.FIXED) == 1
    assert kinds.count(JointKind.SPHERICAL) == 1 and len(system.spring_k) == 1


def test_what_is_not_taken_over_is_counted(tmp_path):
    """Motors and contacts; a rotor between moving bodies, a damper of a ball, springs that are not linear."""
    text = LOOPS.replace('<joint axis="0 1 0"/>', '<joint name="j" damping="1" stiffness="2" axis="0 1 0"/>', 1)
    text = text.replace("</mujoco>", '<actuator><motor joint="j"/></actuator></mujoco>')
    assert mechanism_files.read_mechanism(written(tmp_path, text)).omitted == {
        OmittedContents.ACTUATORS: 1,
        OmittedContents.COLLIDING: 5,
    }
    text = SPRUNG.replace('axis="0 1 .5" stiffness="3"', 'axis="0 1 .5" armature=".1" stiffness="3 1 0"')
    omitted = mechanism_files.read_mechanism(
        written(tmp_path, text.replace('<joint type="ball"', '<joint type="ball" damping="1"'))
    ).omitted
    assert (
        omitted[OmittedContents.ARMATURE] == 1
        and omitted[OmittedContents.DAMPING] == 3
        and omitted[OmittedContents.STIFFNESS] == 1
    )


@pytest.mark.parametrize(
    ("part", "words"),
    [
        ('<equality><joint joint1="j"/></equality>', "equality 0: couplings of type joint are not supported"),
        ('<worldbody><body name="odd"><joint/><joint type="ball"/><geom size=".1"/></body></worldbody>', "hinge, ball"),
        ("<worldbody><boddy/></worldbody>", "boddy"),
        (
            '<asset><mesh name="m" file="m.stl"/></asset>'
            '<worldbody><body name="z"><freejoint/><geom type="mesh" mesh="m"/></body></worldbody>',
            "inertia from a mesh",
        ),
    ],
)
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, part, words):
    base = f'<mujoco><worldbody><body><joint name="j"/>{BOX}</body></worldbody>{part}</mujoco>'
    with pytest.raises(ValueError, match="plugin") as error:
        registry.load_plugin(written(tmp_path, base, "refused.xml"))
    assert words in str(error.value) and "\n" not in str(error.value)


def test_mimic_joints_of_a_urdf_are_refused(tmp_path):
    """They are couplings of joints, which change the motions that are possible."""
    coupled = ROBOT.replace('<axis xyz="1 1 0"/>', '<axis xyz="1 1 0"/><mimic joint="shoulder" multiplier="2"/>')
    with pytest.raises(ValueError, match="<mimic>: joint 'elbow' is coupled to 'shoulder'"):
        mechanism_files.read_mechanism(written(tmp_path, coupled))


def test_a_keyframe_is_a_start_and_is_moved_onto_the_joints(tmp_path):
    """Printed to three digits, it leaves a loop open by as much; the start closes it."""
    closed = mechanism_files.read_mechanism(written(tmp_path, LOOPS))
    text = " ".join(f"{x:.3f}" for x in closed.model.qpos0)
    key = f'<keyframe><key name="home" qpos="{text}"/></keyframe></mujoco>'
    registry.load_plugin(written(tmp_path, LOOPS.replace("</mujoco>", key), "keyed.xml"))
    made = make_problem("keyed", {"keyframe": "home"})
    assert_close(States.one(made.initial).r[0], closed.problem().initial.r, atol=2e-3)


def test_the_files_content_is_part_of_the_runs_identity(tmp_path):
    """Included files as well: a mass changed in one changes the digest."""
    whole = written(tmp_path, '<mujoco><include file="arm.xml"/></mujoco>', "whole.xml")
    arm = written(
        tmp_path, f"<mujocoinclude><worldbody><body><joint/>{BOX}</body></worldbody></mujocoinclude>", "arm.xml"
    )
    assert plugins.list_sources(str(whole)) == (whole, arm)
    before = digest_code((str(whole),))
    arm.write_text(arm.read_text().replace("<joint/>", '<joint axis="1 0 0"/>'))
    digest_code.cache_clear()
    assert digest_code((str(whole),)) != before


def test_a_file_is_solved_like_a_problem(tmp_path):
    """From Python by its path; energy of a frictionless arm is kept."""
    problem = make_problem(str(written(tmp_path, ROBOT, "arm2.urdf")), {"qvel": "1,0", "t_end": 0.2})
    run = registry.make_solver("rkmk_dopri5").solve(problem, StepControl(rtol=1e-9))
    E = energy(problem.system, run.states)
    assert np.max(np.abs(E - E[0])) < 1e-7


def test_the_page_s_slider_crank_moves_as_that_of_the_catalogue(tmp_path, monkeypatch, capsys):
    """Two ways to the same mechanism: a file with a connect, a problem with four joints."""
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "your-own-problem.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"mbsbench (solve crank.xml.*)", page)
    shutil.copy(ROOT / "docs" / "examples" / "crank.xml", "crank.xml")
    assert main(shlex.split(command)) == 0
    assert capsys.readouterr().err.startswith("crank.xml (sha256 ")
    file = load("crank.npz", make_problem("crank.xml", {"qvel": "6,-6,0.48"})).trajectory
    ours = make_problem("slider_crank", {"variant": "planar", "t_end": 1.0})
    there = registry.make_solver("rkmk_dop853").solve(ours, StepControl(rtol=1e-8))
    assert np.max(np.abs(file.states.r[-1] - there.states.r[-1])) < 1e-8


def test_a_suite_takes_a_file(tmp_path, monkeypatch, capsys):
    """Named as a plugin, its problem by the file's name; the workers read it again."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path, ROBOT, "planted.urdf")
    text = 'plugins = ["planted.urdf"]\n[[runs]]\nproblem = "planted"\nsolver = "rkmk_dopri5"\n'
    Path("suite.toml").write_text(text + "parameters = { t_end = 0.05 }\n")
    assert main(["run", "suite.toml", "--jobs", "1", "--out", "runs"]) == 0
    capsys.readouterr()
    assert main(["export", "planted.urdf"]) == 0
    assert [j["type"] for j in json.loads(capsys.readouterr().out)["joints"]] == ["revolute", "prismatic"]


ARM = f"""<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody>
<body name="upper" pos="0 0 1"><joint axis="0 1 .2" stiffness="5" springref="40" damping=".2"/>{BOX}
  <body name="lower" pos="0 0 -.5"><joint axis="1 0 .3" stiffness="2" damping=".1"/>{BOX}
    <body name="hand" pos="0 0 -.3"><joint type="ball"/>{BOX}</body></body></body></worldbody>
<equality><connect body1="hand" anchor="0 0 -.2" solref=".01 1" solimp=".9 .95 .001 .5 2"/></equality></mujoco>"""


def test_mujoco_is_given_the_springs_of_hinges(tmp_path):
    """Its model check compares forces and energies at a start off the rest angles; it does not refuse."""
    open_arm = ARM.partition("<equality>")[0] + "</mujoco>"
    problem = make_problem(str(written(tmp_path, open_arm, "sprung.xml")), {"qpos": "0.3,-0.4,1,0,0,0", "t_end": 0.2})
    solver = registry.make_solver("mujoco")
    run = solver.solve(problem, StepControl(dt=1e-3))
    reference = registry.make_solver("rkmk_dopri5").solve(problem, StepControl(rtol=1e-9))
    assert solver.refuses(problem, StepControl(dt=1e-3)) is None
    assert np.max(np.abs(run.states.r[-1] - reference.states.r[-1])) < 1e-8


def test_the_settings_of_a_file_are_its_own(tmp_path):
    """Integrator and the softness of loops; a note names another step, and another problem is refused in a line."""
    problem = make_problem(str(written(tmp_path, ARM, "soft.xml")), {"t_end": 0.1})
    soft = registry.make_solver("mujoco", {"settings": "file"})
    control = StepControl(dt=0.005)
    assert soft.refuses(problem, control) is None
    model = engine.Model(soft, problem, control).model
    mj = engine.import_package("mujoco")
    assert model.opt.integrator == mj.mjtIntegrator.mjINT_IMPLICITFAST and model.opt.timestep == 0.005
    assert_close(model.eq_solref, (0.01, 1.0))
    assert_close(model.eq_solimp[0, :2], (0.9, 0.95))
    assert not any("timestep" in note for note in engine.Model(soft, problem, control).notes())
    finer = StepControl(dt=0.001)
    other = engine.Model(soft, problem, finer)
    assert soft.refuses(problem, finer) is None and other.model.opt.timestep == 0.001
    assert_close(other.model.eq_solref, (0.01, 1.0))
    assert "dt = 0.001 s; the file's timestep is 0.005 s" in other.notes()
    assert "not read from" in soft.refuses(make_problem("chain"), StepControl(dt=0.001))
