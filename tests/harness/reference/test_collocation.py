"""Collocation against closed forms: the ends of steps, stiff equations, and what a step gives between."""

from math import factorial

import numpy as np
import pytest
from scipy.interpolate import pade

from mbsbench.harness.reference.collocation import Collocation
from mbsbench.harness.reference.extrapolation import vectorize_rate

TIME = np.array([1.0, np.inf])  # units of y and t


def pulled(rate: float):
    """y_dot = -rate (y - cos t) - sin t: cos t, and exp(-rate t) of what the start is off it."""
    return vectorize_rate(lambda y: np.array([-rate * (y[0] - np.cos(y[1])) - np.sin(y[1]), 1.0]))


@pytest.mark.parametrize("z", [-0.5, -3.0, -1e3, 2.0j, -1e2 + 1e2j])
@pytest.mark.parametrize("s", [2, 5, 7])
def test_a_step_of_a_linear_equation_is_its_pade_approximant(s: int, z: complex) -> None:
    """y_dot = z y over 1 s: (s - 1, s) of exp, hence order 2 s - 1, and 0 at infinity."""
    top, bottom = pade([1.0 / factorial(k) for k in range(2 * s)], s, s - 1)
    A = np.array([[z.real, -z.imag], [z.imag, z.real]])
    (step,) = Collocation(lambda y: y @ A.T, s=s).steps(np.array([1.0, 0.0]), 1.0, 1e3, np.ones(2))
    assert step.end @ (1.0, 1.0j) == pytest.approx(top(z) / bottom(z), abs=1e-9)


@pytest.mark.parametrize("rate", [1.0, 1e4, 1e8])
def test_a_stiff_equation_takes_no_more_steps(rate: float) -> None:
    """From its smooth solution: exact at the ends and between, in a few steps whatever the rate."""
    steps = list(Collocation(pulled(rate)).steps(np.array([1.0, 0.0]), 6.0, 1e-11, TIME))
    x = np.linspace(0.0, 1.0, 9)
    gaps = [np.max(np.abs(step.states(x)[:, 0] - np.cos(step.t + x * step.h))) for step in steps]
    assert max(gaps) < 1e-10 and len(steps) < 40


def test_a_fast_transient_is_resolved() -> None:
    """From a start off the smooth solution, exponentially near; steps are short there, and only there."""
    steps = list(Collocation(pulled(1e5)).steps(np.array([2.0, 0.0]), 1.0, 1e-11, TIME))
    t = np.array([step.t + step.h for step in steps])
    assert np.max(np.abs([step.end[0] for step in steps] - np.cos(t) - np.exp(-1e5 * t))) < 1e-10
    assert steps[0].h < 1e-4 and steps[-1].h > 0.05


def test_it_goes_on_from_its_last_step() -> None:
    """In spans one after another, as in one."""
    route, y = Collocation(pulled(1e4)), np.array([1.0, 0.0])
    for _ in range(6):
        for step in route.steps(y, 1.0, 1e-11, TIME):
            y = step.end
    assert abs(y[0] - np.cos(6.0)) < 1e-11 and y[1] == pytest.approx(6.0, abs=1e-14)


def test_no_step_is_an_error() -> None:
    with pytest.raises(ArithmeticError, match="no step"):
        list(Collocation(lambda y: np.full_like(y, np.nan)).steps(np.ones(1), 1.0, 1e-11, np.ones(1)))
