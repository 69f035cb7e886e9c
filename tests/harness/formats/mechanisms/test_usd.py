"""USD Physics becomes the system that Newton makes of it, whatever the units and the vertical of the stage."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench import JointKind, accelerations, make_problem, solve
from mbsbench.harness.formats.mechanisms import mechanism_files
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.tests.comparing import assert_close

from ....solvers.engines.environments import import_engine

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("pxr") is None, reason="usd-core is an optional extra: formats"
)

TURN = {"Z": "(1, 0, 0, 0)", "Y": "(0.7071067811865476, -0.7071067811865476, 0, 0)"}  # z of the model onto the vertical


def linkage(metre: float = 1.0, kilogram: float = 1.0, up: str = "Z", drive: str = "") -> str:
    """A parallelogram, its loop closed outside the articulation; links of 1 m, 2 m and 1 m of 2 kg."""
    L, J = 1.0 / metre, 1.0 / (kilogram * metre**2)

    def body(name: str, x: float, z: float, v: str) -> str:
        return f"""def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{
        double3 xformOp:translate = ({x * L}, 0, {z * L})
        uniform token[] xformOpOrder = ["xformOp:translate"]
        float physics:mass = {2.0 / kilogram}
        point3f physics:centerOfMass = (0, 0, {0.125 * L})
        float3 physics:diagonalInertia = ({0.5 * J}, {0.375 * J}, {0.25 * J})
        {v}
        }}"""

    def hinge(
        name: str, parent: str, child: str, p0: tuple[float, float], p1: tuple[float, float], more: str = ""
    ) -> str:
        return f"""def PhysicsRevoluteJoint "{name}" {more if more.startswith("(") else ""} {{
        uniform token physics:axis = "Y"
        rel physics:body0 = </World{parent}>
        rel physics:body1 = </World{child}>
        point3f physics:localPos0 = ({p0[0] * L}, 0, {p0[1] * L})
        point3f physics:localPos1 = ({p1[0] * L}, 0, {p1[1] * L})
        {more if not more.startswith("(") else drive}
        }}"""

    turning = f"vector3f physics:angularVelocity = (0, 90, 0)\n vector3f physics:velocity = ({np.pi / 3.2 * L}, 0, 0)"
    return f"""#usda 1.0
(
    metersPerUnit = {metre}
    kilogramsPerUnit = {kilogram}
    upAxis = "{up}"
)
def PhysicsScene "scene" {{}}
def Xform "World" (prepend apiSchemas = ["PhysicsArticulationRootAPI"]) {{
    quatd xformOp:orient = {TURN[up]}
    uniform token[] xformOpOrder = ["xformOp:orient"]
    {body("crank", 0, 0.5, turning)}
    {body("coupler", 1, 1, "")}
    {body("rocker", 2, 0.5, turning)}
    {hinge("A", "", "/crank", (0, 0), (0, -0.5), '(prepend apiSchemas = ["PhysicsDriveAPI:angular"])' if drive else "")}
    {hinge("B", "/crank", "/coupler", (0, 0.5), (-1, 0))}
    {hinge("C", "", "/rocker", (2, 0), (0, -0.5))}
    {hinge("D", "/coupler", "/rocker", (1, 0), (0, 0.5), "uniform bool physics:excludeFromArticulation = 1")}
}}"""


def written(folder: Path, text: str, name: str = "model.usda") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_a_loop_is_rows_like_all_others(tmp_path):
    """Four hinges, moving as the file says: the coupler, given no velocity, is taken along."""
    problem = make_problem(str(written(tmp_path, linkage())))
    assert {problem.system.joint_kind(k) for k in range(4)} == {JointKind.REVOLUTE}
    assert_close(problem.system.gravity, [0.0, 0.0, -9.81])
    assert_close(problem.initial.Omega, [[0, np.pi / 2, 0], [0, 0, 0], [0, np.pi / 2, 0]], atol=1e-6)
    assert_close(problem.initial.v[:, 0], np.pi / 2 * np.array([0.625, 1.0, 0.625]), atol=1e-6)


def test_velocities_that_a_file_gives_hold_and_others_follow(tmp_path):
    """Of the crank alone; a rocker that turns the other way is refused."""
    text = linkage()
    head, _, tail = text.rpartition("vector3f physics:angularVelocity = (0, 90, 0)")
    alone = head + tail.partition("\n")[2].partition("\n")[2]
    problem = make_problem(str(written(tmp_path, alone, "alone.usda")))
    assert_close(problem.initial.Omega[:, 1], [np.pi / 2, 0, np.pi / 2], atol=1e-6)
    against = f"{head}vector3f physics:angularVelocity = (0, -90, 0){tail}"
    with pytest.raises(ValueError, match=r"velocities of centres of mass: the loops allow no such rates"):
        make_problem(str(written(tmp_path, against, "against.usda")))


@pytest.mark.parametrize("drive", ["", "spring"])
@pytest.mark.parametrize(("metre", "kilogram", "up"), [(0.01, 0.001, "Z"), (1.0, 1.0, "Y"), (0.01, 1.0, "Y")])
def test_units_and_the_vertical_change_no_motion(tmp_path, metre, kilogram, up, drive):
    """In cm and g as in m and kg, y up as z up: the same accelerations, in another frame."""
    angular = 1.0 / (kilogram * metre**2)
    texts = [
        linkage(
            m,
            k,
            v,
            f"""float drive:angular:physics:stiffness = {4 * a}
        float drive:angular:physics:damping = {a}
        float drive:angular:physics:targetPosition = 10"""
            if drive
            else "",
        )
        for m, k, v, a in ((1.0, 1.0, "Z", 1.0), (metre, kilogram, up, angular))
    ]
    one, other = (
        make_problem(str(written(tmp_path, t, f"{drive}{k}{metre}{kilogram}{up}.usda"))) for k, t in enumerate(texts)
    )
    Q = other.initial.R[0] @ one.initial.R[0].T
    assert_close(Q @ [0.0, 0.0, 1.0], -other.system.gravity / 9.81)
    if drive:
        assert_close(one.system.torsion_k, 4 * 180 / np.pi)
        assert_close(one.system.torsion_rest, np.radians(10))
    for name in ("mass", "inertia", "torsion_k", "torsion_c", "torsion_rest"):
        assert_close(getattr(one.system, name), getattr(other.system, name), rtol=1e-6)
    a, b = (accelerations(p.system, p.initial) for p in (one, other))
    assert np.max(np.abs(a.v_dot)) > 0.1
    assert_close(a.v_dot @ Q.T, b.v_dot, atol=1e-5)
    assert_close(a.Omega_dot, b.Omega_dot, atol=1e-5)


def test_a_joint_may_name_its_bodies_in_either_order(tmp_path):
    """From the link to the world its coordinate has the other sign: the target changes sign, the motion does not."""
    words = "float drive:angular:physics:stiffness = 4\nfloat drive:angular:physics:targetPosition = {}"
    text = linkage(drive=words.format(10))
    ends = "rel physics:body0 = </World>\n        rel physics:body1 = </World/crank>"
    points = ["point3f physics:localPos0 = (0.0, 0, 0.0)", "point3f physics:localPos1 = (0.0, 0, -0.5)"]
    assert ends in text and all(p in text for p in points)
    other = text.replace(ends, "rel physics:body0 = </World/crank>", 1).replace("= 10", "= -10")
    other = other.replace(points[0], "HERE", 1).replace(points[1], points[1].replace("localPos1", "localPos0"), 1)
    other = other.replace("HERE", points[0].replace("localPos0", "localPos1"), 1)
    one, two = (make_problem(str(written(tmp_path, t, f"order{k}.usda"))) for k, t in enumerate((text, other)))
    a, b = (accelerations(p.system, p.initial).v_dot for p in (one, two))
    assert np.max(np.abs(a)) > 1.0
    assert_close(a, b, atol=1e-12)


@pytest.mark.filterwarnings("ignore")  # of Newton's own kinds, which a process without it cannot be told
@pytest.mark.parametrize(
    "name",
    [
        "kamino/basics/box_pendulum.usda",
        "kamino/basics/cartpole.usda",
        "kamino/basics/boxes_hinged.usda",
        "linkage",
    ],
)
def test_accelerations_are_those_of_newton_s_model(tmp_path, name):
    """Newton reads a file of its wheel and makes a model of MuJoCo's, in float64: its own solvers are in float32."""
    newton = import_engine("newton")
    from mbsbench.solvers.engines.export.model_check import SAME, measure_differences

    from ....solvers.engines.test_mechanism_files import CompiledMechanism, moving, theirs

    text = linkage().replace('"scene" {}', '"scene" {\nfloat physics:gravityMagnitude = 9.75\n}')  # a float32
    assets = Path(newton.__file__).parent / "tests" / "assets"
    path = written(tmp_path, text) if name == "linkage" else assets / name
    ours = mechanism_files.read_mechanism(path)
    builder = newton.ModelBuilder()
    builder.add_usd(str(path))
    if max(builder.joint_articulation) < 0:  # Newton wants a joint for a free body, and a root for the tree
        for body in {*range(builder.body_count)} - {*builder.joint_child}:
            builder.add_joint_free(child=body)
        builder.add_articulation([*range(builder.joint_count)])
    model = newton.solvers.SolverMuJoCo(builder.finalize(device="cpu"), use_mujoco_cpu=True).mj_model
    m = CompiledMechanism("newton", Path(), "", pytest.importorskip("mujoco"), model, {})
    qpos, qvel = moving(m)
    problem = replace(ours.problem(), initial=m.state(tuple(qpos), tuple(qvel)))
    found = measure_differences(problem, theirs(m, qpos, qvel))
    assert max(found.values()) < SAME, found


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (
            'def PhysicsRevoluteJoint "B"',
            'def PhysxPhysicsGearJoint "B"',
            "/World/B: PhysxPhysicsGearJoint is not supported",
        ),
        ("float physics:mass = 2.0", "float physics:mass = 0", "/World/crank: give physics:mass"),
        (
            "rel physics:body0 = </World/crank>",
            "rel physics:body0 = </World/none>",
            "/World/B: there is no /World/none",
        ),
        ("(-1.0, 0, 0.0)", "(-1.5, 0, 0.0)", "refused.usda: joint '/World/B' is open at the start by 0.5"),
        (
            '"PhysicsMassAPI"]',
            '"PhysicsMassAPI", "PhysxMimicJointAPI:rotX"]',
            "PhysxMimicJointAPI:rotX is not supported",
        ),
        ("metersPerUnit = 1.0", "metersPerUnit = 0", "metersPerUnit must be finite and > 0 (got 0)"),
        ('axis = "Y"', 'axis = "W"', "/World/A: physics:axis must be X, Y or Z (got W)"),
        (
            "translate = (0.0, 0, 0.5)",
            "translate = (inf, 0, 0.5)",
            "/World/crank: its transform and points must be finite",
        ),
        ("angularVelocity = (0, 90", "angularVelocity = (0, inf", "/World/crank: velocities must be finite (got "),
        (
            "float physics:mass = 2.0",
            "float physics:mas = 1\nfloat physics:mass = 2.0",
            "property physics:mas is not supported",
        ),
        (
            "float physics:mass = 2.0",
            "int physxRigidBody:lockedRotAxis = 1\nfloat physics:mass = 2.0",
            "locks axes of a body",
        ),
        (
            'physics:axis = "Y"',
            'physics:axis = "Y"\nfloat physics:lowerLimit = 9\nfloat physics:upperLimit = 9',
            "must be 0 (got 9)",
        ),
        (
            "def PhysicsScene",
            'def PhysicsScene "other" {\nfloat physics:gravityMagnitude = 1\n}\ndef PhysicsScene',
            "/scene: /other has another gravity",
        ),
        ("#usda 1.0", "#usda one", "refused.usda:1:1: Unable to parse layer version"),
        ("upAxis", "subLayers = [@./none.usda@]\n upAxis", "Could not load sublayer"),
    ],
)
def test_a_refused_prim_is_named(tmp_path, before, after, words):
    """In one line, which also has the file."""
    text = linkage()
    assert before in text
    path = written(tmp_path, text.replace(before, after, 1), "refused.usda")
    with pytest.raises(ValueError, match=r"refused") as error:
        make_problem(str(path))
    assert words in str(error.value) and "\n" not in str(error.value)


def tilted_four_bar(digits: int) -> str:
    """A planar four-bar with a skew crank in a plane that is turned, every number printed to ``digits``."""
    T = Rotation.from_rotvec([0.3, -0.5, 0.7])
    pins = [np.array(p) for p in ((0, 0, 0), (0.2, 0, 0.5), (1.1, 0, 0.7), (1.0, 0, 0))]
    lines = ['#usda 1.0\n(\nmetersPerUnit = 1\nupAxis = "Z"\n)\ndef Xform "World" {']
    frames = {"": (np.zeros(3), Rotation.identity())}

    def printed(values) -> str:
        return "(" + ", ".join(f"{x:.{digits}g}" for x in values) + ")"

    for k, name in enumerate(("crank", "coupler", "rocker")):
        d = pins[k + 1] - pins[k]
        R = T * Rotation.from_rotvec([0.0, np.arctan2(-d[2], d[0]), 0.0])
        frames[name] = T.apply(pins[k] + 0.5 * d), R
        lines.append(f"""def Xform "{name}" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]) {{
        double3 xformOp:translate = {printed(frames[name][0])}
        quatd xformOp:orient = {printed(R.as_quat(scalar_first=True))}
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
        float physics:mass = 1
        point3f physics:centerOfMass = (0, 0, 0)
        float3 physics:diagonalInertia = (0.001, 0.03, 0.03)
        }}""")
    for k, ends in enumerate((("", "crank"), ("crank", "coupler"), ("coupler", "rocker"), ("", "rocker"))):
        lines.append(f'def PhysicsRevoluteJoint "J{k}" {{\nuniform token physics:axis = "Y"')
        for n, end in enumerate(ends):
            centre, R = frames[end]
            lines.append(f"""rel physics:body{n} = </World{"/" * bool(end)}{end}>
            point3f physics:localPos{n} = {printed(R.inv().apply(T.apply(pins[k]) - centre))}
            quatf physics:localRot{n} = {printed((R.inv() * T).as_quat(scalar_first=True))}""")
        lines.append("}")
    return "\n".join([*lines, "}"])


@pytest.mark.parametrize("digits", [5, 7, 17])
def test_a_loop_that_rounding_opens_is_closed(tmp_path, digits):
    """By its joints' frames: three rows stay redundant, and the motion is that of the exact linkage, to rounding.

    One angle is free: M(theta) theta_dot_dot = -dV/dtheta at rest, of the linkage of exact numbers.
    """
    problem = make_problem(str(written(tmp_path, tilted_four_bar(digits), f"four{digits}.usda")), {"t_end": 0.5})
    size = np.linalg.svd(constraint_jacobian(problem.system, problem.initial).toarray(), compute_uv=False)
    assert np.sum(size > 1e-12 * size[0]) == 17 and len(size) == 18
    rate = accelerations(problem.system, problem.initial).Omega_dot[0, 1]
    assert_close(rate, exact_rate(), rtol=10.0 ** (1 - min(digits, 7)))
    run = solve(problem, "rkmk_dop853", rtol=1e-8)
    assert run.record.status == "success" and run.record.phi_max < 1e-12


def exact_rate() -> float:
    """theta_dot_dot of the crank about y, of the four-bar at rest, by differences of its closed places."""
    T = Rotation.from_rotvec([0.3, -0.5, 0.7])
    g = T.inv().apply([0.0, 0.0, -9.81])[[0, 2]]
    pins = np.array([(0, 0), (0.2, 0.5), (1.1, 0.7), (1.0, 0)])
    crank, coupler, rocker = (complex(*d) for d in np.diff(pins, axis=0))
    # angles turn from x to z: positions as complex numbers, C of each bar half way
    lengths = abs(crank), abs(coupler), abs(rocker)

    def places(phi):
        a = lengths[0] * np.exp(1j * phi)
        d = 1.0 - a  # to the ground's other pin: coupler + rocker
        beta = np.arccos((abs(d) ** 2 + lengths[1] ** 2 - lengths[2] ** 2) / (2 * abs(d) * lengths[1]))
        sign = np.sign((coupler * (coupler + rocker).conjugate()).imag)
        b = lengths[1] * d / abs(d) * np.exp(1j * sign * beta)
        return np.array([a / 2, a + b / 2, a + b + (d - b) / 2]), np.unwrap([phi, np.angle(b), np.angle(d - b)])

    phi, h = np.angle(crank), 1e-4
    (c1, t1), (c2, t2) = (places(phi + k * h) for k in (1, -1))
    slope, turn = (c1 - c2) / (2 * h), (t1 - t2) / (2 * h)
    M = np.sum(np.abs(slope) ** 2 + 0.03 * turn**2)
    force = np.sum(slope.real * g[0] + slope.imag * g[1])
    return float(-force / M)  # about y an angle turns from z to x


def test_limits_that_lock_a_joint_fix_it(tmp_path):
    """Of two hinges one is locked at 0: a rigid body about the other, by Steiner."""
    text = linkage()
    text = text[: text.index('def PhysicsRevoluteJoint "C"')] + "}"
    text = text.replace('"Y"', '"Y"\nfloat physics:lowerLimit = 0\nfloat physics:upperLimit = 0').replace(
        '"Y"\nfloat physics:lowerLimit = 0\nfloat physics:upperLimit = 0', '"Y"', 1
    )
    text = text[: text.index('    def Xform "rocker"')] + text[text.index('    def PhysicsRevoluteJoint "A"') :]
    problem = make_problem(str(written(tmp_path, text, "locked.usda")))
    assert "joints fixed by equal limits: 1" in problem.source
    assert [problem.system.joint_kind(k) for k in range(2)] == [JointKind.REVOLUTE, JointKind.FIXED]
    arms = np.array([[0.0, 0.625], [1.0, 1.125]])
    about = 2 * 0.375 + 2.0 * np.sum(arms**2)
    rates = accelerations(problem.system, problem.initial).Omega_dot[:, 1]
    assert_close(rates, 9.81 * 2.0 * np.sum(arms[:, 0]) / about, rtol=1e-6)


def test_what_engines_add_is_named(tmp_path):
    """Damping of bodies, friction, cones; settings of a solver change no motion."""
    more = "float physxRigidBody:angularDamping = 0.1\nint physxRigidBody:solverPositionIterationCount = 8\n"
    text = linkage().replace("float physics:mass", f"{more}float mjc:gravcomp = 1\nfloat physics:mass")
    omitted = make_problem(str(written(tmp_path, text, "engines.usda"))).source
    assert "damping of bodies (3)" in omitted and "attributes mjc:gravcomp (3)" in omitted and "Count" not in omitted


def test_layers_are_part_of_the_runs_identity(tmp_path):
    """A stage that references another file depends on both."""
    base = written(tmp_path, linkage(), "base.usda")
    head = "(\n subLayers = [@./base.usda@]\n metersPerUnit = 1\n)"
    top = written(tmp_path, f"#usda 1.0\n{head}\n", "top.usda")
    assert {p.name for p in mechanism_files.list_files(top)} == {base.name, top.name}
    assert len(mechanism_files.read_mechanism(top).problem().system.mass) == 3
