"""Which Newton iterate ends a step: the first that passes, that one corrected, or one after a correction."""

import numpy as np
import pytest

from mbsbench import StepControl
from mbsbench.api import solve
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint_rate
from mbsbench.solvers.formulations.methods.choices import FINAL_ITERATES
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.factories import solve_run

from ..runs import error, orders, pendulum

PRINTED = {"gauge": "accumulate", "sigma0": "carried", "newton": "exact", "direction": "translation"}
LOOSE = PRINTED | {"tolerance": 1e-3}


@pytest.mark.parametrize("final", FINAL_ITERATES)
@pytest.mark.parametrize("newton", ["exact", "kept", "simplified"])
def test_the_order_is_two_whatever_iterate_ends_a_step(final, newton):
    """The discrete equations are the same; at 1e-10 what is left of them is far below the error of a step."""
    problem = pendulum(1.0)
    options = PRINTED | {"newton": newton, "final_iterate": final, "tolerance": 1e-10}
    errors = [error(problem, solve_run(problem, dt, **options)) for dt in (0.01, 0.005, 0.0025)]
    assert_each(np.abs(orders(errors) - 2.0), "<", 0.2)


@pytest.mark.parametrize(
    ("solver", "options"),
    [
        ("gc_weak_form", {}),
        ("gc_weak_form", PRINTED),
        ("gc_augmented_lagrangian", {"newton": "exact", "penalty": 1e7}),
        ("gc_augmented_lagrangian", {"newton": "exact", "loop": "nested", "penalty": 1e3}),
    ],
)
def test_all_final_iterates_agree_at_a_tight_tolerance(solver, options):
    """They differ by what the tolerance 1e-10 leaves, summed over 50 steps."""
    problem = pendulum(0.5)
    ends = [
        solve_run(problem, 0.01, solver, tolerance=1e-10, final_iterate=f, **options).states.r for f in FINAL_ITERATES
    ]
    assert max(np.max(np.abs(e - ends[0])) for e in ends[1:]) < 1e-9


def test_a_passing_iterate_that_is_corrected_leaves_the_square_of_its_residual():
    """Newton's method with the Jacobian of each iterate is quadratic: below 1e-3 before, far below 1e-4 after.

    Each step has one correction more at least, also those whose first estimate passes.
    """
    passing, corrected = (solve_run(pendulum(2.0), 0.01, **LOOSE, final_iterate=f) for f in ("passing", "corrected"))
    largest = [np.nanmax(out.diagnostics["residual_norm"][1:]) for out in (passing, corrected)]
    assert 1e-5 < largest[0] < 1e-3 and largest[1] < 1e-5
    assert_each(corrected.diagnostics["newton_iterations"][1:], ">=", 1)


def test_a_step_after_one_correction_never_ends_in_its_estimate():
    """At 0.002 s and 1e-3 most first estimates pass; kept as they are they carry the pendulum half a metre off."""
    error_of = {}
    for final in FINAL_ITERATES:
        done = solve("spherical_pendulum", "gc_weak_form", dt=0.002, final_iterate=final, **LOOSE).record
        error_of[final] = done.position_error_judged_m
    assert error_of["passing"] > 0.1 and max(error_of["corrected"], error_of["after_correction"]) < 1e-3


def test_the_final_iterate_decides_the_energy_of_the_pendulum():
    """40 s as printed at 1e-3, from the start of each step: kept uncorrected it loses a third of a joule of 4.9 J."""
    options = LOOSE | {"estimate": "start"}
    lost = {}
    for final in ("passing", "corrected"):
        energy = solve("spherical_pendulum", "gc_weak_form", dt=0.01, final_iterate=final, **options).series["energy"]
        lost[final] = energy[-1] - energy[0]
    assert lost["passing"] < -0.2 and abs(lost["corrected"]) < 1e-3


@pytest.mark.sampled(1)
@pytest.mark.parametrize("direction", ["a", "mass", "translation"])
def test_corrected_the_chain_conserves_its_energy(direction):
    """20 s as printed at 1e-3: over the last quarter the mean error is below 0.1 J, in each direction of c_R."""
    options = LOOSE | {"direction": direction, "final_iterate": "corrected"}
    done = solve("chain", "gc_weak_form", dt=0.001, max_steps=30000, **options).record
    assert done.t_reached_s == pytest.approx(20.0) and abs(done.energy_mean_last_quarter_J) < 0.1


def test_code_for_the_mechanism_refuses_other_iterates():
    """It is the simplified method's, which keeps the passing iterate."""
    problem = make_problem("heavy_top", {"t_end": 0.01})
    solver = make_solver("gc_weak_form", {"code": "mechanism", "final_iterate": "corrected"})
    assert "another final_iterate than passing" in solver.refuses(problem, StepControl(dt=1e-3))


def test_a_low_penalty_leaves_no_phi_dot_that_velocities_can_take_away():
    """(81) on the grid's redundant rows, proximal loop: phi_dot near the tolerance, and the motion of a high penalty.

    What no velocity can change of phi_dot is phi = O(dt^3) of a step, far below.
    """
    problem = make_problem("four_bar_grid", {"t_end": 0.2})
    options = {"newton": "exact", "tolerance": 1e-10, "correct_pose": "never"}
    low, high = (solve_run(problem, 0.01, "gc_augmented_lagrangian", penalty=xi, **options) for xi in (1e3, 1e7))
    assert np.max(np.abs(constraint_rate(problem.system, low.states))) < 1e-8
    assert np.max(np.abs(low.states.r - high.states.r)) < 1e-9
