"""The verdict on an exact motion does not depend on how often, or until when, it was recorded."""

import numpy as np
import pytest

from mbsbench import Status, Trajectory
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.judge.metrics.reactions import compute_exact_loads
from mbsbench.harness.reference.computation import find_reference
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.covering import few

from .judged import judge

MOTIONS = {  # problem, parameters, time [s]
    "pendulum": ("simple_pendulum", {}, 2.0),
    "top": ("heavy_top", {}, 2.0),
    "several turns between rows": ("torque_free_body", {"omega": [3.0, 0.0, 900.0]}, 2.0),
    "spring": ("spring_pendulum", {"tuning": 30.0}, 1.0),
    "drive": ("driven_slider_crank", {}, 0.25),
    "redundant rows": ("bricard", {}, 1.0),
    "a fast linkage": ("andrews", {}, 0.01),
    "chaos": ("chain", {}, 1.0),
    "a drive for a second": ("driven_slider_crank", {}, 1.0),
    "a fast linkage to its end": ("andrews", {}, 0.03),
}
SHORT, LONG = ("drive", "a fast linkage"), ("a drive for a second", "a fast linkage to its end")  # half a minute
ROWS = [(what, rows) for what in MOTIONS for rows in (12, 200, 1000, 5000)]


def is_quick(case: tuple[str, int]) -> bool:
    """No long reference, no thousands of rows, and not the drive in 200 rows, which takes as long as in 12."""
    what, rows = case
    return what not in LONG and rows < 5000 and case != ("drive", 200)


def replay_exact(name, parameters, t_end, times):
    """Return the problem, and its exact motion as a solver would hand it over, without reactions."""
    problem = make_problem(name, parameters | {"t_end": t_end})
    reference = find_reference(problem)
    assert reference is not None and reference.horizon >= t_end
    t = t_end * times
    return problem, Trajectory(t, reference.states(t), Status.SUCCESS, "recorded", {"steps": len(t) - 1})


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("what", "rows"), few(ROWS, is_quick))
def test_an_exact_motion_is_right_in_any_number_of_rows(what, rows):
    name, parameters, t_end = MOTIONS[what]
    found = judge(*replay_exact(name, parameters, t_end, np.linspace(0.0, 1.0, rows + 1)))
    assert not found.doubts and {r.law for r in found.inaccuracy} <= {"rows"}  # too few of them is told


@pytest.mark.sampled(2)
@pytest.mark.parametrize("share", [0.03, 0.37])
@pytest.mark.parametrize("what", few(MOTIONS, lambda what: what not in LONG))
def test_an_exact_motion_that_is_cut_short_is_right(what, share):
    name, parameters, t_end = MOTIONS[what]
    found = judge(*replay_exact(name, parameters, share * t_end, np.linspace(0.0, 1.0, 201)))
    assert not found.doubts and not found.inaccuracy


@pytest.mark.parametrize("what", few(MOTIONS, lambda what: what not in LONG))
def test_an_exact_motion_is_right_at_uneven_rows(what):
    """A step may be a thousand times the one before."""
    name, parameters, t_end = MOTIONS[what]
    random = np.random.default_rng(5)
    h = 10.0 ** random.uniform(-3.0, 0.0, 400)
    found = judge(*replay_exact(name, parameters, t_end, np.concatenate(([0.0], np.cumsum(h) / np.sum(h)))))
    assert not found.doubts and {r.law for r in found.inaccuracy} <= {"rows"}  # too few of them is told


FALSE = {  # after the exact start
    "velocities a tenth too large": lambda s: (s.r, s.R, 1.1 * s.v, 1.1 * s.Omega),
    "velocities reversed": lambda s: (s.r, s.R, -s.v, -s.Omega),
    "frozen": lambda s: tuple(np.broadcast_to(a[:1], a.shape) for a in (s.r, s.R, s.v, s.Omega)),
    "rotations transposed": lambda s: (s.r, np.swapaxes(s.R, -1, -2), s.v, s.Omega),
    "spin in space": lambda s: (s.r, s.R, s.v, np.einsum("tbij,tbj->tbi", s.R, s.Omega)),
    "half as fast again": lambda s: (
        *(a[(1.5 * np.arange(len(a)) % len(a)).astype(int)] for a in (s.r, s.R)),
        s.v,
        s.Omega,
    ),
    "sinking": lambda s: (s.r - 0.3 * np.linspace(0.0, 1.0, len(s.r))[:, None, None], s.R, s.v, s.Omega),
}


@pytest.mark.slow  # a minute
@pytest.mark.parametrize("how", FALSE)
@pytest.mark.parametrize("what", [name for name in MOTIONS if name not in ("spring", *SHORT)])
@pytest.mark.parametrize("rows", [200, "uneven"])
def test_falsified_motions_are_found_in_any_number_of_rows(what, rows, how):
    """By another law than that of the start, which is exact."""
    name, parameters, t_end = MOTIONS[what]
    h = 10.0 ** np.random.default_rng(5).uniform(-3.0, 0.0, 400) if rows == "uneven" else np.ones(rows)
    problem, run = replay_exact(name, parameters, t_end, np.concatenate(([0.0], np.cumsum(h) / np.sum(h))))
    s = run.states
    changed = [np.concatenate((a[:1], b[1:])) for a, b in zip((s.r, s.R, s.v, s.Omega), FALSE[how](s), strict=True)]
    if all(np.array_equal(a, b) for a, b in zip(changed, (s.r, s.R, s.v, s.Omega), strict=True)):
        pytest.skip("changes nothing here")
    false = type(s)(*changed, s.times, s.angles)
    found = judge(problem, Trajectory(run.t, false, Status.SUCCESS, "recorded", {"steps": len(h)}))
    assert found.inaccuracy or {r.law for r in found.doubts} - {"start", "end"}


def test_exact_loads_do_not_depend_on_rows():
    """A load is that of its instant, whatever other instants are asked for."""
    problem = make_problem("andrews", {"t_end": 0.01})
    reference = find_reference(problem)
    assert reference is not None
    three, many = (compute_exact_loads(problem.system, reference.states(np.linspace(0.001, 0.009, n))) for n in (3, 25))
    assert_close(three, many[::12], rtol=0.0, atol=1e-9 * np.nanmax(np.abs(many)), equal_nan=True)
