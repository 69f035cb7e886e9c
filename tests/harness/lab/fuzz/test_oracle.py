"""Faults are found and made small; sound codes are left alone."""

import importlib.util
from dataclasses import replace

import pytest

from mbsbench import JointKind
from mbsbench.harness.lab.fuzz.campaign import CampaignSettings, run_campaign
from mbsbench.harness.lab.fuzz.mechanism import RandomBody, RandomJoint, RandomMechanism
from mbsbench.harness.lab.fuzz.oracle import FINDINGS, Behaviour, Oracle, OracleVerdict
from mbsbench.harness.lab.fuzz.presenting import Form
from mbsbench.harness.lab.fuzz.shrinking import shrink_outcome
from mbsbench.harness.mechanics.consistency import InconsistentStart
from mbsbench.harness.mechanics.system import GROUND
from mbsbench.tests.comparing import assert_close

from .broken import SOUND, Broken, Falls, NoProducts, OneLoop, YIsUp

SEED, STEPS, TRIALS = 4, 20, 60
WITH_DISTANCE = 102
AT_REST = 60  # of seed 1


def make_short_oracle(number: int) -> Oracle:
    """Mechanism ``number`` for a fifth of its time."""
    oracle = CampaignSettings(SEED).make_oracle(number)
    return replace(oracle, mechanism=replace(oracle.mechanism, steps=STEPS))


@pytest.mark.sampled(1)
@pytest.mark.parametrize("solver", [NoProducts(), YIsUp(), OneLoop()], ids=lambda s: type(s).__name__)
def test_a_broken_solver_is_found_and_shrunk_to_three_bodies(solver: Broken):
    """Each fault changes motions by far more than a step does."""
    for number in range(10):
        oracle = make_short_oracle(number)
        found = oracle.examine("broken", solver)
        if found.kind in FINDINGS:
            break
    else:
        pytest.fail("no finding in 10 mechanisms")
    smallest, outcome = shrink_outcome(oracle, found, lambda o: o.examine("broken", solver), TRIALS)
    assert outcome.kind == found.kind
    assert len(smallest.mechanism.bodies) <= 3
    assert smallest.decide("broken", solver)[0] is OracleVerdict.CONFIRMED


def test_a_sound_solver_gives_no_finding_in_10_mechanisms():
    """Its answers converge to the true motion, in every form."""
    outcomes = [make_short_oracle(n).examine(SOUND) for n in range(10)]
    assert not [o for o in outcomes if o.kind in FINDINGS]
    assert sum(o.kind is Behaviour.SOUND for o in outcomes) > 8


@pytest.mark.slow
def test_a_sound_solver_gives_no_finding_in_a_campaign():
    """50 mechanisms, for all of their time, in a process apart."""
    outcomes = list(run_campaign(CampaignSettings(SEED), [(n, SOUND) for n in range(50)], 1))
    assert [o.number for o in outcomes] == list(range(50))
    assert not [o for o in outcomes if o.kind in (*FINDINGS, Behaviour.CRASHED)]
    assert sum(o.kind is Behaviour.SOUND for o in outcomes) > 40


def test_what_is_sound_is_dismissed():
    """What is sound cannot be confirmed as a deviation."""
    assert make_short_oracle(1).decide(SOUND)[0] is OracleVerdict.DISMISSED


@pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="mujoco is an optional extra")
def test_a_refused_mechanism_is_no_finding():
    """MuJoCo has no joint that keeps a distance."""
    oracle = make_short_oracle(WITH_DISTANCE)
    assert JointKind.DISTANCE in [c.kind for c in oracle.mechanism.connections]
    assert oracle.examine("mujoco").kind is Behaviour.REFUSED


def test_a_deviation_from_rest_is_confirmed():
    """The reference of a mechanism that nothing moves is its start; a code that lets it fall is off it."""
    oracle = CampaignSettings(1, form=Form()).make_oracle(AT_REST)
    assert oracle.decide(SOUND)[0] is OracleVerdict.DISMISSED
    verdict, evidence = oracle.decide("broken", Falls())
    assert verdict is OracleVerdict.CONFIRMED and "at rest and without accelerations, nothing moves" in evidence


def make_flat_parallelogram(first: float, second: float) -> RandomMechanism:
    """Cranks of 1 m along X on feet 2 m apart, with their rates [rad/s], and the coupler."""
    ball = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
    of_bodies = (
        (0.5, 0.5 * first, first),
        (2.5, 0.5 * second, second),
        (2.0, 0.5 * (first + second), 0.5 * (second - first)),
    )
    bodies = tuple(
        RandomBody(1.0, ball, (x, 0.0, 0.0), velocity=(0.0, speed, 0.0), spin=(0.0, 0.0, rate))
        for x, speed, rate in of_bodies
    )
    hinges = [(0, GROUND, 0.0), (2, 0, 1.0), (1, GROUND, 2.0), (2, 1, 3.0)]
    return RandomMechanism(bodies, tuple(RandomJoint(JointKind.REVOLUTE, i, j, (x, 0.0, 0.0)) for i, j, x in hinges))


@pytest.mark.parametrize(
    ("first", "second", "moves"), [(1, 1, True), (1, -3, True), (1, 0, False), (1, -2.9, False), (0, 1, False)]
)
def test_velocities_of_no_motion_are_not_drawn(first: float, second: float, moves: bool):
    """Flat, the coupler's length L and the cranks' a ask for (w2 - w1)(a (w2 - w1) - L (w2 + w1)) = 0."""
    mechanism = make_flat_parallelogram(first, second)
    if moves:
        assert_close(mechanism.problem().initial.Omega[:2, 2], (first, second))
        return
    with pytest.raises(InconsistentStart, match="no motion has the velocities of the start"):
        mechanism.problem()
