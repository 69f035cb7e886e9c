"""Pinocchio as a contestant: the loop around it has the order it declares, loops closed or not."""

import dataclasses
import importlib.util

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.types import Status, StepControl
from mbsbench.solvers.engines.pinocchio import INTEGRATORS

from .systems import PROBLEMS

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("pinocchio") is None, reason="pin is an optional extra: make test-engines"
)


@pytest.mark.parametrize(("integrator", "order"), INTEGRATORS.items())
def test_the_loop_has_the_declared_order(integrator, order):
    """A spatial motion on a ball joint, where theta' is not v; the last of two halvings within 0.2."""
    problem, errors = make_problem("spherical_pendulum", {"omega_x": 5.0, "omega_z": 3.0, "t_end": 0.5}), []
    for dt in (0.01, 0.005, 0.0025):
        t = make_solver("pinocchio", {"integrator": integrator}).solve(problem, StepControl(dt=dt))
        assert t.status is Status.SUCCESS, t.message
        errors.append(np.max(np.abs(t.states.r - problem.reference().states(t.t).r)))
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(order, abs=0.2)


def test_gain_closes_the_gaps():
    """Cut joints hold through accelerations: errors open them as time goes on, unless the corrector is on."""
    problem, gaps = dataclasses.replace(PROBLEMS["slider_crank"](), t_end=4.0), {}
    for gain in (0.0, 10.0):
        t = make_solver("pinocchio", {"gain": gain}).solve(problem, StepControl(dt=1e-2))
        assert t.status is Status.SUCCESS, t.message
        gaps[gain] = np.max(np.abs(constraint(problem.system, t.states)))
    assert gaps[10.0] < 0.1 * gaps[0.0]
