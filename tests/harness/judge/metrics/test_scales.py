"""Scales and judgement: they follow what bodies do to each other, not where the whole goes nor what flies beside it."""

import dataclasses
import math

import numpy as np
import pytest

from mbsbench import Joint, MultibodySystem, RigidBody, SpringDamper, State, States, assemble, make_problem, so3
from mbsbench.harness.mechanics.types import Law, Problem, Reason
from mbsbench.harness.reference import computation

from .judged import claimed, judge

BODY = RigidBody(1.0, 1e-3 * np.eye(3))


@dataclasses.dataclass(frozen=True)
class Known:
    """A motion in closed form up to a horizon."""

    of: object
    horizon: float
    own: object = staticmethod(lambda t: np.full(len(t), 1e-15))
    route: str = "closed form"

    def states(self, t: np.ndarray) -> States:
        return self.of(t)

    def error(self, t: np.ndarray) -> np.ndarray:
        return self.own(t)


def turning(arms: list[float], rates: list[float], t: np.ndarray, v: float = 0.0) -> States:
    """Bodies at ``arms`` [m] from the origin turn about OZ at ``rates`` [rad/s]; all fly along OX at ``v``."""
    angle = np.multiply.outer(t, rates)
    a, w = np.array(arms), np.array(rates)
    e = np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=-1)
    n = np.stack((-np.sin(angle), np.cos(angle), 0 * angle), axis=-1)
    along = np.array([v, 0.0, 0.0])
    R = so3.exp(angle[..., None] * np.array([0.0, 0.0, 1.0]))
    Omega = np.broadcast_to(np.stack((0 * w, 0 * w, w), axis=-1), e.shape)
    return States(a[:, None] * e + t[:, None, None] * along, R, (a * w)[:, None] * n + along, Omega)


def found(system: MultibodySystem, exact, run, t: np.ndarray, horizon: float = 10.0) -> tuple[list[Reason], object]:
    """The reasons against a run, and its measures."""
    start = exact(np.zeros(1))[0]
    p = Problem("p", system, start, t[-1], 0.01, "", "", reference_from=lambda _: Known(exact, horizon))
    judged = judge(p, claimed(t, run(t)))
    return [*judged.doubts, *judged.inaccuracy], judged.m


PENDULUM = assemble([BODY], [Joint(0, (-1.0, 0.0, 0.0))])


def pendulum(t: np.ndarray) -> States:
    return turning([1.0], [1.0], t)


PAIR = assemble([BODY, BODY], [Joint(0, (-0.1, 0.0, 0.0), 1, (0.1, 0.0, 0.0))])


def pair(v: float, slower: float = 0.0, gap: float = 0.0):
    """Two bodies on one pin, one straight bar at 3 rad/s; ``slower`` and ``gap`` grow with time."""

    def motion(t: np.ndarray) -> States:
        s = turning([0.1, -0.1], [3.0, 3.0], t, v)
        less = (1.0 - slower * np.minimum(t, 1.0))[:, None, None]
        along = np.array([v, 0.0, 0.0])
        open_ = gap * t[:, None, None] * np.array([[0, 0, 1.0], [0, 0, 0]])
        return States(s.r + open_, s.R, along + less * (s.v - along), less * s.Omega)

    return motion


@pytest.mark.parametrize("fault", [{}, {"slower": 0.3}, {"gap": 1e-3}], ids=["none", "spin lost", "joint open"])
def test_a_common_velocity_changes_no_verdict(fault):
    """Galileo: a pair that flies at 100 m/s breaks the laws that it breaks at rest, at the same limits."""
    t = np.linspace(0.0, 10.0, 1001)
    rest, fast = (found(PAIR, pair(v), pair(v, **fault), t) for v in (0.0, 100.0))
    assert [r.law for r in rest[0]] == [r.law for r in fast[0]] and bool(rest[0]) == bool(fault)
    for one, other in zip(rest[0], fast[0], strict=True):
        assert other.limit == pytest.approx(one.limit, rel=1e-6)
    assert dataclasses.astuple(fast[1].size)[:6] == pytest.approx(dataclasses.astuple(rest[1].size)[:6], rel=1e-6)


def test_a_companion_that_moves_far_hides_no_error():
    """A crank of 1 cm half a turn off is inaccurate, alone and beside a pendulum of 1 m that it is not joined to."""
    t = np.linspace(0.0, 10.0, 1001)
    arms, exact, off = [0.01, 1.0], [3.0, 1.0], [3.0 + np.pi / 10.0, 1.0]
    for n in (1, 2):
        system = assemble([BODY] * n, [Joint(k, (-arms[k], 0.0, 0.0)) for k in range(n)])

        def motion(rates: list[float], n: int = n):
            return lambda t: turning(arms[:n], rates[:n], t)

        reasons, _ = found(system, motion(exact), motion(off), t)
        assert Law.MOTION in {r.law for r in reasons}
        assert not found(system, motion(exact), motion(exact), t)[0]


def test_a_reference_that_ends_early_freezes_no_limit():
    """Known for a millisecond, a pendulum has the limit on |phi| and the verdict of one known to the end."""
    t = np.linspace(0.0, 10.0, 1001)

    def near(t: np.ndarray) -> States:
        s = pendulum(t)
        return States(s.r + 1e-4 * np.minimum(t, 1.0)[:, None, None], s.R, s.v, s.Omega)

    (long, m), (short, n) = (found(PENDULUM, pendulum, near, t, horizon) for horizon in (10.0, 1e-3))
    assert not long and not short
    assert n.size.limits[Law.CONSTRAINT] == pytest.approx(m.size.limits[Law.CONSTRAINT], rel=1e-3)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_row_that_is_no_number_leaves_the_scales_of_the_rows_before(bad):
    """Without a reference, half of a motion of two turns has the scales of the whole."""
    t = np.linspace(0.0, 4.0 * np.pi, 1001)
    s = pendulum(t)
    r = s.r.copy()
    r[700] = bad
    p = Problem("p", PENDULUM, s[0], t[-1], 0.01, "", "", literal_start=True)  # so that no reference is computed
    sizes = [dataclasses.astuple(judge(p, claimed(t, x)).m.size)[:6] for x in (s, States(r, s.R, s.v, s.Omega))]
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-4)


def drift_of_damped_swing(steps: int) -> float:
    """max |energy error| over the limit, of x = d0 + exp(-c t / 2 m) cos(w t), exact at ``steps`` a second."""
    k, c = 4.0 * np.pi**2, 1.0
    w = math.sqrt(k - 0.25 * c**2)
    system = assemble([BODY], springs=[SpringDamper(0, (0, 0, 0), stiffness=k, rest_length=5.0, damping=c)])
    t = np.linspace(0.0, 4.0, 4 * steps + 1)
    decay = np.exp(-0.5 * c * t)
    r, v = np.zeros((2, len(t), 1, 3))
    r[:, 0, 0] = 5.0 + decay * np.cos(w * t)
    v[:, 0, 0] = -decay * (0.5 * c * np.cos(w * t) + w * np.sin(w * t))
    s = States(r, np.broadcast_to(np.eye(3), (len(t), 1, 3, 3)), v, np.zeros_like(r))
    p = Problem("p", system, s[0], 4.0, 0.1, "", "", literal_start=True)  # so that no reference is computed
    m = judge(p, claimed(t, s)).m
    return float(np.max(np.abs(m.energy_error)) / m.size.limits[Law.ENERGY])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("steps", [3, 24, 48])
def test_the_work_of_dampers_is_as_exact_as_the_motion(steps):
    """Three steps a swing are off by 1.7 times the limit by the trapezoidal rule, and by half of it along cubics."""
    assert drift_of_damped_swing(steps) < 1e-9


def test_errors_of_a_reference_that_grow_with_time_are_judged_and_those_of_chaos_are_not():
    """Growing from 1e-10 as the square of time, all is judged; tenfold a second, to 100 times over a tenfold time."""
    t, ends = np.linspace(0.0, 10.0, 1001), []
    for own in (lambda t: 1e-10 * (1.0 + t**2), lambda t: 1e-10 * 10.0**t):
        known = Known(pendulum, 10.0, own)
        p = Problem("p", PENDULUM, pendulum(t)[0], 10.0, 0.01, "", "", reference_from=lambda _, k=known: k)
        ends.append(judge(p, claimed(t, pendulum(t))).c["judged_to_s"])
    assert ends[0] == 10.0 and ends[1] == pytest.approx(2.0 / 0.9, abs=0.02)


def test_a_small_mechanism_is_judged_by_its_computed_reference(tmp_path, monkeypatch):
    """A spherical pendulum of 0.02 mm moves 0.05 mm: a run of the wrong rate is inaccurate, as it is at a metre."""
    monkeypatch.setattr(computation.orbit, "FOLDER", tmp_path)
    for size in (1.0, 2e-5):
        body = RigidBody(1.0, np.diag([0.1, 0.2, 0.25]) * size**2)
        system = assemble([body], [Joint(0, (-size, 0.0, 0.0))], (0.0, 0.0, -9.81 * size))
        rest, at = np.zeros((1, 3)), np.array([[size, 0.0, 0.0]])
        p = Problem("p", system, State(at, np.eye(3)[None], rest, rest), 1.0, 0.01, "", "")
        t = np.linspace(0.0, 1.0, 101)
        exact = computation.find_reference(p)
        for late, laws in ((0.0, []), (0.3, [Law.MOTION])):
            judged = judge(p, claimed(t, exact.states(np.maximum(t - late, 0.0))))
            assert judged.c["judged_to_s"] == 1.0 and [r.law for r in judged.inaccuracy] == laws


def test_a_start_as_printed_has_no_reference_and_may_open_its_joints():
    """The motion that follows is not that of a consistent start; laws of the joints are not its laws."""
    literal = make_problem("spherical_pendulum", {"omega_z": 0.1, "literal_start": True})
    assert literal.reference() is None and computation.find_reference(literal) is None
    assert computation.describe_source(literal) is computation.Source.NONE
    t = np.linspace(0.0, literal.t_end, 101)
    away = t[:, None, None] * np.array([0.0, 0.0, 0.05])
    one = States.one(literal.initial)
    s = States(one.r + away, np.repeat(one.R, 101, 0), np.repeat(one.v, 101, 0), np.repeat(one.Omega, 101, 0))
    judged = judge(literal, claimed(t, s))
    assert judged.c.get("reference", "") == "" and math.isnan(judged.c.get("judged_to_s", math.nan))
    assert not {Law.CONSTRAINT, Law.CONSTRAINT_RATE, Law.MOTION} & set(judged.laws)
