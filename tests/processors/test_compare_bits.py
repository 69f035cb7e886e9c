"""The comparison with emulated processors: which runs it takes, what it calls equal, what it says where it cannot run.

The comparison itself is `make test-processors`.
"""

import dataclasses
import math

import mbsbench
from tests.processors import compare_bits
from tests.processors.compare_bits import Planned, Solved, digest, find_differences, measured_of, motion_of


def solved(case: str, solver: str, cpu: float, motion: str = "a") -> Solved:
    return Solved(case, solver, "success", 10, motion, "b", cpu)


def test_each_solver_comes_first_with_its_cheapest_run():
    """A budget that ends early has then seen every solver."""
    runs = [("one", 3.0), ("one", 1.0), ("two", 9.0), ("one", 2.0), ("two", 8.0)]
    plan = compare_bits.put_in_order([("ci", n, solved(str(n), name, cpu)) for n, (name, cpu) in enumerate(runs)])
    assert plan == [Planned("ci", n, runs[n][1]) for n in (1, 4, 3, 2, 0)]


def test_a_run_that_differs_is_named():
    """By what differs of it; runs that were left out there are no difference."""
    here = [solved("first", "one", 1.0), solved("second", "one", 1.0), solved("third", "two", 1.0)]
    there = [solved("second", "one", 30.0), solved("third", "two", 30.0, motion="c")]
    assert find_differences(here, there) == ["third: motion a here, c there"]


def test_digests_see_the_last_bit():
    """Of a velocity in the motion, and of a number of the record."""
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
    """In one line, with an exit code of its own, so that `.ci/run` goes on."""
    monkeypatch.setattr(compare_bits, "FETCHED", compare_bits.HERE / "none")
    monkeypatch.setattr(compare_bits.shutil, "which", lambda name: None)
    assert compare_bits.main(["--check"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
