"""MuJoCo as a contestant: its trees have their order, its loops are soft."""

import importlib.util

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.types import Status, StepControl
from mbsbench.solvers.engines import mujoco

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mujoco") is None, reason="mujoco is an optional extra: make test-engines"
)


def errors(problem, steps, **options):
    """Largest position error by step."""
    out = []
    for dt in steps:
        t = make_solver("mujoco", options).solve(problem, StepControl(dt=dt))
        assert t.status is Status.SUCCESS, t.message
        out.append(float(np.max(np.abs(t.states.r - problem.reference().states(t.t).r))))
    return out


@pytest.mark.parametrize(("integrator", "order"), mujoco.INTEGRATORS.items())
def test_trees_have_the_declared_order(integrator, order):
    """A spatial motion on a ball joint; the last of three halvings within 0.2."""
    problem = make_problem("spherical_pendulum", {"omega_x": 5.0, "omega_z": 3.0, "t_end": 1.0})
    e = errors(problem, (0.02, 0.01, 0.005, 0.0025), integrator=integrator)
    assert np.log2(e[-2] / e[-1]) == pytest.approx(order, abs=0.2)


def test_loops_are_of_second_order_whatever_the_integrator():
    """Soft constraints give way by (1 - d) a_0 T^2, T = 2 dt: fourth order is lost, second kept."""
    e = errors(make_problem("chain", {"t_end": 0.4}), (2e-3, 1e-3, 5e-4))
    assert np.log2(e[-2] / e[-1]) == pytest.approx(2.0, abs=0.4)
