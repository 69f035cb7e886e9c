"""Gauss and RATTLE in joint coordinates: orders, reversal, the symplectic form, energy, symmetries, reactions."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.consistency import perturb
from mbsbench.harness.mechanics.index1 import solve_index_1
from mbsbench.harness.mechanics.jacobian import constraint_jacobian
from mbsbench.harness.mechanics.joint_tree import build_spanning_tree
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.types import Problem, Status, StepControl, Trajectory
from mbsbench.harness.run.presenting import present_solver
from mbsbench.solvers.formulations.compiled.marching import make_control
from mbsbench.solvers.formulations.joint_coordinates import relay, symplectic
from mbsbench.solvers.formulations.joint_coordinates.code import make_code
from mbsbench.solvers.formulations.joint_coordinates.collocation import (
    CollocationTableau,
    make_gauss_lobatto_tableau,
    make_rattle_tableau,
)
from mbsbench.solvers.formulations.joint_coordinates.hamilton import make_hamilton_code
from mbsbench.solvers.formulations.joint_coordinates.symplectic import SymplecticMarcher
from mbsbench.tests.covering import diagonal, few
from mbsbench.tests.factories import solve_run

from .runs import drift, orders

GAUSS, RATTLE = "gauss_joint", "rattle_joint"
SPAN = {"heavy_top": 0.48, "spherical_pendulum": 1.6, "chain": 0.08, "bricard": 1.6, "four_bar_grid": 0.4}  # [s]


def problem_of(name: str, **parameters: Any) -> Problem:
    """A short motion of a small mechanism."""
    size = {"rows": 2, "columns": 2} if name == "four_bar_grid" else {}
    return make_problem(name, {"t_end": SPAN[name], **size, **parameters})


@pytest.mark.parametrize("stages", [1, 2, 3, 4, 5, 6])
def test_tableaux_are_symplectic(stages: int) -> None:
    """The conditions of Jay (2007), to rounding; so does RATTLE."""
    for of in (make_gauss_lobatto_tableau(stages), make_rattle_tableau()):
        np.testing.assert_allclose(of.b[:, None] * of.a_p + (of.b[:, None] * of.a).T, np.outer(of.b, of.b), atol=1e-15)
        pairs = of.b[:, None] * of.a_row + (of.b_row[:, None] * of.a_node).T
        np.testing.assert_allclose(pairs, np.outer(of.b, of.b_row), atol=1e-15)


@pytest.mark.parametrize("solver", [GAUSS, RATTLE])
def test_a_single_hinge_is_solved(solver: str) -> None:
    """One coordinate, of which CasADi's slices of no entries are rows, not columns; the reference is exact."""
    problem = make_problem("simple_pendulum", {"t_end": 1.0})
    states = solve_run(problem, 1e-3, solver).states
    assert np.max(np.abs(states.r[-1] - problem.reference().states(np.array([1.0])).r[0])) < 1e-5  # RATTLE: 1 dt^2


ORDERS = [
    ("heavy_top", 2, 0.01),
    ("heavy_top", 3, 0.02),
    ("heavy_top", 4, 0.04),
    ("spherical_pendulum", 2, 0.1),
    ("spherical_pendulum", 3, 0.2),
    ("spherical_pendulum", 4, 0.32),
    ("chain", 2, 0.01),
    ("chain", 3, 0.04),
    ("bricard", 2, 0.1),
    ("bricard", 3, 0.1),
    ("heavy_top", 0, 0.01),
    ("spherical_pendulum", 0, 0.05),
    ("chain", 0, 0.01),
    ("bricard", 0, 0.1),
]
OFTEN = (("heavy_top", 4), ("spherical_pendulum", 2), ("chain", 0), ("bricard", 3), ("spherical_pendulum", 0))


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("name", "stages", "dt"), few(ORDERS, lambda case: case[:2] in OFTEN))
def test_errors_are_of_the_order(name: str, stages: int, dt: float) -> None:
    """2 s of Gauss, 2 of RATTLE (0 stages), on trees, balls and loops; steps above rounding."""
    problem = problem_of(name)
    exact = solve_run(problem, 1e-13, "dop853_joint").states.r[-1]
    solver, options = (GAUSS, {"stages": stages}) if stages else (RATTLE, {})
    errors = [
        float(np.max(np.abs(solve_run(problem, h, solver, **options).states.r[-1] - exact)))
        for h in dt / 2.0 ** np.arange(4)
    ]
    above = [e for e in errors if e > 2e-13]
    assert len(above) >= 3
    assert abs(orders(above)[-1] - (2 * stages or 2)) < 0.2, errors


@pytest.mark.parametrize("stages", [5, 6])
def test_orders_ten_and_twelve_are_met_on_the_proved_motion(stages: int) -> None:
    """Between 12 and 16 steps: fewer do not converge, more are at rounding."""
    problem, errors = problem_of("heavy_top"), list[float]()
    reference, steps = problem.reference(), np.array([12, 16])
    assert reference is not None
    for n in steps:
        last = solve_run(problem, problem.t_end / n, GAUSS, stages=stages)
        errors.append(float(np.max(np.abs(last.states.r[-1] - reference.states(last.t[-1:]).r[0]))))
    assert abs(np.log(errors[0] / errors[1]) / np.log(steps[1] / steps[0]) - 2 * stages) < 0.2, errors


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("name", "solver"), diagonal(["heavy_top", "chain", "bricard"], [GAUSS, RATTLE]))
def test_the_way_back_leads_to_the_start(solver: str, name: str) -> None:
    """Symmetric steps with velocities reversed, to the rounding of their iterations."""
    problem, dt = problem_of(name), SPAN[name] / (20 if solver == GAUSS else 80)
    end = solve_run(problem, dt, solver).states
    turned = dataclasses.replace(end[len(end.r) - 1], v=-end.v[-1], Omega=-end.Omega[-1], t=0.0)
    back = solve_run(dataclasses.replace(problem, initial=turned), dt, solver).states
    assert np.max(np.abs(back.r[-1] - problem.initial.r)) < 1e-11
    assert np.max(np.abs(back.v[-1] + problem.initial.v)) < 1e-9 * max(1.0, float(np.max(np.abs(end.v))))


def marcher_of(name: str, tableau: CollocationTableau, dt: float) -> SymplecticMarcher:
    """Ready for steps ``dt``."""
    state = make_control(t_end=1e6, dt=dt)
    return SymplecticMarcher(make_problem(name, {"t_end": 1e6}), state, tableau, radial=not tableau.collocates)


def flow(marcher: SymplecticMarcher, z: np.ndarray, steps: int) -> np.ndarray:
    """(q, p) after steps from ``z``."""
    s = marcher.stages
    s.start[:], s.rest[:], s.past[:], s.guard[:] = z, 0.0, 0.0, (1.0, 0.0)
    assert len(marcher.stretch(steps).t) == steps
    return s.start.copy()


def form(of: Callable[[np.ndarray], np.ndarray], n: int) -> np.ndarray:
    """dp ^ dq on the tangents of a surface (q, p) of n numbers, by differences of fourth order."""
    e, tangents = 2e-3, []
    for k in range(n):
        at = [of(x * e * np.eye(n)[k]) for x in (-2, -1, 1, 2)]
        tangents.append((at[0] - 8.0 * at[1] + 8.0 * at[2] - at[3]) / (12.0 * e))
    T = np.array(tangents)
    pairs = np.einsum("aq,bq->ab", T[:, 1], T[:, 0])
    return pairs - pairs.T


TABLEAUX = {
    "gauss2": make_gauss_lobatto_tableau(2),
    "gauss3": make_gauss_lobatto_tableau(3),
    "rattle": make_rattle_tableau(),
}


@pytest.mark.parametrize(
    ("name", "of"), diagonal(["cart_pendulum", "spherical_pendulum", "bricard"], ["rattle", "gauss2", "gauss3"])
)
def test_steps_keep_the_symplectic_form(name: str, of: str) -> None:
    """M^T J M = J of the flow map, long steps; of a ball on quaternions of unit length, of a loop on phi = 0."""
    tableau = TABLEAUX[of]
    marcher = marcher_of(name, tableau, 0.05)
    s, start = marcher.stages, marcher.stages.start.copy()
    enter = marcher.hamilton.code.function("enter", 2)

    def of_velocities(q: np.ndarray, u: np.ndarray) -> np.ndarray:
        y, p = np.concatenate((q, u)), np.zeros(len(q))
        enter(y.ctypes.data, p.ctypes.data)
        return np.stack((q, p))

    if name == "cart_pendulum":
        n = 2 * len(start[0])

        def surface(x: np.ndarray) -> np.ndarray:
            speed = np.linspace(0.7, -1.2, n // 2)
            return of_velocities(start[0] + 0.2 + x[: n // 2], speed + x[n // 2 :])
    elif name == "spherical_pendulum":
        n = 6

        def surface(x: np.ndarray) -> np.ndarray:
            quaternion = np.concatenate(([np.sqrt(1.0 - x[:3] @ x[:3])], x[:3]))
            return of_velocities(quaternion, np.array([0.7, -1.2, 0.5]) + x[3:])
    else:  # one degree of freedom: along its motion, and by its speed
        n, there = 2, marcher_of(name, make_gauss_lobatto_tableau(6), 0.01)
        base = flow(there, start, 20)

        def surface(x: np.ndarray) -> np.ndarray:
            moved = base
            if x[0] != 0.0:
                there.state["dt"], there.state["grid"], there.state["t"] = abs(x[0]), 0, 0.0
                back = np.array([1.0, np.sign(x[0])])[:, None]
                moved = back * flow(there, back * base, 1)
            return moved * np.array([1.0, 1.0 + x[1]])[:, None]

    before = form(surface, n)
    after = form(lambda x: flow(marcher, surface(x), 3), n)
    assert np.max(np.abs(before)) > 0.1
    assert np.max(np.abs(after - before)) < 1e-8 * np.max(np.abs(before)), (after, before)
    assert s.past[0] == 3.0


@pytest.mark.parametrize(
    ("solver", "name", "dt", "t_end"),
    [(GAUSS, "spherical_pendulum", 0.1, 4000.0), (RATTLE, "heavy_top", 0.002, 100.0), (GAUSS, "bricard", 0.05, 400.0)],
)
def test_energy_oscillates_and_does_not_drift(solver: str, name: str, dt: float, t_end: float) -> None:
    """Its means over the first and the last tenth agree to a part of its oscillation: thousands of periods."""
    problem = make_problem(name, {"t_end": t_end})
    E = drift(problem, solve_run(problem, dt, solver, **({"stages": 3} if solver == GAUSS else {})))
    tenth = len(E) // 10
    assert abs(np.mean(E[:tenth]) - np.mean(E[-tenth:])) < 0.02 * np.max(np.abs(E))


def chain_out_of_plane(t_end: float) -> Problem:
    """Its slender bars turn across their axes and spin about them."""
    problem = make_problem("chain", {"t_end": t_end})
    start = perturb(problem.system, problem.initial, 1e-3, 1)
    spin = np.linspace(-20.0, 20.0, len(start.r))[:, None] * np.eye(3)[0]
    return dataclasses.replace(problem, initial=dataclasses.replace(start, Omega=start.Omega + spin))


@pytest.mark.sampled(0)
def test_slender_bars_out_of_plane_leave_rattle_its_order() -> None:
    """Steps at which I - h/2 d2H/dqdp of the bars themselves is singular; without spins they have no solution."""
    problem = chain_out_of_plane(0.44)
    exact = solve_run(problem, 1e-13, "dop853_joint").states
    last = [solve_run(problem, dt, RATTLE).states for dt in 2e-3 / 2.0 ** np.arange(4)]
    for of in ("r", "v", "R", "Omega"):
        errors = [float(np.max(np.abs(getattr(s, of)[-1] - getattr(exact, of)[-1]))) for s in last]
        assert abs(orders(errors)[-1] - 2.0) < 0.2, (of, errors)


@pytest.mark.sampled(0)
def test_slender_bars_out_of_plane_go_back() -> None:
    """200 steps and back, with spins about axes, to the rounding of their iterations."""
    problem, dt = chain_out_of_plane(0.4), 2e-3
    end = solve_run(problem, dt, RATTLE).states
    turned = dataclasses.replace(end[len(end.r) - 1], v=-end.v[-1], Omega=-end.Omega[-1], t=0.0)
    back = solve_run(dataclasses.replace(problem, initial=turned), dt, RATTLE).states
    assert np.max(np.abs(back.r[-1] - problem.initial.r)) < 1e-11
    assert np.max(np.abs(back.R[-1] - problem.initial.R)) < 1e-11
    assert np.max(np.abs(back.Omega[-1] + problem.initial.Omega)) < 1e-9


def test_energy_of_slender_bars_out_of_plane_is_bounded() -> None:
    """Over 20 s of chaos; spins are constant, for no moment acts about the axis of a bar of revolution."""
    problem = chain_out_of_plane(20.0)
    out = solve_run(problem, 1e-3, RATTLE)
    E = drift(problem, out)
    tenth = len(E) // 10
    assert np.max(np.abs(E)) < 2.0 * np.max(np.abs(E[: 2 * tenth]))
    assert abs(np.mean(E[:tenth]) - np.mean(E[-tenth:])) < 0.1 * np.max(np.abs(E))
    spins = out.states.Omega[:, :, 0]
    assert np.max(np.abs(spins - problem.initial.Omega[:, 0])) < 1e-7


def test_velocities_are_those_of_momenta_with_a_bar_level() -> None:
    """H u = pi at u that have made p: no orientation of a bar takes the pivots of a chain's tree."""
    problem = make_problem("chain")
    tree = build_spanning_tree(problem.system, problem.initial)
    code = make_hamilton_code(problem.system, tree).code
    x = np.tile([1.0, 0.0, 0.0, 0.0], (len(tree.limbs), 1))
    d = next(limb.arm for limb in tree.limbs if limb.parent == tree.limbs[0].body)
    d, level = d / np.linalg.norm(d), np.array([0.6, 0.8, 0.0])  # of the first bar: now, and as it is turned
    x[0] = np.array([1.0 + d @ level, *np.cross(d, level)]) / np.sqrt(2.0 + 2.0 * d @ level)
    u = np.random.default_rng(1).normal(size=(len(x), 3))
    y = np.concatenate((x.ravel(), u.ravel()))
    t, p, q_dot, p_dot = np.zeros(1), *np.zeros((3, x.size))
    code.function("enter", 2)(*(a.ctypes.data for a in (y, p)))
    code.function("stage", 5)(*(a.ctypes.data for a in (t, y, p, q_dot, p_dot)))
    s, v = x[:, :1], x[:, 1:]
    rates = 0.5 * np.concatenate((-np.sum(u * v, axis=1, keepdims=True), s * u + np.cross(u, v)), axis=1)
    np.testing.assert_allclose(q_dot.reshape(x.shape), rates, atol=1e-11)


LOOPS = ("bricard", "four_bar_grid", "chain")


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.parametrize("solver", [GAUSS, RATTLE])
def test_pivots_chosen_anew_leave_the_steps_of_whole_code(
    solver: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all stages of a step as one function."""
    check_pivots_chosen_anew(solver, name, monkeypatch)


@pytest.mark.sampled(0)
@pytest.mark.usefixtures("without_whole_steps")
@pytest.mark.parametrize(("name", "solver"), diagonal(LOOPS, [GAUSS, RATTLE]))
def test_pivots_chosen_anew_leave_the_steps(solver: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Coordinates and momenta stay, and other rows hold on the same surface: the map is the same."""
    check_pivots_chosen_anew(solver, name, monkeypatch)


def check_pivots_chosen_anew(solver: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compare a run of the pivots of the start with one that chooses others all the way."""
    problem, dt = problem_of(name, **({"links": 6} if name == "chain" else {})), SPAN[name] / 40
    monkeypatch.setattr(symplectic, "POOR_PIVOT", 1e-9)
    plain = solve_run(problem, dt, solver)
    monkeypatch.setattr(symplectic, "POOR_PIVOT", 0.99)
    monkeypatch.setattr(relay, "FAIR", 2.0)  # no earlier order goes on
    changed = solve_run(problem, dt, solver)
    assert not any("anew" in note for note in plain.notes)
    assert any("anew" in note for note in changed.notes)
    for of in ("r", "v"):
        a, b = getattr(plain.states, of), getattr(changed.states, of)
        assert np.max(np.abs(a - b)) < 1e-11 * max(1.0, float(np.max(np.abs(a))))
    assert plain.reaction is not None and changed.reaction is not None
    A = constraint_jacobian(problem.system, plain.states[-1])
    load, gone = A.T @ plain.reaction[-1], A.T @ (changed.reaction[-1] - plain.reaction[-1])
    assert np.max(np.abs(gone)) < 1e-9 * np.max(np.abs(load))


PRESENTED = ({"yaw": 0.7}, {"renumber": 3}, {"mirror": "X"})


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("presented_as", "name", "solver"), diagonal(PRESENTED, ["heavy_top", "four_bar_grid"], [GAUSS, RATTLE])
)
def test_errors_are_the_same_however_a_mechanism_is_presented(
    solver: str, name: str, presented_as: dict[str, Any]
) -> None:
    """Coordinates follow the mechanism; renumbered loops are cut elsewhere, which leaves the order of the error."""
    errors, options = [], {"stages": 2} if solver == GAUSS else {}
    for more in ({}, presented_as):
        problem = problem_of(name, **more)
        out = present_solver(make_solver(solver, options), problem).solve(problem, StepControl(dt=0.01))
        assert out.status is Status.SUCCESS, out.message
        exact = present_solver(make_solver("dop853_joint"), problem).solve(problem, StepControl(rtol=1e-13))
        errors.append(float(np.max(np.linalg.norm(out.states.r[-1] - exact.states.r[-1], axis=1))))
    closeness = 10.0 if name == "four_bar_grid" and "renumber" in presented_as else 1.001
    assert 1.0 / closeness < errors[1] / errors[0] < closeness


@pytest.mark.parametrize("solver", [GAUSS, RATTLE])
def test_a_tilt_that_defeats_folding_leaves_the_motion(solver: str) -> None:
    """A hinge 1e-9 out of line makes spatial code of a planar pendulum, and a motion as far away."""
    problem = make_problem("cart_pendulum", {"t_end": 1.0})
    u = problem.system.joint_u.copy()
    u[-1] += 1e-9 * np.array([0.6, 0.5, -0.4])
    tilted = dataclasses.replace(problem, system=dataclasses.replace(problem.system, joint_u=u))
    sizes = [make_code(p.system, build_spanning_tree(p.system, p.initial)).operations for p in (problem, tilted)]
    assert sizes[1] > 1.2 * sizes[0]
    planar, spatial = (solve_run(p, 0.01, solver).states.r[-1] for p in (problem, tilted))
    assert np.max(np.abs(planar - spatial)) < 1e-8


@pytest.mark.parametrize(
    ("name", "solver"), diagonal(["heavy_top", "chain", "bricard", "four_bar_grid"], [GAUSS, RATTLE])
)
def test_reactions_are_the_judges_and_constraints_hold(solver: str, name: str) -> None:
    """Newton and Euler leave no choice of the load of the joints in a state; phi and phi_dot are at rounding."""
    problem = problem_of(name)
    out: Trajectory = solve_run(problem, SPAN[name] / (16 if solver == GAUSS else 64), solver)
    system = problem.system
    assert np.max(np.abs(constraint(system, out.states))) < 1e-12
    assert np.max(np.abs(constraint_rate(system, out.states))) < 1e-11
    assert out.reaction is not None
    judge = solve_index_1(system, out.states)
    for k in range(len(out.t)):
        load = (constraint_jacobian(system, out.states[k]).T @ out.reaction[k]).reshape(system.nb, 6)
        assert np.max(np.abs(load - judge.load[k])) < 1e-10 * max(1.0, float(np.max(np.abs(judge.load[k]))))


@pytest.mark.parametrize("solver", [GAUSS, RATTLE])
def test_what_is_not_sound_is_said(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No rows without phi; of dampers the order is claimed, not energy; no run beyond its pivots."""
    control = StepControl(dt=0.05)
    assert "phi" in (make_solver(solver).refuses(make_problem("knife_edge"), control) or "")
    damped = make_problem("damped_linkage", {"t_end": 0.1})
    assert any("energy" in note for note in solve_run(damped, 0.01, solver).notes)
    singular = make_solver(solver).solve(make_problem("n_four_bar", {"windows": 2}), StepControl(dt=2e-4))
    assert singular.status is Status.STEP_UNDERFLOW
    assert "rank" in singular.message
    monkeypatch.setattr(relay.Relay, "_choose_pivots", lambda _: False)
    out = make_solver(solver).solve(make_problem("bricard", {"t_end": 400.0}), StepControl(dt=0.02))
    assert out.status is Status.STEP_UNDERFLOW
    assert "rank" in out.message
    assert "use rattle" in out.message
