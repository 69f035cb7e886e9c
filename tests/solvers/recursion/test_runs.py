"""Solvers in joint coordinates by recursion over bodies: laws on long chains, user forces, rows chosen anew, cost."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from mbsbench.harness.base.generated import code as generated_code
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.joint_tree import build_spanning_tree
from mbsbench.harness.mechanics.motion import constraint, constraint_rate
from mbsbench.harness.mechanics.types import Problem, Status, StepControl
from mbsbench.solvers.formulations.compiled import algebra
from mbsbench.solvers.formulations.compiled.entries import InlineFunction
from mbsbench.solvers.formulations.joint_coordinates import choice, marching, relay, symplectic
from mbsbench.solvers.formulations.recursion import accelerations, closing_rows, evaluation, hamilton, sweeps, twists
from mbsbench.solvers.formulations.recursion.accelerations import CoupledTree
from mbsbench.solvers.formulations.recursion.evaluation import TreeMechanism
from mbsbench.solvers.formulations.recursion.limbs import select_rows
from mbsbench.solvers.formulations.recursion.phases import TreePhase
from mbsbench.tests.covering import few
from mbsbench.tests.factories import solve_run

from ..arbitrary_systems import consistent, with_user_forces
from ..runs import drift, orders

JOINT = ("dop853_joint", "gauss_joint", "rattle_joint")
LONG = 60  # links: code would have more than 30,000 operations


def long_chain(t_end: float, links: int = LONG) -> Problem:
    """The release of a chain of many links."""
    return make_problem("chain", {"links": links, "t_end": t_end})


@pytest.fixture
def by_bodies(monkeypatch: pytest.MonkeyPatch) -> None:
    """No code is made, of small mechanisms neither."""
    monkeypatch.setattr(choice, "refuse_code", lambda problem: "not now")


@pytest.mark.sampled(0)
def test_a_long_chain_moves_as_with_redundant_coordinates() -> None:
    """Another route altogether: poses, all joints as rows, a sparse factor."""
    problem = long_chain(0.05)
    exact, out = (solve_run(problem, 1e-11, solver) for solver in ("rkmk_dop853", "dop853_joint"))
    assert any("recursion" in note for note in out.notes)
    assert np.max(np.abs(out.states.r[-1] - exact.states.r[-1])) < 1e-9
    assert np.max(np.abs(constraint(problem.system, out.states))) < 1e-11
    assert np.max(np.abs(constraint_rate(problem.system, out.states))) < 1e-10


@pytest.mark.sampled(0)
def test_errors_on_a_long_chain_are_of_the_orders() -> None:
    """Four of two stages of Gauss, two of RATTLE; of DOP853 a hundredth for a thousandth of the tolerance, or less."""
    problem = long_chain(0.08)
    exact = solve_run(problem, 1e-13, "dop853_joint").states.r[-1]

    def error(step: float, solver: str, **options: Any) -> float:
        return float(np.max(np.abs(solve_run(problem, step, solver, **options).states.r[-1] - exact)))

    gauss = [error(h, "gauss_joint", stages=2) for h in (4e-3, 2e-3, 1e-3)]
    assert abs(orders(gauss)[-1] - 4.0) < 0.2, gauss
    rattle = [error(h, "rattle_joint") for h in (2e-3, 1e-3, 5e-4)]
    assert abs(orders(rattle)[-1] - 2.0) < 0.2, rattle
    problem = long_chain(0.3)
    exact = solve_run(problem, 1e-13, "dop853_joint").states.r[-1]
    pair = [error(rtol, "dop853_joint") for rtol in (1e-3, 1e-5, 1e-7)]
    assert pair[1] < pair[0], pair
    assert pair[2] < pair[0] / 100.0, pair


def test_energy_of_a_long_chain_is_kept() -> None:
    """By Gauss to its order, by DOP853 to its tolerance; both are 1 J off with any load or inertia amiss."""
    problem = long_chain(0.4)
    for solver, step, bound in (("gauss_joint", 2e-3, 1e-7), ("dop853_joint", 1e-10, 1e-9)):
        out = solve_run(problem, step, solver)
        assert np.max(np.abs(drift(problem, out))) < bound, solver


@pytest.mark.sampled(0)
@pytest.mark.parametrize("solver", ["gauss_joint", "rattle_joint"])
def test_the_way_back_of_a_long_chain_leads_to_the_start(solver: str) -> None:
    """Steps are symmetric, to the rounding at which their iterations end."""
    problem, dt = long_chain(0.05), 1e-3
    end = solve_run(problem, dt, solver).states
    turned = dataclasses.replace(end[len(end.r) - 1], v=-end.v[-1], Omega=-end.Omega[-1], t=0.0)
    back = solve_run(dataclasses.replace(problem, initial=turned), dt, solver).states
    assert np.max(np.abs(back.r[-1] - problem.initial.r)) < 1e-10


@pytest.mark.sampled(0)
@pytest.mark.parametrize(("links", "dt"), few([(120, 2e-3), (240, 1e-3), (240, 5e-4)], lambda case: case[0] < 200))
def test_steps_of_rattle_end_where_the_limitation_says(links: int, dt: float) -> None:
    """Where dt N w is 0.1 the equations of a step are singular, w the fastest turn; the run says what helps."""
    out = make_solver("rattle_joint").solve(long_chain(0.4, links), StepControl(dt=dt))
    assert out.status is Status.STEP_UNDERFLOW
    assert "shorter" in out.message and "gauss_joint" in out.message
    fastest = float(np.max(np.linalg.norm(out.states.Omega[-1], axis=1)))
    assert 0.08 < dt * links * fastest < 0.16
    solve_run(long_chain(float(out.t[-1]), links), 0.4 * dt, "rattle_joint")


@pytest.mark.parametrize(
    ("solver", "step", "bound"),
    [
        ("dop853_joint", 1e-11, 1e-9),
        ("gauss_joint", 5e-3, 1e-8),
        ("rattle_joint", 2e-3, 1e-3),
    ],
)
def test_user_forces_are_those_of_the_kernel(solver: str, step: float, bound: float) -> None:
    """No code is made of a user's law; the recursion calls it, as the kernel does."""
    system = with_user_forces()
    start = dataclasses.replace(consistent(system, 2), t=0.0)
    problem = dataclasses.replace(make_problem("heavy_top", {"t_end": 0.5}), system=system, initial=start)
    exact, out = solve_run(problem, 1e-12, "rkmk_dop853"), solve_run(problem, step, solver)
    assert np.max(np.abs(out.states.r[-1] - exact.states.r[-1])) < bound


NAMES = ("heavy_top", "bricard", "slider_crank", "four_bar_grid", "driven_slider_crank")


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", few(NAMES, lambda name: name not in ("slider_crank", "four_bar_grid")))
def test_runs_are_those_of_code(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same equations in the same methods; between unit quaternions, where stages are, code has others."""
    parameters = {"rows": 2, "columns": 2} if name == "four_bar_grid" else {}
    problem, found = make_problem(name, {**parameters, "t_end": 0.5}), []
    for refuse in (choice.refuse_code, lambda problem: "not now"):
        monkeypatch.setattr(choice, "refuse_code", refuse)
        found.append([solve_run(problem, 1e-8 if solver == "dop853_joint" else 0.01, solver) for solver in JOINT])
    for made, swept in zip(*found, strict=True):
        assert abs(len(made.t) - len(swept.t)) <= 0.2 * len(made.t)
        assert np.max(np.abs(made.states.r[-1] - swept.states.r[-1])) < 1e-8


@pytest.mark.sampled(1)
@pytest.mark.usefixtures("by_bodies")
@pytest.mark.parametrize("solver", JOINT)
def test_rows_chosen_anew_leave_the_motion(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pivots of the start count as lost: others are chosen at numbers, the motion is the same."""
    problem, step = make_problem("bricard", {"t_end": 1.2}), 1e-9 if solver == "dop853_joint" else 0.01
    plain = solve_run(problem, step, solver)
    monkeypatch.setattr(marching, "LEAST_PIVOT", 0.5)
    monkeypatch.setattr(relay, "FAIR", 2.0)  # no earlier order goes on
    monkeypatch.setattr(symplectic, "POOR_PIVOT", 0.9)
    changed = solve_run(problem, step, solver)
    assert any("anew" in note for note in changed.notes)
    assert np.max(np.abs(plain.states.r[-1] - changed.states.r[-1])) < 1e-7


@pytest.mark.parametrize("solver", JOINT)
def test_mechanisms_are_data(solver: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is compiled for one long chain is all that another takes."""
    step = 1e-6 if solver == "dop853_joint" else 1e-3
    solve_run(long_chain(5e-3, 240), step, solver)
    made = list[str]()
    monkeypatch.setattr(generated_code, "_compile", lambda ir, machine: made.append(str(ir)) or b"")
    solve_run(long_chain(5e-3, 249), step, solver)
    assert not made


def test_large_mechanisms_of_many_loops_are_refused() -> None:
    """Their factor is dense; the kernel's is not."""
    problem = make_problem("four_bar_grid", {"rows": 14, "columns": 14})
    for solver in JOINT:
        reason = make_solver(solver).refuses(problem, StepControl(dt=1e-3))
        assert reason is not None and "rows of closed loops" in reason and "rkmk_dop853" in reason


def test_a_refusal_that_nobody_asked_for_beforehand_is_a_status(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted again where the mechanism is made."""
    monkeypatch.setattr(evaluation, "MOST_ROWS", 2)
    out = make_solver("dop853_joint").solve(long_chain(0.01), StepControl(rtol=1e-6))
    assert out.status is Status.REFUSED and "got 3" in out.message


class Counted(np.ndarray):
    """An array that counts reads of its entries, and of rows."""

    reads = 0

    def __getitem__(self, at: Any) -> Any:
        Counted.reads += 1
        return super().__getitem__(at)


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sweeps as plain Python, whatever has been compiled before."""
    for module in (algebra, twists, sweeps, closing_rows, accelerations, hamilton):
        for name, value in list(vars(module).items()):
            plain = value.function if isinstance(value, InlineFunction) else getattr(value, "py_func", None)
            if plain is not None:
                monkeypatch.setattr(module, name, plain)
        monkeypatch.setattr(module, "run", lambda entry: None if isinstance(entry, int) else entry(), raising=False)


@pytest.mark.usefixtures("uncompiled")
@pytest.mark.parametrize("function", ["couple", "stage"])
def test_work_grows_in_proportion_to_bodies(function: str) -> None:
    """Entries read: twelve links more take as many more from 24 on as from 12 on."""

    def reads(links: int) -> int:
        problem = make_problem("chain", {"links": links})
        tree = build_spanning_tree(problem.system, problem.initial)
        own = TreeMechanism(problem.system, tree)
        limbs = own.mechanism.limbs._replace(
            **{n: a.view(Counted) for n, a in own.mechanism.limbs._asdict().items() if isinstance(a, np.ndarray)}
        )
        limbs = limbs._replace(
            placing=lambda: sweeps.place_bodies(limbs),
            factoring=lambda: sweeps.factor_inertia(limbs),
            responding=lambda: sweeps.find_response(limbs),
        )
        q, u = np.split(tree.start, [tree.nq])
        closing = select_rows(own.mechanism.closing, own.order.rows, own.order.pivots)
        Counted.reads = 0
        if function == "couple":
            accelerations.couple_tree(CoupledTree(limbs, closing, np.zeros(1), q, u))
        else:
            phase = TreePhase(own, radial=True).phase
            hamilton.find_slopes(
                phase._replace(limbs=limbs, t=np.zeros(1), q=q, p=0.0 * q, q_dot=0.0 * q, p_dot=0.0 * q)
            )
        return Counted.reads

    few, some, many = (reads(links) for links in (12, 24, 36))
    assert many - some == some - few > 0
    assert some < 2.1 * few
