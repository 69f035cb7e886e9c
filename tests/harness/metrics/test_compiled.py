"""The compiled passes give the numbers of the laws as numpy states them, for every kind of row and part."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbsbench.harness.catalogue import registry
from mbsbench.harness.mechanics.state import States
from mbsbench.harness.metrics import compiled, measure, rows, scales

ROUNDING = 1e-13  # of the largest value: sums of some hundred terms in another order
PLACES = {"random_mechanism": {"bodies": 7, "loops": 2}}


@pytest.fixture(params=[n for n in registry.problems() if registry.is_own_problem(n)])
def moving(request):
    """A system, and any poses and velocities of its bodies: joints are open, R is off a rotation by a millionth."""
    system = registry.make_problem(request.param, PLACES.get(request.param)).system
    rng, shape = np.random.default_rng(7), (40, system.nb, 3)
    R = Rotation.random(40 * system.nb, rng=rng).as_matrix().reshape(*shape, 3)
    r, v, Omega = (rng.normal(size=shape) for _ in range(3))
    return system, States(r, R + 1e-6 * rng.normal(size=R.shape), v, Omega, np.linspace(0.0, 1.0, 40))


def both(call, monkeypatch):
    """What it gives in numpy and compiled."""
    found = []
    for many in (10**9, 0):
        monkeypatch.setattr(scales, "MANY", many)
        found.append(call())
    return found


def test_all_laws_and_sizes_are_those_of_numpy(moving, monkeypatch):
    """T + V, |phi| and its rate in both units, Eq. (81), R, displacement, speeds, the kinematic defect."""
    system, s = moving
    first = States(*(getattr(s, k)[:1] for k in ("r", "R", "v", "Omega")))
    h = np.linspace(0.01, 2.0, len(s) - 1)

    def step():
        end = rows._moved(h, s.at(slice(0, -1)), s.at(slice(1, None)))
        return end.r, end.R, end.v, end.Omega

    calls = {
        "laws": lambda: measure._laws(system, s),
        "displacement": lambda: (scales.displacement(system, s, first), scales.displacement(system, s, s)),
        "speeds": lambda: (scales.speeds(system, s),),
        "moved": step,
    }
    for name, call in calls.items():
        for k, (plain, fast) in enumerate(zip(*both(call, monkeypatch), strict=True)):
            assert np.allclose(fast, plain, rtol=0.0, atol=ROUNDING * np.max(np.abs(plain), initial=1.0)), (name, k)


def test_what_is_no_number_stays_none(monkeypatch):
    """A motion that blew up is no small error: a NaN of one body is one of all."""
    p = registry.make_problem("chain")
    r = np.tile(p.initial.r, (5, 1, 1))
    R = np.tile(p.initial.R, (5, 1, 1, 1))
    R[2, -1, 0, 0] = np.nan
    s = States(r, R, np.zeros_like(r), np.zeros_like(r))
    for plain, fast in zip(*both(lambda: measure._laws(p.system, s), monkeypatch), strict=True):
        assert np.array_equal(np.isnan(plain), np.isnan(fast))
    assert not compiled.are_rotations(R) and compiled.are_rotations(R[:2])
