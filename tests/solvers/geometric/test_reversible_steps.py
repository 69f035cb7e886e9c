"""Reversible step control of compositions: orders, the way back, fewer steps over a whip, bounded energy."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.types import StepControl

from .test_composed import error, solve

RATE = 5.0
BOTH = pytest.mark.parametrize("solver", ["rattle", "gc_composed"])


@BOTH
def test_the_order_is_that_of_the_composition(solver):
    """Over the first whip of the chain, with steps that differ by the factor of its turn rates."""
    p = make_problem("chain", {"t_end": 0.6})
    errors, lengths = [], []
    for dt in (0.02, 0.01, 0.005):
        t = solve(p, solver, StepControl(dt=dt), composition="suzuki4", rate=RATE)
        errors.append(error(p, t))
        lengths.append(np.diff(t.t))
    assert abs(np.log2(errors[-2] / errors[-1]) - 4.0) < 0.4, errors
    assert np.max(lengths[-1]) / np.min(lengths[-1][:-1]) > 3.0
    assert t.t[-1] == p.t_end


@BOTH
def test_over_the_whip_the_same_number_of_steps_errs_less(solver):
    """Chain to 0.8 s: a tenth of the error of as many equal steps."""
    p = make_problem("chain", {"t_end": 0.8})
    paced = solve(p, solver, StepControl(dt=0.01), composition="suzuki4", rate=RATE)
    equal = solve(p, solver, StepControl(dt=p.t_end / (len(paced.t) - 1)), composition="suzuki4")
    assert error(p, paced) < 0.1 * error(p, equal)


@BOTH
def test_there_and_back_takes_the_same_steps(solver):
    """Velocities reversed: z starts from 1/s instead of its own last value, so nearly the same steps lead back."""
    p = make_problem("chain", {"t_end": 0.5})
    control, options = StepControl(dt=0.005), {"composition": "kahan_li6", "rate": RATE, "tolerance": 1e-14}
    s = solve(p, solver, control, **options).states[-1]
    home = dataclasses.replace(p, initial=State(s.r, s.R, -s.v, -s.Omega), reference_from=None)
    end = solve(home, solver, control, **options).states[-1]
    assert np.max(np.abs(end.r - p.initial.r)) < 1e-8


def test_energy_stays_bounded():
    """Pendulum over 200 s: mean energy errors of the first and the last quarter agree to a tenth."""
    p = make_problem("spherical_pendulum", {"t_end": 200.0})
    t = solve(p, "rattle", StepControl(dt=0.05), composition="suzuki4", rate=RATE)
    E = energy(p.system, t.states) - energy(p.system, t.states)[0]
    quarter = len(E) // 4
    first, last = np.mean(E[:quarter]), np.mean(E[-quarter:])
    assert abs(last - first) < 0.1 * abs(first)
