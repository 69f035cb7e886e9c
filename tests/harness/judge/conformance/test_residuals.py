"""Residuals that stay as steps are halved are found; those that fall, and those that a tolerance leaves, are not."""

import dataclasses
import math

import numpy as np
import pytest

from mbsbench.harness.judge.conformance.ladders import check_residuals
from mbsbench.harness.judge.conformance.trials import Evidence
from mbsbench.harness.judge.order import ITERATED
from mbsbench.harness.mechanics.types import ALLOWED, Law
from mbsbench.tests.comparing import assert_close
from mbsbench.tests.factories import make_record, make_series

STEPS = (0.04, 0.02, 0.01, 0.005)
STAYS = 1e-4  # of the motion's size


def evidence(phi, order=2.0, steps=STEPS, skip=1):
    """A ladder of fixed steps whose |phi| is ``phi(t, dt)`` of the motion's size; every ``skip``-th row is kept."""
    records, series = {}, {}
    for k, dt in enumerate(steps):
        t = np.linspace(0.0, 1.0, round(1.0 / dt) + 1)[::skip]
        size = phi(t, dt)
        none = np.zeros_like(t)
        top = float(np.max(size)) / ALLOWED[Law.CONSTRAINT]
        shares = {"gap_share_max": top, "gap_rate_share_max": 0.0, "dt_s": dt, "rtol": dt**2, "claimed": "success"}
        records[f"finer {k}"] = make_record(status="success", **shares)
        series[f"finer {k}"] = make_series(t, phi_norm=0.3 * size, phi_dot_norm=none, orthogonality=none)
    return Evidence("dt", order, records, series)


def truncation(order):
    """The residual of a scheme: dt^order with a next term, as the largest of the ladder is 1 % of the motion's size."""
    return lambda t, dt: np.abs((25.0 * dt) ** order * 0.01 * (np.sin(5.0 * t) + 5.0 * dt * t))


def test_what_stays_is_measured_below_a_larger_part_that_falls():
    """A drift in proportion to time, at the finest step a half of what the scheme leaves."""

    def sinking(t, dt):
        return truncation(2.0)(t, dt) + STAYS * t

    found = check_residuals(evidence(sinking))
    assert not found.holds and found.is_tested
    assert_close(found.value, STAYS, rtol=0.1)


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
@pytest.mark.parametrize("declared", [0, 1, math.nan])
def test_what_falls_with_the_step_is_met(order, declared):
    """With the declared order, a higher one, or none declared."""
    found = check_residuals(evidence(truncation(order), order - declared if order > declared else order))
    assert found.holds and found.is_tested, found


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_a_joint_that_is_off_at_once_and_stays_so_is_found(order):
    """Constant from the first step on: no tolerance leaves that."""
    assert not check_residuals(evidence(lambda t, dt: np.where(t > 0.0, STAYS, 0.0), order)).holds


@pytest.mark.parametrize("seed", range(20))
def test_what_a_tolerance_leaves_is_no_finding(seed):
    """Newton's iterations end anywhere below it: residuals over three decades, at any step, largest at any time."""
    random = np.random.default_rng(seed)
    found = check_residuals(evidence(lambda t, dt: STAYS * 10.0 ** -random.uniform(0.0, 3.0, len(t))))
    assert found.holds and (found.is_tested or "as a tolerance leaves it" in found.words)


@pytest.mark.parametrize(("stays", "holds"), [(0.5 * ITERATED, True), (2.0 * ITERATED, False)])
def test_what_is_as_small_as_iterations_leave_it_may_stay(stays, holds):
    """1e-8 of the motion's size."""
    assert check_residuals(evidence(lambda t, dt: stays * t)).holds == holds


def test_with_rtol_the_residual_itself_must_fall():
    """From 1.6e-3 to 2.5e-5, as steps would be 4 times as small: 8 times, and not from 1.1e-3 to 1e-3."""
    falling, staying = evidence(lambda t, dt: dt**2 * t), evidence(lambda t, dt: (1e-3 + 0.1 * dt**2) * t)
    for one, holds in ((falling, True), (staying, False)):
        assert check_residuals(dataclasses.replace(one, control="rtol")).holds == holds


def test_two_steps_are_too_few():
    """The part that falls cannot be told from the part that stays."""
    found = check_residuals(evidence(lambda t, dt: STAYS * t, steps=STEPS[:2]))
    assert found.holds and not found.is_tested


def test_only_times_of_all_steps_are_compared():
    """Every seventh row of each ladder: those of 0.02 s and 0.01 s agree at every 0.14 s."""
    assert not check_residuals(evidence(lambda t, dt: truncation(2.0)(t, dt) + STAYS * t, skip=7)).holds
