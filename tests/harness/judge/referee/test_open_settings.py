"""Settings that settle nothing are left out and named: ended by a machine, only slow, never begun, or cut short."""

import numpy as np
import pytest

from mbsbench.harness.results.judgements.claims import ClaimGap, Ending, ExcludedSettings
from mbsbench.reports.model.claim_words import explain_verdicts
from mbsbench.tests.factories import make_record, make_series

from .claiming import RUNS, claim

CUT = {"status": "stalled", "t_reached_s": 3.0, "steps": 9, "max_steps": 9, "max_step_s": 0.5}  # of 10 s


def one_of(columns, others=None):
    """The first run with these columns, the others with |phi| = 0.5 m."""
    return [make_record(x, **(columns if k == 0 else others or {"phi_max": 0.5})) for k, x in enumerate(RUNS)]


def pace(last):
    """Nine steps to 3 s, the last of ``last`` s: the others take what is left."""
    return lambda r: make_series(np.append(np.linspace(0.0, 3.0 - last, 9), 3.0)) if r.t_reached_s == 3.0 else None


def test_runs_ended_by_a_clock_are_left_out_and_named():
    """They would decide it, and another machine might let them go on: by a clock, out of memory, killed."""
    for columns in (CUT | {"steps": 8}, CUT | {"status": "memory"}):
        c = claim(records=one_of(columns))
        assert c.verdict == "reproduced" and "holds for all 11 tried" in explain_verdicts(c) and c.map[0].holds is None
        assert c.beyond.left_out == (ExcludedSettings(Ending.MACHINE, 1),)
    killed = {"status": "crashed", "message": "the solver was done, but measuring its motion took more than 120 s"}
    assert claim(records=one_of(killed | {"t_reached_s": float("nan")})).verdict == "reproduced"


def test_a_budget_of_steps_ends_stuck_runs_and_interrupts_slow_ones():
    """Nine steps to 3 of 10 s, of 0.5 s at most: at last 0.01 s a step is slow, 1e-3 s less than a hundredth, stuck."""
    slow, stuck = (claim(records=one_of(CUT), of=pace(last)) for last in (0.01, 1e-3))
    assert (
        slow.verdict == "reproduced"
        and slow.beyond.left_out == (ExcludedSettings(Ending.SLOW, 1),)
        and slow.map[0].holds is None
    )
    assert stuck.beyond.left_out == (ExcludedSettings(Ending.EARLY, 1),)  # final, and short of the end all the same
    at = 'map = "m"\ntests = [{ metric = "stops at", at_least = 9, unit = "s" }]\n'
    slow, stuck = (claim(at, records=one_of(CUT), of=pace(last)) for last in (0.01, 1e-3))
    assert slow.map[0].holds is None and stuck.map[0].holds is False


def first_holds(test, x=0.5, leaves=9.0):
    """Whether the first run, slow and interrupted at 3 s, holds; ``x`` is its |phi|, and y leaves 0 at ``leaves``."""

    def of(r):
        t = np.append(np.linspace(0.0, 2.99, 200), 3.0) if r.t_reached_s == 3.0 else np.linspace(0.0, 10.0, 200)
        return make_series(t, phi_norm=np.full(len(t), x), y=(t > leaves).astype(float))

    return claim(f'map = "m"\ntests = [{{ {test} }}]\n', one_of(CUT), of).map[0].holds


@pytest.mark.parametrize(
    ("asked", "phi", "holds"),
    [
        ("to = 2.0, at_most = 1.0", 0.5, True),
        ("to = 4.0, at_most = 1.0", 0.5, None),
        ("partial = true, at_most = 1.0", 0.5, None),
        ("partial = true, at_most = 1.0", 1.5, False),
        ("partial = true, at_least = 1.0", 1.5, True),
        ("partial = true, at_least = 1.0", 0.5, None),
    ],
)
def test_what_a_slow_run_had_settled_counts(asked, phi, holds):
    """Over 2 s it got through, nothing is open; |phi| beyond its band so far is beyond it, within it is not yet."""
    assert first_holds(f'metric = "largest", series = "phi_norm", {asked}, unit = "m"', phi) is holds


@pytest.mark.parametrize(
    ("leaves", "band", "holds"),
    [
        (9.0, "at_least = 1, at_most = 2", False),
        (9.0, "at_least = 5, at_most = 6", None),
        (1.5, "at_least = 1, at_most = 2", True),
    ],
)
def test_a_slow_run_passes_a_limit_and_stops_later_than_it_was_interrupted(leaves, band, holds):
    """At 3 s: it does not stop between 1 and 2 s; between 5 and 6 s it might. Passed at 1.5 s: that stays."""
    assert first_holds(f'metric = "leaves at", series = "y", limit = 0.5, {band}, unit = "s"', leaves=leaves) is holds
    if leaves > 3.0:
        assert first_holds(f'metric = "stops at", {band}, unit = "s"') is holds


def test_the_time_of_a_stop_is_asked_of_runs_that_stop():
    """Stopping at 3 s, or at 5 s, decides; getting to the end does not, nor does a slow run that might get there."""
    text = 'map = "m"\ntests = [{ metric = "stop time", at_least = 2, at_most = 4, unit = "s" }]\n'
    for stops, holds in ((3.0, True), (5.0, False)):
        c = claim(text, one_of({"status": "diverged", "t_reached_s": stops, "steps": 9}))
        assert c.map[0].holds is holds and c.beyond.left_out == (ExcludedSettings(Ending.ENDED, 11),)
    assert claim(text, one_of(CUT), pace(0.01)).verdict == "cannot be told"
    assert claim(text).verdict == "cannot be told"


def test_runs_that_took_no_step_are_left_out_and_named():
    """Nothing moved: neither for nor against, unless the claim is about starting. A refusal is the solver's answer."""
    never = {"status": "step_underflow", "t_reached_s": 0.0, "steps": 0}
    for band in ("at_most = 5", "at_least = 5"):
        text = f'map = "m"\ntests = [{{ metric = "stops at", {band}, unit = "s" }}]\n'
        c = claim(text, one_of(never))
        assert c.map[0].holds is None
        assert c.beyond.left_out == (ExcludedSettings(Ending.NO_START, 1),)
        assert claim(text + "starting = true\n", one_of(never)).map[0].holds is (band == "at_most = 5")
    assert claim(text, one_of(never | {"status": "refused"})).map[0].holds is False


def test_a_comparison_with_a_run_cut_short_is_left_out():
    """ODE-GC, to be compared with, ran into a clock: no setting is settled; over a time it got through all are."""
    head = 'map = "m"\nagainst = "gc"\n'
    cut = {"status": "stalled", "t_reached_s": 3.0, "steps": 5, "max_steps": 9}
    found = [make_record(x, **(cut if x.solver == "gc_weak_form" else {})) for x in RUNS]

    def of(r):
        t = np.linspace(0.0, r.t_reached_s, 11)
        return make_series(t, phi_norm=np.ones(11))

    for to, verdict in ((4.0, "cannot be told"), (2.0, "reproduced")):
        test = f'metric = "largest", series = "phi_norm", to = {to}, compare = "over largest", at_least = 1, unit = ""'
        assert claim(f"{head}tests = [{{ {test} }}]\n", found, of).verdict == verdict


def test_no_setting_that_settles_it_is_untestable():
    c = claim(records=[make_record(x, phi_max=0.5, **CUT | {"steps": 8}) for x in RUNS])
    assert c.verdict == "cannot be told" and [m.gap for m in c.missing] == [ClaimGap.SETTLED]
    assert c.beyond.left_out == (ExcludedSettings(Ending.MACHINE, 12),)


def test_the_count_of_those_that_hold_because_a_run_stopped():
    """Losses of 2 m are above 1 m; two runs have no loss but an end before the end."""
    text = 'map = "m"\ntests = [{ metric = "loss", at_least = 1, unit = "m" }]\n'
    ends = [{"t_reached_s": 3.0, "steps": 9, "status": "diverged"}] * 2 + [{}] * len(RUNS)
    found = [make_record(x, position_error_judged_m=2.0, **e) for x, e in zip(RUNS, ends, strict=False)]
    assert "holds for all 12 tried. In 2 of these 12 because a run stopped before its end" in explain_verdicts(
        claim(text, found)
    )
    assert "because a run" not in explain_verdicts(
        claim(text, [make_record(x, position_error_judged_m=2.0) for x in RUNS])
    )


FAILED = {"status": "step_underflow", "t_reached_s": 3.0, "steps": 9}  # of 10 s, by itself


@pytest.mark.parametrize(
    ("asked", "phi", "holds"),
    [
        ("at_least = 1.0", 0.5, None),
        ("at_least = 1.0", 1.5, True),
        ("at_most = 1.0", 0.5, None),
        ("at_most = 1.0", 1.5, False),
        ("at_least = 1.0, at_most = 2.0", 1.5, None),
    ],
)
def test_an_early_end_is_open_for_partial_tests_too(asked, phi, holds):
    """A peak that has come counts, one that may have come later does not count against; one too high stays so."""

    def first(test):
        def of(r):
            t = np.linspace(0.0, r.t_reached_s, 11)
            return make_series(t, phi_norm=np.full(11, phi))

        found = [make_record(x, **(FAILED if k == 0 else {}), phi_max=phi) for k, x in enumerate(RUNS)]
        return claim(f'map = "m"\ntests = [{{ {test}, partial = true, {asked}, unit = "m" }}]\n', found, of).map[0]

    for test in ('metric = "largest", series = "phi_norm"', 'metric = "column", name = "phi_max"'):
        assert first(test).holds is holds


def test_one_early_end_counts_for_nobody():
    """A run that stopped neither loses energy nor keeps it, neither leaves the plane nor stays in it."""
    found = [make_record(x, **FAILED, energy_mean_last_quarter_J=5.0, out_of_plane_max_m=1e-3) for x in RUNS]
    for test in ('metric = "late energy"', 'metric = "column", name = "out_of_plane_max_m", partial = true'):
        for band in ("at_least = 0.1", "at_most = 0.1"):
            c = claim(f'map = "m"\ntests = [{{ {test}, {band}, unit = "" }}]\n', found)
            assert {m.holds for m in c.map} == {None} and c.beyond.left_out == (ExcludedSettings(Ending.EARLY, 12),)


def test_a_comparison_with_a_run_that_stopped_grows_alone():
    """The energy moved so far by a run that stopped is a lower bound, that of the run beside it is none."""
    text = (
        'map = "m"\nagainst = "gc"\ntests = [{ metric = "column", name = "phi_max", partial = true, '
        'compare = "over largest", at_least = 2, unit = "" }]\n'
    )

    def first(own, beside):
        found = [
            make_record(x, phi_max=0.1, **beside) if x.solver == "gc_weak_form" else make_record(x, **own) for x in RUNS
        ]
        return claim(text, found).map[0].holds

    assert first({"phi_max": 0.3} | FAILED, {}) is True and first({"phi_max": 0.1} | FAILED, {}) is None
    assert first({"phi_max": 0.3}, FAILED) is None
