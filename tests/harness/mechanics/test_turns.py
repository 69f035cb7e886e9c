"""Torsional springs keep their turns: in the law, in solvers, in the reference, in what judges.

A wheel of inertia J on a spring k swings by cosines however far it winds: theta = a cos(w t) + b / w sin(w t).
"""

import numpy as np
import pytest

from mbsbench import (
    Joint,
    Load,
    Problem,
    RigidBody,
    State,
    TimeFunction,
    TorsionSpring,
    accelerations,
    assemble,
    make_problem,
    solve,
)
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.mechanics.time_functions import evaluate_functions, shift_time
from mbsbench.harness.mechanics.torsion import count_turns, evaluate_torsion, follow_turns, rewind_springs
from mbsbench.harness.reference.computation import find_reference
from mbsbench.tests.comparing import assert_close, assert_each

J, K = 0.5, 2.0
Z = (0.0, 0.0, 1.0)


def rotation(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def wheel(angle=4.0, rate=5.0, damping=0.0, rest=0.0, loads=(), t_end=3.0, turns=None) -> Problem:
    """Its angle is that of the spring, through all turns."""
    turns = round((angle - rest) / (2.0 * np.pi)) if turns is None else turns
    spring = TorsionSpring(0, (1.0, 0.0, 0.0), -1, Z, (1.0, 0.0, 0.0), K, rest, damping, turns)
    pin = Joint(0, np.zeros(3), -1, np.zeros(3), Z, Z, "pin")
    system = assemble([RigidBody(1.0, np.diag([1.0, 1.0, J]))], [pin], torsions=[spring], loads=loads)
    start = State(np.zeros((1, 3)), rotation(angle)[None], np.zeros((1, 3)), np.array([[0.0, 0.0, rate]]))
    return Problem("watch", system, start, t_end, 1e-3, section="", source="a wheel on a spring")


def exact(t, angle, rate, damping=0.0, rest=0.0):
    """Angle and rate in closed form, of less than critical damping."""
    d, w0 = damping / (2.0 * J), np.sqrt(K / J)
    w, x = np.sqrt(w0**2 - d**2), angle - rest
    b = (rate + d * x) / w
    e, c, s = np.exp(-d * t), np.cos(w * t), np.sin(w * t)
    return rest + e * (x * c + b * s), e * ((b * w - d * x) * c - (x * w + d * b) * s)


@pytest.mark.parametrize("angle", [0.5, 4.0, -4.0, 11.0])
def test_the_law_adds_the_turns_of_the_start(angle):
    """-k theta / J, and k theta^2 / 2 above rest."""
    p = wheel(angle, 0.0)
    assert_close(accelerations(p.system, p.initial).Omega_dot[0, 2], -K * angle / J)
    assert_close(energy(p.system, States.one(p.initial))[0], 0.5 * K * angle**2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "solver",
    [
        "rkmk_dop853",
        "rk45_strong_form",
        "scipy_strong_form",
        "ida_index2",
        "dop853_joint",
        "gc_weak_form",
        "generalized_alpha",
    ],
)
def test_solvers_wind_a_spring_through_its_turns(solver):
    """To their accuracy, the reference's and the judge's words included; 4 rad to -4.7 and back."""
    p = wheel()
    run = solve(p, solver, **({"dt": 1e-3} if solver in ("gc_weak_form", "generalized_alpha") else {"rtol": 1e-9}))
    assert run.record.status == "success" and run.record.energy_drift_max_J < 1e-4 and "pieces" in run.record.notes
    Omega = exact(run.trajectory.t, 4.0, 5.0)[1]
    assert np.max(np.abs(run.trajectory.states.Omega[:, 0, 2] - Omega)) < 1e-4
    assert run.record.motion_error_max_m < 1e-4 and run.record.reference_horizon_s == 3.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("angle", "rate", "damping"), [(4.0, 5.0, 0.0), (0.0, 60.0, 0.2), (-9.0, 0.0, 0.5)])
def test_the_reference_keeps_turns_to_its_stated_error(angle, rate, damping):
    """Up to five turns to either side."""
    p = wheel(angle, rate, damping)
    reference = find_reference(p)
    t = np.linspace(0.0, 3.0, 301)
    theta, _ = exact(t, angle, rate, damping)
    apart = reference.states(t).R[:, 0] - np.array([rotation(a) for a in theta])
    off = p.system.gyration[0] * np.linalg.norm(apart, axis=(1, 2)) / np.sqrt(2.0)
    assert reference.horizon == 3.0
    assert_each(off, "<=", reference.error(t) + 1e-12)


def test_motions_within_half_a_turn_are_the_solver_s_own():
    """Bit for bit, in one piece: nothing is added to a law that holds."""
    p = wheel(0.5, 1.0)
    run = solve(p, "rkmk_dop853", rtol=1e-9)
    assert "pieces" not in run.record.notes and run.trajectory.states.angles is None
    assert follow_turns(p.system, run.trajectory.t, run.trajectory.states) is run.trajectory.states


@pytest.mark.parametrize("rows", [60, 400])
def test_turns_are_counted_from_few_rows_as_from_many(rows):
    """By the rates at both ends, also where a row is more than half a turn from the next."""
    t = np.linspace(0.0, 3.0, rows)
    theta, rate = exact(t, 0.0, 60.0)
    Omega = np.zeros((rows, 1, 3))
    Omega[:, 0, 2] = rate
    s = States(np.zeros((rows, 1, 3)), np.array([rotation(a) for a in theta])[:, None], 0.0 * Omega, Omega, t)
    assert_close(count_turns(wheel(0.0, 60.0).system, t, s)[:, 0], theta, atol=1e-9)


def test_a_spring_with_a_rest_beyond_half_a_turn_and_a_damper_is_judged_by_its_law():
    """200 degrees, as in MuJoCo's ray_swing.xml; the work of the damper is that along all turns."""
    rest = np.radians(200.0)
    p = wheel(0.0, 8.0, 0.3, rest)
    run = solve(p, "rkmk_dop853", rtol=1e-9)
    assert_close(accelerations(p.system, p.initial).Omega_dot[0, 2], (K * rest - 0.3 * 8.0) / J)
    assert run.record.status == "success" and run.record.energy_drift_max_J < 1e-7
    Omega = exact(run.trajectory.t, 0.0, 8.0, 0.3, rest)[1]
    assert np.max(np.abs(run.trajectory.states.Omega[:, 0, 2] - Omega)) < 1e-7


@pytest.mark.sampled(0)
def test_loads_of_time_go_on_where_a_piece_begins():
    """A torque M sin(w t) about the axis, off resonance, beside the free swing."""
    M, w = 6.0, 3.0
    load = Load(0, torque=(0.0, 0.0, M), follows=True, factor=TimeFunction((), 1.0, w))
    p = wheel(4.0, 5.0, loads=[load])
    run = solve(p, "rkmk_dop853", rtol=1e-10)
    t, w0 = run.trajectory.t, np.sqrt(K / J)
    forced = M / (J * (w0**2 - w**2)) * w * (np.cos(w * t) - np.cos(w0 * t))
    Omega = exact(t, 4.0, 5.0)[1] + forced
    assert run.record.status == "success" and "pieces" in run.record.notes
    assert np.max(np.abs(run.trajectory.states.Omega[:, 0, 2] - Omega)) < 1e-7


def test_functions_of_time_are_shifted():
    numbers = np.array([[0.3, -1.0, 0.5, 0.2, 1.5, 2.0, 0.7]])
    t = np.linspace(0.0, 2.0, 9)
    for a, b in zip(evaluate_functions(shift_time(numbers, 0.4), t), evaluate_functions(numbers, t + 0.4), strict=True):
        assert_close(a, b, atol=1e-13)


def test_a_law_about_another_angle_is_the_same_law():
    p = wheel(4.0, 5.0)
    again = rewind_springs(p.system, p.initial)
    assert_close(evaluate_torsion(again, States.one(p.initial))[0], 4.0, atol=1e-14)
    assert_close(again.torsion_wound[0], 4.0)
    rates = [accelerations(s, p.initial).Omega_dot for s in (p.system, again)]
    assert_close(*rates, atol=1e-13)


STARTS = [(0, 4.0, -4.0), (200, 0.0, np.radians(200)), (0, -10.0, 10.0)]
MJCF = """<mujoco><option gravity="0 0 0"/><worldbody><body>
<joint name="pin" axis="0 0 1" stiffness="1" springref="{}"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("springref", "qpos", "expected"), [(0, 4.0, -4.0), (200, 0.0, np.radians(200)), (0, -10.0, 10.0)]
)
def test_a_hinge_of_mjcf_keeps_its_turns(tmp_path, springref, qpos, expected):
    """And MuJoCo, whose own coordinate counts them, is judged right."""
    pytest.importorskip("mujoco", reason="mujoco is an optional extra: make test-engines")
    path = tmp_path / f"spring{springref}_{abs(qpos):.0f}.xml"
    path.write_text(MJCF.format(springref))
    p = make_problem(str(path), {"qpos": str(qpos), "qvel": "5", "t_end": 3.0})
    assert_close(accelerations(p.system, p.initial).Omega_dot[0, 2], expected)
    for solver, setting in (("mujoco", {"dt": 1e-3}), ("rkmk_dop853", {"rtol": 1e-9})):
        run = solve(p, solver, **setting)
        rest = np.radians(springref)
        last = -(qpos - rest) * np.sin(3.0) + 5.0 * np.cos(3.0)
        assert run.record.status == "success"
        assert_close(run.trajectory.states.Omega[-1, 0, 2], last, atol=1e-7)


@pytest.mark.beyond_core
def test_a_joint_of_sdformat_keeps_the_turns_of_its_spring(tmp_path):
    """A reference of 4 rad pulls forwards by 4 k, not backwards by 2.28 k."""
    path = tmp_path / "wound.sdf"
    path.write_text("""<sdf version="1.7"><model name="m"><link name="wheel"/><joint name="pin" type="revolute">
    <parent>world</parent><child>wheel</child><axis><xyz>0 0 1</xyz><dynamics><spring_stiffness>3</spring_stiffness>
    <spring_reference>4</spring_reference></dynamics></axis></joint></model></sdf>""")
    p = make_problem(str(path))
    assert_close(accelerations(p.system, p.initial).Omega_dot[0, 2], 12.0)
