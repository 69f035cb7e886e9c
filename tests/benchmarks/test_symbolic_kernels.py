"""Form fi on the symbolic route: residual and Jacobian of one body, 15 links and 55 bars in quaternions."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.solvers.formulations.dae import ImplicitForm
from mbsbench.solvers.formulations.start import choose_layout, make_consistent, pack_start


@pytest.fixture(params=["spherical_pendulum", "chain", "four_bar_grid"])
def case(request) -> tuple[ImplicitForm, np.ndarray, np.ndarray]:
    """The form and a consistent (y, y')."""
    problem = make_problem(request.param)
    layout, _ = choose_layout(problem, "quaternion")
    y, y_dot = make_consistent(layout, pack_start(layout, problem), 5.0, 5.0)
    return ImplicitForm(layout, "fi", 5.0, 5.0), y, y_dot


def test_symbolic_residual(benchmark, case):
    """F(y, y') vanishes at a consistent start, to rounding of the loads (N)."""
    form, y, y_dot = case
    F = benchmark(form.residual, y, y_dot)
    assert np.max(np.abs(F)) < 1e-9


def test_symbolic_jacobian(benchmark, case):
    """dF/dy and dF/dy' as nonzeros of one pattern."""
    form, y, y_dot = case
    of_y, of_y_dot = benchmark(form.jacobian, y, y_dot)
    assert len(of_y) == len(of_y_dot) == form.pattern.nnz
