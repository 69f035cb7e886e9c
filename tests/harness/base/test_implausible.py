"""No number that a solver or problem hands over switches a judge off: a motion that is none stays no success."""

import dataclasses
import math

import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.registry import read_declaration
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.types import Invariant, Problem, Status, StepControl, Trajectory
from mbsbench.harness.run import handover, measuring
from mbsbench.harness.run.contract import check_trajectory, split_cost
from mbsbench.harness.run.job import Job

from ..misbehaving import Exact, FreeFall, free_fall

STEP = StepControl(dt=0.5)  # so long that poses and velocities of the motion aside may be those of one motion
FALSE = {"lifted": ([0.0, 0.0, 3.0], "wrong"), "aside": ([3.0, 0.0, 0.0], "inaccurate")}  # [m] at the end, as t^2
SIZES = (-5.0, math.inf, 1e-30, math.nan, 1e30)


def falls(aside, p: Problem) -> Trajectory:
    """The motion of the unchanged problem, plus ``aside`` [m]: upwards it breaks a law, sideways it keeps all."""
    done = Exact().solve(p, STEP)
    r = done.states.r + np.array(aside) * ((done.t / done.t[-1]) ** 2)[:, None, None]
    return dataclasses.replace(done, states=dataclasses.replace(done.states, r=r))


@dataclasses.dataclass(frozen=True)
class Says(FreeFall):
    """A reference with one number of another size."""

    bound: float | None = None
    height: float | None = None

    def error(self, t):
        return super().error(t) if self.bound is None else np.full(len(t), self.bound)

    def states(self, t):
        s = super().states(t)
        return s if self.height is None else dataclasses.replace(s, r=np.full_like(s.r, self.height))


def known_by(p, **said):
    return dataclasses.replace(p, reference_from=lambda start: Says(start, **{"horizon": 2.0, **said}))


def entry(a, x):
    """``a`` with its last entry replaced."""
    out = np.array(a, dtype=float)
    out.flat[-1] = x
    return out


def moved(name):
    return lambda d, x: dataclasses.replace(
        d, states=dataclasses.replace(d.states, **{name: entry(getattr(d.states, name), x)})
    )


def back(d, x):
    last = d.states[-1]
    return dataclasses.replace(d, returned=State(entry(last.r, x), last.R, last.v, last.Omega))


OF_SOLVERS = {
    **{name: moved(name) for name in ("r", "R", "v", "Omega")},
    "t": lambda d, x: dataclasses.replace(d, t=entry(d.t, x)),
    "cpu_time": lambda d, x: dataclasses.replace(d, cpu_time=x),
    "setup_time": lambda d, x: dataclasses.replace(d, setup_time=x),
    "diagnostics": lambda d, x: dataclasses.replace(d, diagnostics={"x": np.full(len(d.t), x)}),
    "reaction": lambda d, x: dataclasses.replace(d, reaction=np.full((len(d.t), 0), x)),
    "returned": back,
}
OF_PROBLEMS = {
    "t_end": lambda p, x: dataclasses.replace(p, t_end=x),
    "dt": lambda p, x: dataclasses.replace(p, dt=x),
    "energy_allowed": lambda p, x: dataclasses.replace(p, energy_allowed=x),
    "horizon": lambda p, x: known_by(p, horizon=x),
    "error": lambda p, x: known_by(p, bound=x),
    "reference": lambda p, x: known_by(p, height=x),
    "invariant": lambda p, x: dataclasses.replace(p, invariants=(Invariant("I", "J", lambda s: np.full(len(s), x)),)),
    "planar_normal": lambda p, x: dataclasses.replace(p, planar_normal=np.array([0.0, 0.0, x])),
    "frame": lambda p, x: dataclasses.replace(p, frame=entry(p.frame, x)),
    **{
        name: lambda p, x, name=name: dataclasses.replace(
            p, system=dataclasses.replace(p.system, **{name: entry(getattr(p.system, name), x)})
        )
        for name in ("mass", "inertia", "gravity")
    },
    "start": lambda p, x: dataclasses.replace(p, initial=dataclasses.replace(p.initial, v=entry(p.initial.v, x))),
}


MATTER = ("mass", "inertia")  # matter 1e15 m away is another system, beside which 3 m are nothing


@pytest.fixture
def status(monkeypatch, tmp_path):
    """How a motion of a problem is judged; ``refused`` where either is not taken at all."""

    def call(make_problem, make_motion) -> str:
        found = dataclasses.replace(registry.problems()["free_fall"], make=lambda mass: make_problem())
        monkeypatch.setitem(registry._plugin_problems, "free_fall", found)
        job = Job(RunSpec("free_fall", "exact", STEP), tmp_path)
        try:
            p = registry.make_problem("free_fall")
            motion = check_trajectory(make_motion(), Exact(), p)
            split_cost(motion, 1.0, 0.0, 1.0, Exact())
            handover.write_handover(
                job.handover, handover.Handover(handover.SolverReport(claimed=Status.SUCCESS), motion)
            )
            motion = handover.read_handover(job.handover, p.system).trajectory
            return measuring.judge_motion(job, p, motion)[0].status
        except (ValueError, TypeError):  # one run, crashed: its message is the exception's
            return "refused"

    return call


def test_the_motions_are_told_apart(status):
    """Else the tests below show nothing."""
    known = known_by(free_fall())
    assert status(lambda: known, lambda: falls([0.0] * 3, known)) == "success"
    for aside, word in FALSE.values():
        assert status(lambda: known, lambda a=aside: falls(a, known)) == word


@pytest.mark.sampled(2)
@pytest.mark.parametrize("aside", FALSE)
@pytest.mark.parametrize(
    ("what", "x"),
    [(what, x) for what in (*OF_SOLVERS, *OF_PROBLEMS) for x in SIZES if what not in MATTER or x not in (1e-30, 1e30)],
)
def test_no_number_makes_a_success_of_a_false_motion(status, what, x, aside):
    """Refused, crashed, wrong or inaccurate, whatever is said beside it."""
    plain = known_by(free_fall())
    motion = falls(FALSE[aside][0], plain)
    said = OF_SOLVERS.get(what, lambda d, x: d)
    made = OF_PROBLEMS.get(what, lambda p, x: p)
    assert status(lambda: made(plain, x), lambda: said(motion, x)) != "success"


@pytest.mark.parametrize("x", [-5.0, 0.0, math.inf])
def test_an_order_is_positive(x):
    """Certificates hold a method to what it declares: minus five would be met by anything."""
    with pytest.raises(TypeError, match="order must be"):
        read_declaration(type("Odd", (Exact,), {"order": x, "name": "odd"})())


def test_a_solver_that_says_it_is_ours_pays_for_its_whole_call():
    """``__module__`` and the name in the catalogue are the plugin's to choose; what the catalogue made is not."""
    motion = dataclasses.replace(falls([0.0] * 3, free_fall()), cpu_time=0.6, setup_time=0.0)
    forged = type("Forged", (Exact,), {"__module__": "mbsbench.solvers.rattle", "__mbsbench_name__": "rattle"})
    assert split_cost(motion, 1.0, 0.0, 1.0, forged()) == (1.0, 0.0, 0.0)
    assert split_cost(motion, 1.0, 0.0, 1.0, registry.make_solver("rattle")) == (0.6, 0.4, 0.0)


def test_what_is_compiled_is_left_out_once():
    """Whether a plugin's own set-up holds it or not; the cost of a call is that of all but code."""
    plugin = Exact()
    for set_up, cost in ((math.nan, 4.0), (1.0, 4.0), (7.0, 3.0)):  # of 10 s, 6 of which made code
        motion = dataclasses.replace(falls([0.0] * 3, free_fall()), cpu_time=math.nan, setup_time=set_up)
        found = split_cost(motion, 10.0, 6.0, 10.0, plugin)
        assert found == (cost, 10.0 - cost, 6.0) and found.call == 4.0
    motion = dataclasses.replace(falls([0.0] * 3, free_fall()), cpu_time=5.0, setup_time=6.0)
    assert split_cost(motion, 10.0, 6.0, 10.0, registry.make_solver("rattle")) == (4.0, 6.0, 6.0)
