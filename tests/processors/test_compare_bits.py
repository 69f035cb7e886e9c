"""The comparison with emulated processors: which runs it takes, what it calls equal, what it says where it cannot run.

The comparison itself is `make test-processors`.
"""

import dataclasses
import math
from pathlib import Path

import mbsbench
from mbsbench.tests.processors import compare_bits
from mbsbench.tests.processors.compare_bits import (
    Processor,
    compare_motions,
    find_differences,
    judge_architectures,
    judge_processor,
)
from mbsbench.tests.processors.runs import (
    FAMILIES,
    Planned,
    Solved,
    digest,
    measured_of,
    motion_of,
    put_in_order,
    read_suite,
)


def solved(case: str, solver: str, cpu: float, motion: str = "a") -> Solved:
    return Solved(case, solver, "success", 10, motion, "b", cpu)


def test_each_solver_comes_first_with_its_cheapest_run():
    """A budget that ends early has then seen every solver."""
    runs = [("one", 3.0), ("one", 1.0), ("two", 9.0), ("one", 2.0), ("two", 8.0)]
    plan = put_in_order([("ci", n, solved(str(n), name, cpu)) for n, (name, cpu) in enumerate(runs)])
    assert plan == [Planned("ci", n, runs[n][1]) for n in (1, 4, 3, 2, 0)]


def test_a_run_that_differs_is_named():
    """The line says what differs; runs that were left out there are no difference."""
    here = [solved("first", "one", 1.0), solved("second", "one", 1.0), solved("third", "two", 1.0)]
    there = [solved("second", "one", 30.0), solved("third", "two", 30.0, motion="c")]
    assert find_differences(here, there) == ["third: motion a here, c there"]


def test_runs_of_families_come_before_all_others():
    """A budget is spent on each family of solvers first, however dear its run."""
    ci, families = solved("1", "one", 1.0), solved("2", "one", 9.0)
    assert [p.suite for p in put_in_order([("ci", 0, ci), (FAMILIES, 0, families)])] == [FAMILIES, "ci"]


def test_a_family_that_was_left_out_is_wrong():
    """One run that is equal says nothing of the others, and no run at all says nothing."""
    here = [solved(spec.case, spec.solver, 1.0) for spec in read_suite(FAMILIES)]
    cases, machine = [s.case for s in here], Processor("haswell", [], "a")
    assert len(cases) == 8
    assert judge_processor("Haswell", machine, machine, here, here, cases) == []
    for k in range(8):
        left = here[:k] + here[k + 1 :]
        assert judge_processor("Haswell", machine, machine, here, left, cases) == [f"{cases[k]}: not compared"]
    assert judge_processor("Haswell", machine, machine, here, [], []) == ["no run was compared"]


def shortened(solver: str, x: float, status: str = "success", **given) -> Solved:
    """A shortened run of ten steps at rtol = 1e-8 that ends at ``x``."""
    last = {"r": [1.0, x], "reaction": [0.0, x]}
    return Solved("case", solver, status, 10, digest([repr(x).encode()]), "", 1.0, rtol=1e-8, last=last, **given)


def test_a_reason_explains_no_more_than_the_tolerance_allows():
    """Steps of both runs may err by rtol each, here 2e-7 in all; a wrong sign is none of that."""
    here = shortened("rk45_strong_form", 0.5)
    for x, explained in ((0.5, True), (0.5 + 1e-7, True), (0.5 + 1e-6, False), (-0.5, False), (math.nan, False)):
        assert compare_motions(here, shortened("rk45_strong_form", x)).explained is explained, x
    assert not compare_motions(here, here._replace(motion="c", last={"r": [1.0, 0.5]})).explained


def test_solvers_of_our_own_have_no_excuse():
    """Their loops contain no code of others: the last bit counts."""
    here = shortened("rattle", 0.5)
    assert compare_motions(here, shortened("rattle", 0.5)).words == "equal"
    assert not compare_motions(here, shortened("rattle", math.nextafter(0.5, 1.0))).explained
    assert not compare_motions(here, shortened("rattle", 0.5, "failed")).explained


def test_nothing_that_was_compared_is_no_success():
    """No run, or none but those that are refused on both sides or not there, says nothing of bits."""
    run, lacking = shortened("rattle", 0.5), shortened("ida_index1", 0.5, message="sksundae is not installed: pip")
    assert judge_architectures([run, lacking], [run, lacking]) == 0
    assert judge_architectures([run], []) == 1
    assert judge_architectures([lacking], [lacking]) == 1


def test_digests_see_the_last_bit():
    """One bit of a velocity changes the digest of the motion, one of a number that of what is measured."""
    run = mbsbench.solve("heavy_top", "gc_weak_form", t_end=0.01, dt=1e-3)
    moved = run.trajectory.states.v.copy()
    moved.view("u8")[-1, 0, 0] ^= 1
    trajectory = dataclasses.replace(run.trajectory, states=dataclasses.replace(run.trajectory.states, v=moved))
    assert digest(motion_of(run)) == digest(motion_of(dataclasses.replace(run)))
    assert digest(motion_of(run)) != digest(motion_of(dataclasses.replace(run, trajectory=trajectory)))
    drift = math.nextafter(run.record.energy_drift_max_J, 1.0)
    record = dataclasses.replace(run.record, energy_drift_max_J=drift)
    names = ("steps", "energy_drift_max_J")
    assert digest(measured_of(run, names)) != digest(measured_of(dataclasses.replace(run, record=record), names))


def test_a_machine_without_emulator_is_told_what_is_missing(monkeypatch, capsys):
    """It is one line, with an exit code of its own, so that `.ci/run` goes on."""
    monkeypatch.setattr(compare_bits, "FETCHED", Path("none"))
    monkeypatch.setattr(compare_bits.shutil, "which", lambda name: None)
    assert compare_bits.main(["--check"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
