"""Motions of slender rods and point masses: exact ones, and those of added inertia that changes nothing."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.motion import energy
from mbsbench.harness.mechanics.types import Problem, Trajectory
from mbsbench.harness.run.presenting import present_solver
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.factories import choose_control, solve_run

OTHERWISE = {"yaw": 0.4, "perturb": 0.2, "renumber": 2, "mirror": "X", "unit_length": 100.0}


def solve_accepted(p: Problem, name: str, size: float, **options: object) -> Trajectory:
    """A run that the solver does not refuse; ``size``: rtol or dt."""
    assert present_solver(make_solver(name, options), p).refuses(p, choose_control(name, size)) is None
    return solve_run(p, size, name, **options)


def off(p: Problem, out: Trajectory) -> float:
    """Largest distance of an end from the reference [m]."""
    reference = p.reference()
    assert reference is not None
    return float(np.max(np.abs(out.states.r - reference.states(out.t).r)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("given", [{}, OTHERWISE])
@pytest.mark.parametrize(
    ("solver", "size", "allowed"),
    [
        ("rkmk_dop853", 1e-10, 1e-10),
        ("rattle", 1e-3, 1e-5),
        ("gc_weak_form", 1e-3, 1e-5),
        ("ida_index1", 1e-9, 1e-6),
        ("rk45_strong_form", 1e-9, 1e-7),
    ],
)
def test_a_point_mass_on_a_link_is_a_pendulum(solver: str, size: float, allowed: float, given: dict) -> None:
    """By theta functions, on both routes; errors are those of the steps."""
    p = make_problem("simple_pendulum", {"support": "link", "t_end": 1.0, **given})
    assert off(p, solve_accepted(p, solver, size)) < allowed


@pytest.mark.parametrize(
    ("solver", "size"),
    [("rattle", 1e-3), ("gc_augmented_lagrangian", 1e-3), ("rkmk_dop853", 1e-8), ("ndf_index1", 1e-6)],
)
def test_axial_inertia_in_a_plane_changes_nothing(solver: str, size: float) -> None:
    """A grid of slender rods (redundant rows) as with 1e-4 kg m2 put in by hand: motion, energy, loads of joints."""
    given = {"rows": 1, "columns": 2, "t_end": 0.2}
    none, some = (make_problem("four_bar_grid", {**given, "axial_inertia": J}) for J in (0.0, 1e-4))
    assert np.max(np.abs(none.system.added_inertia)) > 0.0
    a, b = (solve_accepted(p, solver, size) for p in (none, some))
    assert len(a.t) == len(b.t)
    assert_close(a.states.r, b.states.r, rtol=0.0, atol=1e-10)
    assert_close(energy(none.system, a.states), energy(some.system, b.states), rtol=1e-11)
    loads = [constraint_jacobian(none.system, out.states[-1]).T @ out.reaction[-1] for out in (a, b)]
    assert_close(*loads, rtol=0.0, atol=1e-8 * np.max(np.abs(loads)))
