"""The simplified Newton method takes the step of the full one: same motion to the tolerance, wherever it applies."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.types import Problem, StepControl
from mbsbench.solvers.formulations.methods.gc_step import applies

from ..arbitrary_systems import consistent, linkage
from ..runs import pendulum, run, sprung_linkage

SHARP = {"tolerance": 1e-12}


def gap(problem: Problem, dt: float, solver: str = "gc_weak_form", **options) -> float:
    """Largest difference of positions, orientations and velocities between the two methods."""
    one, two = (run(problem, dt, solver, newton=n, **SHARP, **options) for n in ("simplified", "kept"))
    assert np.array_equal(one.t, two.t)
    assert one.counters["newton_iterations"] != two.counters["newton_iterations"]  # it is another method
    assert np.max(np.abs(one.reaction[1:] - two.reaction[1:])) < 1e-5
    return max(np.max(np.abs(getattr(one.states, k) - getattr(two.states, k))) for k in ("r", "R", "v", "Omega"))


@pytest.mark.parametrize(("name", "dt"), [("heavy_top", 1e-3), ("spherical_pendulum", 0.01), ("chain", 1e-3)])
def test_both_methods_give_one_trajectory(name, dt):
    """Each solves (74), (75) to 1e-12 sqrt(J) a step; steps add up to less than 1e-8."""
    assert gap(make_problem(name, {"t_end": 0.4}), dt) < 1e-8


@pytest.mark.parametrize("direction", ["a", "mass"])
@pytest.mark.parametrize("gauge", ["symmetric", "zero", "accumulate"])
def test_every_gauge_and_direction_on_an_arbitrary_linkage(gauge, direction):
    """Spherical and revolute joints, ends on the ground and between bodies, inertia without symmetry."""
    system = linkage(springs=False)
    problem = Problem("linkage", system, consistent(system, 2), t_end=0.05, dt=1e-3, section="", source="")
    assert gap(problem, 1e-3, gauge=gauge, direction=direction) < 1e-8


@pytest.mark.parametrize("options", [{"direction": "translation"}, {"f_bar": False}, {"b_term": False}], ids=str)
def test_other_choices_of_the_scheme(options):
    """c_R along the translations, f_bar off, the planted error: the same equations in both methods."""
    assert gap(pendulum(0.5), 0.01, gauge="zero", **options) < 1e-8


def test_redundant_rows_get_no_multiplier_and_the_motion_is_that_of_the_proximal_saddle():
    """Reactions differ, A^T nu does not."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 3, "t_end": 0.3})
    options = {"correct_pose": "never", **SHARP}
    one, two = (run(problem, 0.01, "gc_augmented_lagrangian", newton=n, **options) for n in ("simplified", "kept"))
    assert np.max(np.abs(one.states.r - two.states.r)) < 1e-10
    assert np.max(np.abs(one.states.v - two.states.v)) < 1e-9


def test_poses_of_redundant_systems_are_corrected():
    """One pass a step, with a factor of S from nearby: what is left is a small part of what there would be."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 3, "t_end": 0.3})
    solver, worst = "gc_augmented_lagrangian", {}
    for when in ("redundant", "never"):
        out = run(problem, 0.01, solver, newton="simplified", correct_pose=when)
        worst[when] = np.max(np.abs(constraint(problem.system, out.states)))
    assert worst["redundant"] < 0.1 * worst["never"]


def test_steps_it_does_not_converge_at_are_taken_by_the_full_method():
    """The contraction is O(dt omega): at 0.15 s it fails, the run goes on, and the motion is the same."""
    problem = pendulum(10.0)
    out = [run(problem, 0.15, newton=n, **SHARP) for n in ("simplified", "kept")]
    assert np.array_equal(out[0].t, out[1].t) and out[0].counters["residuals"] > out[0].counters["newton_iterations"]
    assert np.max(np.abs(out[0].states.r - out[1].states.r)) < 1e-9


def test_springs_carried_sigma_and_the_nested_loop_are_not_its_own():
    """There the march is that of ``newton = kept``, to the last bit."""
    problem = sprung_linkage(0.05)
    one, two = (run(problem, 1e-3, newton=n) for n in ("simplified", "kept"))
    assert np.array_equal(one.states.r, two.states.r)
    free = make_problem("chain")
    for options, own in (
        ({}, True),
        ({"sigma0": "carried"}, False),
        ({"c_bar": 1.0}, False),
        ({"newton": "kept"}, False),
    ):
        assert applies(make_solver("gc_weak_form", options).settings(free), free.system) == own


def test_recorded_norms_are_below_the_tolerance():
    """(80) and (81) of every step."""
    out = make_solver("gc_weak_form").solve(make_problem("chain", {"t_end": 0.2}), StepControl(dt=1e-3))
    assert np.nanmax(out.diagnostics["residual_norm"]) < 1e-8
    assert np.nanmax(out.diagnostics["constraint_norm"]) < 1e-8
