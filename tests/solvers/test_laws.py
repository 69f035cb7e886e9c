"""Laws that motions of all solvers obey: the way back, energy, momenta, frames, reactions, limits, repetition."""

import dataclasses

import numpy as np
import pytest

from mbsbench import Status, StepControl, constraint_jacobian
from mbsbench.harness.catalogue.registry import engines, make_problem, make_solver, solvers
from mbsbench.harness.mechanics import so3, work
from mbsbench.harness.mechanics.presentation import Presentation
from mbsbench.tests.comparing import assert_each, assert_same
from mbsbench.tests.factories import choose_control, solve_run

from .runs import ACCEPTED, CONTESTANTS, SYMBOLIC, drift, error, momentum, pendulum, sprung_linkage

OWN = [name for name in solvers() if name not in engines()]
SHARP = {"tolerance": 1e-14}
PLANAR, CHAIN = ("spherical_pendulum", {"t_end": 5.0}, 0.01), ("chain", {"t_end": 0.5}, 1e-3)
SPATIAL = "spherical_pendulum", {"t_end": 5.0, "omega_z": 0.1}, 0.01
REVERSIBLE = [  # solver, options, problem, how near [m] it comes back
    *(("gc_composed", SHARP, p, 1e-10) for p in (PLANAR, CHAIN)),
    *((solver, {}, p, 1e-11) for solver in ("energy_momentum", "lie_variational") for p in (PLANAR, CHAIN)),
    *(("rattle", {"composition": c}, p, 1e-11) for c in ("plain", "suzuki4", "kahan_li6") for p in (PLANAR, CHAIN)),
    ("gc_weak_form", {"tolerance": 1e-12}, SPATIAL, 1e-9),
    *(
        (solver, {"composition": "kahan_li6", "rate": 5.0, **SHARP}, (*CHAIN[:2], 0.005), 1e-8)
        for solver in ("rattle", "gc_composed")
    ),  # z starts from 1/s, not from its own last value: nearly the same steps
]


@pytest.mark.parametrize(("solver", "options", "problem", "near"), REVERSIBLE)
def test_there_and_back_ends_at_the_start(solver, options, problem, near):
    """Velocities reversed, the same steps lead back, as far as their equations are solved and rounding stays small."""
    name, parameters, dt = problem
    p = make_problem(name, parameters)
    there = solve_run(p, dt, solver, **options).states[-1]
    back = dataclasses.replace(there, v=-there.v, Omega=-there.Omega, t=0.0)
    home = dataclasses.replace(p, initial=back, reference_from=None)
    end = solve_run(home, dt, solver, **options).states[-1]
    assert np.max(np.abs(end.r - p.initial.r)) < near
    if parameters.get("omega_z"):  # of the chain, rounding grows most in velocities
        assert max(np.max(np.abs(end.R - p.initial.R)), np.max(np.abs(end.v + p.initial.v))) < near


@pytest.mark.parametrize(
    ("solver", "options", "t_end", "dt", "share"),
    [
        ("gc_composed", {}, 400.0, 0.04, 0.02),
        ("rattle", {}, 200.0, 0.01, 0.01),
        ("rattle", {"composition": "suzuki4", "rate": 5.0}, 200.0, 0.05, 0.1),
    ],
)
def test_energy_stays_bounded_over_hundreds_of_periods(solver, options, t_end, dt, share):
    """Mean energy errors of the first and the last quarter agree: no drift."""
    p = make_problem("spherical_pendulum", {"t_end": t_end})
    E = drift(p, solve_run(p, dt, solver, **options))
    first, last = np.mean(E[: len(E) // 4]), np.mean(E[-(len(E) // 4) :])
    assert abs(last - first) < share * abs(first)


@pytest.mark.parametrize(("which", "options"), [("alpha", {"rho_inf": 0.6}), ("alpha", {}), ("al", {})])
def test_numerical_damping_takes_energy_away(which, options):
    """Pendulum over some sixty periods: the mean of the last quarter lies below that of the first."""
    p, (solver, standard) = make_problem("spherical_pendulum", {"t_end": 100.0}), CONTESTANTS[which]
    E = drift(p, solve_run(p, 0.02, solver, **standard, **options))
    assert np.mean(E[-(len(E) // 4) :]) < np.mean(E[: len(E) // 4]) < 0.0


@pytest.mark.parametrize("form", [{}, {"form": "index3"}], ids=str)
def test_more_damping_is_asked_for_by_a_smaller_radius(form):
    p = make_problem("spherical_pendulum", {"t_end": 50.0})
    drifts = [drift(p, solve_run(p, 0.02, "generalized_alpha", **form, rho_inf=rho)) for rho in (0.8, 0.4)]
    lost = [np.mean(E[:500]) - np.mean(E[-500:]) for E in drifts]
    assert 0.0 < 5.0 * lost[0] < lost[1], lost


@pytest.mark.parametrize(
    ("name", "parameters", "dt"),
    [
        ("spherical_pendulum", {"t_end": 4.0, "omega_z": 0.1}, 0.02),
        ("heavy_top", {"t_end": 5.0}, 0.008),
        ("chain", {"t_end": 0.4}, 0.008),
        ("four_bar_grid", {"t_end": 0.3}, 0.025),
    ],
)
def test_energy_momentum_keeps_energy_and_the_momentum_about_the_vertical(name, parameters, dt):
    """To rounding in steps of any length; gravity and the fixed point exert no torque on the top about it."""
    p = make_problem(name, parameters)
    out = solve_run(p, dt, "energy_momentum")
    assert np.max(np.abs(drift(p, out))) < 1e-9
    if name == "heavy_top":
        L = momentum(p, out) @ p.system.gravity
        assert np.ptp(L) < 1e-10 * np.abs(L[0])


def test_springs_give_back_what_they_took():
    """The discrete gradient: energy of springs included, kept to rounding; a damper only takes away."""
    p, damped = sprung_linkage(0.4, 5, damped=False), sprung_linkage(0.4, 5)
    assert np.max(np.abs(drift(p, solve_run(p, 4e-3, "energy_momentum")))) < 1e-9
    assert_each(np.diff(drift(damped, solve_run(damped, 4e-3, "energy_momentum"))), "<", 0.0)


@pytest.mark.parametrize(("solver", "dt", "sharp"), [("gc_weak_form", 300.0, 1e-11), ("rattle", 50.0, 1e-12)])
def test_a_symmetric_free_body_is_exact_in_any_step(solver, dt, sharp):
    """It turns about a fixed axis at constant rate, which is the exact motion (Sect. 5.1)."""
    p = make_problem("torque_free_body", {"t_end": dt})
    out = solve_run(p, dt, solver)
    exact = p.reference().states(out.t)
    assert len(out.t) == 2
    assert np.max(np.abs(out.states.R - exact.R)) < sharp and np.max(np.abs(out.states.Omega - exact.Omega)) < sharp


@pytest.mark.parametrize(
    ("solver", "options", "dt"),
    [
        ("gc_weak_form", {"tolerance": 1e-12}, 0.01),
        ("lie_variational", {}, 0.05),
    ],
)
def test_a_free_body_keeps_momentum_and_energy_but_not_time(solver, options, dt):
    """Three inertias, 20 s: to what the equations are solved to.

    ODE-GC: with E = exp(dt/2 (Omega0 + Omega1)^), J Omega1 = E^T J Omega0 and E leaves Omega0 + Omega1 alone, so
    (Omega0 + Omega1) . J (Omega1 - Omega0) = 0. The discrete equations of the variational step are integrable, too.
    """
    p = make_problem("torque_free_body", {"t_end": 20.0, "inertia_factors": (1.0, 1.5, 2.0), "omega": (0.3, 1.0, 0.2)})
    out = solve_run(p, dt, solver, **options)
    L = momentum(p, out)
    assert np.max(np.abs(L - L[0])) < 1e-9
    assert np.max(np.abs(drift(p, out))) < 1e-9
    angles = so3.angle_between(out.states.R, p.reference().states(out.t).R)
    assert 1e-6 < np.max(angles) < 0.1


TURNED = [  # solver, options, problem, step, the change of the error allowed
    *((*CONTESTANTS[which], "heavy_top", 2e-3, 1e-6) for which in CONTESTANTS),
    *((solver, {}, "heavy_top", 1e-7, 0.05) for solver in ("rkmk_dopri5", "rkmk_dop853")),
    ("radau_ggl", {}, "heavy_top", 1e-6, 0.05),
    ("gc_weak_form", {}, "chain", 1e-3, 1e-3),
    ("ida_index1", {}, "chain", 1e-8, np.inf),
]


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("solver", "options", "name", "step", "change"), TURNED)
def test_a_turned_frame_changes_nothing(solver, options, name, step, change):
    """Yaw and an oblique rotation turn gravity, ground points and start; errors stay to what rounding leaves."""
    runs = []
    for frame in ({}, {"yaw": 0.7}, {"rotation": (0.3, -0.5, 0.7)}):
        p = make_problem(name, {"t_end": 0.4, **frame})
        out = solve_run(p, step, solver, **options)
        runs.append((len(out.t), error(p, out), p.home(out.states).r[-1]))
    for steps, size, end in runs[1:]:
        assert abs(steps - runs[0][0]) <= 2 or np.isinf(change)
        assert size == pytest.approx(runs[0][1], rel=change)
        assert np.max(np.abs(end - runs[0][2])) < 1e-6


@pytest.mark.sampled(2)
@pytest.mark.parametrize("solver", ["gc_weak_form", "gc_composed", "gc_extrapolated", *SYMBOLIC])
def test_reactions_are_those_of_the_exact_motion(solver):
    """The pendulum's pull on its body, m (v_dot - g), is (A^T reaction)_r; index 3 starts with noise in lambda."""
    p = pendulum(1.0, 3.0)
    limits = {"max_step": 5e-3} if solver in SYMBOLIC else {}
    out = solve_run(p, 0.005 if solver in ("gc_weak_form", "gc_composed") else 1e-8, solver, limits)
    late, d = np.flatnonzero((out.t > 0.1) & (out.t < 0.95)), 1e-4
    ahead, behind = (p.reference().states(out.t[late] + way).v[:, 0] for way in (d, -d))
    force = p.system.mass[0] * ((ahead - behind) / (2.0 * d) - p.system.gravity)
    pull = np.array([constraint_jacobian(p.system, out.states[k]).T @ out.reaction[k] for k in late])[:, :3]
    part = 1e-2 if solver in ("gc_weak_form", "ida_index3") else 1e-3
    assert np.max(np.abs(pull - force)) < part * np.max(np.abs(force))


@pytest.mark.parametrize("which", CONTESTANTS)
def test_reactions_agree_with_those_of_index_1(which):
    """Of the end of the chain's run, against DOP853's; alternating parts of index 3 are of the order of dt."""
    p, (solver, options) = make_problem("chain", {"t_end": 0.4}), CONTESTANTS[which]
    exact = solve_run(p, 1e-10, "rkmk_dop853").reaction[-1]
    reactions = [solve_run(p, dt, solver, **options).reaction for dt in (2e-3, 1e-3)]
    errors = [np.max(np.abs(r[-1] - exact)) / np.max(np.abs(exact)) for r in reactions]
    assert errors[1] < max(0.6 * errors[0], 1e-9) and errors[1] < 5e-3, errors


@pytest.mark.parametrize("solver", ["rattle", "lie_variational", "half_explicit", "radau_ggl"])
def test_reactions_are_of_the_order_of_the_motion(solver):
    """Index 1 gives them at the end of each step; those of Radau are of order 3 in the last, which is cut."""
    p = make_problem("chain", {"t_end": 0.4})
    exact = solve_run(p, 1e-10, "rkmk_dop853").reaction[-1]
    if solver == "radau_ggl":
        runs = [solve_run(p, ACCEPTED, solver, {"max_step": h}) for h in (0.01, 0.0025)]
    else:
        runs = [solve_run(p, dt, solver) for dt in (8e-3, 4e-3)]
    errors = [np.max(np.abs(out.reaction[-1] - exact)) for out in runs]
    slope = np.log(errors[0] / errors[1]) / np.log(np.diff(runs[0].t)[-1] / np.diff(runs[1].t)[-1])
    assert slope > 2.5 if solver == "radau_ggl" else abs(slope - make_solver(solver).order) < 0.3, errors


@pytest.mark.parametrize("solver", SYMBOLIC[:4])
def test_springs_and_dampers_lose_what_the_dampers_take(solver):
    """E(t) - E(0) = integral of the damping power, by the trapezoid rule on the recorded steps (1 ms: 1e-5 J)."""
    p = sprung_linkage(0.5, 3)
    out = solve_run(p, 1e-8, solver, {"max_step": 1e-3})
    power = work.compute_power(p.system, out.states)
    lost = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(out.t))
    gained = drift(p, out)[-1]
    assert gained == pytest.approx(lost, abs=1e-3) and lost < -1e-2


STOPS = 7


@pytest.mark.parametrize("solver", OWN)
def test_a_limit_on_steps_leaves_a_partial_trajectory(solver):
    """Stalled, with exactly the steps allowed, the time or the limit in the message, a reaction for each row."""
    made, p = make_solver(solver), make_problem("heavy_top")
    control = choose_control(solver, 1e-3 if made.control == "dt" else 1e-8, max_steps=STOPS)
    out = made.solve(p, control)
    assert out.status is Status.STALLED and len(out.t) == STOPS + 1 and out.counters["steps"] == STOPS
    assert f"{out.t[-1]:.6g}" in out.message or f"max_steps = {STOPS}" in out.message
    assert out.reaction is None or out.reaction.shape == (STOPS + 1, p.system.nrows)


@pytest.mark.parametrize("solver", [*SYMBOLIC, pytest.param("cvode", marks=pytest.mark.beyond_core)])
def test_a_limit_on_cpu_time_is_kept(solver):
    """A run of hours stops at 50 ms with what it has."""
    p = make_problem("heavy_top", {"t_end": 1e4})
    out = make_solver(solver).solve(p, StepControl(rtol=1e-9, max_step=1e-4, cpu_limit=0.05))
    assert out.status is Status.STALLED and "CPU limit" in out.message and out.t[-1] < 1e4


@pytest.mark.parametrize(("solver", "options"), [*CONTESTANTS.values(), ("rattle", {})])
def test_a_step_that_is_too_long_says_so(solver, options):
    out = make_solver(solver, options).solve(make_problem("heavy_top", {"t_end": 1.0}), StepControl(dt=0.5))
    assert out.status in (Status.STEP_UNDERFLOW, Status.DIVERGED) and "t = " in out.message


@pytest.mark.parametrize("solver", ["gc_weak_form", *SYMBOLIC])
def test_a_run_is_repeatable_to_the_last_bit(solver):
    """No thread, cache or random number takes part, and nothing of what ran before."""
    p = make_problem("chain" if solver == "gc_weak_form" else "heavy_top", {"t_end": 0.1})
    a, b = (solve_run(p, 1e-3 if solver == "gc_weak_form" else 1e-6, solver) for _ in range(2))
    for one, other in ((a.t, b.t), (a.states.r, b.states.r), (a.states.R, b.states.R), (a.reaction, b.reaction)):
        assert_same(one, other)
    assert a.counters == b.counters


@pytest.mark.parametrize("name", OWN)
def test_a_thrown_brick_needs_no_joint(name):
    """Every solver follows it for ten steps: no row, no multiplier, nothing to factorise."""
    p = make_problem("free_body", {"t_end": 0.1})
    out = solve_run(p, 1e-2 if make_solver(name).control == "dt" else 1e-8, name)
    assert np.max(np.abs(out.states.r[-1] - p.reference().states(out.t[-1:]).r[0])) < 1e-6
    assert out.reaction is None or out.reaction.shape == (len(out.t), 0)


STEPS = 4000


@pytest.mark.parametrize(
    "name",
    [
        "rattle",
        "lie_variational",
        "generalized_alpha",
        "half_explicit",
        "energy_momentum",
        "al_index3",
        "gc_weak_form",
        "gc_augmented_lagrangian",
        "gc_composed",
        "gc_extrapolated",
        "rkmk_dop853",
        "radau_ggl",
    ],
)
def test_rotations_stay_orthogonal(name):
    """A tumbling body: left alone, R leaves SO(3) by 2e-16 a step, the more the more steps; kept, by rounding alone."""
    p = make_problem("torque_free_body", {"inertia_factors": (1.0, 1.5, 2.0), "t_end": STEPS * 1e-3})
    fixed = make_solver(name).control == "dt"
    out = solve_run(p, 1e-3 if fixed else 1e-6, name, None if fixed else {"max_step": 1e-3})
    assert len(out.t) >= STEPS
    assert np.max(so3.orthogonality_defect(out.states.R)) < 8.0 * np.finfo(float).eps


def test_redundant_rows_of_a_turned_loop_stay_closed():
    """Bricard's loop has a redundant row, which nothing closes when R is no rotation: 2e-16 a step open it."""
    p = make_problem("bricard", {"rotation": (0.3, -0.5, 0.7), "t_end": 4.0})
    solve_run(p, 2e-3, "rattle", **SHARP)


@pytest.mark.parametrize("which", ["alpha", "al", "em", "variational"])
def test_far_from_the_origin_the_motion_is_the_same(which):
    """Where phi has roundings of 1e-10 m, no smaller phi is asked for; the record says so."""
    moved, notes, (solver, options) = [], [], CONTESTANTS[which]
    for offset in (0.0, 1e6):
        given = {"bodies": 2, "mechanism_seed": 51, "offset": offset, "t_end": 0.2}
        out = solve_run(make_problem("random_mechanism", given), 5e-3, solver, **options)
        moved.append(out.states.r - out.states.r[0])
        notes.append(out.notes)
    assert np.max(np.abs(moved[1] - moved[0])) < 1e-7
    assert not notes[0] and notes[1][-1].endswith(": 16 roundings of the largest coordinate"), notes
    raised, asked = map(float, notes[1][-1].removeprefix("tolerance ").split(":")[0].split(" instead of "))
    assert asked <= 1e-12 and 3.5e-9 < raised < 3.7e-9  # 16 x 2.2e-16 x 1e6 m


@pytest.mark.parametrize("solver", ["rattle", "gc_composed"])
def test_over_the_whip_the_same_number_of_paced_steps_errs_less(solver):
    """Chain to 0.8 s: a tenth of the error of as many equal steps."""
    p, composition = make_problem("chain", {"t_end": 0.8}), {"composition": "suzuki4"}
    paced = solve_run(p, 0.01, solver, **composition, rate=5.0)
    assert np.ptp(np.log(np.diff(paced.t)[:-1])) > np.log(3.0)
    equal = solve_run(p, p.t_end / (len(paced.t) - 1), solver, **composition)
    assert error(p, paced) < 0.1 * error(p, equal)


def test_redundant_rows_share_reactions_in_the_augmented_lagrangian():
    """A joint declared twice: both carry half of it, where dropped pivots leave the second one idle."""
    p = make_problem("spherical_pendulum", {"t_end": 0.5})
    p = dataclasses.replace(p, system=Presentation(duplicate=1).system(p.system), reference_from=None)
    shared, dropped = (
        solve_run(p, 0.01, CONTESTANTS[which][0]).reaction[-1].reshape(2, -1) for which in ("al", "alpha")
    )
    np.testing.assert_allclose(shared[0], shared[1], rtol=1e-5, atol=1e-5 * np.max(np.abs(shared)))
    assert np.all(dropped == 0.0, axis=1).sum() == 1
    np.testing.assert_allclose(shared.sum(axis=0), dropped.sum(axis=0), rtol=1e-2, atol=1e-3)
