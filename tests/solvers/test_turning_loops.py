"""Loops with redundant rows over whole turns of their crank, by every solver, against the closed form of their motion.

Bennett's linkage keeps rank 17 of 20 rows, yet those that the start suggests come to depend on each other with the
crank at 180 degrees.
"""

from dataclasses import fields

import numpy as np
import pytest

from mbsbench import Status, StepControl, constraint_jacobian
from mbsbench.harness.catalogue.registry import engines, make_problem, make_solver, solvers
from mbsbench.harness.mechanics.motion import constraint, energy
from mbsbench.harness.mechanics.state import States
from mbsbench.solvers.formulations.compiled import host, mechanism
from mbsbench.solvers.formulations.compiled.kernel import make_kernel, set_state
from mbsbench.solvers.formulations.compiled.row_choice import IN_USE, NEVER, WORN
from mbsbench.tests.covering import diagonal, every

from .turning_loops import bennett, skew_crank_rocker


def takes_code(name: str) -> bool:
    of = {f.name: f.metadata for f in fields(make_solver(name))}
    return "mechanism" in str(of.get("code"))


OWN = [name for name in solvers() if name not in engines()]
REDUNDANT = [name for name in OWN if name != "gc_weak_form"]  # that one refuses redundant rows
LOOPS = {"bennett": bennett(), "skew crank and rocker": skew_crank_rocker()}
PARTS = 1000  # of a turn: a step
DRIFTING = {"rk45_strong_form", "scipy_strong_form", "cvode"}  # no stabilisation: phi is as large as the error
OFF = {"ida_index3": 2e-3, "ida_index1": 1e-5, **dict.fromkeys(DRIFTING, 1e-6)}
MOST = 2e-4  # [m] of 1.8 m, of order 2 at a thousand steps a turn; some are right to 1e-15


def control(name: str, t_end: float) -> StepControl:
    return StepControl(dt=t_end / PARTS) if make_solver(name).control == "dt" else StepControl(rtol=1e-8)


@pytest.mark.parametrize("linkage", LOOPS)
def test_closed_forms_satisfy_the_joints_at_every_angle(linkage):
    loop = LOOPS[linkage]
    problem = loop.problem(linkage)
    for angle in np.linspace(0.1, 6.2, 40):
        s = loop.at(angle)
        one = States(s.r[None], s.R[None], s.v[None], s.Omega[None])
        A = constraint_jacobian(problem.system, s).toarray()
        u = np.concatenate((s.v, s.Omega), axis=1).ravel()
        least = np.linalg.svd(A, compute_uv=False)
        assert np.max(np.abs(A @ u)) < 1e-12 and least[16] > 1e-2 and least[17] < 1e-12
        assert np.max(np.abs(constraint(problem.system, one))) < 1e-13


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "linkage"), diagonal(REDUNDANT, list(LOOPS)))
def test_a_whole_turn_ends_where_it_began(linkage, name):
    """After the period of the quadrature, with the energy and the rows of the start all the way."""
    problem = LOOPS[linkage].problem(linkage)
    out = make_solver(name).solve(problem, control(name, problem.t_end))
    assert out.status is Status.SUCCESS, out.message
    end, start, off = out.states[-1], problem.initial, OFF.get(name, MOST)
    assert np.max(np.abs(end.r - start.r)) < off and np.max(np.abs(end.R - start.R)) < 2.0 * off
    assert np.max(np.abs(end.v - start.v)) < 20.0 * off  # rates of 6 rad/s
    E = energy(problem.system, out.states)
    assert np.max(np.abs(E - E[0])) < 10.0 * off * E[0]
    assert np.max(np.abs(constraint(problem.system, out.states))) < (3.0 * off if name in DRIFTING else 1e-4)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", every([name for name in REDUNDANT if takes_code(name)], 3))
def test_a_whole_turn_by_code_of_the_mechanism_ends_where_it_began(name):
    problem = LOOPS["bennett"].problem("bennett")
    out = make_solver(name, {"code": "mechanism"}).solve(problem, control(name, problem.t_end))
    assert out.status is Status.SUCCESS, out.message
    assert any("code of the mechanism" in note for note in out.notes)
    assert np.max(np.abs(out.states.r[-1] - problem.initial.r)) < MOST
    assert np.max(np.abs(constraint(problem.system, out.states))) < 1e-4


def test_code_that_a_run_changes_to_chooses_rows_too(monkeypatch):
    monkeypatch.setattr(mechanism, "is_code_kept", lambda *_: False)
    monkeypatch.setattr(host, "EVALUATIONS_THAT_PAY", 300)
    monkeypatch.setattr(host, "STRETCH_BYTES", 0.0)
    problem = LOOPS["bennett"].problem("bennett")
    out = make_solver("rattle", {"code": "auto"}).solve(problem, control("rattle", problem.t_end))
    assert out.status is Status.SUCCESS, out.message
    assert any("code of the mechanism from t = " in note for note in out.notes)
    assert np.max(np.abs(out.states.r[-1] - problem.initial.r)) < MOST


def pivots(kernel) -> np.ndarray:
    """Of the rows kept, each as a share of its own diagonal."""
    b = kernel.blocks
    of = [(b.start[c], a, b.row[c] + a) for c in range(len(b.joint)) for a in range(b.size[c])]
    kept = np.array([(kernel.L[p, a, a], kernel.diagonal[row]) for p, a, row in of if kernel.L[p, a, a] > 0.0])
    return 1.0 / (kept[:, 0] ** 2 * kept[:, 1])


def test_rows_kept_stay_independent_all_the_way_and_rank_is_that_of_all():
    """Least pivots of the fixed order fall to 1e-7 beside 180 degrees, a step from there."""
    loop = LOOPS["bennett"]
    system = loop.problem("bennett").system
    kernel, chosen = make_kernel(system, ("rows", "factorise")), set()
    set_state(kernel, loop.at(0.9))
    kernel.rows.run()
    kernel.factorise.run()
    first = np.min(pivots(kernel))
    for angle in np.pi + np.linspace(-1.0, 1.0, 401):
        here = loop.at(angle)
        kernel.r[:], kernel.R[:] = here.r, here.R
        kernel.rows.run()
        kernel.factorise.run()
        chosen.add(int(kernel.state["chosen"]))
        assert kernel.state["rank"] == 17 and np.min(pivots(kernel)) > 0.99 * WORN * first
    assert {NEVER, IN_USE} <= chosen


@pytest.mark.parametrize("name", ["bricard", "n_four_bar"])
def test_where_rows_stay_well_apart_or_all_lose_rank_none_are_chosen(name):
    """Bricard's linkage over its motion, and the four-bar windows up to their singular position."""
    problem = make_problem(name)
    motion = make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-8))
    kernel = make_kernel(problem.system, ("rows", "factorise"))
    set_state(kernel, problem.initial)
    for s in motion.states:
        kernel.r[:], kernel.R[:] = s.r, s.R
        kernel.rows.run()
        kernel.factorise.run()
        assert kernel.state["chosen"] == NEVER
