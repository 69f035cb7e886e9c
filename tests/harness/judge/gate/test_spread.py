"""Bounds around runs that rounding changed: what is rounding, what it may widen, and what it may not decide."""

import dataclasses
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from mbsbench.cli.__main__ import main
from mbsbench.harness.base import machine
from mbsbench.harness.catalogue.registry import make_problem
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.judge.gate import rounding
from mbsbench.harness.judge.gate.baseline import format_thresholds, read_thresholds
from mbsbench.harness.judge.gate.check import tighten_bounds
from mbsbench.harness.judge.gate.rounding import (
    FRAME,
    SIZE,
    START,
    TOLERANCE,
    choose_kernels,
    list_core_types,
    repeat_run,
)
from mbsbench.harness.judge.gate.spread import find_unstable, widen_by_spread
from mbsbench.harness.judge.gate.thresholds import Spread, Threshold, Thresholds, propose_bounds
from mbsbench.harness.mechanics import so3
from mbsbench.harness.mechanics.types import StepControl
from mbsbench.harness.results.environment import ROOT
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.run.protocol import Supervised

CASE = "free_fall exact rtol=1e-08"
CORES = ("Haswell", "Sandybridge")
PENDULUM = {"omega_z": 3.0, "t_end": 1.0}
TURNED = {"rotation": (0.3, -0.5, 0.7), **PENDULUM}
KINDS = ("", START, FRAME, TOLERANCE)


def drift_bound(**change) -> Threshold:
    given = {"value": 1e-5, "upper": 2.5e-5, "lower": 4e-6, "reason": "a reason", **change}
    return Threshold(case=CASE, metric="energy_drift_max_J", **given)


OLD = Thresholds("t", (drift_bound(),))


def samples_of(*values: float, **change) -> dict[str, list[tuple[str, RunRecord]]]:
    """Runs of one case under error control, each with its energy drift [J] and a name of its own."""
    base = RunRecord(**{"status": "success", "control": "rtol", "energy_scale_J": 1.0, "length_scale_m": 1.0, **change})
    records = [dataclasses.replace(base, case=f"{CASE} {k}", energy_drift_max_J=v) for k, v in enumerate(values)]
    return {CASE: [(KINDS[k % len(KINDS)], r) for k, r in enumerate(records)]}


def test_bounds_lie_around_what_rounding_gives():
    """2.5 times the largest, the smallest by 2.5, about the median; one run does not narrow them, a worse one fails."""
    new = widen_by_spread(OLD, samples_of(1e-5, 4e-5, 2e-5))
    (bound,) = new.bounds
    assert (bound.value, bound.samples) == (2e-5, 3)
    assert bound.reason == "error control: 3 runs that differ by rounding (frame, start) gave 1e-05 to 4e-05"
    assert (bound.lower, bound.upper) == pytest.approx((4e-6, 1e-4))
    (narrow,) = (b for b in propose_bounds([samples_of(1e-6)[CASE][0][1]]) if b.metric == bound.metric)
    assert tighten_bounds(new, [], [replace(narrow, case=CASE)], loosen=False) == new
    assert tighten_bounds(new, [], [replace(narrow, case=CASE)], loosen=True).bounds == (replace(narrow, case=CASE),)


def test_bounds_lie_around_samples_far_apart_though_all_are_within():
    """The one that was measured when the bound was set may have been at the edge; bounds around many are let be."""
    new = widen_by_spread(OLD, samples_of(5e-6, 1e-5, 2e-5))
    assert (new.bounds[0].lower, new.bounds[0].upper) == pytest.approx((2e-6, 5e-5))
    assert widen_by_spread(new, samples_of(6e-6, 1e-5, 3e-5)).bounds == new.bounds


def test_bounds_of_a_fixed_step_lie_around_what_was_measured():
    """By its own width, 1.2; the reason says so."""
    old = Thresholds("t", (drift_bound(upper=1.2e-5, lower=8.333e-6),))
    still, moved = (samples_of(1e-5, v, control="dt", steps=100) for v in (1.1e-5, 1.5e-5))
    assert widen_by_spread(old, still).bounds == old.bounds
    (bound,) = widen_by_spread(old, moved).bounds
    assert (bound.lower, bound.upper, bound.samples) == (8.333e-6, 1.8e-5, 2)
    assert bound.reason == "fixed step: 2 runs that differ by rounding (start) gave 1e-05 to 1.5e-05"


@pytest.mark.parametrize("given", [(1e-5, 2e-5), (1e-3, 2e-3), (1e-7, 1.1e-7)])
def test_a_change_that_rounding_does_not_explain_stays_a_breach(given):
    """All within the bounds, or all far beside the old value: nothing is widened."""
    assert widen_by_spread(OLD, samples_of(*given)).bounds == OLD.bounds


def test_bounds_of_a_case_whose_status_rounding_decides_are_left():
    """It is named with the kinds of rounding that lead to each status; nor do runs that all fail have bounds."""
    failed = samples_of(1e-5, 4e-5, 2e-5)
    assert find_unstable(failed) == {}
    failed[CASE][1] = START, dataclasses.replace(failed[CASE][1][1], status="step_underflow")
    assert find_unstable(failed) == {CASE: "success (unchanged, frame); step_underflow (start)"}
    assert widen_by_spread(OLD, failed) == OLD
    wrong = {CASE: [(kind, dataclasses.replace(r, status="wrong")) for kind, r in failed[CASE]]}
    assert find_unstable(wrong) == {} and widen_by_spread(OLD, wrong) == OLD


def test_the_file_says_what_was_measured(tmp_path):
    """How often, by what, and where a fixed step moved most; numbers that are nothing but rounding do not count."""
    samples = samples_of(1e-5, 1.01e-5, 1e-5, control="dt", steps=100)
    for k, (kind, record) in enumerate(samples[CASE]):
        samples[CASE][k] = kind, dataclasses.replace(record, phi_max=1e-17 * (1 + k))
    new = widen_by_spread(OLD, samples)
    assert new.spread == Spread(3, (FRAME, START), 1.01, f"{CASE} energy_drift_max_J")
    path = tmp_path / "t.toml"
    path.write_text(format_thresholds(new), encoding="utf-8")
    assert read_thresholds(path) == new and "[spread]\nsamples = 3" in path.read_text(encoding="utf-8")


def specify_pendulum(parameters: dict, rtol: float | None = None) -> RunSpec:
    control = StepControl(dt=0.01) if rtol is None else StepControl(rtol=rtol)
    return RunSpec("spherical_pendulum", "rattle", control, parameters)


def test_kinds_of_rounding_come_in_turn():
    """Every run has another name, or other kernels; a second round with these meets another start."""
    kinds = [START, FRAME, TOLERANCE, "BLAS Haswell", "BLAS Sandybridge"]
    found = repeat_run(specify_pendulum(PENDULUM, 1e-8), 10, CORES)
    assert [kind for kind, _, _ in found] == 2 * kinds
    assert len({(spec.settings_id, core) for _, spec, core in found}) == 10
    assert [kind for kind, _, _ in repeat_run(specify_pendulum(PENDULUM), 4, CORES)] == [START, FRAME, *kinds[3:]]
    assert choose_kernels(found[0][2]) == {}


@pytest.mark.skipif(not machine.list_variables(), reason="this processor has no pinned arithmetic")
@pytest.mark.parametrize("native", ["0", "1"])
def test_repeats_with_other_kernels_differ_in_them_alone(native):
    """Code that is compiled for another processor would be a second kind of rounding; natively both are the host's."""
    (core,) = {core for _, _, core in repeat_run(specify_pendulum(PENDULUM), 4, CORES)} & {"Sandybridge"}
    targets = "m.find_llvm_target(), m.find_numba_target(), m.list_features()"
    program = f"from mbsbench.harness.base import machine as m; print({targets})"
    shown = "import numpy; print(m.list_kernels())"
    given = {k: v for k, v in os.environ.items() if k != "OPENBLAS_CORETYPE"} | {machine.NATIVE: native}
    plain, other = (
        subprocess.run(
            (sys.executable, "-c", f"{program}; {shown}"),
            cwd=ROOT,
            env={**given, **environ},
            capture_output=True,
            text=True,
            check=True,
        ).stdout.splitlines()
        for environ in ({}, choose_kernels(core))
    )
    assert plain[0] == other[0] and "Sandybridge" in other[1] and "Sandybridge" not in plain[1]
    assert native == "1" or "haswell" in other[0]


@pytest.mark.parametrize("parameters", [PENDULUM, TURNED], ids=["upright", "turned"])
def test_each_kind_moves_a_problem_by_roundings_and_no_more(parameters):
    """Of the start, gravity and joints; what was zero is not when the frame is turned."""
    plain = make_problem("spherical_pendulum", parameters)
    for kind, spec, _ in repeat_run(specify_pendulum(parameters, 1e-8), 8, ()):
        moved = make_problem("spherical_pendulum", spec.parameters)
        changes = [np.max(np.abs(getattr(moved.initial, n) - getattr(plain.initial, n))) for n in ("r", "R", "Omega")]
        changes.append(np.max(np.abs(moved.system.gravity - plain.system.gravity)))
        assert max(changes) < 100.0 * SIZE
        assert (max(changes) > 0.0) == (kind != TOLERANCE)
        assert abs(spec.control.rtol / 1e-8 - 1.0) < 1e-12
        if kind == FRAME:
            assert 0.0 < np.max(np.abs(so3.log(plain.frame.T @ moved.frame))) < 10.0 * SIZE


def test_a_start_that_breaks_the_constraints_on_purpose_is_not_moved():
    """It would be projected, and be another problem."""
    kinds = [kind for kind, _, _ in repeat_run(specify_pendulum({**PENDULUM, "literal_start": True}), 4, CORES)]
    assert kinds == [FRAME, "BLAS Haswell", "BLAS Sandybridge", FRAME]


def test_kernels_are_those_that_the_processor_has(monkeypatch):
    """SkylakeX's are AVX-512's, and end a process without it."""
    for flags, cores in (
        ("", ()),
        ("sse2 avx avx2 fma", ("Haswell", "Zen", "Sandybridge")),
        ("avx avx2 avx512f avx512vl", ("Haswell", "Zen", "Sandybridge", "SkylakeX")),
    ):
        monkeypatch.setattr(rounding, "read_processor_flags", lambda flags=flags: frozenset(flags.split()))
        assert list_core_types() == cores


def test_runs_are_made_by_processes_with_these_variables():
    """The supervisor forks every run."""
    supervised = Supervised({"OPENBLAS_CORETYPE": "Sandybridge"})
    try:
        there, deadline = b"", time.monotonic() + 10.0
        while not there and time.monotonic() < deadline:  # empty until the new program is loaded
            there = Path(f"/proc/{supervised.process.pid}/environ").read_bytes()
        assert b"OPENBLAS_CORETYPE=Sandybridge" in there.split(b"\0")
    finally:
        supervised.close()


SUITE = """name = "small"
plugins = ["touchy.py"]
[[runs]]
problem = "spherical_pendulum"
parameters = { t_end = 0.5, omega_z = 3.0 }
solver = ["touchy", "rattle"]
dt = 0.05
"""
TOUCHY = '''"""A solver that a start moved by rounding stops."""
import dataclasses
from mbsbench import Status, solver
from mbsbench.harness.catalogue.registry import make_solver

@solver("touchy")
@dataclasses.dataclass(frozen=True)
class Touchy:
    """RATTLE, which gives up where the start is not that of the plain problem."""
    paper_label = ""
    control = "dt"
    def refuses(self, problem, control):
        return None
    def solve(self, problem, control):
        out = make_solver("rattle").solve(problem, control)
        return dataclasses.replace(out, status=Status.DIVERGED) if "perturb" in problem.parameters else out
'''


LITERAL = SUITE.replace("omega_z = 3.0", "literal_start = true").replace('["touchy", "rattle"]', '"rattle"')


def test_a_run_that_is_repeated_as_it_was_is_one_sample(tmp_path, monkeypatch):
    """A literal start is not moved, so a second round meets the same kernels with the same start."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mbsbench.harness.judge.gate.rounding.CORES", {"Sandybridge": "avx"})
    Path("small.toml").write_text(LITERAL.replace('plugins = ["touchy.py"]\n', ""))
    update = ["gate", "--suite", "small.toml", "--thresholds", "t.toml", "--jobs", "1", "--update", "--write"]
    assert main([*update, "--spread", "4"]) == 0
    assert read_thresholds(Path("t.toml")).spread.samples == 4  # unchanged, two frames, one of kernels


@pytest.mark.sampled(0)
def test_a_gate_with_a_case_that_rounding_decides_says_so_and_bounds_the_others(tmp_path, monkeypatch, capfd):
    """Exit code 2 and a line; the bounds of that case are as they were, the file says what was measured."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr("mbsbench.harness.judge.gate.rounding.CORES", {"Sandybridge": "avx"})
    Path("small.toml").write_text(SUITE)
    Path("touchy.py").write_text(TOUCHY)
    gate = ["gate", "--suite", "small.toml", "--thresholds", "t.toml", "--jobs", "1"]
    assert main([*gate, "--update", "--write", "--out", "made"]) == 0
    before = read_thresholds(Path("t.toml"))
    assert before.spread is None
    assert main([*gate, "--update", "--write", "--spread", "3", "--results", "made"]) == 2
    (line,) = (x for x in capfd.readouterr().err.splitlines() if x.startswith("error: "))
    assert "touchy" in line and "success (unchanged, frame" in line and "diverged (start)" in line
    after = read_thresholds(Path("t.toml"))
    assert after.bounds == before.bounds and after.spread is not None
    assert after.spread.samples == 4 and after.spread.kinds == ("BLAS Sandybridge", FRAME, START)
    assert 1.0 <= after.spread.fixed_step < 1.001
