"""S = A M^-1 A^T by joints against dense algebra and the symbolic route, at states far from any special one."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.state import State, States
from mbsbench.harness.mechanics.system import RigidBody, SpringDamper, assemble
from mbsbench.solvers.formulations.charts import CHARTS
from mbsbench.solvers.formulations.compiled.kernel import Kernel, Made, make_kernel, start_at
from mbsbench.solvers.formulations.layout import Layout
from mbsbench.solvers.formulations.start import Accelerations

from ...arbitrary_systems import arbitrary, consistent, linkage


def at(system, state: State) -> tuple[Made, Kernel, int]:
    """The kernel at ``state``, evaluated, a copy with rows in the system's order, and the rank it found."""
    made = make_kernel(system)
    start_at(made.kernel, state)
    made.entry("accelerate")()
    k = made.kernel
    in_order = {name: getattr(k, name)[k.order] for name in ("lam", "gamma", "phi")}
    return made, k._replace(**in_order), int(k.state["rank"])


def mass_matrix(system) -> np.ndarray:
    M = np.zeros((6 * system.nb, 6 * system.nb))
    for b in range(system.nb):
        M[6 * b : 6 * b + 3, 6 * b : 6 * b + 3] = system.mass[b] * np.eye(3)
        M[6 * b + 3 : 6 * b + 6, 6 * b + 3 : 6 * b + 6] = system.inertia[b]
    return M


@pytest.mark.parametrize("springs", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_accelerations_are_those_of_the_symbolic_route(seed, springs):
    """Two independent routes to v_dot and the reaction, springs and dampers with them, off the constraints too."""
    system = linkage(springs=springs)
    state = arbitrary(system, seed)
    _, kernel, rank = at(system, state)
    layout = Layout(system, CHARTS["quaternion"], np.arange(system.nrows))
    pu = np.concatenate([part.ravel() for part in layout.chart.coordinates(state)])
    v_dot, reaction = Accelerations(layout).at(np.concatenate((pu, np.zeros(layout.k))))
    size = np.max(np.abs(v_dot))
    assert rank == system.nrows
    np.testing.assert_allclose(kernel.v_dot.ravel(), v_dot, atol=1e-10 * size)
    np.testing.assert_allclose(kernel.lam, reaction, atol=1e-10 * np.max(np.abs(reaction)))


@pytest.mark.parametrize("name", ["four_bar_grid", "chain"])
def test_equations_of_motion_hold_row_by_row(name):
    """M v_dot = f + A^T lam and A v_dot = -gamma to rounding, on the grid with 75 redundant rows among 400."""
    problem = make_problem(name)
    system, start = problem.system, problem.initial
    _, kernel, rank = at(system, start)
    A = constraint_jacobian(system, start).toarray()
    assert rank == np.linalg.matrix_rank(A, tol=1e-9)
    v_dot = kernel.v_dot.ravel()
    np.testing.assert_allclose(mass_matrix(system) @ v_dot - A.T @ kernel.lam, kernel.force.ravel(), atol=1e-11)
    np.testing.assert_allclose(A @ v_dot, -kernel.gamma, atol=1e-11)


def test_gamma_is_the_derivative_of_the_rows_along_the_motion():
    """Central differences of A v with v kept: the error of 1e-5 squared and of rounding over 1e-5."""
    system = linkage(springs=False)
    state, h = arbitrary(system, 3), 1e-5

    def rate(dt: float) -> np.ndarray:
        moved = State(state.r + dt * state.v, state.R @ so3.exp(dt * state.Omega), state.v, state.Omega)
        return constraint_rate(system, States.one(moved))[0]

    _, kernel, _ = at(system, state)
    np.testing.assert_allclose(kernel.gamma, (rate(h) - rate(-h)) / (2.0 * h), atol=1e-8)
    np.testing.assert_allclose(kernel.phi, constraint(system, States.one(state))[0], atol=1e-14)


def test_projection_returns_to_the_constraints():
    """From 1e-5 away one pass leaves the square of it; a second one rounding. What was consistent is left alone."""
    system = linkage(springs=False)
    good = consistent(system, 11)
    random = np.random.default_rng(0)
    off = State(
        good.r + 1e-5 * random.standard_normal(good.r.shape),
        good.R @ so3.exp(1e-5 * random.standard_normal(good.Omega.shape)),
        good.v, good.Omega,
    )  # fmt: skip
    made, kernel, _ = at(system, off)
    sizes = []
    for _ in range(2):
        made.entry("accelerate")()
        made.entry("project")()
        now = States.one(State(kernel.r, kernel.R, kernel.v[:, :3], kernel.v[:, 3:]))
        sizes.append(np.max(np.abs(constraint(system, now))))
        assert np.max(np.abs(constraint_rate(system, now))) < 1e-4 * sizes[-1] + 1e-8
    assert sizes[0] < 1e-8 and sizes[1] < 1e-12


def test_systems_without_joints_fall_freely():
    """No rows: a = g, and a spring pulls along its line."""
    body = RigidBody(2.0, np.diag([0.1, 0.2, 0.25]))
    system = assemble([body], gravity=(0.0, 0.0, -9.81), springs=[SpringDamper(0, (0.0, 0.0, 0.0), stiffness=8.0)])
    state = State(np.array([[1.0, 0.0, 0.0]]), np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    _, kernel, rank = at(system, state)
    assert rank == 0
    np.testing.assert_allclose(kernel.v_dot[0], [-4.0, 0.0, -9.81, 0.0, 0.0, 0.0], atol=1e-15)
