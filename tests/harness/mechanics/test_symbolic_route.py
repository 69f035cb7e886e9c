"""The symbolic route against the geometric one: two derivations of the same mechanics, at arbitrary states."""

import dataclasses
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbsbench.harness.mechanics import motion, work
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.state import State, States
from mbsbench.solvers.formulations.assembly import Assembly
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.start import Accelerations
from mbsbench.solvers.formulations.strong_form import StrongForm
from mbsbench.solvers.formulations.system_elements import equations_of_motion

from ...solvers.arbitrary_systems import arbitrary, linkage

SYSTEM = linkage(springs=True)
INNER_SPRING = dataclasses.replace(
    SYSTEM, **{n: getattr(SYSTEM, n)[:1] for n in vars(SYSTEM) if n.startswith("spring_")}
)
MOMENTA = (motion.linear_momentum, motion.angular_momentum)
STEP = 1e-5  # of central differences: truncation 1e-10, rounding 1e-10 of values of order 10
ROUNDING = 1e-11  # a thousand operations on values of order 10
DIFFERENCES = 1e-6
seeds = st.integers(0, 2**20)
few = settings(max_examples=15, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@cache
def layout(coordinates: str) -> Layout:
    return Layout(SYSTEM, CHARTS[coordinates], np.arange(SYSTEM.nrows))


@cache
def equations(coordinates: str, alpha: float = 0.0, beta: float = 0.0) -> Assembly:
    return equations_of_motion(layout(coordinates), "acceleration", alpha, beta, differentiable=False)


@cache
def strong_form(coordinates: str) -> StrongForm:
    return StrongForm(layout(coordinates))


@cache
def free_bodies(coordinates: str) -> tuple[Layout, Accelerations]:
    bare = Layout(INNER_SPRING, CHARTS[coordinates], np.zeros(0, dtype=np.int64))
    return bare, Accelerations(bare)


def unknowns(at: Layout, state: State) -> np.ndarray:
    p, u = at.chart.coordinates(state)
    return np.concatenate((p.ravel(), u.ravel(), np.zeros(at.k)))


def states(at: Layout, y: np.ndarray) -> States:
    p = y[at.p].reshape(1, SYSTEM.nb, -1)
    return at.chart.states(p, y[at.u].reshape(1, SYSTEM.nb, 6))


def margin(at: Layout, y: np.ndarray) -> float:
    """|sin(theta)| at its smallest: derivatives of angles grow with its inverse."""
    return float(at.chart.margin(y[at.p].reshape(1, SYSTEM.nb, -1))[0])


def velocity_map(at: Layout, y: np.ndarray) -> np.ndarray:
    """B of V = B u, all bodies (n_u, n_u)."""
    B = np.zeros((at.n_u, at.n_u))
    T = at.chart.rotation_rates(y[at.p].reshape(SYSTEM.nb, -1))
    for b in range(SYSTEM.nb):
        B[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = np.eye(3)
        B[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = T[b]
    return B


def along(at: Layout, y: np.ndarray, u_dot: np.ndarray, h: float) -> np.ndarray:
    """y a time ``h`` further, to first order in p' and u'."""
    whole = np.concatenate((y[at.p], y[at.u], np.zeros(SYSTEM.nrows)))
    p_dot = equations(at.chart.name).values(whole, u_dot)[at.p]
    return y + h * np.concatenate((p_dot, u_dot, np.zeros(at.k)))


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_a_chart_returns_the_state_it_was_given(coordinates, seed):
    """(r, R, v, Omega) -> (p, u) -> (r, R, v, Omega) is the identity away from the chart's singularity."""
    state = arbitrary(SYSTEM, seed)
    at = layout(coordinates)
    back = states(at, unknowns(at, state))[0]
    for name in ("r", "R", "v", "Omega"):
        np.testing.assert_allclose(getattr(back, name), getattr(state, name), atol=ROUNDING)


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_the_chart_moves_as_the_body_turns(coordinates, seed):
    """R_dot = R hat(Omega) and r_dot = v, by central differences along p_dot = G u."""
    at, state = layout(coordinates), arbitrary(SYSTEM, seed)
    y = unknowns(at, state)
    ahead, behind = (states(at, along(at, y, np.zeros(at.n_u), h))[0] for h in (STEP, -STEP))
    R_dot = (ahead.R - behind.R) / (2.0 * STEP)
    Omega_hat = np.swapaxes(state.R, 1, 2) @ R_dot
    got = np.stack((Omega_hat[:, 2, 1], Omega_hat[:, 0, 2], Omega_hat[:, 1, 0]), axis=1)
    sharp = DIFFERENCES / margin(at, y) ** 2
    np.testing.assert_allclose(got, state.Omega, atol=sharp)
    np.testing.assert_allclose((ahead.r - behind.r) / (2.0 * STEP), state.v, atol=DIFFERENCES)


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_constraints_and_their_jacobian_agree_with_the_geometric_route(coordinates, seed):
    """phi, phi_dot, A B and the weights M_bar come out alike from (r, R) and from a chart."""
    at, state = layout(coordinates), arbitrary(SYSTEM, seed)
    form, y, one = strong_form(coordinates), unknowns(at, state), States.one(state)
    terms = form.terms(y[: at.n - at.k])
    np.testing.assert_allclose(terms.phi, motion.constraint(SYSTEM, one)[0], atol=ROUNDING)
    np.testing.assert_allclose(terms.phi_dot, motion.constraint_rate(SYSTEM, one)[0], atol=ROUNDING)
    np.testing.assert_allclose(terms.M_bar, motion.scaling_masses(SYSTEM, one)[0], atol=ROUNDING)
    A = constraint_jacobian(SYSTEM, state).toarray() @ velocity_map(at, y)
    np.testing.assert_allclose(form.pattern.dense(terms.A), A, atol=ROUNDING)


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_power_of_the_unbalanced_load_is_the_rate_of_energy(coordinates, seed):
    """u . e = d(T + V)/dt + dissipation at any u_dot: Newton, gravity, springs and dampers at once."""
    at, state = layout(coordinates), arbitrary(SYSTEM, seed)
    y, u_dot = unknowns(at, state), np.random.default_rng(seed).standard_normal(at.n_u)
    e = equations(coordinates).values(y, u_dot)[at.u]
    ahead, behind = (motion.energy(SYSTEM, states(at, along(at, y, u_dot, h)))[0] for h in (STEP, -STEP))
    rate = (ahead - behind) / (2.0 * STEP) - work.power(SYSTEM, States.one(state))[0]
    sharp = DIFFERENCES * (1.0 + abs(rate)) / margin(at, y) ** 2
    assert y[at.u] @ e == pytest.approx(rate, abs=sharp)


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_free_bodies_change_their_momenta_by_gravity_alone(coordinates, seed):
    """Without joints and ground springs, d/dt sum m v = sum m g and d/dt sum (r x m v + R J Omega) = sum r x m g.

    Gyroscopic terms do no work, so the power law cannot see them; momenta can.
    """
    at, state = layout(coordinates), arbitrary(SYSTEM, seed)
    bare, accelerations = free_bodies(coordinates)
    y = unknowns(bare, state)
    u_dot, _ = accelerations.at(y)
    ahead, behind = (states(at, along(bare, y, u_dot, h)) for h in (STEP, -STEP))
    rate = [(of(SYSTEM, ahead)[0] - of(SYSTEM, behind)[0]) / (2.0 * STEP) for of in MOMENTA]
    weight = SYSTEM.mass[:, None] * SYSTEM.gravity
    sharp = DIFFERENCES * (1.0 + np.max(np.abs(u_dot))) / margin(at, y) ** 2
    np.testing.assert_allclose(rate[0], weight.sum(axis=0), atol=sharp)
    np.testing.assert_allclose(rate[1], np.cross(state.r, weight).sum(axis=0), atol=sharp)


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_reactions_work_on_the_constraint_rate_only(coordinates, seed):
    """The load of lam is A^T lam: its power is lam . phi_dot, and reactions on two bodies are opposite."""
    at, state = layout(coordinates), arbitrary(SYSTEM, seed)
    load_at = equations(coordinates).values
    y, w = unknowns(at, state), np.zeros(at.n_u)
    loaded = y.copy()
    lam = loaded[at.lam] = np.random.default_rng(seed).standard_normal(at.k)
    load = load_at(y, w)[at.u] - load_at(loaded, w)[at.u]
    assert y[at.u] @ load == pytest.approx(lam @ motion.constraint_rate(SYSTEM, States.one(state))[0], abs=1e-10)


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_constraint_rows_are_the_second_derivative_with_baumgarte_terms(coordinates, seed):
    """c = phi_ddot + 2 alpha phi_dot + beta^2 phi, Eq. (94), phi_ddot by central differences of phi_dot."""
    alpha, beta = 3.0, 7.0
    at, state = layout(coordinates), arbitrary(SYSTEM, seed)
    y, u_dot = unknowns(at, state), np.random.default_rng(seed).standard_normal(at.n_u)
    c = equations(coordinates, alpha, beta).values(y, u_dot)[at.lam]
    ahead, behind = (motion.constraint_rate(SYSTEM, states(at, along(at, y, u_dot, h)))[0] for h in (STEP, -STEP))
    one = States.one(state)
    rates = 2.0 * alpha * motion.constraint_rate(SYSTEM, one)[0] + beta**2 * motion.constraint(SYSTEM, one)[0]
    sharp = DIFFERENCES / margin(at, y) ** 3
    np.testing.assert_allclose(c - rates, (ahead - behind) / (2.0 * STEP), atol=sharp, rtol=1e-5)
