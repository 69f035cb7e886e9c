"""Motions in multiple precision: against elliptic functions, each other, their laws, and the references in doubles."""

import dataclasses
from fractions import Fraction

import flint
import mpmath
import numpy as np
import pytest

from mbsbench.harness.catalogue import registry
from mbsbench.harness.lab.shadow import long_motion
from mbsbench.harness.lab.shadow.long_motion import (
    FIRST,
    SECOND,
    Integration,
    load_long_motion,
    measure_difference,
    to_fixed_point,
)
from mbsbench.harness.lab.shadow.rods import RECIPES, Rod, Rods
from mbsbench.harness.lab.shadow.series import FORMULATIONS, GUARD, PlaneFlow
from mbsbench.harness.mechanics.motion import energy
from mbsbench.tests.comparing import assert_close, assert_each

BITS = 200
STORED = sorted(p.stem for p in long_motion.STORED.glob("*.json"))


def march(flow: PlaneFlow, state, t: Fraction):
    """The state at ``t`` [s]."""
    at = to_fixed_point(t, flow.bits)
    return next(p for p, asked in flow.march(state, at, (at,)) if asked)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_pendulum_is_an_elliptic_function_to_fifty_digits(formulation):
    """Released from rest a rad from hanging: sin(phi/2) = sin(a/2) sn(K - w t), w^2 = m g s / (I + m s^2)."""
    rod = Rod(Fraction(2), Fraction(1), Fraction(1, 3), Fraction(1, 7))
    rods = Rods((rod,), Fraction("9.81"))
    t, a = Fraction("0.7"), 2
    with flint.ctx.workprec(BITS + 64):
        start = rods.state([a - flint.arb.pi() / 2], [flint.arb(0)], 0, BITS)
    reached = march(PlaneFlow(rods.make_mechanism(), formulation, BITS), start, t)
    with mpmath.workdps(70):
        k = mpmath.sin(mpmath.mpf(a) / 2)
        w = mpmath.sqrt(2 * mpmath.mpf("9.81") / 3 / (mpmath.mpf(1) / 7 + mpmath.mpf(2) / 9))
        s = k * mpmath.ellipfun("sn", mpmath.ellipk(k**2) - w * mpmath.mpf("0.7"), m=k**2)
        sin_phi, cos_phi = 2 * s * mpmath.sqrt(1 - s**2), 1 - 2 * s**2
        found = [mpmath.mpf(x) / 2**BITS for x in reached.X[0]]
        expected = (sin_phi / 3, -cos_phi / 3, sin_phi, -cos_phi)
        assert max(abs(x - y) for x, y in zip(found, expected, strict=True)) < mpmath.mpf(10) ** -50


@pytest.mark.parametrize("apart", [1, 2, 4, 8])
def test_steps_see_coefficients_between_those_that_vanish(apart):
    """1 / (1 - (t/R)^apart): its last coefficients may be zero, its radius R stays, and so does the step."""
    mechanism = Rods(
        (Rod(Fraction(2), Fraction(1), Fraction(1, 3), Fraction(1, 7)),), Fraction("9.81")
    ).make_mechanism()
    flow = PlaneFlow(mechanism, "angles", BITS)
    flow.order = 8 * (flow.order // 8) + 7  # the last seven are zero if apart is 8
    flow.unit = 1 << BITS
    series = [(1 << BITS) >> k if k % apart == 0 else 0 for k in range(flow.order + 1)]  # R = 2 s
    expected = 2.0 * 2.0 ** ((GUARD - BITS) / flow.order)
    assert flow._choose_step([[series]]) / 2.0**BITS == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("name", RECIPES)
def test_exact_starts_are_those_of_the_problems(name):
    """To the rounding of doubles, in poses and velocities."""
    recipe, problem = RECIPES[name](), registry.make_problem(name, {})
    run = Integration(recipe, *FIRST)
    X, V = (np.array([a], dtype=float) / 2.0**run.flow.bits for a in (run.now.X, run.now.V))
    start = recipe.bodies(X, V)
    for part in ("r", "R", "v", "Omega"):
        assert_close(getattr(start, part)[0], getattr(problem.initial, part), rtol=0.0, atol=1e-14, what=part)


@pytest.mark.parametrize("name", RECIPES)
def test_both_formulations_agree_and_keep_energy_and_joints(name):
    """To fifty digits, after 0.05 s."""
    recipe, runs = RECIPES[name](), []
    for setting in (FIRST, SECOND):
        run = Integration(recipe, *setting)
        start = run.now
        runs.append((start, march(run.flow, start, Fraction(1, 20)), run.flow.bits))
    assert measure_difference(*(r[1:] for r in runs)) < 1e-55
    m = recipe.rods.make_mechanism()
    for start, end, bits in runs:
        assert abs(energy_of(m, end, bits) - energy_of(m, start, bits)) < mpmath.mpf(10) ** -50
        for row in m.rows:
            before, after = (sum(a * p.X[b][k] for b, r in row.items() for k, a in enumerate(r)) for p in (start, end))
            assert abs(after - before) < 2 ** (bits - 170)


def energy_of(m, p, bits):
    """[J]"""
    with mpmath.workdps(90):
        unit, E = mpmath.mpf(2) ** -bits, mpmath.mpf(0)
        g = mpmath.mpf(m.gravity.numerator) / m.gravity.denominator
        for mass, inertia, X, V in zip(m.mass, m.inertia, p.X, p.V, strict=True):
            M, I = (mpmath.mpf(a.numerator) / a.denominator for a in (mass, inertia))
            v = [x * unit for x in V]
            E += M * ((v[0] ** 2 + v[1] ** 2) / 2 + g * X[1] * unit) + I * (v[2] ** 2 + v[3] ** 2) / 2
        return E


@pytest.mark.parametrize("name", STORED)
def test_stored_motion_is_that_of_the_reference_in_doubles(name):
    """As far as the latter is known, to its own error: on the chain to 5.3 s."""
    motion, problem = load_long_motion(name), registry.make_problem(name, {})
    reference = problem.reference() or long_motion_reference(problem)
    t = np.array([float(a) for a in motion.t if a <= reference.horizon])
    apart = np.max(np.linalg.norm(motion.states(t).r - reference.states(t).r, axis=2), axis=1)
    assert_each(apart, "<=", reference.error(t) + np.array(motion.difference[: len(t)]) + 1e-13)
    E = energy(problem.system, motion.states(np.array([float(a) for a in motion.t])))
    assert_close(E, E[0], rtol=0.0, atol=1e-11)


def long_motion_reference(problem):
    from mbsbench.harness.reference.computation import find_reference

    return find_reference(problem)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", STORED)
def test_a_stored_state_leads_to_the_next(name):
    """By the second run's formulation, to thirty digits."""
    motion, bits = load_long_motion(name), 144
    k = len(motion.t) // 2
    flow = PlaneFlow(motion.recipe.rods.make_mechanism(), SECOND[0], bits)
    reached = march(flow, motion.state(k - 1, bits), motion.t[k])
    assert measure_difference((reached, bits), (motion.state(k, bits), bits)) < 1e-30


@pytest.mark.slow
@pytest.mark.parametrize("name", STORED)
def test_motion_between_stored_states_is_continuous(name):
    """Just before each stored time the motion marched from the one before is where the stored one is."""
    motion = load_long_motion(name)
    at = np.array([float(a) for a in motion.t[1:]])
    early = motion.states(at - 1e-9)
    there = motion.states(at)
    assert np.max(np.abs(early.r + 1e-9 * there.v - there.r)) < 1e-12


def test_damage_and_times_beyond_the_end_are_refused(tmp_path, monkeypatch):
    """In one line each."""
    motion = load_long_motion(STORED[0])
    with pytest.raises(ValueError, match="times must increase"):
        motion.states(np.array([motion.horizon + 1.0]))
    text = (long_motion.STORED / f"{STORED[0]}.json").read_text()
    (tmp_path / f"{STORED[0]}.json").write_text(text.replace(motion.q[1][0], motion.q[1][0][:-1]))
    monkeypatch.setattr(long_motion, "STORED", tmp_path)
    with pytest.raises(ValueError, match="damaged"):
        load_long_motion(STORED[0])
    assert dataclasses.replace(motion, problem="other").compute_digest() != motion.compute_digest()
