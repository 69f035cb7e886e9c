"""What experiments need of a solver's code comes by the catalogue, which says where it is missing."""

import casadi as ca
import numpy as np
import pytest

from mbsbench import make_problem
from mbsbench.harness.catalogue import offers, registry
from mbsbench.harness.mechanics import dynamics
from mbsbench.harness.mechanics.joint_expressions import JointExpressions
from mbsbench.harness.mechanics.joint_tree import build_spanning_tree
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, kinetic_energy
from mbsbench.harness.mechanics.state import States
from mbsbench.tests.comparing import assert_close

MECHANISMS = ["heavy_top", "cart_pendulum", "spring_pendulum", "slider_crank"]  # the last one closes a loop
CLOSING = 6  # Newton steps, each of which doubles the digits


def evaluate(e: JointExpressions, x: ca.SX, y: np.ndarray) -> np.ndarray:
    """The numbers of an expression at t = 0 and ``y``; columns as (n,)."""
    found = np.array(ca.Function("f", [e.t, e.y], [ca.densify(x)])(0.0, y))
    return found[:, 0] if found.shape[1] == 1 else found


@pytest.mark.parametrize("name", MECHANISMS)
def test_expressions_obey_the_laws_of_mechanics(name):
    """At a closed state off the start: u^T H u = 2 T_kin, q_dot = T u, r_dot = v, and the judge's accelerations."""
    problem = make_problem(name)
    system, tree = problem.system, build_spanning_tree(problem.system, problem.initial)
    e = offers.find_offer("expressions").write(system, tree)
    y = tree.start + 0.1 * np.random.default_rng(1).normal(size=len(tree.start))
    for _ in range(CLOSING):
        y = evaluate(e, e.closed, y)
    r, R, V, rate = (evaluate(e, x, y) for x in (e.r, e.R, e.V, e.rate))
    V, shape, u = V.reshape(-1, 6), (1, -1, 3), y[tree.nq :]
    v, Omega = V[None, :, :3], V[None, :, 3:]
    here = States(r.reshape(shape), R.reshape(1, -1, 3, 3), v, Omega, np.zeros(1))
    assert_close(
        u @ np.atleast_2d(evaluate(e, e.H, y)) @ u, 2.0 * kinetic_energy(system, here)[0], rtol=1e-12, atol=0.0
    )
    assert_close(rate[: tree.nq], np.reshape(evaluate(e, e.T, y), (tree.nq, tree.nu)) @ u, rtol=1e-12, atol=1e-13)
    assert_close(evaluate(e, ca.jtimes(e.r, e.y, e.rate), y).reshape(shape), here.v, rtol=1e-11, atol=1e-12)
    for gaps in (evaluate(e, e.gaps, y), constraint(system, here), constraint_rate(system, here)):
        assert_close(gaps, np.zeros_like(gaps), atol=1e-12)
    judged = dynamics.accelerations(system, here[0])
    exact = np.concatenate((judged.v_dot, judged.Omega_dot), axis=1)
    assert_close(evaluate(e, ca.jtimes(e.V, e.y, e.rate), y).reshape(-1, 6), exact, rtol=1e-9, atol=1e-9)


def test_expressions_are_refused_with_the_reason_and_none_are_written():
    problem = make_problem("four_bar_grid", rows=60, columns=60)
    assert "operations" in offers.find_offer("expressions").refuse(problem)


def test_accelerations_are_the_judges():
    """Of a chain off its rest, by compiled kernels."""
    problem = make_problem("chain")
    found = offers.find_offer("accelerations")(problem.system, problem.initial)
    exact = dynamics.accelerations(problem.system, problem.initial)
    for name in ("v_dot", "Omega_dot"):
        assert_close(getattr(found, name), getattr(exact, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", offers.OFFERS)
def test_a_copy_without_the_solver_says_what_it_lacks(name, monkeypatch):
    assert offers.find_offer(name) is not None
    monkeypatch.setattr(registry, "solvers", dict)
    with pytest.raises(ValueError, match=rf"^this needs the {name} of solver {offers.OFFERS[name]}, which this copy"):
        offers.find_offer(name)
