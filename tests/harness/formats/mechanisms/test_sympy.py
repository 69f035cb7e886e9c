"""Systems of ``sympy.physics.mechanics`` become mechanisms whose accelerations are those of SymPy's own equations.

Models: the pendulum on a cart and the masses on springs that SymPy ships, and as in published examples the block with
two pendulums of SymPy's tutorials on mechanics and the rods on a wall of "Learn Multibody Dynamics" (Moore), written
anew; the four-bar linkage is the example of the manual.
"""

import importlib
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from mbsbench import JointKind, accelerations, read_sympy, solve
from mbsbench.harness.formats.mechanisms.sympy_systems import _Equations
from mbsbench.harness.mechanics.motion import energy
from mbsbench.tests.comparing import assert_close, assert_each

pytestmark = pytest.mark.skipif(importlib.util.find_spec("sympy") is None, reason="sympy: extra formats")
EXAMPLE = Path(__file__).parents[4] / "docs/examples/kane_four_bar.py"


@pytest.fixture(scope="module")
def me():
    return pytest.importorskip("sympy.physics.mechanics")


@pytest.fixture(scope="module")
def sp():
    return pytest.importorskip("sympy")


def block_with_pendulums(me, sp, torque=0.0):
    """A System of joints: a block (a particle) on springs slides, a rigid pendulum and a second one hang from it."""
    q, u = me.dynamicsymbols("q1:4"), me.dynamicsymbols("u1:4")
    m, g, l, k, c, kt = sp.symbols("m g l k c kt")
    wall, block = me.RigidBody("wall"), me.Particle("block", mass=2 * m)
    rods = [me.RigidBody(f"rod{i}", mass=m) for i in (1, 2)]
    for rod in rods:
        rod.central_inertia = me.inertia(rod.frame, m * l**2 / 12, m * l**2 / 100, m * l**2 / 12)
    system = me.System.from_newtonian(wall)
    frame = me.ReferenceFrame("B")
    block.masscenter.set_vel(frame, 0)
    system.add_joints(
        me.PrismaticJoint("slider", wall, block, q[0], u[0], child_interframe=frame),
        me.PinJoint(
            "pin1",
            block,
            rods[0],
            q[1],
            u[1],
            joint_axis=wall.z,
            child_point=l / 2 * rods[0].y,
            parent_interframe=frame,
        ),
        me.PinJoint(
            "pin2",
            rods[0],
            rods[1],
            q[2],
            u[2],
            joint_axis=rods[0].z,
            parent_point=-l / 2 * rods[0].y,
            child_point=l / 2 * rods[1].y,
        ),
    )
    system.apply_uniform_gravity(-g * wall.y)
    system.add_loads(me.Force(block, -(k * q[0] + c * u[0]) * wall.x))
    system.add_actuators(me.TorqueActuator(-kt * (q[2] - sp.pi / 6) - torque * u[2] ** 3, rods[0].z, rods[1], rods[0]))
    values = {m: 1.5, g: 9.81, l: 0.8, k: 40.0, c: 0.7, kt: 3.0}
    return system, values, dict(zip([*q, *u], (0.1, 0.4, -0.3, 0.5, 1.0, -2.0), strict=True)), {}


def four_bar(me, sp):
    """The example of the manual: three pinned links, the last one closed onto the ground by dependent coordinates."""
    found: dict = {}
    exec(EXAMPLE.read_text(encoding="utf-8").partition("\nproblem = ")[0], found)  # its model alone
    start = dict(zip([*found["q"], found["u"][0]], (1.2, -1.0, -1.7, 1.0), strict=True))
    return found["kane"], found["values"], start, {}


def two_rods(me, sp):
    """A KanesMethod in space: a rod turns about z, a second one about its x, a bead slides on that on a spring."""
    q, u = me.dynamicsymbols("q1:4"), me.dynamicsymbols("u1:4")
    m, l, kt, kl, g = sp.symbols("m l kt kl g")
    N, O = me.ReferenceFrame("N"), me.Point("O")
    A = N.orientnew("A", "Axis", (q[0], N.z))
    B = A.orientnew("B", "Axis", (q[1], A.x))
    rates = dict(zip([c.diff() for c in q], u, strict=True))
    O.set_vel(N, 0)
    points = [O.locatenew("Ao", l / 2 * A.x), O.locatenew("Bo", l * A.x), O.locatenew("Q", l * A.x + q[2] * B.y)]
    for p in points:
        p.set_vel(N, me.msubs(p.pos_from(O).dt(N), rates))
    A.set_ang_vel(N, u[0] * N.z)
    B.set_ang_vel(A, u[1] * A.x)
    J = m * l**2 / 12
    bodies = [
        me.RigidBody("A", points[0], A, m, (me.inertia(A, J / 10, J, J), points[0])),
        me.RigidBody("B", points[1], B, m, (me.inertia(B, J, J / 10, J), points[1])),
        me.Particle("Q", points[2], m / 4),
    ]
    loads = [(p, w * g * N.x) for p, w in zip(points, (m, m, m / 4), strict=True)]
    loads += [(points[2], -kl * q[2] * B.y), (points[1], kl * q[2] * B.y)]
    loads += [(A, -kt * q[0] * N.z + kt * q[1] * A.x), (B, -kt * q[1] * A.x)]
    kane = me.KanesMethod(N, q, u, [c.diff() - w for c, w in zip(q, u, strict=True)])
    kane.kanes_equations(bodies, loads)
    start = dict(zip([*q, *u], (0.3, 0.5, 0.1, 0.1, 2.2, 0.3), strict=True))
    return kane, {m: 1.0, l: 0.6, kt: 0.6, kl: 2.0, g: 9.81}, start, {}


def masses_on_strings(me, sp):
    """A LagrangesMethod: two particles, one below the other; massless links."""
    q = me.dynamicsymbols("q1:3")
    m, l, g = sp.symbols("m l g")
    N, O = me.ReferenceFrame("N"), me.Point("O")
    O.set_vel(N, 0)
    bodies, end = [], O
    for i in range(2):
        frame = N.orientnew(f"F{i}", "Axis", (q[i], N.z))
        end = end.locatenew(f"P{i}", l * frame.x)
        end.set_vel(N, end.pos_from(O).dt(N))
        bodies.append(me.Particle(f"mass{i + 1}", end, m))
        bodies[-1].potential_energy = -m * g * end.pos_from(O).dot(N.x)
    lagrange = me.LagrangesMethod(me.Lagrangian(N, *bodies), q, frame=N)
    lagrange.form_lagranges_equations()
    return lagrange, {m: 1.0, l: 0.5, g: 9.81}, {q[0]: 0.3, q[1]: 0.7, q[0].diff(): 1.0}, {"bodies": bodies}


def pendulum_on_a_cart(me, sp):
    """A KanesMethod of SymPy's own models: three particles on massless links."""
    kane = importlib.import_module("sympy.physics.mechanics.models").n_link_pendulum_on_cart(3, cart_force=False)
    symbols = (kane.mass_matrix_full.free_symbols | kane.forcing_full.free_symbols) - {me.dynamicsymbols._t}
    values = {s: 1.0 + 0.1 * k for k, s in enumerate(sorted(symbols, key=str))}
    return kane, values, {**{c: 0.1 * k for k, c in enumerate(kane.q, 1)}, **dict.fromkeys(kane.u, 0.2)}, {}


def masses_on_springs(me, sp):
    """A KanesMethod of SymPy's own models: three particles on one line, springs and dampers between them."""
    kane = importlib.import_module("sympy.physics.mechanics.models").multi_mass_spring_damper(3, apply_gravity=True)
    symbols = kane.forcing_full.free_symbols - {me.dynamicsymbols._t}
    values = {s: 1.0 + 0.3 * k for k, s in enumerate(sorted(symbols, key=str))}
    return kane, values, {**{c: 0.3 + 0.1 * k for k, c in enumerate(kane.q)}, **dict.fromkeys(kane.u, 0.2)}, {}


EXPECTED = {
    masses_on_springs: "point on line",
    pendulum_on_a_cart: "distance, point on line, point on plane",
    block_with_pendulums: "normal axes, point on line, point on plane, revolute, spherical",
    four_bar: "revolute",
    two_rods: "point on line, revolute",
    masses_on_strings: "distance, point on plane",
}


@pytest.mark.parametrize(
    "make",
    [pytest.param(f, marks=pytest.mark.slow if f is four_bar else ()) for f in EXPECTED],
    ids=[f.__name__ for f in EXPECTED],
)
def test_accelerations_are_those_of_sympy_s_own_rhs(me, sp, make):
    """Its equations solved in its coordinates, its points' and frames' accelerations; ours by rows of joints: 1e-10."""
    method, values, start, more = make(me, sp)
    problem = read_sympy(method, values, start, **more)
    kinds = {problem.system.joint_kind(k) for k in range(problem.system.nj)}
    assert ", ".join(sorted(kinds)) == EXPECTED[make]
    e = _Equations(method, values, tuple(more.get("bodies", ())), None)
    random = np.random.default_rng(5)
    q = e._close_loops(np.array([start.get(c, 0.0) for c in e.q]) + 0.1 * random.standard_normal(len(e.q)))
    C = e._evaluate("speed_rows", q)
    u = random.standard_normal(len(e.u))
    u -= np.linalg.pinv(C) @ C @ u
    here = {**values, **dict(zip([*e.u, *e.q], [*u, *q], strict=True))}
    M, f = (np.array(me.msubs(m, here), dtype=float) for m in (e.method.mass_matrix_full, e.method.forcing_full))
    u_dot = np.linalg.solve(M, f).ravel()[len(q) : len(q) + len(u)]
    q_dots = {} if e.is_lagrange else e.method.kindiffdict()
    moving = dict(zip([c.diff() for c in e.u], u_dot, strict=True))
    state, N = e.state(q, u), e.frame
    ours = accelerations(problem.system, state)
    for b, part in enumerate(e.parts):
        vectors = [(part.masscenter.acc(N), N)]
        if hasattr(part, "central_inertia"):
            vectors.append((part.frame.ang_acc_in(N), part.frame))
        for (vector, frame), found in zip(vectors, (ours.v_dot[b], ours.Omega_dot[b]), strict=False):
            plain = me.msubs(me.msubs(me.msubs(vector.to_matrix(frame), moving), q_dots), here)
            assert_close(found, np.array(plain, dtype=float).ravel(), rtol=1e-10, atol=1e-10)


@pytest.mark.slow
def test_a_motion_of_ours_keeps_the_energy(me, sp):
    """The four-bar linkage, closed from a start of two digits, swings by ``rkmk_dop853``."""
    problem = read_sympy(*four_bar(me, sp)[:3])
    run = solve(problem, "rkmk_dop853", rtol=1e-10, t_end=1.0)
    E = energy(problem.system, run.trajectory.states)
    assert run.status == "success" and np.ptp(E) < 1e-7


def test_springs_and_dampers_are_recognised(me, sp):
    """Numbers that the model has: k and c of the slide, k and rest of the pin; none of the loads is read."""
    s = read_sympy(*block_with_pendulums(me, sp)[:3]).system
    assert_close(s.gravity, [0.0, -9.81, 0.0], atol=1e-9)
    assert_close(s.spring_k, 40.0)
    assert_close(s.spring_c, 0.7)
    assert_close(s.torsion_k, 3.0)
    assert_close(s.torsion_c, 0.0, atol=1e-9)
    assert JointKind.REVOLUTE in {s.joint_kind(k) for k in range(s.nj)}


def test_springs_between_point_masses_are_recognised(me, sp):
    """Masses that meet on their line, so that only a spring without a length at rest is one of theirs."""
    kane, values, start, _ = masses_on_springs(me, sp)
    s, given = read_sympy(kane, values, start).system, {str(k): v for k, v in values.items()}
    assert_close(s.gravity, [given["g"], 0.0, 0.0])
    assert len(s.spring_k) == 3
    assert_close(s.spring_k, [given[f"k{i}"] for i in range(3)])
    assert_close(s.spring_c, [given[f"c{i}"] for i in range(3)])
    assert_close(s.spring_d0[1:], 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda v, s: v.popitem(), "values lacks kt"),
        (lambda v, s: s.pop(next(iter(s))), "start lacks q1"),
        (lambda v, s: s.update(x=1.0), "start: x is not one of q1"),
        (
            lambda v, s: s.update(dict.fromkeys([next(iter(s))], np.nan)),
            "start: q1.t. must be a finite number .got nan",
        ),
        (
            lambda v, s: v.update(dict.fromkeys([next(iter(v))], "heavy")),
            "values: m must be a finite number .got 'heavy'",
        ),
        (lambda v, s: v.update(dict.fromkeys([list(v)[2]], 0.0)), "the mass matrix of its equations is singular"),
    ],
)
def test_numbers_that_lack_or_are_none_are_named(me, sp, change, words):
    system, values, start, _ = block_with_pendulums(me, sp)
    change(values, start)
    with pytest.raises(ValueError, match=words) as error:
        read_sympy(system, values, start)
    assert "\n" not in str(error.value)


def test_a_start_that_is_no_dict_is_refused(me, sp):
    system, values, _, _ = block_with_pendulums(me, sp)
    with pytest.raises(ValueError, match=r"start: expected a dict of numbers by symbol .got None"):
        read_sympy(system, values, None)


def test_forces_of_no_kind_here_are_refused(me, sp):
    """A cubic damper explains no acceleration by springs and dampers."""
    system, values, start, _ = block_with_pendulums(me, sp, torque=0.5)
    with pytest.raises(ValueError, match="not gravity and linear springs and dampers"):
        read_sympy(system, values, start)


def test_a_loop_that_cannot_be_closed_is_refused(me, sp):
    """A ground link longer than the others together."""
    kane, values, start, _ = four_bar(me, sp)
    longest = next(k for k in values if str(k) == "l4")
    with pytest.raises(ValueError, match="no pose near the start"):
        read_sympy(kane, {**values, longest: 5.0}, start)


def test_restrictions_of_velocities_alone_are_refused(me, sp):
    """A knife edge: its body is free in every pose, and not in every velocity."""
    q, u = me.dynamicsymbols("x y a"), me.dynamicsymbols("u v w")
    N, O = me.ReferenceFrame("N"), me.Point("O")
    A = N.orientnew("A", "Axis", (q[2], N.z))
    A.set_ang_vel(N, u[2] * N.z)
    C = O.locatenew("C", q[0] * N.x + q[1] * N.y)
    O.set_vel(N, 0)
    C.set_vel(N, u[0] * N.x + u[1] * N.y)
    kane = me.KanesMethod(
        N,
        q,
        u[::2],
        [c.diff() - w for c, w in zip(q, u, strict=True)],
        u_dependent=u[1:2],
        velocity_constraints=[C.vel(N).dot(A.y)],
    )
    kane.kanes_equations([me.RigidBody("sleigh", C, A, 1.0, (me.inertia(A, 1, 1, 1), C))], [])
    with pytest.raises(ValueError, match=r"1 constraints more than the joints found .*velocities alone"):
        read_sympy(kane, {}, dict.fromkeys(q, 0.1))


def test_bodies_that_no_force_moves_are_recognised(me, sp):
    """A double pendulum in free space: centrifugal forces cancel to rounding, of which no share is left to explain."""
    q1, q2, u1, u2 = me.dynamicsymbols("q1 q2 u1 u2")
    N, A, B = (me.ReferenceFrame(x) for x in "NAB")
    O = me.Point("O")
    O.set_vel(N, 0)
    A.orient_axis(N, q1, N.z)
    B.orient_axis(N, q2, N.z)
    A.set_ang_vel(N, u1 * N.z)
    B.set_ang_vel(N, u2 * N.z)
    P = O.locatenew("P", A.x)
    C = O.locatenew("C1", A.x / 2), P.locatenew("C2", B.x / 2)
    for point, base, frame in ((P, O, A), (C[0], O, A), (C[1], P, B)):
        point.v2pt_theory(base, N, frame)
    bars = [
        me.RigidBody(n, c, f, sp.Integer(1), (me.inertia(f, 0.001, sp.Rational(1, 12), sp.Rational(1, 12)), c))
        for n, c, f in (("upper", C[0], A), ("lower", C[1], B))
    ]
    kane = me.KanesMethod(N, q_ind=[q1, q2], u_ind=[u1, u2], kd_eqs=[q1.diff() - u1, q2.diff() - u2])
    kane.kanes_equations(bars, [])
    problem = read_sympy(kane, {}, {q1: 0.3, q2: 1.0, u1: 1.0}, origin=O, bodies=bars)
    assert problem.system.joint_names == ("ground-upper", "upper-lower")
    assert_each(problem.system.gravity, "==", 0.0)
    rates = accelerations(problem.system, problem.initial).Omega_dot[:, 2]
    c, s = np.cos(0.7), np.sin(0.7)  # (4/3) a1 + c/2 a2 = 0, c/2 a1 + a2/3 = u1^2 s/2 of two bars of 1 kg and 1 m
    assert_close(rates, np.linalg.solve([[4 / 3, c / 2], [c / 2, 1 / 3]], [0.0, -s / 2]), atol=1e-10)


def test_a_wheel_about_its_own_centre_is_a_hinge(me, sp):
    """Nothing of it moves but its orientation: no distance to compare with."""
    q, u = me.dynamicsymbols("q u")
    N, A = me.ReferenceFrame("N"), me.ReferenceFrame("A")
    O = me.Point("O")
    O.set_vel(N, 0)
    A.orient_axis(N, q, N.z)
    A.set_ang_vel(N, u * N.z)
    wheel = me.RigidBody("wheel", O, A, sp.Integer(2), (me.inertia(A, 1, 2, 3), O))
    kane = me.KanesMethod(N, q_ind=[q], u_ind=[u], kd_eqs=[q.diff() - u])
    kane.kanes_equations([wheel], [(A, -4 * q * N.z)])
    problem = read_sympy(kane, {}, {q: 0.5}, origin=O, bodies=[wheel])
    assert problem.system.joint_kind(0) is JointKind.REVOLUTE
    assert_close(accelerations(problem.system, problem.initial).Omega_dot, [[0.0, 0.0, -4 * 0.5 / 3]])
