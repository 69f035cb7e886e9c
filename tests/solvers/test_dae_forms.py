"""Residuals and exact Jacobians of the classical DAEs, and the start they are given."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.harness.mechanics.types import Problem
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.dae import ImplicitForm
from mbsbench.solvers.formulations.differences import INCREMENT, DifferencedForm
from mbsbench.solvers.formulations.layout import Layout, StabilisedLayout
from mbsbench.solvers.formulations.start import Accelerations, choose_layout, make_consistent, pack_start
from mbsbench.tests.comparing import assert_each

from . import arbitrary_systems
from .arbitrary_systems import arbitrary, linkage

SYSTEM = linkage(springs=True)
STEP = 1e-6  # of central differences
ALPHA, BETA = 3.0, 7.0
FORMS = ("fi", "se", "position", "velocity", "both")
few = settings(max_examples=10, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def presented(seed: int) -> Problem:
    state = arbitrary_systems.consistent(SYSTEM, seed)
    return Problem("linkage", SYSTEM, state, t_end=1.0, dt=1e-3, section="", source="")


def of_form(form: str, at: Layout) -> Layout:
    return StabilisedLayout(at.system, at.chart, at.kept) if form == "both" else at


@pytest.mark.parametrize("coordinates", CHARTS)
@pytest.mark.parametrize("form", FORMS)
def test_jacobians_are_exact(form, coordinates):
    """dF/dy and dF/dy' equal central differences column by column at an inconsistent state with rows dropped."""
    kept = np.delete(np.arange(SYSTEM.nrows), [4, 9])
    at = of_form(form, Layout(SYSTEM, CHARTS[coordinates], kept))
    random = np.random.default_rng(3)
    p, u = at.chart.coordinates(arbitrary(SYSTEM, 3))
    multipliers = random.standard_normal(at.n - at.n_p - at.n_u)
    y, y_dot = np.concatenate((p.ravel(), u.ravel(), multipliers)), random.standard_normal(at.n)
    implicit = ImplicitForm(at, form, ALPHA, BETA)
    of_y, of_y_dot = (implicit.pattern.make_matrix(part).toarray() for part in implicit.jacobian(y, y_dot))
    for k, way in enumerate(np.eye(at.n)):
        h = STEP * way
        by_y = (implicit.residual(y + h, y_dot) - implicit.residual(y - h, y_dot)) / (2.0 * STEP)
        by_y_dot = (implicit.residual(y, y_dot + h) - implicit.residual(y, y_dot - h)) / (2.0 * STEP)
        size = 1.0 + np.max(np.abs(by_y))  # rounding of the differences grows with the derivative
        np.testing.assert_allclose(of_y[:, k], by_y, atol=1e-7 * size)
        np.testing.assert_allclose(of_y_dot[:, k], by_y_dot, atol=1e-7 * size)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["linkage", "chain", "four_bar_grid"])
def test_differences_of_grouped_columns_equal_the_exact_jacobian(name, form):
    """At random states, to sqrt(eps) of the terms in F, with the grid's redundant rows dropped.

    A forward difference errs by h F'' / 2 and by rounding eps |F| / h, both of which that bounds; far fewer
    evaluations than columns.
    """
    problem = presented(3) if name == "linkage" else make_problem(name)
    start, _ = choose_layout(problem, "quaternion")
    at, random = of_form(form, start), np.random.default_rng(5)
    y = np.concatenate((pack_start(start, problem), np.zeros(at.n - start.n)))
    y += 0.1 * random.standard_normal(at.n)
    y_dot = random.standard_normal(at.n)
    exact, differenced = (kind(at, form, ALPHA, BETA) for kind in (ImplicitForm, DifferencedForm))
    for ours, expected in zip(differenced.jacobian(y, y_dot), exact.jacobian(y, y_dot), strict=True):
        assert np.max(np.abs(ours - expected)) < 20.0 * INCREMENT * (1.0 + np.max(np.abs(expected)))
    assert name == "linkage" or differenced.difference_evaluations < 0.4 * at.n


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=st.integers(0, 1000))
def test_a_consistent_start_satisfies_every_form(coordinates, seed):
    """One (y, y') solves all forms, with eta = 0: they are one set of equations. Rounding times forces of order 1e3."""
    problem = presented(seed)
    at, notes = choose_layout(problem, coordinates)
    assert notes == ()
    y, y_dot = make_consistent(at, pack_start(at, problem), ALPHA, BETA)
    size = 1.0 + np.max(np.abs(np.concatenate((y, y_dot))))
    for form in FORMS:
        here = of_form(form, at)
        eta = np.zeros(here.n - at.n)
        F = ImplicitForm(here, form, ALPHA, BETA).residual(np.append(y, eta), np.append(y_dot, eta))
        assert np.max(np.abs(F)) < 1e-10 * size, form


@pytest.mark.parametrize("coordinates", CHARTS)
def test_eta_moves_the_bodies_along_the_gradients_of_the_constraints(coordinates):
    """Of F only p' depends on eta, and d phi/dt of what eta adds is A A^T eta in the chart's velocities: a pull on phi.

    The change of phi by a step of h along it, in central differences, against A of the form "velocity".
    """
    at = Layout(SYSTEM, CHARTS[coordinates], np.arange(SYSTEM.nrows))
    random, h = np.random.default_rng(11), 1e-5
    p, u = at.chart.coordinates(arbitrary(SYSTEM, 11))
    y, eta = np.concatenate((p.ravel(), u.ravel(), np.zeros(at.k))), random.standard_normal(at.k)
    both = ImplicitForm(of_form("both", at), "both", 0.0, 0.0)
    F = [both.residual(np.append(y, e), np.zeros(at.n + at.k)) for e in (0.0 * eta, eta)]
    change = F[0] - F[1]
    assert_each(change[at.n_p :], "==", 0.0)
    y_dot = np.zeros(at.n)
    velocity, position = (ImplicitForm(at, form, 0.0, 0.0) for form in ("velocity", "position"))
    A = velocity.pattern.make_matrix(velocity.jacobian(y, y_dot)[0]).toarray()[at.lam, at.u]
    moved = [y + way * np.append(change[at.p], np.zeros(at.n - at.n_p)) for way in (h, -h)]
    phi = [position.residual(z, y_dot)[at.lam] for z in moved]
    np.testing.assert_allclose((phi[0] - phi[1]) / (2.0 * h), A @ A.T @ eta, atol=1e-7 * np.max(np.abs(A @ A.T)))


def test_lambda_dot_of_the_start_is_the_derivative_along_the_motion():
    """lam' by the start's difference equals that of a ten times longer one to its truncation."""
    problem = presented(5)
    at, _ = choose_layout(problem, "quaternion")
    y, y_dot = make_consistent(at, pack_start(at, problem), 0.0, 0.0)
    accelerations, h = Accelerations(at), 1e-4
    longer = (
        accelerations.compute_accelerations(y + h * y_dot)[1] - accelerations.compute_accelerations(y - h * y_dot)[1]
    ) / (2.0 * h)
    np.testing.assert_allclose(y_dot[at.lam], longer, rtol=1e-4, atol=1e-4 * np.max(np.abs(longer)))


def test_redundant_rows_are_dropped_and_named():
    """A joint stated twice has rank one joint: its rows are left out, the note says which, lam is that of one joint."""
    problem = presented(1)
    system = Presentation(duplicate=1).system(SYSTEM)
    at, notes = choose_layout(dataclasses.replace(problem, system=system), "quaternion")
    assert at.k == SYSTEM.nrows and system.nrows == SYSTEM.nrows + 3
    assert notes[0].startswith("dropped 3 of 19 constraint rows")
    once, _ = choose_layout(problem, "quaternion")
    u_dot, _ = Accelerations(at).compute_accelerations(pack_start(at, problem))
    expected, _ = Accelerations(once).compute_accelerations(pack_start(once, problem))
    np.testing.assert_allclose(u_dot, expected, atol=1e-8)
