"""Solvers from one function: those on the page do what it says, and wrong ones are answered in one line."""

import math
import re
from typing import Annotated

import numpy as np
import pytest

import mbsbench
from mbsbench import (
    Parameter,
    Rates,
    State,
    States,
    StepFailed,
    accelerations,
    advance,
    equations,
    make_problem,
    project,
    rhs,
    solve,
    step,
)
from mbsbench.harness.judge.conformance import trials
from mbsbench.harness.mechanics import motion
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.results.work import count_index_1_evaluations

PAGE = (ROOT / "docs" / "your-own-solver.md").read_text(encoding="utf-8")
MIDPOINT, BAUMGARTE = re.findall(r"```python\n(.*?)```", PAGE, flags=re.S)


def made(text: str, name: str) -> type:
    """The object that the code on the page defines under ``name``."""
    names: dict = {"__name__": f"page_{name}"}
    exec(text, names)
    return names[name]


def test_the_page_s_solver_is_of_second_order():
    """Halving dt divides the error by four."""
    midpoint = made(MIDPOINT, "midpoint")
    coarse, fine = (solve("heavy_top", midpoint, dt=dt, t_end=0.1).record for dt in (2e-3, 1e-3))
    assert fine.status == "success" and fine.declared_order == 2.0 and fine.steps == 100
    assert math.log2(coarse.position_error_max_m / fine.position_error_max_m) == pytest.approx(2.0, abs=0.2)
    assert fine.reaction_error_max_N < 0.01 * fine.reaction_size_N


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_the_page_s_rhs_follows_its_tolerance(method):
    """Two decades of rtol; joints open by what the tolerance allows, no more."""
    baumgarte = made(BAUMGARTE, "baumgarte")
    loose, tight = (
        solve("spherical_pendulum", baumgarte, rtol=r, t_end=0.3, method=method).record for r in (1e-5, 1e-8)
    )
    assert tight.status == "success" and tight.evaluations > tight.steps
    assert tight.position_error_max_m < 0.1 * loose.position_error_max_m < 1e-3
    assert tight.reaction_error_max_N < 1e-4 * tight.reaction_size_N


def test_keywords_are_options():
    """With unit and limits, as those of a problem."""

    @step("lagging")
    def lagging(system, state, dt, *, share: Annotated[float, Parameter("of the step", at_most=1.0)] = 1.0):
        """Free fall."""
        return advance(state, accelerations(system, state), share * dt)

    run = solve("torque_free_body", lagging, dt=0.01, t_end=0.1, share=0.5)
    assert run.record.solver_options == '{"share": 0.5}'
    with pytest.raises(ValueError, match="share must be <= 1"):
        solve("torque_free_body", lagging, dt=0.01, share=2.0)


def test_what_goes_wrong_in_a_function_is_a_status_or_names_it():
    """A state that is not finite diverges with the steps so far; something else than a state is a bug."""

    @step("explodes")
    def explodes(system, state, dt):
        return advance(state, accelerations(system, state), math.inf if state.r[0, 0] != 0.0 else dt)

    @step("forgets")
    def forgets(system, state, dt):
        advance(state, accelerations(system, state), dt)

    with np.errstate(all="ignore"):
        run = solve("spherical_pendulum", explodes, dt=0.01, t_end=0.1)
    assert run.status == "diverged" and "t = 0 s" in run.record.message
    with pytest.raises(TypeError, match="a step must return a State"):
        solve("spherical_pendulum", forgets, dt=0.01, t_end=0.1)

    @rhs("refusing", refuses=lambda system, state: "one body is too few")
    def refusing(system, state):
        return accelerations(system, state)

    assert solve("heavy_top", refusing).record.message == "one body is too few"


def test_a_step_that_cannot_go_on_says_why():
    """A failure of the method is no fault of the program: ``diverged``, with the steps so far and its words."""

    @step("cannot_go_on")
    def cannot_go_on(system, state, dt):
        if state.t > 0.045:
            raise StepFailed("Newton does not converge in 50 iterations")
        return advance(state, accelerations(system, state), dt)

    run = solve("spherical_pendulum", cannot_go_on, dt=0.01, t_end=0.1)
    assert (run.status, run.record.steps) == ("diverged", 5)
    assert run.record.message == "stopped at t = 0.05 s: Newton does not converge in 50 iterations"


def test_a_singular_matrix_names_redundant_rows_where_there_are_any():
    """The saddle-point matrix of a grid is singular, whatever the step: rows, rank and both remedies are named."""

    @step("by_saddle")
    def by_saddle(system, state, dt):
        e = equations(system, state)
        M = np.kron(np.eye(system.nb), np.ones((6, 6)))
        M[M != 0] = e.M.ravel()
        x = np.linalg.solve(
            np.block([[M, -e.A.T], [e.A, np.zeros((len(e.A), len(e.A)))]]), np.concatenate((e.f.ravel(), -e.A_dot_v))
        )
        a = x[: 6 * system.nb].reshape(-1, 6)
        return advance(state, Rates(state.v, state.Omega, a[:, :3], a[:, 3:], x[6 * system.nb :]), dt)

    words = "four_bar_grid has redundant rows (20 rows of rank 17): solve by least squares (numpy.linalg.lstsq)"
    grid = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.1})
    run = solve(grid, by_saddle, dt=0.05)
    assert run.status == "diverged" and f"Singular matrix: {words}" in run.record.message
    assert solve("heavy_top", by_saddle, dt=1e-4, t_end=1e-3).record.steps == 10
    evidence = trials.Evidence("dt", math.nan, {"easy revolute": run.record}, {})
    assert words in trials.check_endings(evidence).remedy


@pytest.mark.parametrize("dropped", ["a stage", "the end"])
def test_a_state_without_its_time_is_named(dropped):
    """Drives would stand still, and loads be those of the start."""

    def forget(s):
        return State(s.r, s.R, s.v, s.Omega)

    @step("forgets_time")
    def forgets_time(system, state, dt):
        half = advance(state, accelerations(system, state), dt / 2)
        half = forget(half) if dropped == "a stage" else half
        end = advance(state, accelerations(system, half), dt)
        return forget(end) if dropped == "the end" else end

    with pytest.raises(ValueError, match=r"t = 0 s.*pass the time on: State\(r, R, v, Omega, t\)"):
        solve("heavy_top", forgets_time, dt=1e-3, t_end=0.01)

    @rhs("forgets_time_too")
    def forgets_time_too(system, state):
        return accelerations(system, forget(state))

    with pytest.raises(ValueError, match="pass the time on"):
        solve("heavy_top", forgets_time_too, rtol=1e-4, t_end=0.01)


def test_project_and_scipy_are_public():
    """A start pushed off its joints is brought back; a method of scipy has the strong form's accuracy."""
    p = make_problem("heavy_top")
    off = State(p.initial.r + 1e-3, p.initial.R, p.initial.v + 1e-3, p.initial.Omega)
    back = States.one(project(p.system, off))
    assert max(np.max(np.abs(f(p.system, back))) for f in (motion.constraint, motion.constraint_rate)) < 1e-12
    run = solve("spherical_pendulum", mbsbench.scipy("BDF"), rtol=1e-7, t_end=0.2)
    assert run.status == "success" and run.record.position_error_max_m < 1e-4


def test_calls_of_accelerations_are_counted():
    """Three a step of the page's solver; those of scipy and one for each recorded reaction under error control."""
    record = solve("spherical_pendulum", made(MIDPOINT, "midpoint"), dt=0.02, t_end=0.1).record
    assert (record.evaluations, record.factorisations) == (15.0, 15.0)

    @rhs("counted_rates")
    def rates(system, state):
        """Index 1."""
        return accelerations(system, state)

    run = solve("spherical_pendulum", rates, rtol=1e-6, t_end=0.1).record
    assert run.evaluations == run.factorisations > run.steps
    assert count_index_1_evaluations(run) == run.evaluations


def test_one_unit_of_work_for_all_solvers():
    """A factorised evaluation is one, one without is half, and who counts no factorisations makes one an evaluation."""
    of = {"newton_iterations": 10.0, "factorisations": 2.0}
    assert count_index_1_evaluations(RunRecord(**of)) == 2.0 + 0.5 * 8.0
    assert count_index_1_evaluations(RunRecord(evaluations=7.0)) == 7.0
    assert count_index_1_evaluations(RunRecord(evaluations=7.0, factorisations=7.0)) == 7.0
