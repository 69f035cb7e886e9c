"""A start that is off the constraints by more than the error test allows does not end a run of Radau."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbsbench import Status, StepControl
from mbsbench.harness.catalogue import registry
from mbsbench.harness.mechanics.motion import energy
from mbsbench.solvers.formulations.methods import radau
from mbsbench.tests.comparing import assert_close

from ..plain import cases

EXAM = Path(__file__).parents[2] / "exam" / "own_mechanisms.py"


@pytest.fixture
def solve(monkeypatch):
    """Solve by ``radau_ggl``, and return whether a start was moved, too."""
    schemes, prepare = [], radau.prepare

    def keep(*given, **named):
        step = prepare(*given, **named)
        schemes.append(step.scheme)
        return step

    monkeypatch.setattr(radau, "prepare", keep)

    def solve(problem, rtol):
        out = registry.make_solver("radau_ggl").solve(problem, StepControl(rtol=rtol, max_steps=5_000))
        return out, bool(schemes[-1]["exact"])

    return solve


@pytest.mark.parametrize(("name", "size"), [("exam_far_four_bar", 1.0), ("exam_tiny_four_bar", 1e-5)])
def test_no_start_is_left_where_no_step_passes(name, size, solve):
    """A tolerance of 2e-10 m over steps of 1e-3 s, or of 1e-11 m over 4e-6 s, leaves more than rtol in velocities.

    The motions are those of ``rkmk_dop853``, which solves no equations, to ten times the error of a step. Without
    exact iterations from then on, the tiny mechanism takes more steps than are allowed.
    """
    registry.load_plugin(EXAM)
    problem = registry.make_problem(name)
    found, moved = solve(problem, 1e-8)
    other = registry.make_solver("rkmk_dop853").solve(problem, StepControl(rtol=1e-11))
    assert (found.status, other.status) == (Status.SUCCESS, Status.SUCCESS), (found.message, other.message)
    assert moved
    assert_close(found.states.r[-1], other.states.r[-1], rtol=0.0, atol=1e-7 * size)


def test_a_start_off_the_constraints_is_moved_onto_them():
    """Poses and velocities go where plain rows move them: a wrong sign of either leaves 2e-8 m or m/s."""
    case = cases.start_off(cases.make_problems()["springs"])
    case.compare(case.solve())


@pytest.mark.parametrize(("name", "t_end", "rtol"), [("andrews", 0.05, 1e-6), ("chain", 0.4, 1e-5)])
def test_starts_of_ordinary_mechanisms_stay_where_they_are(name, t_end, rtol, solve):
    """Steps are rejected there, too, for what discretisation does."""
    out, moved = solve(replace(registry.make_problem(name), t_end=t_end), rtol)
    assert out.status is Status.SUCCESS and out.counters["rejected"] > 0 and not moved


def test_a_start_before_a_singular_pose_stays_where_it_is(solve):
    """A small gap is a large distance there: moved by it, the motion gains 170 of its 620 J before it ends."""
    problem = registry.make_problem("n_four_bar")
    out, moved = solve(problem, 1e-5)
    E = energy(problem.system, out.states)
    assert out.status is Status.STEP_UNDERFLOW and not moved
    assert np.max(np.abs(E - E[0])) < 1e-6 * np.max(np.abs(E))
