"""How a run ended is a fact of its record; the pace tells stuck from slow."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from mbsbench.harness.base.forked_process import ProcessEnd
from mbsbench.harness.catalogue import registry
from mbsbench.harness.judge.referee.claims.endings import (
    Ending,
    classify_ending,
    ended_by_budget,
    ended_by_machine,
    measure_pace,
)
from mbsbench.harness.mechanics.types import EndCause, StepControl
from mbsbench.harness.results.words import describe_ending
from mbsbench.harness.run.job import Job, record_unfinished
from mbsbench.solvers.formulations.recording import Clock, march
from mbsbench.solvers.formulations.start import choose_layout, pack_start
from mbsbench.solvers.gc_weak_form import GcWeakForm
from mbsbench.tests.factories import make_record, make_series, parse_specs


def stopped_by_geometric_driver(**limits):
    """ODE-GC's own status and words."""
    found = GcWeakForm().solve(
        registry.make_problem("torque_free_body", {"t_end": 1.0}), StepControl(dt=1e-4, **limits)
    )
    return found.status, found.message, found.counters["steps"]


def stopped_by_recording(**limits):
    """Those of the solvers with error control."""
    problem, t = registry.make_problem("torque_free_body", {"t_end": 10.0}), iter(np.linspace(0.1, 10.0, 100))
    layout, clock = choose_layout(problem, "quaternion")[0], Clock(limits.pop("wall", None))
    y = pack_start(layout, problem)
    time.sleep(0.001)
    found = march(
        problem,
        StepControl(rtol=1e-3, **limits),
        layout,
        clock,
        lambda: (next(t), y, y[layout.lam]),
        y,
        y[layout.lam],
        lambda steps: {},
        (),
    )
    return found.status, found.message, found.counters["steps"]


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: stopped_by_geometric_driver(cpu_limit=1e-9), "CPU limit of 1e-09 s reached at t = "),
        (lambda: stopped_by_recording(wall=1e-9), "the CPU limit of 1e-09 s was reached"),
    ],
)
def test_a_solver_stopped_by_its_clock_is_ended_by_the_machine(made, words):
    """It is stalled with steps left: a clock, whatever its message."""
    status, message, *_ = made()
    assert words in message
    record = make_record(status=str(status), ended_by="solver", t_reached_s=4.0, steps=50, max_steps=100)
    assert ended_by_machine(record) and classify_ending(record) is Ending.MACHINE


@pytest.mark.parametrize(
    ("killed", "limit", "code", "peak", "by", "words"),
    [
        (True, 62.0, -9, 0.0, EndCause.WALL_LIMIT, "not finished here: killed after 62 s of wall time"),
        (True, 120.0, -9, 0.0, EndCause.MEASURE_LIMIT, "measuring its motion took too long"),
        (False, 62.0, -signal.SIGXCPU, 0.0, EndCause.CPU_LIMIT, "killed past its limit of 60 s of CPU time"),
        (
            False,
            62.0,
            -signal.SIGKILL,
            99.0,
            EndCause.MEMORY_LIMIT,
            "ended by SIGKILL with 99 MB resident, near its memory lim",
        ),
        (True, 900.0, -signal.SIGKILL, 5.0, EndCause.TOTAL_LIMIT, "total_limit of 900 s"),
    ],
)
def test_a_process_ended_by_clock_or_memory_is_ended_by_the_machine(killed, limit, code, peak, by, words):
    """As the supervisor states it, and in words."""
    job = Job(
        parse_specs('[[runs]]\nproblem = "heavy_top"\nsolver = "gc_weak_form"\nmemory = 100.0\ncpu_limit = 60.0')[0],
        Path("nowhere"),
    )
    record = record_unfinished(job, ProcessEnd(code, killed, "", peak), 1.0, by, limit)
    assert record.ended_by == by and words in describe_ending(record)
    assert ended_by_machine(record) and classify_ending(record) is Ending.MACHINE


@pytest.mark.parametrize(("killed", "code"), [(True, -signal.SIGKILL), (False, -signal.SIGXCPU)])
def test_compilation_that_takes_too_long_is_said_to_be_that(killed, code):
    """Whoever ends it, its parent or the system: it is the machine's doing, and no time of the solver's."""
    job = Job(parse_specs('[[runs]]\nproblem = "heavy_top"\nsolver = "gc_weak_form"')[0], Path("nowhere"))
    ended = ProcessEnd(code, killed, "", 0.0, cpu=603.0, over="code", code_s=601.0)
    record = record_unfinished(job, ended, 700.0, EndCause.WALL_LIMIT, 620.0)
    assert (record.ended_by, record.status, record.code_s) == (EndCause.CODE_LIMIT, "unfinished", 601.0)
    assert "compilation took over 600 s of CPU time" in describe_ending(record)
    assert ended_by_machine(record) and classify_ending(record) is Ending.MACHINE


@pytest.mark.parametrize("by", [EndCause.SUPERVISOR_LOST, EndCause.WORKERS_LOST])
def test_a_lost_parent_is_the_machines_doing(by):
    record = make_record(status="crashed", ended_by=str(by), t_reached_s=4.0, steps=50)
    assert ended_by_machine(record) and "died" in describe_ending(record)


@pytest.mark.parametrize("made", [stopped_by_geometric_driver, stopped_by_recording])
def test_the_budget_of_steps_is_no_clock(made):
    """Seven steps asked for and taken, whatever the solver says: the same on every machine."""
    status, message, steps = made(max_steps=7)
    record = make_record(status=str(status), message=message, t_reached_s=0.7, steps=steps, max_steps=7)
    assert ended_by_budget(record) and not ended_by_machine(record) and steps == 7


def test_pace_is_that_of_the_last_tenth():
    """Ninety steps of 0.05 s and ten of 0.01 s. Of a thinned series too."""
    t = np.concatenate([[0.0], np.cumsum([0.05] * 90 + [0.01] * 10)])

    def cut(asked):
        return make_record(t_reached_s=t[-1], status="stalled", steps=100, max_steps=100, max_step_s=asked)

    assert measure_pace(cut(0.05), make_series(t)) == pytest.approx(0.01)
    assert measure_pace(cut(0.05), make_series(t[::5])) == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("last", "asked", "reached", "how"),
    [
        (0.005, 0.6, 4.0, Ending.FINAL),
        (0.005, 0.4, 4.0, Ending.SLOW),
        (0.005, 0.6, 6.0, Ending.SLOW),
        (0.1, 11.0, 9.9, Ending.SLOW),
    ],
)
def test_a_stuck_run_is_slow_and_far_from_its_end(last, asked, reached, how):
    """100 steps, of 10 s. At 0.005 s a step, below a hundredth of 0.6 s, from 4 s the end is 1200 steps away, from 6 s
    800, below ten times as many. A steady pace that got to 9.9 s gets to the end, however large a step it may take.
    """
    t = np.append(np.linspace(0.0, reached - 10 * last, 91), reached - last * np.arange(9, -1, -1))
    r = make_record(t_reached_s=reached, status="stalled", steps=100, max_steps=100, max_step_s=asked)
    assert classify_ending(r, make_series(t)) is how


def test_a_run_that_stands_still_is_stuck():
    """Its last steps are below the spacing of times: no pace, no end."""
    t = np.append(np.linspace(0.0, 4.0, 91), np.full(10, 4.0))
    r = make_record(t_reached_s=4.0, status="stalled", steps=100, max_steps=100, step_max_s=0.05)
    assert measure_pace(r, make_series(t)) == 0.0 and classify_ending(r, make_series(t)) is Ending.FINAL


def test_what_failed_by_itself_is_final():
    """Also what a solver refused; what took no step and is not at its end has shown nothing."""
    assert classify_ending(make_record(status="diverged", t_reached_s=4.0, steps=3)) is Ending.FINAL
    assert classify_ending(make_record(status="refused", t_reached_s=float("nan"))) is Ending.FINAL
    assert classify_ending(make_record(status="success", steps=100)) is Ending.FINAL
    assert classify_ending(make_record(status="singular", t_reached_s=0.0)) is Ending.NO_START


@pytest.mark.parametrize(
    ("reached", "step", "how"),
    [
        (0.003, 0.01, Ending.NO_START),
        (0.02, 0.01, Ending.FINAL),
        (0.003, float("nan"), Ending.FINAL),
    ],
)
def test_a_run_that_does_not_get_as_far_as_one_step_cannot_start(reached, step, how):
    """Fourteen tiny steps to 3 ms, where 10 ms may be one: its start failed, whatever the motion."""
    assert classify_ending(make_record(status="step_underflow", t_reached_s=reached, steps=14, max_step_s=step)) is how
