"""The simplified Newton method takes the step of the full one: same motion to the tolerance, wherever it serves."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.mechanics.types import Problem, Status, StepControl
from mbsbench.solvers.formulations.compiled import mechanism
from mbsbench.solvers.formulations.methods.choices import find_unsupported
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.factories import solve_run

from ..arbitrary_systems import consistent, linkage
from ..runs import drift, error, orders, pendulum, sprung_linkage

SHARP = {"tolerance": 1e-12}


def gap(problem: Problem, dt: float, solver: str = "gc_weak_form", **options) -> float:
    """Largest difference of positions, orientations and velocities between the two methods."""
    one, two = (solve_run(problem, dt, solver, newton=n, **SHARP, **options) for n in ("simplified", "kept"))
    assert_same(one.t, two.t)
    assert one.counters["newton_iterations"] != two.counters["newton_iterations"]  # it is another method
    assert np.max(np.abs(one.reaction[1:] - two.reaction[1:])) < 1e-5
    return max(np.max(np.abs(getattr(one.states, k) - getattr(two.states, k))) for k in ("r", "R", "v", "Omega"))


@pytest.mark.parametrize(("name", "dt"), [("heavy_top", 1e-3), ("spherical_pendulum", 0.01), ("chain", 1e-3)])
def test_both_methods_give_one_trajectory(name, dt):
    """Each solves (74), (75) to 1e-12 sqrt(J) a step; steps add up to less than 1e-8."""
    assert gap(make_problem(name, {"t_end": 0.4}), dt) < 1e-8


SCHEMES = [(gauge, direction) for gauge in ("symmetric", "zero", "accumulate") for direction in ("a", "mass")]


def keep_half(rest):
    """Every gauge once and both directions, the other half with a ``rest`` of 1; what is left out is slow."""
    kept = [k % 2 == (k // 2 + rest) % 2 for k in range(len(SCHEMES))]
    return [pytest.param(*s, marks=() if own else pytest.mark.slow) for s, own in zip(SCHEMES, kept, strict=True)]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("gauge", "direction"), keep_half(0))
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
    one, two = (
        solve_run(problem, 0.01, "gc_augmented_lagrangian", newton=n, **options) for n in ("simplified", "kept")
    )
    assert np.max(np.abs(one.states.r - two.states.r)) < 1e-10
    assert np.max(np.abs(one.states.v - two.states.v)) < 1e-9


def test_poses_of_redundant_systems_are_corrected():
    """One pass a step, with a factor of S from nearby: what is left is a small part of what there would be."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 3, "t_end": 0.3})
    solver, worst = "gc_augmented_lagrangian", {}
    for when in ("redundant", "never"):
        out = solve_run(problem, 0.01, solver, newton="simplified", correct_pose=when)
        worst[when] = np.max(np.abs(constraint(problem.system, out.states)))
    assert worst["redundant"] < 0.1 * worst["never"]


def test_steps_it_does_not_converge_at_are_taken_by_the_full_method():
    """The contraction is O(dt omega): at 0.15 s it fails, the run goes on, and the motion is the same."""
    problem = pendulum(10.0)
    out = [solve_run(problem, 0.15, newton=n, **SHARP) for n in ("simplified", "kept")]
    assert_same(out[0].t, out[1].t)
    assert out[0].counters["residuals"] > out[0].counters["newton_iterations"]
    assert np.max(np.abs(out[0].states.r - out[1].states.r)) < 1e-9


def test_springs_carried_sigma_and_the_nested_loop_are_not_its_own():
    """There the march is that of ``newton = kept``, to the last bit."""
    problem = sprung_linkage(0.05)
    one, two = (solve_run(problem, 1e-3, newton=n) for n in ("simplified", "kept"))
    assert_same(one.states.r, two.states.r)
    free = make_problem("chain")
    for options, own in (
        ({}, True),
        ({"sigma0": "carried"}, False),
        ({"c_bar": 1.0}, False),
        ({"newton": "kept"}, False),
    ):
        assert (not find_unsupported(make_solver("gc_weak_form", options).make_settings(free), free.system)) == own


def test_recorded_norms_are_below_the_tolerance():
    """(80) and (81) of every step."""
    out = make_solver("gc_weak_form").solve(make_problem("chain", {"t_end": 0.2}), StepControl(dt=1e-3))
    assert np.nanmax(out.diagnostics["residual_norm"]) < 1e-8
    assert np.nanmax(out.diagnostics["constraint_norm"]) < 1e-8


CODES = ("kernel", "mechanism")
SAME = 1e-9  # [m], [m/s] of steps solved to 1e-12 sqrt(J)


def gap_of_codes(problem: Problem, dt: float, solver: str = "gc_weak_form", **options) -> float:
    """Largest difference of the motion, and of what is told, between loops over joints and code for the mechanism."""
    one, two = (solve_run(problem, dt, solver, code=code, **SHARP, **options) for code in CODES)
    assert "code of the mechanism" in two.notes
    assert_same(one.t, two.t)
    assert two.counters["newton_iterations"] < 1.2 * one.counters["newton_iterations"]
    for out in (one, two):  # no step is handed to the full method, whose motion is right where these equations are not
        assert out.counters["residuals"] == out.counters["newton_iterations"]
    assert one.reaction is not None and two.reaction is not None
    assert np.max(np.abs(one.reaction[1:] - two.reaction[1:])) < 1e-6 * max(1.0, np.max(np.abs(one.reaction[1:])))
    if "log_determinant" in one.diagnostics:  # of factors that may be taken an iteration apart
        assert np.max(np.abs(one.diagnostics["log_determinant"] - two.diagnostics["log_determinant"])[1:]) < 0.1
    return max(np.max(np.abs(getattr(one.states, k) - getattr(two.states, k))) for k in ("r", "R", "v", "Omega"))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("name", "dt", "solver"),
    [
        ("heavy_top", 1e-3, "gc_weak_form"),
        ("spherical_pendulum", 0.01, "gc_weak_form"),
        ("chain", 1e-3, "gc_weak_form"),
        ("chain", 1e-3, "gc_augmented_lagrangian"),
        ("bricard", 0.01, "gc_augmented_lagrangian"),
    ],
)
def test_code_for_the_mechanism_gives_the_motion_of_the_kernel(name, dt, solver):
    """Straight code instead of loops over joints: the same step, redundant rows and pose corrections included."""
    assert gap_of_codes(make_problem(name, {"t_end": 0.4}), dt, solver) < SAME


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("gauge", "direction"), keep_half(1))
def test_code_for_the_mechanism_has_every_gauge_and_direction(gauge, direction):
    """On an arbitrary linkage, whose numbers leave no zeros."""
    check_codes_on_a_linkage(gauge=gauge, direction=direction)


@pytest.mark.parametrize("options", [{"f_bar": False}, {"b_term": False}], ids=str)
def test_code_for_the_mechanism_has_every_choice_of_the_scheme(options):
    """The planted error among them."""
    check_codes_on_a_linkage(**options)


def check_codes_on_a_linkage(**options):
    """Loops over joints and code for the mechanism give one motion."""
    system = linkage(springs=False)
    problem = Problem("linkage", system, consistent(system, 2), t_end=0.05, dt=1e-3, section="", source="")
    assert gap_of_codes(problem, 1e-3, **options) < SAME


def test_code_for_the_mechanism_hands_over_where_the_simplified_method_fails():
    """To the full method, as the kernel does, and takes the march back."""
    problem = pendulum(10.0)
    out = [solve_run(problem, 0.15, code=code, **SHARP) for code in CODES]
    assert out[1].counters["residuals"] > out[1].counters["newton_iterations"]
    assert np.max(np.abs(out[0].states.r - out[1].states.r)) < SAME


def test_code_for_the_mechanism_keeps_order_reversal_and_energy():
    """Order 2 against exact motion; back where it came from; energy of the pendulum bounded."""
    problem = pendulum(2.0)
    ladder = [solve_run(problem, 0.02 / 2**k, code="mechanism") for k in range(3)]
    assert_each(np.abs(orders([error(problem, out) for out in ladder]) - 2.0), "<", 0.1)
    E = np.abs(drift(problem, solve_run(pendulum(20.0), 0.01, code="mechanism")))
    assert np.max(E[len(E) // 2 :]) < 1.1 * np.max(E[: len(E) // 2])
    there = solve_run(problem, 0.01, code="mechanism", **SHARP)
    last = there.states[-1]
    turned = dataclasses.replace(problem, initial=dataclasses.replace(last, v=-last.v, Omega=-last.Omega, t=0.0))
    back = solve_run(turned, 0.01, code="mechanism", **SHARP)
    assert np.max(np.abs(back.states.r[-1] - problem.initial.r)) < SAME
    assert np.max(np.abs(there.states.r - problem.initial.r)) > 0.5


def test_code_for_the_mechanism_is_refused_in_a_line_where_none_is_made(monkeypatch):
    """Springs, choices of the full method, the nested loop, more than 30,000 operations."""
    for name, solver, options, word in (
        ("spring_pendulum", "gc_weak_form", {}, "forces"),
        ("chain", "gc_weak_form", {"max_turn": 0.1}, "max_turn"),
        ("chain", "gc_augmented_lagrangian", {"loop": "nested"}, "nested"),
        ("four_bar_grid", "gc_augmented_lagrangian", {}, "30000 operations"),
    ):
        reason = make_solver(solver, {"code": "mechanism", **options}).refuses(make_problem(name), StepControl(dt=0.01))
        assert reason is not None and word in reason and "\n" not in reason and "code = kernel" in reason
    solver, chain = make_solver("gc_augmented_lagrangian", {"code": "mechanism"}), make_problem("chain")
    monkeypatch.setattr(mechanism, "MOST_OPERATIONS", 4000)  # known once it is written
    assert solver.refuses(chain, StepControl(dt=0.01)) is None
    assert solver.solve(chain, StepControl(dt=0.01)).status is Status.REFUSED
