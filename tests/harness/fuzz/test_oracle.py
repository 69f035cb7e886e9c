"""Faults are found and made small; sound codes are left alone."""

import importlib.util

import pytest

from mbsbench.harness.fuzz.campaign import make_oracle, run_campaign
from mbsbench.harness.fuzz.oracle import FINDINGS, Kind
from mbsbench.harness.fuzz.shrinking import shrink_outcome

from .broken import SOUND, Broken, NoProducts, OneLoop, YIsUp

SEED, TRIALS = 2, 60


@pytest.mark.parametrize("solver", [NoProducts(), YIsUp(), OneLoop()], ids=lambda s: type(s).__name__)
def test_a_broken_solver_is_found_and_shrunk_to_three_bodies(solver: Broken):
    """Each fault changes motions by far more than a step does."""
    for number in range(20):
        oracle = make_oracle(SEED, number)
        found = oracle.examine("broken", solver)
        if found.kind in FINDINGS:
            break
    else:
        pytest.fail("no finding in 20 mechanisms")
    smallest, outcome = shrink_outcome(oracle, found, lambda o: o.examine("broken", solver), TRIALS)
    assert outcome.kind == found.kind
    assert len(smallest.mechanism.bodies) <= 3
    assert smallest.confirm("broken", solver)


def test_a_sound_solver_gives_no_finding_in_50_mechanisms():
    """Its answers converge to the true motion, in every form."""
    outcomes = list(run_campaign(SEED, [(n, SOUND) for n in range(50)], 1))
    assert [o.number for o in outcomes] == list(range(50))
    assert not [o for o in outcomes if o.kind in (*FINDINGS, Kind.CRASHED)]
    assert sum(o.kind is Kind.SOUND for o in outcomes) > 40


def test_the_evidence_of_no_fault_is_empty():
    """What is sound cannot be confirmed as a deviation."""
    assert make_oracle(SEED, 1).confirm(SOUND) == ""


@pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="mujoco is an optional extra")
def test_a_refused_mechanism_is_no_finding():
    """Engines get hinges and balls only."""
    outcomes = [make_oracle(SEED, n).examine("mujoco") for n in range(30)]
    assert not [o for o in outcomes if o.kind in FINDINGS and "joints" in o.words]
    assert any(o.kind is Kind.REFUSED for o in outcomes)
