"""ODE-GC composed and extrapolated: orders, reversibility, energy over hundreds of periods, error control, refusals."""

import dataclasses

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.motion import constraint, constraint_rate, energy
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.types import Problem, Status, StepControl, Trajectory

from ..arbitrary_systems import consistent, linkage


def solve(problem: Problem, solver: str, control: StepControl, **options: object) -> Trajectory:
    t = make_solver(solver, options).solve(problem, control)
    assert t.status is Status.SUCCESS, t.message
    return t


def error(problem: Problem, t: Trajectory) -> float:
    reference = problem.reference()
    assert reference is not None
    return float(np.max(np.linalg.norm(t.states.r - reference.states(t.t).r, axis=2)))


LADDERS = [  # problem, parameters, composition, order, coarsest step, halvings
    ("spherical_pendulum", {"t_end": 4.0, "omega_z": 0.1}, "suzuki4", 4, 0.04, 3),
    ("spherical_pendulum", {"t_end": 4.0, "omega_z": 0.1}, "kahan_li6", 6, 0.04, 2),
    ("heavy_top", {"t_end": 1.0}, "suzuki4", 4, 0.008, 3),
    ("heavy_top", {"t_end": 1.0}, "kahan_li6", 6, 0.016, 2),
    ("four_bar_grid", {"t_end": 0.5}, "suzuki4", 4, 0.05, 2),
    ("four_bar_grid", {"t_end": 0.5}, "kahan_li6", 6, 0.05, 2),
]


@pytest.mark.parametrize(("name", "parameters", "composition", "order", "dt", "halvings"), LADDERS)
def test_order_of_a_composition(name, parameters, composition, order, dt, halvings):
    """One body and the redundant grid (400 rows of rank 325): the last slope within 0.2, as declared."""
    p = make_problem(name, parameters)
    steps = [StepControl(dt=dt / 2**k) for k in range(halvings + 1)]
    errors = np.array([error(p, solve(p, "gc_composed", s, composition=composition)) for s in steps])
    slopes = np.log2(errors[:-1] / errors[1:])
    assert abs(slopes[-1] - order) < 0.2, (errors, slopes)
    assert make_solver("gc_composed", {"composition": composition}).order == order


def test_the_plain_composition_is_the_weak_form_itself():
    p = make_problem("chain", {"t_end": 0.3})
    step = StepControl(dt=1e-3)
    mine, theirs = solve(p, "gc_composed", step, composition="plain"), solve(p, "gc_weak_form", step, tolerance=1e-12)
    np.testing.assert_allclose(mine.states.r, theirs.states.r, atol=1e-10)


@pytest.mark.parametrize(("name", "t_end", "dt"), [("spherical_pendulum", 5.0, 0.01), ("chain", 0.5, 1e-3)])
def test_there_and_back_ends_at_the_start(name, t_end, dt):
    """Velocities reversed, the same sub-steps lead back, to the tolerance of their equations."""
    p = make_problem(name, {"t_end": t_end})
    t = solve(p, "gc_composed", StepControl(dt=dt), tolerance=1e-14)
    s = t.states[len(t.t) - 1]
    home = dataclasses.replace(p, initial=State(s.r, s.R, -s.v, -s.Omega), reference_from=None)
    end = solve(home, "gc_composed", StepControl(dt=dt), tolerance=1e-14).states[-1]
    assert np.max(np.abs(end.r - p.initial.r)) < 1e-10


def test_energy_stays_bounded_over_hundreds_of_periods():
    """Mean energy errors of the first and the last quarter of 400 s agree to 2 %: no drift."""
    p = make_problem("spherical_pendulum", {"t_end": 400.0})
    t = solve(p, "gc_composed", StepControl(dt=0.04))
    E = energy(p.system, t.states) - energy(p.system, t.states)[0]
    quarter = len(E) // 4
    first, last = np.mean(E[:quarter]), np.mean(E[-quarter:])
    assert abs(last - first) < 0.02 * abs(first)


@pytest.mark.parametrize("columns", [2, 3])
def test_extrapolation_has_twice_the_order_of_its_columns(columns):
    """Steps held to ``max_step`` by a tolerance that never cuts them: 2 K to 0.2; more columns reach rounding."""
    p = make_problem("spherical_pendulum", {"t_end": 2.0, "omega_z": 3.0})
    steps = {2: 0.01, 3: 0.025}[columns] / np.array([1.0, 1.4])
    errors = []
    for h in steps:
        t = solve(p, "gc_extrapolated", StepControl(rtol=0.1, max_step=float(h)), columns=columns)
        errors.append(float(np.linalg.norm(t.states.r[-1] - p.reference().states(t.t[-1:]).r[0])))
    slopes = np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert abs(slopes[-1] - 2 * columns) < 0.2, (errors, slopes)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("heavy_top", {"t_end": 1.0}), ("chain", {"t_end": 0.8}), ("four_bar_grid", {"t_end": 0.5})],
)
def test_extrapolation_follows_its_tolerance_over_the_whip(name, parameters):
    """A hundredth of the tolerance, a thirtieth of the error at most; phi and A v near rounding after each step."""
    p = make_problem(name, parameters)
    loose, tight = (solve(p, "gc_extrapolated", StepControl(rtol=r)) for r in (1e-5, 1e-7))
    assert error(p, tight) < error(p, loose) / 30.0 < 1e-3
    assert np.max(np.abs(constraint(p.system, tight.states))) < 1e-10
    assert np.max(np.abs(constraint_rate(p.system, tight.states))) < 1e-8


@pytest.mark.parametrize("solver", ["gc_composed", "gc_extrapolated"])
def test_springs_are_refused_with_the_solver_that_takes_them(solver):
    system = linkage(springs=True)
    p = dataclasses.replace(
        make_problem("heavy_top"), system=system, initial=consistent(system, 5), reference_from=None
    )
    control = StepControl(dt=0.01) if solver == "gc_composed" else StepControl(rtol=1e-6)
    assert "gc_weak_form" in make_solver(solver).refuses(p, control)


@pytest.mark.parametrize("solver", ["gc_composed", "gc_extrapolated"])
def test_reactions_are_those_of_the_exact_motion(solver):
    """The pendulum's pull on its body, from the recorded multipliers and from the reference's acceleration."""
    p = make_problem("spherical_pendulum", {"t_end": 1.0, "omega_z": 3.0})
    t = solve(p, solver, StepControl(dt=0.01) if solver == "gc_composed" else StepControl(rtol=1e-8))
    k, d = len(t.t) // 2, 1e-4
    exact = p.reference().states(t.t[k] + d * np.array([-1.0, 1.0]))
    force = p.system.mass[0] * ((exact.v[1, 0] - exact.v[0, 0]) / (2.0 * d) - p.system.gravity)
    np.testing.assert_allclose(t.reaction[k, :3], force, atol=1e-4 * np.linalg.norm(force))
