"""Eq. (65) as printed, against its solution by the saddle, and against plain index 1."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbsbench.harness.base.generated import Program
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.types import Problem, Status, StepControl, Trajectory
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.saddle import InverseMass
from mbsbench.solvers.formulations.start import Accelerations
from mbsbench.solvers.formulations.strong_form import RowTerms, StrongForm
from mbsbench.solvers.formulations.symbolic import DIRECTIONS
from mbsbench.tests.comparing import assert_each

from .arbitrary_systems import arbitrary, consistent, linkage

few = settings(max_examples=10, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
seeds = st.integers(0, 1000)


@cache
def layout(coordinates: str, *, springs: bool) -> Layout:
    system = linkage(springs=springs)
    return Layout(system, CHARTS[coordinates], np.arange(system.nrows))


@cache
def strong_form(coordinates: str, *, springs: bool, **choice: Any) -> StrongForm:
    """The equations of a layout, which are made once and take any state."""
    return StrongForm(layout(coordinates, springs=springs), **choice)


@cache
def plain_index_1(coordinates: str) -> Accelerations:
    """Those of plain index 1, without springs."""
    return Accelerations(layout(coordinates, springs=False))


def position_and_velocity(at: Layout, state: State) -> np.ndarray:
    return np.concatenate([part.ravel() for part in at.chart.coordinates(state)])


@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_without_springs_the_strong_form_is_unstabilised_index_1(coordinates, seed):
    """C_bar = K_bar = 0 and phi_dot = 0: Eq. (65)'s acceleration and reaction are those of phi_ddot = 0, whatever lam.

    Both routes solve the same banded system; what may differ is rounding of accelerations of order 1e2.
    """
    at = layout(coordinates, springs=False)
    pu = position_and_velocity(at, consistent(at.system, seed))
    random = np.random.default_rng(seed)
    lam, lam_dot = random.standard_normal((2, at.k))
    strong = strong_form(coordinates, springs=False).rates(pu, lam, lam_dot)
    u_dot, reaction = plain_index_1(coordinates).compute_accelerations(np.concatenate((pu, np.zeros(at.k))))
    size = np.max(np.abs(u_dot))
    np.testing.assert_allclose(strong.u_dot, u_dot, atol=1e-10 * size)
    np.testing.assert_allclose(strong.reaction, reaction, atol=1e-10 * size)


@pytest.mark.parametrize(
    ("springs", "choice"), [(False, {}), (True, {"direction": "mass", "c_bar": 3.0, "k_bar": 40.0})]
)
@pytest.mark.parametrize("coordinates", CHARTS)
@few
@given(seed=seeds)
def test_the_printed_matrix_equation_holds(coordinates, springs, choice, seed):
    """Both rows of Eq. (65), assembled densely with M, A, M_bar, vanish, at states off the constraints too."""
    at = layout(coordinates, springs=springs)
    form = strong_form(coordinates, springs=springs, **choice)
    pu = position_and_velocity(at, arbitrary(at.system, seed))
    lam, lam_dot = np.random.default_rng(seed).standard_normal((2, at.k))
    r = form.rates(pu, lam, lam_dot)
    s: RowTerms = form.terms(pu)
    inverse = InverseMass(at, pu)
    Program(inverse.steps).run()
    M = np.linalg.inv(inverse.pattern.make_matrix(inverse.data[inverse.places]).toarray())
    A = form.pattern.make_matrix(s.A).toarray()
    first = M @ r.u_dot - A.T @ (s.M_bar * r.lam_ddot) + s.e
    first -= A.T @ ((s.M_bar_dot + s.C_bar) * lam_dot + s.K_bar * lam - s.f_bar)
    second = s.M_bar * (A @ r.u_dot + s.gamma) + (s.M_bar_dot + s.C_bar) * s.phi_dot + s.K_bar * s.phi
    size = 1.0 + np.max(np.abs(M @ r.u_dot)) + np.max(np.abs(r.reaction))
    np.testing.assert_allclose(first, 0.0, atol=1e-9 * size)
    np.testing.assert_allclose(second, 0.0, atol=1e-9 * size)


def test_gravity_alone_gives_no_c_bar_and_no_k_bar():
    """Constant forces have no slopes, Eq. (32); springs and dampers have."""
    plain, sprung = layout("quaternion", springs=False), layout("quaternion", springs=True)
    state = arbitrary(plain.system, 1)
    terms = StrongForm(plain).terms(position_and_velocity(plain, state))
    assert_each(terms.C_bar, "==", 0.0)
    assert_each(terms.K_bar, "==", 0.0)
    terms = StrongForm(sprung).terms(position_and_velocity(sprung, state))
    assert_each(terms.C_bar, ">=", 0.0)  # dampers only dissipate: -df/dV is positive semidefinite
    assert np.max(terms.C_bar) > 0.0 and np.max(np.abs(terms.K_bar)) > 0.0


@few
@given(seed=seeds)
def test_c_bar_and_k_bar_are_slopes_of_the_force_along_c(seed):
    """Eq. (32) by central differences: the springs' force at velocities V +- h c and at poses moved by +- h c."""
    at, h = layout("quaternion", springs=True), 1e-5
    form, pu = strong_form("quaternion", springs=True), position_and_velocity(at, arbitrary(at.system, seed))
    terms = form.terms(pu)
    A = form.pattern.make_matrix(terms.A).toarray()
    c = A / np.sum(A * A, axis=1, keepdims=True)

    def force(pu: np.ndarray) -> np.ndarray:
        return form._loads.values(pu, np.zeros(at.n_u))

    for row in (0, 4, 7, 9):
        faster = [pu + np.concatenate((np.zeros(at.n_p), way * c[row])) for way in (h, -h)]
        moved = [pu + np.concatenate((way * _flow(at, pu, c[row]), np.zeros(at.n_u))) for way in (h, -h)]
        C_bar = -c[row] @ (force(faster[0]) - force(faster[1])) / (2.0 * h)
        K_bar = -c[row] @ (force(moved[0]) - force(moved[1])) / (2.0 * h)
        assert terms.C_bar[row] == pytest.approx(C_bar, abs=1e-6)
        assert terms.K_bar[row] == pytest.approx(max(K_bar, 0.0), abs=1e-5)


@cache
def another_form() -> StrongForm:
    """One whose numbers may change while those of ``strong_form`` are looked at."""
    return StrongForm(layout("quaternion", springs=True))


def _flow(at: Layout, pu: np.ndarray, V: np.ndarray) -> np.ndarray:
    """p_dot of velocities V at p."""
    return another_form().terms(np.concatenate((pu[at.p], V))).p_dot


def opened(direction: str) -> tuple[Problem, Trajectory]:
    """The spatial pendulum, 2 s from a joint open by 2 cm along each axis, with C_bar = 3 kg/s and K_bar = 50 N/m."""
    p = make_problem("spherical_pendulum", {"omega_z": 0.1, "t_end": 2.0})
    p = replace(p, initial=State(p.initial.r + 0.02, p.initial.R, p.initial.v, p.initial.Omega))
    solver = make_solver("rk45_strong_form", {"direction": direction, "c_bar": 3.0, "k_bar": 50.0})
    t = solver.solve(p, StepControl(rtol=1e-9, max_step=1e-3))
    assert t.status is Status.SUCCESS, t.message
    return p, t


def test_along_the_translation_phi_is_a_damped_oscillator():
    """c = (e_k, 0) makes M_bar = m, constant: m phi'' + c_bar phi' + k_bar phi = 0 from phi = 0.02 m at rest."""
    p, t = opened("translation")
    decay = 3.0 / (2.0 * p.system.mass[0])
    omega = np.sqrt(50.0 / p.system.mass[0] - decay**2)
    expected = 0.02 * np.exp(-decay * t.t) * (np.cos(omega * t.t) + decay / omega * np.sin(omega * t.t))
    np.testing.assert_allclose(constraint(p.system, t.states), np.tile(expected[:, None], 3), atol=1e-7)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_phi_obeys_eq_64_for_every_direction(direction):
    """M_bar phi_dot + c_bar phi + k_bar int phi dt = const, by the trapezoid rule over steps of 1 ms.

    M_bar is written out here from Eqs. (30), (31) with a = (e_k, s x R^T e_k) of the one spherical joint.
    """
    p, t = opened(direction)
    phi, phi_dot, s = constraint(p.system, t.states), constraint_rate(p.system, t.states), np.array([-0.5, 0.0, 0.0])
    m, J = p.system.mass[0], p.system.inertia[0]
    turning = np.cross(s, t.states.R[:, 0])  # (nt, 3 rows, 3)
    if direction == "a":
        size = 1.0 + np.sum(turning**2, axis=2)
        M_bar = (m + np.einsum("tki,ij,tkj->tk", turning, J, turning)) / size**2
    elif direction == "mass":
        M_bar = 1.0 / (1.0 / m + np.einsum("tki,ij,tkj->tk", turning, np.linalg.inv(J), turning))
    else:
        M_bar = np.full_like(phi, m)
    area = np.cumsum(0.5 * (phi[1:] + phi[:-1]) * np.diff(t.t)[:, None], axis=0)
    kept = M_bar * phi_dot + 3.0 * phi
    kept[1:] += 50.0 * area
    assert np.max(np.abs(kept - kept[0])) < 1e-5
    assert np.max(np.abs(phi_dot)) > 0.05


def test_the_translational_direction_is_refused_at_revolute_joints():
    """(e_k, 0) has a . c = 0 with an axis row, against Eq. (31)."""
    reason = make_solver("rk45_strong_form", {"direction": "translation"}).refuses(
        make_problem("four_bar_grid"), StepControl(rtol=1e-6)
    )
    assert reason is not None and "spherical joints" in reason
