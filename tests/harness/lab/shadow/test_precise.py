"""Taylor series of the tape: against theta functions, elliptic functions, 50 digits, and equations written by hand.

Data are multiples of small powers of 2, so that the tape's sums and products are exact, and constant pivots are powers
of 2: what differs is the series. A step rounds at 2^-64 or 2^-113 of the numbers in it, which are up to ``SIZE``, and
mechanisms here let an error grow less than ``GROWTH`` times.
"""

import platform
import subprocess
import sys
from fractions import Fraction

import flint
import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from mbsbench import Joint, RigidBody, assemble, make_problem
from mbsbench.harness.lab.shadow import precise, series_code
from mbsbench.harness.lab.shadow.precise import PreciseFlow, measure_difference
from mbsbench.harness.lab.shadow.rods import Rod, Rods
from mbsbench.harness.lab.shadow.series import PlaneFlow
from mbsbench.harness.lab.shadow.taylor import TaylorSeries, sum_exactly
from mbsbench.harness.mechanics.state import State
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.harness.results.npz import read_npz
from mbsbench.problems.exact.pinned_body import PinnedBody
from mbsbench.tests.comparing import assert_each
from mbsbench.tests.problems.test_proved import motion_of, sum_series

BITS = (80, 113)
ROUNDING = {80: 2.0**-64, 113: 2.0**-113}
SIZE, STEPS, GROWTH = 16.0, 100, 4.0
AXIS = np.array([0.0, 0.0, 1.0])
REST = np.zeros((1, 3))
BODIES = {
    "top": (np.array([0.25, 0.25, 0.125]), (0.0, 0.0, 0.5), (0.0, 0.0, -9.75), (1.0, 0.5, 8.0)),
    "free body": (np.array([1.0, 2.0, 2.5]), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (3.0, -2.0, 1.0)),
}


def allowed(bits: int, steps: int = STEPS) -> float:
    return SIZE * GROWTH * steps * ROUNDING[bits]


def exact(parts: np.ndarray) -> np.ndarray:
    """Sums of doubles as mpf."""
    return np.array([mpf(x.numerator) / x.denominator for x in map(sum_exactly, parts)], dtype=object)


def last(flow: PreciseFlow, *times: str) -> np.ndarray:
    """The state at the last of ``times``."""
    return list(flow.march([Fraction(t) for t in times]))[-1]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("name", BODIES)
def test_a_body_on_a_pin_is_where_theta_functions_have_it(name, bits):
    """Within their proved radius, which is that of 64 bits; and where 50 digits have it."""
    inertia, arm, gravity, Omega = BODIES[name]
    pin = -np.array(arm)
    system = assemble([RigidBody(2.0, np.diag(inertia))], [Joint(0, pin, GROUND, (0.0, 0.0, 0.0))], gravity)
    start = State(-pin[None], np.eye(3)[None], np.cross(Omega, arm)[None], np.array([Omega]))
    flow = PreciseFlow(system, start, bits)
    poses = flow.compute_poses(last(flow, "1/2"))
    body = PinnedBody.from_system(system)
    t = np.array([0.5])
    with mp.workdps(50):
        R = exact(poses[3:12])
        assert max(abs(R - sum_series(body, start, 0.5).ravel())) < allowed(bits)
        motion = motion_of(body, start).motion
        attitude = motion.attitude(t)[0][0].ravel()
        proved = [mpf(float(x)) + mpf(float(x - np.longdouble(float(x)))) for x in attitude]
        assert mp.norm(R - proved) < motion.error(t)[0] + 3.0 * allowed(bits)


@pytest.mark.parametrize("bits", BITS)
def test_a_pendulum_is_an_elliptic_function(bits):
    """Released a right angle from hanging: sin(phi/2) = sin(pi/4) sn(K - w t), w^2 = m g s / (I + m s^2)."""
    body = RigidBody(2.0, np.diag([0.5, 0.5, 0.5]))
    hinge = Joint(0, (-0.5, 0.0, 0.0), GROUND, (0.0, 0.0, 0.0), AXIS, AXIS)
    start = State(np.array([[0.5, 0.0, 0.0]]), np.eye(3)[None], REST, REST)
    flow = PreciseFlow(assemble([body], [hinge], (0.0, -9.75, 0.0)), start, bits)
    with mp.workdps(50):
        r = exact(flow.compute_poses(last(flow, "1.75"))[:2])
        k = mp.sin(mp.pi / 4)
        half = k * mpmath.ellipfun("sn", mpmath.ellipk(k**2) - mp.sqrt(mpf("9.75")) * mpf("1.75"), m=k**2)
        phi = 2 * mp.asin(half)
        assert max(abs(r - [mp.sin(phi) / 2, -mp.cos(phi) / 2])) < allowed(bits)


def hanging(end: bool = True) -> tuple:
    """Five rods of 1 m, two down, one across, two up; the last end is fixed; and the same for ``Rods``."""
    angles, w, g = np.array([-1, -1, 0, 1, 1]), 2.0, 9.75
    along = np.stack((angles == 0, angles, 0 * angles), axis=1).astype(float)
    across = np.cross(AXIS, along)
    rates = w * np.abs(angles)
    R = np.stack((along, across, np.tile(AXIS, (5, 1))), axis=-1)
    ends, speeds = np.cumsum(along, axis=0), np.cumsum(rates[:, None] * across, axis=0)
    Omega = rates[:, None] * AXIS
    start = State(ends - 0.5 * along, R, speeds - 0.5 * rates[:, None] * across, Omega)
    low, high = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)
    joints = [Joint(k, low, k - 1 if k else GROUND, high if k else (0.0,) * 3, AXIS, AXIS) for k in range(5)]
    joints += [Joint(4, high, GROUND, (1.0, 0.0, 0.0), AXIS, AXIS)] * end
    rod = Rod(Fraction(1), Fraction(1), Fraction(1, 2), Fraction(1, 4))
    system = assemble([RigidBody(1.0, 0.25 * np.eye(3)) for _ in range(5)], joints, (0.0, -g, 0.0))
    return system, start, (Rods((rod,) * 5, Fraction(g), end=Fraction(1)), angles, rates)


def test_a_chain_moves_as_equations_written_by_hand_have_it():
    """Directors in 200 bits share nothing with the tape; errors grow by 1e3 in this second."""
    system, start, (rods, angles, rates) = hanging()
    t = Fraction(1)
    with flint.ctx.workprec(264):
        q = [int(a) * flint.arb.pi() / 2 for a in angles]
        state = rods.state(q, [flint.arb(float(w)) for w in rates], 0, 200)
    other = PlaneFlow(rods.make_mechanism(), "directors", 200)
    reached = next(p for p, asked in other.march(state, 1 << 200, (1 << 200,)) if asked)
    for bits in BITS:
        flow = PreciseFlow(system, start, bits)
        with mp.workdps(60):
            r = exact(flow.compute_poses(last(flow, str(t)))[:15]).reshape(5, 3)
            expected = np.array([[mpf(x) / 2**200 for x in body[:2]] for body in reached.X])
            apart = np.max(np.abs(r[:, :2] - expected))
        assert apart < 1e3 * allowed(bits)


@pytest.mark.parametrize("bits", BITS)
def test_energy_stays_and_the_way_back_ends_at_the_start(bits):
    """T + V by numbers of 50 digits, over a second and back; errors grow by 1e3 and 1e6."""
    system, start, _ = hanging()
    flow = PreciseFlow(system, start, bits)
    begin = flow.start
    end = last(flow, "1/2", "1")

    def energy(x: np.ndarray):
        p = exact(flow.compute_poses(x))
        r, V = p[:15].reshape(5, 3), p[60:].reshape(5, 6)
        return sum(sum(V[:, :3] ** 2, mpf(0)) + sum(V[:, 3:] ** 2, mpf(0)) / 4) / 2 + mpf("9.75") * sum(r[:, 1])

    with mp.workdps(50):
        assert abs(energy(end) - energy(begin)) < 1e3 * allowed(bits)
    flow.start = end
    assert measure_difference(last(flow, "0"), begin) < 1e6 * allowed(bits)
    assert measure_difference(begin, end) > 0.1


def test_the_error_follows_the_tolerance():
    """In proportion, within a power of ten for each of three steps of 1e-6: the order follows the tolerance."""
    system, start, _ = hanging()
    best = last(PreciseFlow(system, start, 113), "1/4")
    errors = [
        measure_difference(last(PreciseFlow(system, start, 113, tol), "1/4"), best) for tol in (1e-12, 1e-18, 1e-24)
    ]
    ratios = np.diff(np.log10(errors))
    assert_each(np.abs(ratios + 6.0), "<", 1.0, errors)


def test_functions_of_the_tape_have_their_series():
    """y_dot = f(y) of each, over a short step, in 113 bits and as mpmath integrates it."""
    import casadi as ca

    from mbsbench.harness.base.generated.functions import GeneratedFunction

    y = ca.SX.sym("y", 2)
    f = ca.sin(y[0]) + ca.exp(-y[1]) * ca.log(2 + y[0]) + ca.sqrt(1 + y[1] ** 2) - ca.atan2(y[0], 2 + y[1])
    s = TaylorSeries(
        GeneratedFunction([y], [ca.vertcat(f, ca.atan(y[0]) - ca.cos(y[1]) / (3 + y[0]))]), 113, 24, rates=True
    )
    parts = np.zeros((2, 3))
    parts[:, 0] = 0.5, -0.25
    s.expand(parts)
    with mp.workdps(40):

        def rate(t, y):
            a, b = y
            g = mp.sin(a) + mp.exp(-b) * mp.log(2 + a) + mp.sqrt(1 + b**2) - mp.atan2(a, 2 + b)
            return [g, mp.atan(a) - mp.cos(b) / (3 + a)]

        expected = mp.odefun(rate, 0, [mpf("0.5"), mpf("-0.25")])(mpf(1) / 64)
        assert max(abs(exact(s.sum_series(Fraction(1, 64))) - expected)) < 1e-32


def test_the_command_writes_what_the_referee_reads(tmp_path):
    """A file of the top, its error beside, within the proved radius and rounding of its reference."""
    file = tmp_path / "top.npz"
    command = [sys.executable, "-m", "mbsbench.harness.lab.shadow.precise", "heavy_top", "1/2", "--rows", "11"]
    done = subprocess.run([*command, "--out", str(file)], capture_output=True, text=True, check=True)
    assert "error" in done.stdout
    found = read_npz(file, 1 << 20)
    reference = make_problem("heavy_top").reference()
    apart = np.max(np.abs(found["r"] - reference.states(found["t"]).r))
    assert apart < 1e-15 and found["error"][-1] < 1e-15
    wrong = subprocess.run(
        [*command[:-2], "--out", str(file), "--bits", "64"], check=False, capture_output=True, text=True
    )
    assert wrong.returncode == 2 and "Traceback" not in wrong.stderr


def test_other_processors_and_functions_are_refused_in_one_line(monkeypatch):
    """80 bits are x86's own."""
    import casadi as ca

    from mbsbench.harness.base.generated.functions import GeneratedFunction

    y = ca.SX.sym("y")
    with pytest.raises(ValueError, match="without Taylor series"):
        TaylorSeries(GeneratedFunction([y], [ca.fabs(y)]), 80, 8, rates=True)
    monkeypatch.setattr(platform, "machine", lambda: "aarch64")
    series_code.compile_machine.cache_clear()
    with pytest.raises(ValueError, match="needs an x86-64"):
        TaylorSeries(GeneratedFunction([y], [y]), 80, 8, rates=True)
    assert precise.TOLERANCE.keys() == series_code.TYPES.keys()
