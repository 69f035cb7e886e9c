"""Laws that a user writes: the same on all routes, in all presentations, in the balance of energy."""

import math
from functools import cache

import numpy as np
import pytest
from jaxtyping import Float

from mbsbench.harness.catalogue.registry import in_frame, make_solver
from mbsbench.harness.foreign.description import describe_problem
from mbsbench.harness.mechanics import motion, so3, work
from mbsbench.harness.mechanics.consistency import project
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import Joint, MultibodySystem, RigidBody, assemble
from mbsbench.harness.mechanics.user_forces import UserForce
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory
from mbsbench.problems.random_mechanism import arbitrary_body
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, start_at
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.start import Accelerations, coordinates_and_velocities

from ...solvers.arbitrary_systems import arbitrary

Rows = Float[np.ndarray, "2 3"]
T_END = 0.2  # [s]


def law(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """All arguments, no symmetry, no action = reaction."""
    stretch = np.sqrt(1.0 + (r[0, 0] - r[1, 0]) ** 2 + (r[0, 1] - r[1, 1]) ** 2 + (r[0, 2] - r[1, 2]) ** 2)
    for k in range(3):
        F[0, k] = -3.0 * stretch * (r[0, k] - r[1, k]) - 0.4 * v[0, k] * abs(v[1, k]) + np.sin(2.0 * t + k)
        F[1, k] = 2.0 * R[0, k, 0] - v[1, k]
        T[0, k] = -0.2 * Omega[0, k] + 0.3 * R[1, k, 2] * np.cos(t)
        T[1, k] = 0.5 * Omega[0, k] * Omega[1, 0] - 0.1 * R[1, k, 0]


def branched(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """A stop: nothing above the floor."""
    if r[0, 2] < 0.0:
        F[0, 2] = -100.0 * r[0, 2]


def mathematical(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """Functions of ``math``."""
    F[0, 0] = math.sin(t)


@cache
def system() -> MultibodySystem:
    """Two bodies on a chain of joints; the law between them, and between one and the ground."""
    random = np.random.default_rng(3)
    bodies = [arbitrary_body(random) for _ in range(2)]
    joints = [
        Joint(0, (0.3, 0.1, 0.0), s_j=(0.1, -0.2, 0.3)),
        Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2), (1.0, 2.0, 3.0), (0.5, -1.0, 0.2)),
    ]
    return assemble(bodies, joints, (0.3, -2.0, -9.0), user_forces=[UserForce(law, 1, 0), UserForce(law, 0)])


@cache
def problem() -> Problem:
    start = project(system(), arbitrary(system(), 3), 200)
    return Problem("user forces", system(), start, T_END, 1e-3, "", "made up")


def forces(s: MultibodySystem, state: State) -> np.ndarray:
    """(F_i, F_j, T_i, T_j) of the law as Python, twice, on the bodies, in space."""
    out = np.zeros((3, 2, 3))
    for i, j in ((1, 0), (0, -1)):
        ends = [(a[i], a[j] if j >= 0 else 0.0 * a[i]) for a in (state.r, state.v, state.Omega)]
        r, v, Omega = (np.array(two) for two in ends)
        R, F, T = np.array([state.R[i], state.R[j] if j >= 0 else np.eye(3)]), np.zeros((2, 3)), np.zeros((2, 3))
        law(state.t, r, R, v, Omega, F, T)
        for e, b in enumerate((i, j)):
            out[b] += F[e], T[e]
    return out[:2]


def at(seed: int) -> State:
    s = arbitrary(system(), seed)
    return State(s.r, s.R, s.v, s.Omega, 0.4 + seed)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_applied_is_the_law(seed: int) -> None:
    """Compiled and called by address, or as Python: force in space, torque in the body."""
    state = at(seed)
    found = motion.applied(system(), States.one(state))[0]
    F, T = np.swapaxes(forces(system(), state), 0, 1)
    assert np.max(np.abs(found[:, :3] - F - system().mass[:, None] * system().gravity)) < 1e-12
    assert np.max(np.abs(found[:, 3:] - np.einsum("bij,bi->bj", state.R, T))) < 1e-12
    omega = np.einsum("bij,bj->bi", state.R, state.Omega)
    assert work.power(system(), States.one(state))[0] == pytest.approx(np.sum(F * state.v + T * omega), rel=1e-12)


@pytest.mark.parametrize("coordinates", CHARTS)
@pytest.mark.parametrize("seed", range(3))
def test_both_routes_give_one_acceleration(coordinates: str, seed: int) -> None:
    """The kernel with the compiled law, and CasADi with the law run on symbols."""
    state = at(seed)
    layout = Layout(system(), CHARTS[coordinates], np.arange(system().nrows))
    p = Problem("user forces", system(), state, 1.0, 1e-3, "", "made up")
    y = coordinates_and_velocities(layout, p)
    accelerations = Accelerations(layout)
    u_dot, _ = accelerations.at(y, state.t)
    made = make_kernel(system(), ("accelerate",))
    start_at(made.kernel, state)
    made.entry("accelerate")()
    exact = made.kernel.v_dot
    if coordinates == "quaternion":  # there u is V
        assert np.max(np.abs(u_dot.reshape(2, 6) - exact)) < 1e-9 * np.max(np.abs(u_dot))
    ahead, behind = (y[layout.u] + h * u_dot for h in (1e-6, -1e-6))
    rates = [(layout.p, accelerations.rate(y))]
    V = [
        layout.chart.states((y[layout.p] + h * rates[0][1]).reshape(1, 2, -1), u.reshape(1, 2, 6))
        for h, u in ((1e-6, ahead), (-1e-6, behind))
    ]
    v_dot = np.concatenate([(V[0].v - V[1].v)[0], (V[0].Omega - V[1].Omega)[0]], axis=1) / 2e-6
    assert np.max(np.abs(v_dot - exact)) < 1e-6 * np.max(np.abs(exact))


@pytest.mark.parametrize(
    "given", [{"mirror": "X"}, {"renumber": 2}, {"unit_length": 100.0, "unit_mass": 0.2, "unit_time": 7.0}]
)
def test_a_presentation_changes_no_power(given: dict) -> None:
    """The law is presented with the bodies: mirrored, renumbered, in other units."""
    asked, state = Presentation(**given), at(4)
    shown, there = asked.system(system()), asked.state(system(), state)
    unit = asked.force * asked.unit_length / asked.unit_time
    P = work.power(system(), States.one(state))[0]
    assert work.power(shown, States.one(there))[0] == pytest.approx(P * unit, rel=1e-11)


def test_a_turned_frame_turns_the_law() -> None:
    """The power stays when everything is turned."""
    state = at(5)
    p = Problem("user forces", system(), state, 1.0, 1e-3, "", "made up")
    q = in_frame(p, so3.exp(np.array([0.3, -0.2, 0.5])))
    turned = States(*(getattr(States.one(q.initial), n) for n in ("r", "R", "v", "Omega")), np.array([state.t]))
    P = work.power(system(), States.one(state))[0]
    assert work.power(q.system, turned)[0] == pytest.approx(P, rel=1e-12)


@cache
def run(name: str, **control: float) -> Trajectory:
    out = make_solver(name).solve(problem(), StepControl(**control))
    assert out.status == Status.SUCCESS, out.message
    return out


def off(out: Trajectory) -> float:
    return float(np.max(np.abs(out.states.r[-1] - run("rkmk_dop853", rtol=1e-12).states.r[-1])))


@pytest.mark.parametrize("name", ["gc_weak_form", "gc_augmented_lagrangian", "rattle", "half_explicit"])
def test_fixed_steps_converge_with_their_order(name: str) -> None:
    """A force of velocity and time lowers no order."""
    solver = make_solver(name)
    size = [off(run(name, dt=dt)) for dt in (4e-3, 2e-3)]
    assert np.log2(size[0] / size[1]) == pytest.approx(solver.order, abs=0.2)


@pytest.mark.parametrize("name", ["radau_ggl", "ida_index2", "radau_index1", "rk45_strong_form"])
def test_error_control_holds_its_tolerance(name: str) -> None:
    """A thousand tolerances at most."""
    assert off(run(name, rtol=1e-9)) < 1e-6


def test_energy_less_the_work_of_the_law_is_kept() -> None:
    """E - E(0) - W along DOP853."""
    out = run("rkmk_dop853", rtol=1e-12)
    states = out.states.timed(out.t)
    E = motion.energy(system(), states)
    drift = E - E[0]
    assert np.max(np.abs(drift)) > 0.1
    assert np.max(np.abs(drift - work.work(system(), out.t, states, E)[0])) < 1e-6 * np.max(np.abs(drift))


@pytest.mark.parametrize("name", ["gc_weak_form", "gc_augmented_lagrangian"])
def test_the_newton_matrix_knows_the_law(name: str) -> None:
    """With the derivatives of the law, Newton's method takes three corrections a step of 4 ms on average, at most."""
    out = make_solver(name, {"newton": "exact"}).solve(problem(), StepControl(dt=4e-3))
    assert out.counters["newton_iterations"] <= 3 * out.counters["steps"]


@pytest.mark.parametrize(
    ("own", "said"), [(branched, ": it branches on the state; "), (mathematical, "user force 0 symbolically")]
)
def test_a_law_that_is_no_expression_is_refused_by_symbols_and_taken_by_kernels(own, said: str) -> None:  # type: ignore[no-untyped-def]
    """With the reason, before the first step."""
    ball = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(own, 0)])
    start = State(np.zeros((1, 3)), np.eye(3)[None], np.array([[0.0, 0.0, -1.0]]), np.zeros((1, 3)))
    p = Problem("a stop", ball, start, 0.5, 1e-3, "", "made up")
    assert said in (make_solver("radau_index1").refuses(p, StepControl(rtol=1e-6)) or "")
    out = make_solver("rkmk_dopri5").solve(p, StepControl(rtol=1e-8))
    assert out.status == Status.SUCCESS
    if own is branched:  # half a period of 0.63 s on the floor, then up at the speed of the fall
        assert out.states.v[-1, 0, 2] == pytest.approx(1.0, abs=1e-5)


def divided(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """An error of Python's at t = 0.1 s."""
    F[0, 0] = 1.0 / (0.0 if t > 0.1 else 1.0)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # the error, as C prints it
def test_a_law_that_raises_an_error_ends_the_run() -> None:
    """Not with zeros in its place, which would look like a success."""
    ball = assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(divided, 0)])
    at_rest = State(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    p = Problem("an error", ball, at_rest, 0.5, 1e-3, "", "made up")
    out = make_solver("rattle").solve(p, StepControl(dt=1e-2))
    assert out.status == Status.DIVERGED
    assert 0.05 < out.t[-1] < 0.15


def test_what_cannot_take_a_law_says_so() -> None:
    """A method of discrete gradients, the simplified step alone, a file, a law that does not compile."""
    for name, control in (("energy_momentum", StepControl(dt=1e-3)), ("gc_composed", StepControl(dt=1e-3))):
        assert make_solver(name).refuses(problem(), control)
    with pytest.raises(ValueError, match="user forces, which are code"):
        describe_problem(problem())


def imports(t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
    """Bytecode that Numba has no translation of."""
    import math as own

    F[0, 0] = own.sin(t)


class Bound:
    """A law as a method."""

    def law(self, t: float, r: Rows, R: Float[np.ndarray, "2 3 3"], v: Rows, Omega: Rows, F: Rows, T: Rows) -> None:
        F[0, 0] = t


@pytest.mark.parametrize(
    "own", [lambda t: None, 1, None, "abc", [], abs, np.sin, math.sin, Bound().law, Bound, imports]
)
def test_what_is_no_law_is_refused_by_its_number(own) -> None:  # type: ignore[no-untyped-def]
    """Whatever it is, and whatever error Numba ends with."""
    with pytest.raises(ValueError, match="user force 1: numba does not compile law"):
        assemble([RigidBody(1.0, np.eye(3))], user_forces=[UserForce(law, 0), UserForce(own, 0)])
