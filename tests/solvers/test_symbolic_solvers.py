"""The symbolic route alone: its forms, Jacobians, norms and charts, what it refuses, and how it fails."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.base.generated import Program
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics import motion, so3
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import RigidBody, assemble
from mbsbench.harness.mechanics.types import Problem, Status, StepControl
from mbsbench.solvers.formulations import ida, sundials
from mbsbench.solvers.formulations.recording import Clock, StepFailure
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import solve_run

from .runs import SYMBOLIC, drift, error, pendulum

every_solver = pytest.mark.parametrize("solver", SYMBOLIC)


def test_the_mass_matrix_form_costs_jacobians_where_the_mass_depends_on_the_state():
    """d(E y')/dy is left out of Newton's matrix: the same motion to 1e-6 m, more evaluations in Euler angles.

    At Euler angles E depends on the angles; the solver with the exact matrix is the same formula on the same residual.
    """
    p, made = pendulum(4.0), {}
    for form in ("unknown", "mass_matrix"):
        made[form] = solve_run(p, 1e-9, "ndf_index1", accelerations=form, coordinates="euler313")
    assert abs(error(p, made["mass_matrix"]) - error(p, made["unknown"])) < 1e-6
    assert made["mass_matrix"].counters["linear_solves"] > made["unknown"].counters["linear_solves"]


def test_baumgarte_keeps_what_plain_index_1_loses():
    """phi grows quadratically without stabilisation and stays at the tolerance with it."""
    p = pendulum(20.0)
    phi = {}
    for stabilised in (0.0, 5.0):
        t = solve_run(p, 1e-6, "ida_index1", alpha=stabilised, beta=stabilised)
        phi[stabilised] = np.linalg.norm(motion.constraint(p.system, t.states), axis=1)[-1]
    assert phi[5.0] < 1e-5 < phi[0.0]


@pytest.mark.parametrize("solver", SYMBOLIC[1:])
def test_either_jacobian_gives_the_same_motion(solver):
    """A Jacobian decides how Newton's iteration converges, not where to: steps and motion agree within the tolerance.

    The evaluations spent on differences are counted, and are part of the evaluations.
    """
    p = pendulum(2.0)
    exact, differenced = (solve_run(p, 1e-7, solver, jacobian=j) for j in ("exact", "finite_difference"))
    errors = error(p, exact), error(p, differenced)
    assert max(errors) < 3.0 * min(errors)  # IDA's steps are chosen by what Newton's test leaves, too
    assert differenced.counters["steps"] == pytest.approx(exact.counters["steps"], rel=0.1)
    spent = differenced.counters["difference_evaluations"]
    assert exact.counters["difference_evaluations"] == 0 < spent < differenced.counters["evaluations"]


@pytest.mark.parametrize("coordinates", ["quaternion", "euler313"])
@pytest.mark.parametrize("rtol", [1e-5, 1e-7])
def test_the_stabilised_index_2_keeps_both_levels_and_more_energy_than_index_3(rtol, coordinates):
    """phi = 0 and A u = 0 are rows of their own: both hold to Newton's error, some tolerances; index 3 has phi alone.

    So index 3 loses velocity out of the joint and with it energy, ten times more of each.
    """
    p, kept = pendulum(4.0), {}
    for solver in ("ida_index2", "ida_index3"):
        t = solve_run(p, rtol, solver, coordinates=coordinates)
        norms = [np.max(np.abs(f(p.system, t.states))) for f in (motion.constraint, motion.constraint_rate)]
        kept[solver] = (*norms, np.max(np.abs(drift(p, t))))
    (phi, phi_dot, lost), (_, phi_dot_3, lost_3) = kept["ida_index2"], kept["ida_index3"]
    assert phi < 10.0 * rtol and phi_dot < 20.0 * rtol
    assert 10.0 * phi_dot < phi_dot_3 and 10.0 * lost < lost_3


def test_phi_decays_at_the_rate_of_velocity_level_baumgarte():
    """A u + alpha phi = 0 is phi_dot = -alpha phi: from an open joint with that velocity, phi0 exp(-alpha t)."""
    alpha, p = 4.0, pendulum(1.0)
    apart = State(p.initial.r + 0.02, p.initial.R, p.initial.v - alpha * 0.02, p.initial.Omega)
    t = solve_run(replace(p, initial=apart), 1e-8, "ida_index2", form="velocity", alpha=alpha)
    expected = np.broadcast_to(0.02 * np.exp(-alpha * t.t)[:, None], (len(t.t), 3))
    np.testing.assert_allclose(motion.constraint(p.system, t.states), expected, atol=1e-6)


def spinning_beside(idle: int) -> Problem:
    """One unsymmetric free body in rotation, and ``idle`` bodies at rest."""
    n = 1 + idle
    system = assemble([RigidBody(1.0, np.diag([1.0, 2.0, 2.5]))] * n)
    Omega = np.zeros((n, 3))
    Omega[0] = 1.0, 2.0, 3.0
    start = State(np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), Omega)
    return Problem("free_bodies", system, start, t_end=2.0, dt=0.1, section="", source="")


def test_bodies_at_rest_dilute_the_root_mean_square_not_the_maximum():
    """Of 26 bodies one turns: its error in the mean is sqrt(26) times smaller, in the maximum it is what it was."""
    steps = {
        (norm, idle): solve_run(spinning_beside(idle), 1e-7, "ndf_index1", norm=norm).counters["steps"]
        for norm in ("rms", "max")
        for idle in (0, 25)
    }
    assert steps["max", 25] == pytest.approx(steps["max", 0], abs=2)  # the first step is chosen in the mean
    assert steps["rms", 25] < 0.9 * steps["rms", 0]
    assert steps["rms", 0] < steps["max", 0]


def free_body(theta: float, Omega: tuple[float, float, float]) -> Problem:
    """A symmetric body in free rotation from 3-1-3 angles (0, theta, 0)."""
    system = assemble([RigidBody(1.0, np.eye(3))])
    rest = np.zeros((1, 3))
    start = State(rest, so3.euler313(0.0, theta, 0.0)[None], rest, np.array([Omega]))
    return Problem("free_body", system, start, t_end=3.0, dt=0.1, section="", source="")


@every_solver
def test_a_fixed_step_is_refused_in_words(solver):
    """Error control takes rtol; solve() then hands back the start alone."""
    p, control = make_problem("heavy_top"), StepControl(dt=1e-3)
    made = make_solver(solver)
    assert "rtol" in made.refuses(p, control)
    t = made.solve(p, control)
    assert t.status is Status.REFUSED and len(t.t) == 1 and "rtol" in t.message


@every_solver
def test_a_start_on_the_charts_singularity_is_refused(solver):
    """At theta = 0 precession and spin cannot be told apart: 3-1-3 angles have no rates there, quaternions do."""
    p, control = free_body(0.0, (0.1, 0.2, 0.3)), StepControl(rtol=1e-6)
    assert "sin(theta)" in make_solver(solver, {"coordinates": "euler313"}).refuses(p, control)
    t = make_solver(solver).solve(p, control)
    assert t.status is Status.SUCCESS, t.message


@pytest.mark.parametrize("solver", ["rk45_strong_form", "ndf_index1", "ida_index1"])
def test_steps_shrink_near_the_charts_singularity_only(solver):
    """A body in free rotation passes theta = 0.02 and its angles jump there, which quaternions do not notice."""
    p = free_body(0.5, (-1.0, 0.02, 0.0))
    angles = make_solver(solver, {"coordinates": "euler313"}).solve(p, StepControl(rtol=1e-6))
    quaternions = make_solver(solver).solve(p, StepControl(rtol=1e-6))
    near = np.argmin(angles.diagnostics["chart_margin"])
    assert angles.diagnostics["chart_margin"][near] < 0.05
    assert np.abs(angles.t[near] - 0.5) < 0.05
    here, there = np.diff(angles.t)[near - 1], np.diff(quaternions.t)[np.searchsorted(quaternions.t, 0.5) - 1]
    assert here < 0.2 * there


@every_solver
def test_redundant_rows_are_refused_on_request(solver):
    """One cell of the grid has 14 redundant rows of 20: named in the refusal, dropped by default with a note."""
    p = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.01})
    control = StepControl(rtol=1e-5)
    rank = make_solver(solver, {"redundancy": "refuse"}).refuses(p, control)
    assert "rank" in rank and "drop" in rank
    t = make_solver(solver).solve(p, control)
    assert t.status is Status.SUCCESS, t.message
    assert t.notes[0].startswith("dropped ")
    dropped = [int(row) for row in t.notes[0].split(": ")[1].split(",")]
    assert_each(t.reaction[:, dropped], "==", 0.0)


@every_solver
def test_the_clock_is_looked_at_inside_a_step(solver, monkeypatch):
    """A step near a singular pose may take any number of evaluations: the CPU limit ends it inside.

    IDA's residuals look at a deadline of their own, at every 16th; here it has come when the first is evaluated.
    """
    looks = 0

    def check(clock: Clock) -> None:
        nonlocal looks
        looks += 1
        if looks > 400:
            raise StepFailure(Status.STALLED, "the CPU limit was reached")

    monkeypatch.setattr(Clock, "check", check)
    monkeypatch.setattr(Clock, "cpu_left", lambda clock: 0.0)
    problem = make_problem("n_four_bar", {"windows": 2, "t_end": 10.0})
    t = make_solver(solver).solve(problem, StepControl(rtol=1e-6, cpu_limit=100.0))
    assert t.status is Status.STALLED and "CPU limit" in t.message
    assert 0 < t.counters["evaluations"] <= looks + t.counters.get("difference_evaluations", 0)


@pytest.mark.parametrize("form", ["fi", "se"])
def test_dense_banded_and_sparse_matrices_give_one_motion(form, monkeypatch):
    """The slider-crank's 56 unknowns in each: equal steps, and positions to rounding times what IDA makes of it.

    The band of form se is nearly full, so that its room for pivoting is wider than the matrix.
    """
    problem, runs = make_problem("slider_crank", {"t_end": 0.02}), []
    for dense_below, band_work in ((1000, 2e7), (0, 2e7), (0, 0.0)):
        monkeypatch.setattr(ida, "DENSE_BELOW", dense_below)
        monkeypatch.setattr(ida, "BAND_WORK", band_work)
        runs.append(solve_run(problem, 1e-6, "ida_index1", form=form))
    for other in runs[1:]:
        assert len(other.t) == len(runs[0].t)
        assert np.max(np.abs(other.states.r - runs[0].states.r)) < 1e-9


def test_lambda_in_the_error_test_stalls_the_fully_implicit_form():
    """The noise of u' in lambda drives the step down: 10,000 steps do not bring the top to 0.3 s."""
    p, control = make_problem("heavy_top", {"t_end": 0.3}), StepControl(rtol=1e-8, max_steps=10_000)
    inside = make_solver("ida_index1", {"lambda_in_error_test": True}).solve(p, control)
    outside = make_solver("ida_index1").solve(p, control)
    assert inside.status is Status.STALLED and inside.t[-1] < 0.3
    assert outside.status is Status.SUCCESS and len(outside.t) < 2000


def test_lambda_zero_at_the_start_fails_the_first_step_when_lambda_is_tested():
    """The jump to the true lambda does not shrink with the step, so no step is small enough."""
    options = {"consistent_start": False, "lambda_in_error_test": True}
    t = make_solver("ida_index1", options).solve(make_problem("heavy_top"), StepControl(rtol=1e-6))
    assert t.status is Status.STEP_UNDERFLOW and len(t.t) == 1 and "IDA" in t.message


ALIGNED: dict[str, Any] = {"rows": 2, "columns": 1, "release": "all_rows", "rate": 5.0, "t_end": 4.0}


def test_a_run_that_loses_its_rows_says_so():
    """It swings through aligned bars, where all rows together lose rank: the run ends there in words."""
    t = make_solver("ndf_index1").solve(make_problem("four_bar_grid", ALIGNED), StepControl(rtol=1e-8))
    assert t.status in (Status.SINGULAR, Status.DIVERGED)
    assert "came apart" in t.message or "dependent" in t.message
    assert 0.5 < t.t[-1] < 4.0


def test_a_run_that_steps_over_aligned_bars_stays_on_a_motion_of_the_mechanism():
    """Where two motions fork, the run goes on along one of them: joints are kept as the tolerance asks.

    Energy is kept less well: forces grow without bound towards the fork, and rounding decides how near to it a step
    ends. Tolerances that differ by 1e-13 of themselves give 3e-4 to 5e-3 at 1e-6, and 3e-5 to 3e-4 at 1e-8.
    """
    p = make_problem("four_bar_grid", ALIGNED)
    gaps = []
    for rtol, kept in ((1e-6, 1e-2), (1e-8, 1e-3)):
        t = solve_run(p, rtol, "rk45_strong_form")
        gaps.append(np.max(np.abs(motion.constraint(p.system, t.states))))
        assert np.max(np.abs(drift(p, t))) < kept * np.max(motion.kinetic_energy(p.system, t.states))
    assert gaps[1] < 0.1 * gaps[0] < 1e-4


@pytest.mark.parametrize(
    "name", ["N_VMake_Serial", "SUNDenseMatrix", "SUNBandMatrix", "SUNSparseMatrix", "SUNLinSol_Dense", "IDACreate"]
)
def test_sundials_without_memory_raises(name, monkeypatch):
    """NULL from a function that allocates is no address to go on with: the run ends with status memory, not a crash."""
    known = sundials._function
    monkeypatch.setattr(sundials, "_function", lambda asked: (lambda *a: None) if asked == name else known(asked))
    n = np.zeros(3)
    jacobian = lambda cj: np.ones(3)  # noqa: E731
    equations = sundials.IdaEquations(Program.__new__(Program), n[:1], n, n, n, jacobian, np.arange(3), np.arange(3))
    kind = next((k for k in ("dense", "band", "sparse") if k in name.lower()), "dense")
    with pytest.raises(MemoryError, match=name):
        sundials.Ida(equations, kind, rtol=1e-6, atol=n, first_step=0.0, max_step=1.0, seconds=None)
