"""Each solver has its declared order, follows its tolerance and keeps its constraints, against exact motions."""

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.tests.covering import one
from mbsbench.tests.factories import solve_run

from .runs import ACCEPTED, CONTESTANTS, SYMBOLIC, drift, end_of_strong_form, error, orders, sprung_linkage

PENDULUM = "spherical_pendulum", {"t_end": 4.0, "omega_z": 0.1}
SHORT = "spherical_pendulum", {"t_end": 1.0, "omega_z": 0.1}
TOP = "heavy_top", {"t_end": 1.0}
CHAIN = "chain", {"t_end": 0.4}
GRID = "four_bar_grid", {"t_end": 0.5}  # 400 rows of rank 325
BRIEF = "four_bar_grid", {"t_end": 0.3}
COARSEST = ((PENDULUM, 0.01), (TOP, 0.004), (CHAIN, 0.004), (BRIEF, 0.0125))
LADDERS = [  # solver, options, problem, coarsest step, runs with halved steps, order, within
    *(
        ("rattle", {"composition": c}, PENDULUM, dt, n, order, 0.2)
        for c, dt, n, order in (
            ("plain", 0.02, 4, 2),
            ("suzuki4", 0.04, 4, 4),
            ("kahan_li6", 0.08, 4, 6),
            ("kahan_li8", 0.16, 3, 8),
        )
    ),
    *(("rattle", {"composition": c}, GRID, 0.05, 3, order, 0.2) for c, order in (("plain", 2), ("suzuki4", 4))),
    *(
        ("gc_composed", {"composition": c}, p, dt, n, order, 0.2)
        for c, p, dt, n, order in (
            ("suzuki4", PENDULUM, 0.04, 4, 4),
            ("kahan_li6", PENDULUM, 0.04, 3, 6),
            ("suzuki4", TOP, 0.008, 4, 4),
            ("kahan_li6", TOP, 0.016, 3, 6),
            ("suzuki4", GRID, 0.05, 3, 4),
            ("kahan_li6", GRID, 0.05, 3, 6),
        )
    ),
    *(
        (solver, {"composition": "suzuki4", "rate": 5.0}, ("chain", {"t_end": 0.6}), 0.02, 3, 4, 0.4)
        for solver in ("rattle", "gc_composed")
    ),  # steps that differ by the factor of turn rates over the first whip
    *(
        one((solver, options, p, dt, 4, make_solver(solver).order, 0.2), i, k)
        for i, (solver, options) in enumerate(CONTESTANTS.values())
        for k, (p, dt) in enumerate(COARSEST)
    ),
    *(("radau_ggl", {}, p, h, 4, 5, 0.2) for p, h in ((TOP, 0.02), (PENDULUM, 0.16), (BRIEF, 0.04))),
    ("rkmk_dopri5", {}, TOP, 8e-3, 4, 5, 0.2),
    ("rkmk_dop853", {}, TOP, 3.2e-2, 4, 8.5, 0.7),  # its error constant is small: poses fall like h^9 at rounding
    ("gc_augmented_lagrangian", {}, ("spherical_pendulum", {"t_end": 3.0, "omega_z": 0.1}), 0.02, 4, 2, 0.1),
    ("gc_augmented_lagrangian", {}, GRID, 0.05, 3, 2, 0.2),
    ("gc_weak_form", {"gauge": "zero"}, SHORT, 0.01, 3, 2, 0.2),
    ("gc_weak_form", {"gauge": "accumulate", "direction": "translation", "mu0": "velocity"}, SHORT, 0.01, 3, 2, 0.2),
    *(
        ("gc_weak_form", {"tolerance": 1e-11}, (name, {"t_end": 0.4}), 8e-3, 3, 2, 0.1)  # with or without a phi
        for name in ("rolling_disc", "knife_edge", "driven_slider_crank")
    ),
]
HELD = {  # phi [m] and A v [m/s] in every step; without a number A v is O(dt^2), as in the index 3 form of alpha
    "generalized_alpha": (1e-11, 1e-11), "al_index3": (1e-11, 1e-7), "half_explicit": (1e-11, 1e-11),
    "lie_variational": (1e-11, 1e-12), "energy_momentum": (1e-11, None), "rattle": (1e-12, 1e-12),
}  # fmt: skip


def name_of(row) -> str:
    solver, options, (problem, _), *_ = row
    return "-".join((solver, *map(str, options.values()), problem))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("row", LADDERS, ids=name_of)
def test_the_order_is_the_declared_one(row):
    """The last slope of position errors; first steps of error control, grown from 1e-4 s, do not matter.

    phi is at rounding in every step where the scheme solves for it, and A v where it asks for that too.
    """
    solver, options, problem, step, n, order, within = row
    p, adaptive = make_problem(*problem), make_solver(solver).control == "rtol"
    steps = [step / 2**k for k in range(n)]
    runs = [
        solve_run(p, ACCEPTED, solver, {"max_step": h}) if adaptive else solve_run(p, h, solver, **options)
        for h in steps
    ]
    slopes = orders([error(p, out) for out in runs])
    assert abs(slopes[-1] - order) < within, slopes
    if solver not in HELD:
        return
    phi, rate = HELD[solver]
    rates = [np.max(np.abs(constraint_rate(p.system, out.states))) for out in runs]
    assert max(np.max(np.abs(constraint(p.system, out.states))) for out in runs) < phi
    if rate is None or "form" in options:
        assert abs(orders(rates)[-1] - 2.0) < 0.2, rates
    else:
        assert max(rates) < rate


SPRUNG = [  # solver, options, coarsest step, order; at the finest of radau_ggl its iteration's 1e-10 m is below 2 %
    *((*CONTESTANTS[which], 8e-3 if which == "hem" else 4e-3, None) for which in CONTESTANTS),
    ("rattle", {}, 4e-3, 2),
    ("rattle", {"composition": "suzuki4"}, 2e-2, 4),
    ("radau_ggl", {}, 0.1, 5),
    ("gc_weak_form", {}, 4e-3, 2),
    ("gc_weak_form", {"corrective": False}, 4e-3, 2),
    ("gc_augmented_lagrangian", {"loop": "nested", "penalty": 1e3, "lambda_bar": True}, 4e-3, 2),
]


@pytest.mark.parametrize(("solver", "options", "step", "order"), SPRUNG)
def test_springs_dampers_and_skew_axes_keep_the_order(solver, options, step, order):
    """To the motion of Eq. (65), which another route integrates; with C_bar, K_bar of Eq. (32) or without."""
    p, exact, errors = sprung_linkage(0.3), end_of_strong_form(0.3), []
    for h in (step, step / 2, step / 4):
        out = (
            solve_run(p, ACCEPTED, solver, {"max_step": h})
            if solver == "radau_ggl"
            else solve_run(p, h, solver, **options)
        )
        errors.append(np.max(np.abs(out.states.r[-1] - exact)))
    assert abs(orders(errors)[-1] - (order or make_solver(solver).order)) < 0.2, errors


@pytest.mark.parametrize("columns", [2, 3])
def test_extrapolation_has_twice_the_order_of_its_columns(columns):
    """Steps held to ``max_step`` by a tolerance that never cuts them: 2 K to 0.2; more columns reach rounding."""
    p = make_problem("spherical_pendulum", {"t_end": 2.0, "omega_z": 3.0})
    steps, errors = {2: 0.01, 3: 0.025}[columns] / np.array([1.0, 1.4]), []
    for h in steps:
        out = solve_run(p, 0.1, "gc_extrapolated", {"max_step": float(h)}, columns=columns)
        errors.append(float(np.linalg.norm(out.states.r[-1] - p.reference().states(out.t[-1:]).r[0])))
    assert abs(np.diff(np.log(errors)) / np.diff(np.log(steps)) - 2 * columns) < 0.2, errors


WHIPS = [("heavy_top", {"t_end": 1.0}), ("chain", {"t_end": 0.8}), GRID]
LOOSE_AND_TIGHT = [  # solver, options, problem, tolerances, the least factor between the errors, the first allowed
    *((solver, {}, PENDULUM, (1e-4, 1e-8), 50.0, np.inf) for solver in SYMBOLIC),  # an order of 0.4, even at index 3
    *(
        pytest.param(("cvode", {"method": method}, p, (1e-6, 1e-8), 10.0, 1e-3), marks=[pytest.mark.beyond_core, *more])
        for method, p, more in (
            ("Adams", ("heavy_top", {"t_end": 0.2}), ()),
            ("BDF", ("chain", {"t_end": 0.1}), ()),
            ("BDF", ("heavy_top", {"t_end": 0.2}), (pytest.mark.slow,)),
            ("Adams", ("chain", {"t_end": 0.1}), (pytest.mark.slow,)),
        )
    ),
    *(("gc_extrapolated", {}, p, (1e-5, 1e-7), 30.0, 0.03) for p in WHIPS),
]


@pytest.mark.parametrize("row", LOOSE_AND_TIGHT, ids=name_of)
def test_errors_follow_the_tolerance(row):
    solver, options, problem, tolerances, factor, allowed = row
    p = make_problem(*problem)
    loose, tight = (error(p, solve_run(p, rtol, solver, **options)) for rtol in tolerances)
    assert tight < loose / factor and loose < allowed


LONG = ("heavy_top", {"t_end": 2.0}), ("spherical_pendulum", {"t_end": 10.0, "omega_z": 0.1})
MANY = ("chain", {"t_end": 1.0}), ("four_bar_grid", {"t_end": 1.0})
ENDLESS = (np.inf,) * 3
FORMS = [
    ("ida_index1", {"form": "se"}),
    ("ida_index1", {"lambda_in_error_test": True, "form": "se"}),
    ("ida_index1", {"alpha": 0.0, "beta": 0.0}),
    ("ida_index1", {"consistent_start": False}),
    ("ida_index2", {"form": "velocity"}),
    ("ida_index2", {"form": "velocity", "alpha": 0.0}),
    ("ndf_index1", {"accelerations": "eliminated"}),
    ("ndf_index1", {"lambda_in_error_test": True, "accelerations": "eliminated"}),
    ("ndf_index1", {"accelerations": "mass_matrix"}),
    ("ndf_index1", {"accelerations": "mass_matrix", "coordinates": "euler313"}),
    ("ndf_index1", {"accelerations": "mass_matrix", "jacobian": "finite_difference", "norm": "max"}),
    ("rk45_strong_form", {"alpha": 5.0, "beta": 5.0}),
    ("rk45_strong_form", {"lambda_in_error_test": True}),
]
TIGHT = [  # solver, options, problem, tolerance, allowed: error [m], phi, A v, energy [J]
    *(
        (solver, {}, p, 1e-7, 1e-4 if p[0] == "chain" else 1e-5, (1e-12, 1e-10, 1e-3))
        for solver in ("rkmk_dopri5", "rkmk_dop853")
        for p in (*LONG, *MANY)
    ),
    *(("radau_ggl", {}, p, 1e-7, 1e-7, (1e-10, 1e-8, 1e-5)) for p in (*LONG, *MANY)),
    *(("gc_extrapolated", {}, p, 1e-7, 1e-3, (1e-10, 1e-8, np.inf)) for p in WHIPS),
    *(
        one((solver, {"coordinates": chart}, p, 1e-8, 1e-4 if p[0] == "heavy_top" else 1e-3, ENDLESS), i, j, k)
        for i, solver in enumerate(SYMBOLIC[:4])
        for j, chart in enumerate(("quaternion", "euler313"))
        for k, p in enumerate(LONG)
    ),
    *((solver, options, PENDULUM, 1e-8, 1e-4, ENDLESS) for solver, options in FORMS),
    *(
        (solver, {}, (name, {"t_end": 2.0}), rtol, np.inf, (np.inf, np.inf, 0.02))  # the rows kept at the start
        for solver in ("rk45_strong_form", "ndf_index1", "ida_index1")
        for name, rtol in (("chain", 1e-7), (GRID[0], 1e-6))
    ),
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("row", TIGHT, ids=name_of)
def test_a_tight_tolerance_reaches_the_exact_motion(row):
    """Every form and chart has the same exact solution; methods that project hold phi and A v in every step."""
    solver, options, problem, rtol, allowed, (phi, rate, most) = row
    p = make_problem(*problem)
    out = solve_run(p, rtol, solver, **options)
    assert allowed == np.inf or error(p, out) < allowed
    assert np.max(np.abs(constraint(p.system, out.states))) < phi
    assert np.max(np.abs(constraint_rate(p.system, out.states))) < rate
    assert np.max(np.abs(drift(p, out))) < most
    assert solver not in SYMBOLIC or p.name != GRID[0] or "rank 325" in out.notes[0]
