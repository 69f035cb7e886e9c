"""Profiles, envelopes and wrong successes on records whose answers are known."""

import dataclasses
import json
import math
from pathlib import Path

import pytest

from mbsbench.harness.judge.referee.certificates.work import TARGETS, collect_work
from mbsbench.harness.judge.referee.false_successes import find_false_successes
from mbsbench.harness.mechanics.types import Law, Reason
from mbsbench.harness.results.records import format_reasons
from mbsbench.tests.factories import make_record

NOWHERE = Path()


def make_work(solver, step, error, evaluations, **more):
    """The record of a run of a swing of 2 m, with an error and evaluations that are known."""
    settings = {
        "run_id": f"{solver}{step}",
        "settings_id": f"{solver}-{step}-{more.get('solver_options', '')}",
        "case": f"swing {solver} dt={step}",
        "problem": "swing",
        "solver": solver,
        "control": "dt",
        "dt_s": step,
        "t_end_s": 1.0,
    }
    outcome = {
        "status": "success",
        "claimed": "success",
        "reference": "by hand",
        "reference_own_error_m": 1e-12,
        "length_scale_m": 2.0,
        "judged_to_s": 1.0,
        "position_error_judged_m": error,
        "orientation_error_judged_rad": error,
        "evaluations": float(evaluations),
        "energy_drift_max_J": 1e-3,
        "phi_max": 1e-6,
        "steps": evaluations,
        "cpu_median_s": 1e-6 * evaluations,
    }
    return make_record(**(settings | outcome | more))


def profile(found, solver, name="evaluations", of="profile"):
    return next(p for p in getattr(found, of) if (p.solver, p.work) == (solver, name))


GOOD = [make_work("a", 0.1, 2e-2, 10), make_work("a", 0.01, 2e-4, 100), make_work("a", 0.001, 2e-6, 1000)]
OTHER = [make_work("b", 0.1, 0.5, 20), make_work("b", 0.01, 2e-2, 50)]


def test_a_profile_counts_targets_by_the_least_work_that_reaches_them():
    """Errors 1e-2, 1e-4, 1e-6 of the size: three, then seven, then eleven half decades from 1e-1 on."""
    found = collect_work(NOWHERE, [*GOOD, *OTHER])
    mine = profile(found, "a")
    assert mine.total == len(TARGETS)
    assert mine.target_work == (10.0,) * 3 + (100.0,) * 4 + (1000.0,) * 4
    assert profile(found, "b").target_work == (50.0,) * 3
    assert profile(found, "a", "cpu").target_work[0] == pytest.approx(1e-5)


def test_targets_below_the_references_own_error_are_left_out_for_everybody():
    """Own error 1e-5 of the size: targets below 3e-5 are nobody's."""
    vague = [dataclasses.replace(r, reference_own_error_m=2e-5) for r in (*GOOD, *OTHER)]
    found = collect_work(NOWHERE, vague)
    own = found.targets[0].own
    assert own == pytest.approx(2e-9)  # up to where the motion is predictable the reference is better than 1e-9
    strict = collect_work(NOWHERE, [dataclasses.replace(r, reference_own_error_m=1e-9) for r in (*GOOD, *OTHER)])
    assert min(strict.targets[0].errors) >= 3e-9
    assert profile(strict, "a").total == sum(t * 2.0 >= 3e-9 for t in TARGETS)


def test_tuned_runs_count_for_the_best_and_not_for_the_defaults():
    """Options other than the defaults are told apart."""
    tuned = make_work("a", 0.02, 2e-4, 60, solver_options=json.dumps({"tolerance": 1e-6}))
    found = collect_work(NOWHERE, [*GOOD, tuned, *OTHER])
    assert profile(found, "a").target_work[3] == 60.0
    assert profile(found, "a", of="profile_default").target_work[3] == 100.0
    best = {p.settings_id: p.best for p in found.points}
    assert best[tuned.settings_id]
    assert not best[GOOD[1].settings_id]
    assert best[GOOD[2].settings_id]


def test_contradicted_stopped_and_perturbed_runs_reach_nothing():
    """A success that is none, a run that stopped early, a motion that is another one."""
    wrongly = make_work("c", 0.1, 1e-8, 1, status="wrong")
    stopped = make_work("c", 0.2, 1e-8, 1, t_reached_s=0.5)
    other = make_work("c", 0.3, 1e-8, 1, problem_parameters=json.dumps({"perturb": 1e-3}))
    found = collect_work(NOWHERE, [*GOOD, *OTHER, wrongly, stopped, other])
    assert profile(found, "c").target_work == ()
    assert not any(p.best for p in found.points if p.solver == "c")
    assert len([p for p in found.points if p.solver == "c"]) == 2


def test_a_refusal_never_reaches_and_a_variant_not_all_were_tried_on_is_left_out():
    """Nobody loses targets by not having been asked; who was asked and refused does."""
    refused = make_work("c", 0.1, math.nan, 0, status="refused", claimed="refused", reference="")
    more = {"problem_parameters": '{"t_end": 2.0}', "case": "swing[t_end=2] a dt=1"}
    elsewhere = [dataclasses.replace(r, **more, settings_id=r.settings_id + "2") for r in (*GOOD, *OTHER)]
    found = collect_work(NOWHERE, [*GOOD, *OTHER, refused, *elsewhere])
    assert profile(found, "c").target_work == ()
    assert profile(found, "c").total == profile(found, "a").total == len(TARGETS)
    assert [t.variant for t in found.targets] == ["swing"]
    assert {p.variant for p in found.points} == {"swing", "swing[t_end=2]"}


def test_work_on_a_motion_that_is_judged_in_part_is_not_profiled():
    """A chain over 20 s is compared over 1.9 s: its work bought something else."""
    chaotic = [dataclasses.replace(r, judged_to_s=0.4) for r in (*GOOD, *OTHER)]
    assert collect_work(NOWHERE, chaotic).profile == ()
    assert len(collect_work(NOWHERE, chaotic).points) == 5


def test_bodies_that_only_turn_are_compared_by_orientation():
    """Where all positions are exact they compare nothing."""
    turning = [dataclasses.replace(r, position_error_judged_m=0.0) for r in (*GOOD, *OTHER)]
    found = collect_work(NOWHERE, turning)
    assert {(p.error_kind, p.unit) for p in found.points} == {("orientation error", "rad")}
    assert profile(found, "a").target_work[:2] == (10.0, 10.0)


def test_a_variant_of_one_solver_is_no_comparison():
    """Nothing to profile."""
    assert collect_work(NOWHERE, GOOD).points == ()


def test_factorisations_count_where_they_are_counted():
    """Operations are evaluations plus factorisations; a solver that counts none has evaluations alone."""
    counted = [dataclasses.replace(r, factorisations=5.0) for r in GOOD]
    found = collect_work(NOWHERE, [*counted, *OTHER])
    assert profile(found, "a", "operations").target_work[0] == 15.0
    assert profile(found, "b", "operations").target_work[0] == 50.0
    assert not any(p.solver == "b" and p.work == "factorisations" for p in found.profile)


RATES = Reason(Law.TRUNCATION, 95.0, 1.0, name="the error of accelerations")


def test_wrong_successes_have_the_verdicts_reasons_and_the_planes():
    """Only where success is claimed, and planarity only where the motion is predictable to its end."""
    contradicted = make_work(
        "a", 0.1, 1.0, 10, status="wrong", wrong_because=format_reasons([Reason(Law.ENERGY, 5.0, 1.0, "J")])
    )
    gave_up = dataclasses.replace(contradicted, claimed="diverged", settings_id="x")
    away = make_work("b", 0.1, 1e-3, 10, out_of_plane_max_m=0.5)
    chaotic = dataclasses.replace(away, judged_to_s=0.3, settings_id="y")
    planar = dataclasses.replace(away, out_of_plane_max_m=math.nan, settings_id="z")
    found = find_false_successes([contradicted, gave_up, away, chaotic, planar], [])
    assert [e.settings_id for e in found] == [contradicted.settings_id, away.settings_id]
    assert [(b.law, b.value) for b in found[0].because] == [(Law.ENERGY, 5.0)]
    assert [(b.law, b.value) for b in found[1].because] == [(Law.PLANE, 0.5)]


@pytest.mark.parametrize(
    ("changed", "misleads"),
    [
        ({}, False),
        ({"motion_error_judged_m": 0.02}, True),
        ({"rate_error_judged_m_per_s": 0.05}, True),
        ({"reaction_error_max_N": 0.5}, True),
        ({"reaction_error_max_N": math.nan, "reaction_size_N": math.nan}, False),  # a solver without reactions
        ({"judged_to_s": 0.5}, True),  # not compared to the end
        ({"wrong_because": format_reasons([RATES, Reason(Law.ENERGY, 5.0, 1.0, "J")])}, True),
    ],
)
def test_rates_of_a_motion_that_is_right_mislead_nobody(changed, misleads):
    """Wrong by its own rates alone, and right by comparison: no false success."""
    right = make_work(
        "a", 0.1, 1.0, 10, status="wrong", wrong_because=format_reasons([RATES]), motion_error_judged_m=1e-4,
        length_scale_m=1.0, rate_error_judged_m_per_s=1e-3, speed_scale_m_per_s=2.0, reaction_error_max_N=0.05,
        reaction_size_N=10.0, judged_to_s=1.0, t_end_s=1.0,
    )  # fmt: skip
    assert bool(find_false_successes([dataclasses.replace(right, **changed)], ())) is misleads


def test_literal_starts_are_no_targets_and_no_false_successes():
    """Their joints are open from the start, and the exact motion is that of another start."""
    literal = [dataclasses.replace(r, problem_parameters='{"literal_start": true}') for r in (*GOOD, *OTHER)]
    assert collect_work(NOWHERE, literal).points == ()
    broken = {"status": "wrong", "wrong_because": format_reasons([Reason(Law.CONSTRAINT, 2.0, 1.0, "m")])}
    assert len(find_false_successes([dataclasses.replace(GOOD[0], **broken)], ())) == 1
    assert find_false_successes([dataclasses.replace(literal[0], **broken)], ()) == ()


def test_the_references_error_is_that_of_the_time_judged():
    """Where it is recorded it counts, however large: 1e-5 m leaves the targets above 3e-5 m."""
    found = collect_work(NOWHERE, [dataclasses.replace(r, reference_own_error_judged_m=1e-5) for r in (*GOOD, *OTHER)])
    assert found.targets[0].own == 1e-5 and min(found.targets[0].errors) >= 3e-5
