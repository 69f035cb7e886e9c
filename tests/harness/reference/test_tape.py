"""Tapes against the functions they are made from."""

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.mechanics.consistency import perturb
from mbsbench.harness.reference.directors import Directors
from mbsbench.harness.reference.newton_euler import NewtonEuler
from mbsbench.tests.comparing import assert_close


@pytest.mark.parametrize("name", ["chain", "flyball_governor", "knife_edge", "stewart_platform", "driven_slider_crank"])
def test_rates_by_tape_are_those_by_numpy(name):
    """Zeros left out and products by them change no sum; 1e-9 is rounding times the condition of redundant rows."""
    problem = registry.make_problem(name, {})
    state = perturb(problem.system, problem.initial, 1e-2, 1)
    first, second = NewtonEuler(problem.system), Directors(problem.system)
    y, z = first.project_state(first.pack_state(state)), second.pack_state(state)
    plain = first.rate(y), second.rate(z[None])[0]
    first.compile()
    second.compile()
    for by_numpy, by_tape in zip(plain, (first.rate(y), second.rate(np.stack((z, z)))[1]), strict=True):
        assert_close(by_tape, by_numpy, rtol=1e-9, atol=1e-9 * np.max(np.abs(by_numpy)))
