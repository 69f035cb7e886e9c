"""Energy laws of driven and damped systems: what enters and leaves is known as well as the motion, or not judged."""

import dataclasses
import json

import numpy as np
import pytest

from mbsbench import State, States, TimeFunction, api, so3
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.mechanics.system import GROUND, Joint, Load, RigidBody, TorsionSpring, assemble
from mbsbench.harness.mechanics.types import Law, Problem, Status, Trajectory
from mbsbench.harness.mechanics.work import compute_work
from mbsbench.tests.comparing import assert_each

from .judged import claimed, judge

J, K, C = 0.02, 5.0, 0.002  # [kg m2], [N m/rad], [N m s]
X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@pytest.fixture(autouse=True)
def no_computed_reference(monkeypatch):
    """Laws of energy need none, and that of a torque of 1e6 rad/s takes a minute."""
    monkeypatch.setattr("mbsbench.harness.judge.metrics.measure.find_reference", Problem.reference)


def discs(count: int, spin: float, t_end: float, **parts) -> Problem:
    """Hinged to the ground beside each other; the first one spins."""
    bodies = [RigidBody(1.0, J * np.eye(3)) for _ in range(count)]
    hinges = [Joint(k, (0, 0, 0), GROUND, (1.0 * k, 0, 0), Z, Z) for k in range(count)]
    r, Omega = np.outer(np.arange(count), X), np.outer(np.arange(count) == 0, (0.0, 0.0, spin))
    start = State(r, np.array([np.eye(3)] * count), np.zeros((count, 3)), Omega)
    return Problem("discs", assemble(bodies, hinges, **parts), start, t_end, 1e-3, "", "")


def about_z(problem: Problem, t: np.ndarray, angle: np.ndarray, rate: np.ndarray) -> Trajectory:
    """All discs at ``angle`` and ``rate`` (nt, nb)."""
    zero, places = np.zeros((*angle.shape, 3)), np.broadcast_to(problem.initial.r, (*angle.shape, 3))
    R = so3.exp(angle[..., None] * Z)
    return claimed(t, States(places, R, zero, rate[..., None] * np.array(Z)))


@pytest.mark.parametrize(
    ("solver", "steps"),
    [
        ("rkmk_dop853", {"rtol": 1e-9}),
        ("rkmk_dop853", {"rtol": 1e-6}),
        ("ida_index1", {"rtol": 1e-6}),
        ("rattle", {"dt": 1e-3}),
        ("gc_weak_form", {"dt": 1e-3}),
        ("lie_variational", {"dt": 1e-3}),
    ],
)
def test_discs_coupled_by_a_torsion_spring_alone_are_one_mechanism(solver, steps):
    """theta_1 - theta_2 = (3/w) sin wt, w^2 = 2 k/J, the mean angle 3 t / 2: each disc alone keeps no energy."""
    run = api.solve(discs(2, 3.0, 2.0, torsions=[TorsionSpring(0, X, 1, Z, X, stiffness=K)]), solver, **steps)
    w, t = np.sqrt(2.0 * K / J), run.trajectory.t
    exact = 1.5 + 1.5 * np.cos(w * t)
    assert np.max(np.abs(run.trajectory.states.Omega[:, 0, 2] - exact)) < 0.02
    assert run.status is Status.SUCCESS, run.record.wrong_because


def braked(
    steps: int, torque: float = 0.0, frequency: float = 0.0, lost: float = 0.0, t_end: float = 10.0
) -> tuple[Problem, Trajectory]:
    """J w' = -C w + torque sin(frequency t) from 100 rad/s, exactly, at a few times; ``lost``: a part of the speed."""
    loads = [Load(0, torque=(0, 0, torque), factor=TimeFunction(amplitude=1.0, frequency=frequency))] if torque else []
    brake = [TorsionSpring(0, X, GROUND, Z, X, damping=C)]
    problem = discs(1, 100.0, t_end, torsions=brake, loads=loads)
    t, rate, a = np.linspace(0.0, t_end, steps + 1), C / J, torque / J / ((C / J) ** 2 + frequency**2 or 1.0)
    f = frequency or 1.0
    w = (100.0 + a * f) * np.exp(-rate * t) + a * (rate * np.sin(f * t) - f * np.cos(f * t))
    turned = (100.0 + a * f) * (1.0 - np.exp(-rate * t)) / rate
    turned += a * (rate * (1.0 - np.cos(f * t)) / f - np.sin(f * t))
    return problem, about_z(problem, t, turned[:, None], (w * (1.0 - lost * t / t_end))[:, None])


@pytest.mark.parametrize(("steps", "step"), [(2, 0.15), pytest.param(16, 0.625, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("torque", "frequency"), [(0.0, 0.0), (1.0, 40.0), pytest.param(5.0, 200.0, marks=pytest.mark.slow)]
)
def test_few_exact_steps_lose_no_energy(torque, frequency, steps, step):
    """Of 0.6 s: up to 10 turns of the wheel in each, and 4 to 20 periods of a torque; of 0.15 s a quarter of that."""
    problem, exact = braked(steps, torque, frequency, t_end=steps * step)
    E = energy(problem.system, exact.states)
    done, unsure, unknown = compute_work(problem.system, exact.t, exact.states, E)
    assert_each(unknown, "==", 0.0)
    away = np.abs(E - E[0] - done)
    assert_each(away, "<=", unsure + 1e-9 * E[0])
    assert unsure[-1] < 1e-3 * E[0]
    assert not judge(problem, exact).laws


@pytest.mark.parametrize(("torque", "frequency"), [(0.0, 0.0), (1.0, 40.0)])
def test_a_real_loss_is_found_between_few_steps(torque, frequency):
    """Up to 60 % of the speed goes without a cause: more than a tenth of the energy exchanged."""
    problem, false = braked(16, torque, frequency, lost=0.6)
    assert Law.ENERGY in judge(problem, false).laws


def test_work_that_nobody_can_tell_is_not_judged_and_says_so():
    """A torque of 1e6 rad/s over steps of 0.6 s: more periods than can be followed; its error is stated."""
    problem, exact = braked(16, 1.0, 1e6)
    m, c, *_ = judge(problem, exact)
    assert m.steps_of_unknown_work == 16 and np.max(np.abs(m.energy_error)) < 1e-12 * m.energy[0]
    assert c["notes"].count("energy not judged over 16 of 16 steps") == 1


def test_energy_is_judged_anew_after_a_step_of_unknown_work():
    """The wheel is found nearly at rest at the end, long after one step that is too long to be followed."""
    problem, exact = braked(400, 1.0, 300.0)
    few = np.r_[0:20, 380:401]  # a gap of 9 s, 430 periods of the torque
    for lost, broken in ((0.0, False), (0.9, True)):
        s = exact.states.at(few)
        slower = np.where(np.arange(len(few)) > 30, 1.0 - lost, 1.0)[:, None, None]
        seen = dataclasses.replace(
            exact, t=exact.t[few], states=dataclasses.replace(s, Omega=s.Omega * slower), reaction=None
        )
        assert judge(problem, seen).m.steps_of_unknown_work == 1
        assert (Law.ENERGY in judge(problem, seen).laws) is broken


def crank(turned: float) -> Problem:
    """Driven at 2 rad/s from theta = 0, started ``turned`` [rad] away."""
    hinge = Joint(0, (0, 0, 0), GROUND, (0, 0, 0), Z, Z)
    motion = TimeFunction((0.0, 2.0))
    drive = Joint(0, (0, 0, 0), axis_i=Z, axis_j=Z, across_i=X, across_j=X, kind="driven angle", motion=motion)
    system = assemble([RigidBody(1.0, J * np.eye(3))], [hinge, drive])
    start = State(np.zeros((1, 3)), so3.exp(turned * np.array(Z))[None], np.zeros((1, 3)), np.array([[0, 0, 2.0]]))
    return Problem("crank", system, start, 2.0, 1e-3, "", "")


def welded(turned: float) -> Problem:
    """Its third row is the sine of the turn about the axis."""
    weld = Joint(0, (0, 0, 0), axis_i=Z, axis_j=Z, across_i=X, across_j=X, kind="fixed")
    system = assemble([RigidBody(1.0, J * np.eye(3))], [weld])
    start = dataclasses.replace(crank(turned).initial, Omega=np.zeros((1, 3)))
    return Problem("weld", system, start, 1.0, 0.1, "", "")


@pytest.mark.parametrize("made", [crank, welded])
def test_a_start_half_a_turn_from_a_drive_or_a_weld_is_refused(made):
    """sin(theta - f) vanishes there, too."""
    assert api.solve(made(0.0), "rkmk_dop853", rtol=1e-8).status is Status.SUCCESS
    with pytest.raises(ValueError, match="half a turn"):
        api.solve(made(np.pi), "rkmk_dop853", rtol=1e-8)


def test_a_crank_half_a_turn_from_its_drive_is_wrong():
    """A run that starts there, or jumps there, opens the joint by two units of sin, whatever its row says."""
    problem, t = crank(0.0), np.linspace(0.0, 2.0, 201)
    for off in (np.full(201, np.pi), np.where(t > 1.0, np.pi, 0.0)):
        false = about_z(problem, t, (2.0 * t + off)[:, None], np.full((201, 1), 2.0))
        assert Law.CONSTRAINT in judge(problem, false).laws
    assert not judge(problem, about_z(problem, t, (2.0 * t)[:, None], np.full((201, 1), 2.0))).laws


def test_the_record_of_a_damped_run_names_its_drift():
    """The drift itself stands in the record, not what is left of it after the error of the work."""
    run = api.solve(braked(2)[0], "rkmk_dop853", rtol=1e-9)
    assert run.status is Status.SUCCESS and run.record.energy_drift_max_J < 1e-6, json.loads(run.record.wrong_because)
