"""The exam's own motions have second routes: closed forms, a chain of frames, one angle or two coordinates by hand."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from mbsbench.harness.catalogue import registry
from mbsbench.tests.exam.__main__ import PLUGINS
from mbsbench.tests.exam.building import DECLARED, meet, turn
from mbsbench.tests.exam.motion import Truth, energy, integrate
from mbsbench.tests.exam.open_mechanisms import bennett_frames

pytestmark = pytest.mark.slow  # `make exam` stands on them


@pytest.fixture(scope="module", autouse=True)
def plugins():
    for plugin in PLUGINS:
        registry.load_plugin(plugin)


def truth(name, t_end=None) -> Truth:
    registry.make_problem(name)
    return integrate(dataclasses.replace(DECLARED[name], t_end=t_end or DECLARED[name].t_end))


def test_the_rack_is_a_harmonic():
    """(M + J / r^2) x'' = -k x."""
    found, w = truth("exam_rack", 1.0), np.sqrt(300.0 / (2.0 + 4e-4 / 0.02**2))
    t = np.linspace(0.0, 1.0, 50)
    r, R, v, _ = found.bodies(t)
    x = 0.3 * np.cos(w * t)
    assert np.max(np.abs(r[:, 1, 0] - x)) < 1e-10 and np.max(np.abs(v[:, 1, 0] + 0.3 * w * np.sin(w * t))) < 1e-9
    assert np.max(np.abs(R[:, 0] - [turn((0, 0, 1), -a) for a in x / 0.02])) < 1e-8
    # teeth pull the rack: what its spring leaves of M x''
    assert found.loads(t)[:, 1, 0] == pytest.approx((300.0 - 2.0 * w**2) * x, abs=1e-7)


def test_the_gyroscope_has_two_coordinates():
    """In the turntable: springs, Coriolis and centrifugal forces, and the push."""
    W, m1, m2, k1, k2 = 100.0, 1e-9, 2e-9, 1.2, 0.8

    def rate(t, y):
        x, z, dx, dz = y
        ax = (2 * m2 * W * dz + (m1 + m2) * W**2 * x - k1 * x + 1e-6 * np.sin(2e4 * t)) / (m1 + m2)
        return dx, dz, ax, -2 * W * dx + W**2 * z - k2 * z / m2

    found, t = truth("exam_gyroscope", 1e-3), np.linspace(0.0, 1e-3, 30)
    by_hand = solve_ivp(rate, (0.0, 1e-3), (2e-6, 0, 0, 0), method="DOP853", rtol=1e-12, atol=1e-18, t_eval=t).y
    r, R, _, _ = found.bodies(t)
    in_table = np.einsum("tji,tj->ti", R[:, 0], r[:, 2])
    assert np.max(np.abs(in_table[:, 0] - by_hand[0])) < 1e-13 and np.max(np.abs(in_table[:, 1] - by_hand[1])) < 1e-13


def test_bennetts_linkage_is_a_chain_of_frames_that_keeps_its_energy():
    """One angle decides all poses, and the energy its rate: all of the motion."""
    found, t = truth("exam_bennett"), np.linspace(0.0, 3.0, 80)
    s = found.bodies(t)
    angle = np.arctan2(s[1][:, 0, 1, 0], s[1][:, 0, 0, 0])
    frames = [bennett_frames(a)[:3] for a in angle]
    assert found.equations.rank == 17 and np.ptp(angle) > 6.0
    assert np.max(np.abs(s[1] - [[f[:3, :3] for f in row] for row in frames])) < 1e-9
    T, V = energy(found.equations.d, np.zeros((len(t), 0)), s)
    assert np.ptp(T + V) < 1e-9 * np.max(T)


def test_the_driven_linkage_is_where_its_drive_puts_it():
    """The crank's angle by its law, the coupler and the rocker by two circles."""
    found, t = truth("exam_driven_four_bar", 2.0), np.linspace(0.0, 2.0, 40)
    r, _, _, _ = found.bodies(t)
    frame = turn((1.0, -2.0, 0.7), 0.9)
    for k, a in enumerate(0.7 + 3.0 * t + 0.4 * np.sin(5.0 * t)):
        knee = 0.4 * np.array([np.cos(a), np.sin(a)])
        end = meet(knee, (1.2, 0.0), 1.3, 0.9)
        flat = (0.5 * knee, 0.5 * (knee + end), 0.5 * (end + np.array([1.2, 0.0])))
        assert np.max(np.abs(r[k] - [frame @ (*p, 0.0) for p in flat])) < 1e-9


@pytest.mark.parametrize(("name", "rank"), [("exam_sarrus", 29), ("exam_watt", 29), ("exam_spherical_four_bar", 17)])
def test_power_is_the_rate_of_energy(name, rank):
    """What dampers take is what T + V loses; rows hold, at the rank of the start."""
    found = truth(name, 0.5)
    d, t = found.equations.d, np.linspace(0.0, 0.5, 2001)
    s = found.bodies(t)
    T, V = energy(d, found.values(t)[:, 13 * found.equations.n :], s)
    lost = np.zeros(len(t))
    for x in d.torsions:
        lost += x.damping * s[3][:, x.i, 2] ** 2  # the crank turns about OZ
    for x in d.springs:
        at, speed = s[0][:, x.i] + s[1][:, x.i] @ np.array(x.p_i), s[2][:, x.i]
        speed = speed + np.cross(s[3][:, x.i], at - s[0][:, x.i])
        way = (at - np.array(x.p_j)) / np.linalg.norm(at - np.array(x.p_j), axis=1)[:, None]
        lost += x.damping * np.sum(way * speed, axis=1) ** 2
    work = np.concatenate(([0.0], np.cumsum(0.5 * (lost[1:] + lost[:-1]) * np.diff(t))))
    assert np.max(np.abs(T + V + work - (T + V)[0])) < 1e-6 * np.max(T)
    assert found.equations.rank == rank
    phi = [found.equations.rows(a, *(x[k] for x in s))[0] for k, a in enumerate(t)]
    assert np.max(np.abs(phi)) < 1e-9


def test_a_rotor_in_gimbals_keeps_its_angular_momentum_about_the_hinge_along_gravity():
    """Neither the hinge along OZ nor weight has a moment about it: gyroscopic moments have their sign."""
    found, t = truth("exam_gimbal_rotor", 0.04), np.linspace(0.0, 0.04, 60)
    r, R, v, w = found.bodies(t)
    spin = np.einsum("tbij,bjk,tblk,tbl->tbi", R, found.equations.J, R, w)
    L = np.sum(spin + found.equations.mass[:, None] * np.cross(r, v), axis=1)[:, 2]
    swing = np.max(np.abs(np.einsum("tij,j->ti", R[:, 2], (0.0, 9.0, 0.0))[:, 2]))  # of the rotor, 9 kg m2/s
    assert swing > 1e-3 and np.max(np.abs(L - L[0])) < 1e-9
