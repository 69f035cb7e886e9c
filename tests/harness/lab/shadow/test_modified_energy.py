"""The modified energy against a closed form, and of methods that are symplectic or not."""

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.lab.shadow.findings import describe_energy
from mbsbench.harness.lab.shadow.modified_energy import compute_modified_energy, find_modified_energy
from mbsbench.harness.results.findings import Verdict
from mbsbench.harness.results.shadows import NearestMotion
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.factories import solve_run

from .test_shadow import OMEGA, oscillator


def test_leapfrog_keeps_the_modified_energy_of_the_oscillator():
    """H = theta / sin theta (p^2 + omega^2 (1 - h^2 omega^2 / 4) q^2) / 2, cos theta = 1 - h^2 omega^2 / 2."""
    problem, h = oscillator(), 0.02
    found = find_modified_energy(problem, solve_run(problem, h, "rattle"))
    start, m = problem.initial, problem.system.mass[0]
    theta = np.arccos(1.0 - 0.5 * (h * OMEGA) ** 2)
    size = np.sum(start.v**2) + OMEGA**2 * (1.0 - 0.25 * (h * OMEGA) ** 2) * np.sum(start.r**2)
    assert_close(found.values, 0.5 * m * theta / np.sin(theta) * size, rtol=1e-12)
    assert np.ptp(found.energy) > 1e6 * found.energy_range


@pytest.mark.parametrize(
    ("solver", "verdict"),
    [
        ("rattle", Verdict.MET),
        ("half_explicit", Verdict.OPEN),
        ("generalized_alpha", Verdict.OPEN),
        ("gc_weak_form", Verdict.OPEN),
        ("rk45_strong_form", None),
    ],
)
def test_verdict_tells_symplectic_methods(solver, verdict):
    """RATTLE has a modified energy; explicit Runge-Kutta and dissipative methods have none, nor is one found of ODE-GC.

    A swing does not refute it: steps may be too coarse. Varying steps are no such method.
    """
    problem = registry.make_problem("simple_pendulum", {"t_end": 4.0})
    trajectory = solve_run(problem, 1e-8 if verdict is None else 2e-3, solver)
    if verdict is None:
        with pytest.raises(ValueError, match="fixed step"):
            find_modified_energy(problem, trajectory)
    else:
        swing = describe_energy(find_modified_energy(problem, trajectory))[0]
        words = "symplectic: yes" if verdict is Verdict.MET else "symplectic: not shown"
        assert (swing.verdict, swing.words) == (verdict, words)


@pytest.mark.parametrize(
    ("solver", "shown"), [("rattle", "yes"), ("half_explicit", "not shown"), ("gc_weak_form", "not shown")]
)
def test_tops_that_nutate_have_it(solver, shown):
    """Their free motion is two rotations; ``half_explicit`` keeps the energy to 4e-9, and is not symplectic."""
    problem = registry.make_problem("heavy_top", {"t_end": 1.0})
    found = find_modified_energy(problem, solve_run(problem, 1e-3, solver))
    assert NearestMotion(modified_energy=found.energy_range / found.scale).symplectic == shown
    assert np.max(np.abs(found.values - found.energy)) < 1e-4 * found.scale  # both differ by dt^2


def test_coarse_steps_hide_it_on_the_chain():
    """At the whip (0.48 s) the swing is that of the differences: it falls by their order, at last below the bound."""
    problem = registry.make_problem("chain", {"t_end": 0.6})
    runs = [solve_run(problem, h, "rattle") for h in (1e-3, 5e-4, 2.5e-4)]
    assert (
        3.7
        < np.log2(
            compute_modified_energy(problem, runs[1], 4).energy_range
            / compute_modified_energy(problem, runs[2], 4).energy_range
        )
        < 4.3
    )
    best = [find_modified_energy(problem, r) for r in (runs[0], runs[2])]
    assert [NearestMotion(modified_energy=m.energy_range / m.scale).symplectic for m in best] == ["not shown", "yes"]


def test_bodies_of_three_inertias_that_nutate_are_refused():
    """Their free motion between two rows is of no closed form, nor RATTLE's exact."""
    problem = registry.make_problem("free_body", {"t_end": 0.1})
    trajectory = solve_run(problem, 1e-3, "rattle")
    with pytest.raises(ValueError, match="two equal principal inertias"):
        find_modified_energy(problem, trajectory)
