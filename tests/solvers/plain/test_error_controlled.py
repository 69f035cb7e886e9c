"""Compiled methods with error control take the steps of the plain ones, and the plain control chooses as theirs does.

Each step is that of the plain method over the time that the compiled one chose. The choice is compared on the same
errors: where an error is at rounding, as over the first steps, rounding chooses the next step.
"""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from mbsbench import State, States, StepControl
from mbsbench.harness.catalogue.registry import make_problem, make_solver
from mbsbench.harness.mechanics.types import Status
from mbsbench.solvers.formulations.compiled import marching
from mbsbench.solvers.plain import radau_ggl, rkmk
from mbsbench.solvers.plain.error_control import ErrorControl
from mbsbench.solvers.plain.march import march
from mbsbench.solvers.plain.mechanics import Mechanism, move, solve
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.covering import diagonal, few
from mbsbench.tests.factories import solve_run

from ..arbitrary_joints import KINDS, MOVING, moving_rows, one_joint
from ..arbitrary_systems import consistent, linkage, with_user_forces
from ..runs import ACCEPTED, error, orders
from .test_contract import compare_runs, problem_of

SHARP = 1e-10  # rtol, at which radau_ggl ends its iteration at 1e-13
STEPS = {  # the plain steps of each solver
    "rkmk_dopri5": lambda p: rkmk.Step(p, rkmk.PAIRS["5(4)"], SHARP),
    "rkmk_dop853": lambda p: rkmk.Step(p, rkmk.PAIRS["8(5,3)"], SHARP),
    "radau_ggl": lambda p: radau_ggl.Step(p, 1e-13, SHARP),
}
CLOSE = {
    "rkmk_dopri5": 1e-5,
    "rkmk_dop853": 1e-5,
    "radau_ggl": 1e-2,
}  # of the ends of steps
LEFT = {"rkmk_dopri5": 0.0, "rkmk_dop853": 0.0, "radau_ggl": 1e-13}  # [m] of h v: h^2 dv' ends the iteration


class Replay:
    """The steps between given times."""

    def __init__(self, t):
        self.left, self.counters, self.ended = [b - a for a, b in pairwise(t)], {}, (Status.SUCCESS, "")

    def choose_step(self, t):
        return self.left[0] if self.left else None

    def accept(self, h, made):
        del self.left[0]
        return made is not None


def compare(problem, solver, codes=("kernel",)):
    """Compare with the plain steps over the same times: of 1e-4, 5e-4 and then 1e-3 s, as the control grows them."""
    control = StepControl(rtol=SHARP, max_step=problem.dt)
    for code in codes:
        made = make_solver(solver, {"code": code})
        if code != "kernel" and made.refuses(problem, control):
            continue
        found = made.solve(problem, control)
        where = f"{solver}, {code}, {problem.name}"
        assert found.status is Status.SUCCESS, f"{where}: {found.message}"
        compare_runs(problem, where, found, step_plainly(solver, problem, control, found.t), LEFT[solver] / problem.dt)


def step_plainly(solver, problem, control, t):
    """The plain steps between given times."""
    return march(problem, control, STEPS[solver](problem), Replay(t))


def move_off(problem, by=1e-8):
    """The problem from a start off phi = 0 and A v + phi_t = 0, by that along M^-1 A^T, in m and m/s of each row."""
    m, s = Mechanism(problem.system), problem.initial
    v = np.hstack((s.v, s.Omega))
    A = m.rows(s.t, s.r, s.R, v).A
    x = by * np.cos(1.0 + np.arange(m.nr))
    gap = m.divide_by_inertia(A.T @ solve(m.schur(A, A), x)).reshape(-1, 6)
    return _begin_at(problem, *move(s.r, s.R, gap), v - 3.0 * gap)


def close_start(problem):
    """The problem from its start moved onto phi = 0 and A v + phi_t = 0, by the least changes in the norm of M."""
    m, s = Mechanism(problem.system), problem.initial
    r, R, v = s.r, s.R, np.hstack((s.v, s.Omega))
    for _ in range(3):
        rows = m.rows(s.t, r, R, v)
        S = m.schur(rows.A, rows.A)
        change, gain = (m.divide_by_inertia(rows.A.T @ solve(S, -x)).reshape(-1, 6) for x in (rows.phi, rows.phi_dot))
        (r, R), v = move(r, R, change), v + gain
    return _begin_at(problem, r, R, v)


def _begin_at(problem, r, R, v):
    return replace(problem, initial=State(r, R, v[:, :3], v[:, 3:], problem.initial.t))


def leave_start_out(found):
    """A run without its first node, unless that is all it has."""
    s = found.states
    if len(found.t) == 1:
        return found
    states = States(s.r[1:], s.R[1:], s.v[1:], s.Omega[1:])
    return replace(found, t=found.t[1:], states=states, reaction=found.reaction[1:])


def compare_steps(where, found, plain, within):
    """Compare the ends of steps that both methods have chosen by their errors."""
    where = f"{where}: ends of steps are {found.t}, by the plain method {plain.t}"
    assert len(plain.t) == len(found.t), where
    assert_close(plain.t, found.t, rtol=within, atol=0.0, what=where)


ON_JOINTS = [(kind, solver) for kind in (*KINDS, *MOVING) for solver in STEPS]


def is_on_the_diagonal(case):
    """Each joint by a pair of Runge-Kutta, which takes all; radau_ggl on three of them."""
    kind, solver = case
    k = [*KINDS, *MOVING].index(kind)
    return solver == ("rkmk_dopri5", "rkmk_dop853")[k % 2] or (solver == "radau_ggl" and k % 5 == 2)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("kind", "solver"), few(ON_JOINTS, is_on_the_diagonal))
def test_every_joint(kind, solver):
    """Between two bodies and to the ground, beside springs and loads; rows that a method refuses are left out."""
    systems = [one_joint(kind, ground=ground) for ground in (True, False)] if kind in KINDS else []
    if not systems:
        system = moving_rows(kind)
        systems = [(system, consistent(system, 4))]
    for system, start in systems:
        problem = problem_of(kind, system, start, 8)
        if make_solver(solver).refuses(problem, StepControl(rtol=SHARP)) is None:
            compare(problem, solver, ("kernel", "mechanism"))


NAMES = ("linkage", "linkage with springs", "user forces", "redundant rows")


@pytest.mark.parametrize(("name", "solver"), diagonal(NAMES, list(STEPS)))
def test_linkages(name, solver):
    """Three bodies; forces of the user; redundant rows, which share a reaction by any rule: the motion is one."""
    if name == "redundant rows":
        problem = make_problem("four_bar_grid", {"rows": 1, "columns": 1, "t_end": 0.01})
    else:
        system = with_user_forces() if name == "user forces" else linkage(springs=name == "linkage with springs")
        problem = problem_of(name, system, consistent(system, 2), 10)
    compare(problem, solver)


def body_of(name):
    """The plain Python function of a step control's: numba takes its place once something has been compiled."""
    function = getattr(marching, name)
    return getattr(function, "py_func", None) or function.function


@pytest.mark.parametrize("order", [4.0, 5.0, 8.0])
@pytest.mark.parametrize("longest", [None, 0.03])
def test_control_chooses_the_compiled_steps(order, longest):
    """Of the same errors, too large ones among them, and of iterations that fail."""
    random, t_end = np.random.default_rng(int(order)), 3.0
    control = StepControl(rtol=1e-6, max_step=longest)
    c = SimpleNamespace(
        t=0.0,
        t_end=t_end,
        adaptive=1,
        next_step=1e-4,
        max_step=longest or np.inf,
        order=order,
        last_error=1e-4,
        rejected=0,
        outcome=marching.FULL,
    )
    next_end, accept_step, choose_next_step = map(body_of, ("_next_end", "_accept_step", "_choose_next_step"))
    plain, t, taken = ErrorControl(SimpleNamespace(t_end=t_end), control, order), 0.0, 0
    while (h := plain.choose_step(t)) is not None:
        end = next_end(c, None)
        assert c.outcome == marching.FULL and h == pytest.approx(c.h, rel=1e-12), f"step {taken} at t = {t}"
        fails, c.error = random.random() < 0.1, float(10.0 ** random.uniform(*[(-12.0, 1.5), (-2.0, 1.0)][taken % 2]))
        if fails:
            c.error = (marching.SAFETY / 0.5) ** order
        taken += 1
        stands = accept_step(c)
        assert plain.accept(h, None if fails else (None, None, None, c.error)) == stands
        if stands:
            choose_next_step(c)
            t, c.t = t + h, end
    next_end(c, None)
    assert c.outcome == marching.FINISHED and t == pytest.approx(t_end) and taken > 15
    assert plain.counters["rejected"] == c.rejected > 2


@pytest.mark.parametrize("solver", STEPS)
def test_runs_choose_the_same_steps(solver):
    """From the catalogue, over a motion whose errors are far above rounding; what the stop test leaves moves them."""
    problem = make_problem("heavy_top", {"t_end": 0.06})
    control = StepControl(rtol=1e-5)
    found, plain = (make_solver(solver, {"code": code}).solve(problem, control) for code in ("kernel", "plain"))
    assert plain.status is Status.SUCCESS, plain.message
    assert plain.counters["rejected"] == found.counters["rejected"]
    if solver == "radau_ggl":
        for out in (plain, found):
            assert out.counters["newton_iterations"] > 2 * out.counters["steps"]
        assert found.counters["factorisations"] == 1 + found.counters["steps"] + found.counters["rejected"]
    else:
        evaluations = plain.counters["evaluations"]
        assert evaluations == found.counters["evaluations"] == found.counters["factorisations"]
    compare_steps(f"{solver}, {problem.name}", found, plain, CLOSE[solver])


def test_what_is_left_is_the_rest_of_a_geometric_series():
    """By the rate of the last two iterations, which may take turns; at rounding it is the last change."""
    left = radau_ggl.estimate_further_changes
    assert left([8.0, 2.0, 0.5]) == pytest.approx(0.5 / 4 + 0.5 / 16 + 0.5 / 64, rel=0.02)
    assert left([8.0, 8.0, 0.5]) == left([8.0, 2.0, 0.5])
    assert left([1e-15, 1e-15, 2e-15]) == 2e-15
    assert left([3.0, 0.0]) == 0.0 and left([3.0, 1e-9]) == left([3.0]) == np.inf
    assert radau_ggl.measure_change(np.array([[0.5, -8.0]]), np.array([[0.0, -3.0]])) == 2.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("solver", "step", "order"), [("rkmk_dopri5", 8e-3, 5.0), ("rkmk_dop853", 3.2e-2, 8.0), ("radau_ggl", 0.02, 5.0)]
)
def test_the_order_of_plain_steps(solver, step, order):
    """Three halvings, to the exact motion."""
    problem = make_problem("heavy_top", {"t_end": 0.32})
    runs = [solve_run(problem, ACCEPTED, solver, {"max_step": step / 2**k}, code="plain") for k in range(4)]
    found = orders([error(problem, out) for out in runs])
    assert abs(found[-1] - order) < 0.2, found
