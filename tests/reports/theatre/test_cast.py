"""Who plays: every solver, what broke under each label, never more than ten, nobody silently dropped."""

import numpy as np
import pytest

from mbsbench.reports.mechanism.theatre.scene import AT_MOST, choose_players
from mbsbench.reports.model.results import StoredRun, Variant
from mbsbench.tests.factories import make_measured_record


def variant(*runs) -> Variant:
    return Variant("p", "p", tuple(StoredRun(c) for c in runs))


def names(runs) -> list[str]:
    return [c.record.run_id for c in runs]


@pytest.mark.parametrize("seed", range(4))
def test_everyone_plays_or_is_reported(seed):
    """The cast and those left out are all runs, once each; every solver with a motion is on the stage."""
    random = np.random.default_rng(seed)
    runs = [
        make_measured_record(
            f"c{k}",
            f"s{random.integers(6)}",
            str(random.choice(["success", "diverged", "wrong"])),
            label=str(random.choice(["a", "b", "c"])),
            dt_s=float(random.choice([0.1, 0.01])),
        )
        for k in range(30)
    ]
    moved = [c.run_id for c in runs if random.uniform() < 0.8]
    chosen, left = choose_players(variant(*runs), moved)
    assert sorted(names(chosen) + names(left)) == sorted(c.run_id for c in runs)
    settings = {(c.solver, c.dt_s) for c in runs if c.run_id in moved}
    assert len(chosen) == min(AT_MOST, len(settings)) and set(names(chosen)) <= set(moved)
    assert {c.record.solver for c in chosen} == {c.solver for c in runs if c.run_id in moved}


def test_the_solid_one_is_sound_and_plain():
    """Not the least drift of all: one with options of its own shows less of its solver."""
    chosen, _ = choose_players(
        variant(
            make_measured_record("odd", solver_options='{"gauge": "zero"}', energy_drift_max_J=1e-12),
            make_measured_record("plain", energy_drift_max_J=1e-3),
            make_measured_record("lost", "beta", "diverged", energy_drift_max_J=1e-15),
        ),
        ["odd", "plain", "lost"],
    )
    assert names(chosen)[0] == "plain"


def test_the_same_settings_play_once():
    """Under another label, or with more steps allowed, they move alike; another step or option does not."""
    runs = [
        make_measured_record("first", label="map"),
        make_measured_record("again", label="as printed", max_steps=7),
        make_measured_record("finer", label="map", dt_s=0.001),
        make_measured_record("odd", label="as printed", solver_options='{"gauge": "zero"}'),
    ]
    chosen, left = choose_players(variant(*runs), [c.run_id for c in runs])
    assert len(chosen) == 3 and {"finer", "odd"} < set(names(chosen))
    assert names(left) in (["first"], ["again"])


def test_every_failure_is_on_stage_before_more_successes():
    """With more solvers than places: the best, the middle, the worst, then who is wrong or stopped."""
    runs = [make_measured_record(f"s{k:02}", f"s{k:02}", energy_drift_max_J=10.0 ** (k - 20)) for k in range(15)]
    lost = [
        make_measured_record("w", "zz", "wrong"),
        make_measured_record("d", "zy", "diverged"),
        make_measured_record("i", "zx", "inaccurate"),
    ]
    chosen, _ = choose_players(variant(*runs, *lost), [c.run_id for c in (*runs, *lost)])
    assert {"w", "d", "i", "s00", "s07", "s14"} <= set(names(chosen)) and names(chosen)[0] == "s00"


def test_all_solvers_that_fail_are_on_stage():
    """However many they are, beside the best, the middle and the worst."""
    runs = [make_measured_record(f"s{k}", f"s{k}", energy_drift_max_J=10.0**k) for k in range(5)]
    lost = [make_measured_record(f"w{k:02}", f"w{k:02}", "wrong") for k in range(12)]
    chosen, _ = choose_players(variant(*runs, *lost), [c.run_id for c in (*runs, *lost)])
    assert set(names(chosen)) == {"s0", "s2", "s4", *(c.run_id for c in lost)}


def test_failures_come_before_more_of_the_same():
    """Of a solver's other label the run that stopped is shown, not the one that held."""
    runs = [make_measured_record("fine", dt_s=0.001), make_measured_record("coarse", dt_s=0.1)]
    runs += [
        make_measured_record("held", label="as printed", dt_s=0.001),
        make_measured_record("broke", "alpha", "diverged", label="as printed"),
    ]
    chosen, left = choose_players(variant(*runs), [c.run_id for c in runs], at_most=2)
    assert set(names(chosen)) == {"fine", "broke"} and set(names(left)) == {"coarse", "held"}
