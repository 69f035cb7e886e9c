"""Options of ODE-GC: labels, given C_bar and K_bar, Eq. (84) in full, raised penalties, the rank check."""

import math
import time

import numpy as np
import pytest

from mbsbench.api import solve
from mbsbench.harness.catalogue.registry import make_problem, make_solver, read_declaration, solvers
from mbsbench.harness.mechanics.motion import constraint
from mbsbench.harness.mechanics.system import Joint, RigidBody, SpringDamper, assemble
from mbsbench.harness.mechanics.types import Problem, StepControl
from mbsbench.solvers.formulations.compiled import host
from mbsbench.solvers.formulations.compiled.kernel import Kernel
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.factories import solve_run

from ..arbitrary_systems import consistent
from ..runs import error, orders, pendulum, sprung_linkage

PRINTED = {"gauge": "accumulate", "sigma0": "carried", "newton": "exact"}
NESTED = {"loop": "nested", "penalty": 1e3}
OTHER = "accumulating, sigma carried"
RAISED = NESTED | {"lambda_bar": True, "penalty_growth": 10.0, "correct_pose": "never", "tolerance": 1e-3}


@pytest.mark.parametrize(
    ("solver", "options", "label", "order"),
    [
        ("gc_weak_form", {}, "ODE-GC (symmetric)", 2.0),
        ("gc_weak_form", {"gauge": "zero"}, "ODE-GC (zero gauge)", 2.0),
        ("gc_weak_form", PRINTED, "ODE-GC (as printed)", 2.0),
        ("gc_weak_form", PRINTED | {"f_bar": False}, "ODE-GC (accumulating, sigma carried)", 2.0),
        ("gc_weak_form", PRINTED | {"newton": "kept"}, "ODE-GC (accumulating, sigma carried)", 2.0),
        ("gc_weak_form", PRINTED | {"estimate": "start", "direction": "mass"}, "ODE-GC (as printed)", 2.0),
        ("gc_augmented_lagrangian", {}, "ODE-GC (AL, symmetric)", 2.0),
        ("gc_augmented_lagrangian", PRINTED | NESTED, "ODE-GC (AL, accumulating, sigma carried)", 2.0),
        ("gc_augmented_lagrangian", PRINTED | RAISED, "ODE-GC (AL, as printed)", 2.0),
        ("gc_augmented_lagrangian", PRINTED | RAISED | {"accept": 0.1}, f"ODE-GC (AL, {OTHER})", 2.0),
        ("gc_augmented_lagrangian", PRINTED | RAISED | {"max_turn": 0.1}, f"ODE-GC (AL, {OTHER})", 2.0),
        ("rattle", {}, "", 2.0),
        ("rattle", {"composition": "kahan_li6"}, "", 6.0),
        ("rkmk_dop853", {}, "", math.nan),
    ],
)
def test_label_and_order_follow_the_options(solver, options, label, order):
    """Printed are the choices of Sects. 4.2 and 4.3, all of them; the order is that of the composition."""
    assert read_declaration(make_solver(solver, options))[0] == label
    assert read_declaration(make_solver(solver, options))[1] == pytest.approx(order, nan_ok=True)


def test_a_record_has_the_label_of_its_options():
    """The catalogue lists the label of the defaults."""
    done = solve("torque_free_body", "gc_weak_form", dt=0.1, t_end=0.5, gauge="zero")
    assert done.record.paper_label == "ODE-GC (zero gauge)"
    assert solvers()["gc_weak_form"].paper_label == "ODE-GC (symmetric)"


@pytest.mark.parametrize("newton", ["simplified", "kept"])
@pytest.mark.parametrize("solver", ["gc_weak_form", "gc_augmented_lagrangian"])
def test_what_is_prepared_is_set_up(solver, newton, monkeypatch):
    """A cold compiler takes its time before the first step: the record has it as set-up, not as CPU time of the run."""
    sound = host.make_kernel

    def slow(*given: object) -> Kernel:
        began = time.process_time()
        while time.process_time() - began < 0.5:
            pass
        return sound(*given)

    monkeypatch.setattr(host, "make_kernel", slow)
    record = solve("heavy_top", solver, t_end=0.01, newton=newton).record
    assert record.setup_s >= 0.5 and record.cpu_min_s < 0.25


@pytest.mark.parametrize("direction", ["a", "mass", "translation"])
def test_given_c_bar_and_k_bar_pull_phi_back(direction):
    """M_bar (phi_ddot + c phi_dot + k phi) = 0, Eq. (37): critically damped, phi stays below a tenth of what it was.

    The motion keeps order two whatever c_R is: corrective terms vanish on the constraint manifold.
    """
    problem = pendulum(2.0)
    free = solve_run(problem, 0.005)
    errors = []
    for dt in (0.01, 0.005, 0.0025):
        out = solve_run(problem, dt, c_bar=200.0, k_bar=1e4, direction=direction)
        errors.append(error(problem, out))
        if dt == 0.005:
            held = np.max(np.abs(constraint(problem.system, out.states)))
    assert held < 0.1 * np.max(np.abs(constraint(problem.system, free.states)))
    assert_each(np.abs(orders(errors) - 2.0), "<", 0.3)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("direction", ["a", "mass", "translation"])
def test_eq_32_converges_for_every_c_r(direction):
    """Springs and dampers, C_bar and K_bar of Eq. (32) and given ones on top: to the strong form with order two."""
    pin = [Joint(0, (0.3, 0.1, 0.0), s_j=(0.1, -0.2, 0.3)), Joint(1, (0.2, 0.0, -0.3), 0, (-0.4, 0.1, 0.2))]
    bodies = [RigidBody(m, np.diag(m * np.array([0.04, 0.07, 0.09]))) for m in (1.3, 0.7)]
    springs = [SpringDamper(1, (-0.1, 0.2, 0.0), stiffness=40.0, rest_length=0.2, damping=0.7, p_j=(1.0, 2.0, -1.0))]
    system = assemble(bodies, pin, (1.1, -2.3, -9.5), springs)
    problem = Problem("pins", system, consistent(system, 2), t_end=0.3, dt=1e-3, section="", source="")
    strong = make_solver("rk45_strong_form").solve(problem, StepControl(rtol=1e-12))
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        out = solve_run(problem, dt, direction=direction, c_bar=5.0, k_bar=50.0)
        errors.append(np.max(np.abs(out.states.r[-1] - strong.states.r[-1])))
    assert_each(np.abs(orders(errors) - 2.0), "<", 0.2)


@pytest.mark.parametrize("solver", ["gc_weak_form", "gc_augmented_lagrangian"])
def test_a_gauge_without_effect_is_noted(solver):
    """With springs mu is carried on (Eq. 32): the same motion in every gauge, and the run says so."""
    problem = sprung_linkage(0.3)
    one, other = (solve_run(problem, 0.01, solver, gauge=g) for g in ("symmetric", "zero"))
    assert_same(one.states.r, other.states.r)
    assert "gauge = symmetric has no effect" in one.notes[-1]
    assert "gauge = zero has no effect" in other.notes[-1]
    assert not any(
        "gauge" in note for note in solve_run(make_problem("heavy_top", {"t_end": 0.01}), 1e-3, solver).notes
    )


def test_lambda_bar_leaves_the_motion_alone():
    """The augmentation takes phi_dot to zero with or without it: the multipliers change, the motion hardly."""
    without, out = (
        solve_run(sprung_linkage(0.3), 1e-3, "gc_augmented_lagrangian", **NESTED, lambda_bar=on) for on in (False, True)
    )
    assert 0.0 < np.max(np.abs(out.states.r - without.states.r)) < 1e-7


def test_the_plain_composition_is_the_weak_form_itself():
    p = make_problem("chain", {"t_end": 0.3})
    mine, theirs = solve_run(p, 1e-3, "gc_composed", composition="plain"), solve_run(p, 1e-3, tolerance=1e-12)
    np.testing.assert_allclose(mine.states.r, theirs.states.r, atol=1e-10)


def test_a_raised_penalty_converges_where_a_low_one_does_not():
    """xi = 1 leaves steps that run out of augmentations; raised tenfold where phi_dot falls too slowly, none."""
    problem = make_problem("chain", {"t_end": 0.1})
    low = solve_run(problem, 1e-3, "gc_augmented_lagrangian", loop="nested", penalty=1.0)
    raised = solve_run(problem, 1e-3, "gc_augmented_lagrangian", loop="nested", penalty=1.0, penalty_growth=10.0)
    plain = solve_run(problem, 1e-3)
    assert low.counters["loose_steps"] > 10
    assert raised.counters["loose_steps"] == 0
    assert np.nanmax(raised.diagnostics["penalty"]) > 1.0
    assert np.max(np.abs(raised.states.r - plain.states.r)) < 1e-7


def test_the_nested_loop_asks_for_eq_81_after_the_augmentation():
    """A low penalty leaves phi_dot above the tolerance in Newton's loop; sigma carried on or not, (85) takes it out.

    Sect. 4.3 tests (80) at a fixed multiplier; with (81) in that loop every step would end at its first augmentation.
    """
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.2})
    for sigma0 in ("zero", "carried"):
        options = PRINTED | NESTED | {"penalty": 10.0, "sigma0": sigma0, "tolerance": 1e-5, "correct_pose": "never"}
        out = solve_run(problem, 1e-2, "gc_augmented_lagrangian", **options)
        assert out.counters["step_cuts"] == 0 and out.counters["augmentations"] > 2 * out.counters["steps"]
        assert np.nanmax(out.diagnostics["constraint_norm"]) < 1e-5


@pytest.mark.parametrize("newton", ["simplified", "kept", "exact"])
def test_the_first_estimate_costs_corrections_and_changes_no_motion(newton):
    """From the start of the step instead of an extrapolation, Newton's method ends in the same step."""
    problem = pendulum(1.0)
    one, other = (
        solve_run(problem, 1e-2, newton=newton, estimate=e, tolerance=1e-11) for e in ("extrapolated", "start")
    )
    assert other.counters["newton_iterations"] > one.counters["newton_iterations"]
    np.testing.assert_allclose(other.states.r, one.states.r, atol=1e-9)


@pytest.mark.parametrize("option", [{"lambda_bar": True}, {"penalty_growth": 10.0}], ids=str)
def test_options_of_the_nested_loop_need_it(option):
    """The proximal loop has no augmentations of its own."""
    problem = make_problem("heavy_top")
    reason = make_solver("gc_augmented_lagrangian", option).refuses(problem, StepControl(dt=1e-3))
    assert "nested" in reason


def test_without_the_rank_check_the_weak_form_itself_is_tried():
    """Not the simplified method, whose dropped pivots would be the augmented Lagrangian's motion."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.1})
    runs = []
    for newton in ("simplified", "kept"):
        tried = make_solver("gc_weak_form", {"rank_check": False, "newton": newton})
        assert tried.refuses(problem, StepControl(dt=1e-2)) is None
        runs.append(tried.solve(problem, StepControl(dt=1e-2)))
    first, second = runs
    assert first.status is second.status and first.counters == second.counters
    np.testing.assert_array_equal(first.states.r, second.states.r)


def test_as_printed_runs_on_the_grid_without_correcting_poses():
    """Fig. 12 as printed: phi stays where the step leaves it, so it is larger than with corrected poses."""
    problem = make_problem("four_bar_grid", {"rows": 2, "columns": 2, "t_end": 0.5})
    worst = {}
    for when in ("never", "redundant"):
        options = PRINTED | NESTED | {"tolerance": 1e-3, "correct_pose": when}
        out = solve_run(problem, 1e-2, "gc_augmented_lagrangian", **options)
        worst[when] = np.max(np.abs(constraint(problem.system, out.states)))
        assert any("corrected" in note for note in out.notes) == (when == "redundant")
    assert worst["never"] > 10.0 * worst["redundant"]
