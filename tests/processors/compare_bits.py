"""Solve the same runs here and on an emulated processor, and compare all bytes of what comes out.

    .venv/bin/python tests/processors/compare_bits.py --processors Haswell EPYC-Rome Skylake-Client
    .venv/bin/python tests/processors/compare_bits.py --suites families ci

`qemu-x86_64 -cpu NAME` (Debian's qemu-user) translates every instruction of a process, for a processor with no more
than the named one has; /proc/cpuinfo stays the machine's. Its version 7.2 sorts wrongly with AVX2, as
``--check`` finds out.
Each run is solved in one process here and in one there: two digests, of all bytes of the trajectory (times, poses,
velocities, reactions), and of all that is measured of it (the record's numbers, the series). A process that an emulated
one starts is not emulated, so runs are solved in the process itself.

The order is a rule: the cheapest run of each solver, by the CPU time here, then the second of each, and so on; those
that would exceed ``--budget`` [s of CPU, for each processor] are left out and counted. Machine code that was compiled
here and kept is read there, since the pin makes both compile for one target; one kernel is compiled again there, and
its bytes are compared too.
"""

import argparse
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from mbsbench.harness import machine

HERE = Path(__file__).resolve()
FETCHED = Path(sys.prefix) / "qemu" / "usr" / "bin" / "qemu-x86_64"  # by `make qemu`, where apt's own errs
SORTS = "import numpy as np; x = np.random.default_rng(0).permutation(64); assert (x[np.argsort(x)] == range(64)).all()"
TAKEN_FOR = {"Haswell": "haswell", "EPYC-Rome": "znver2", "Skylake-Client": "skylake"}  # LLVM's names of qemu's models
SLOWER = 30.0  # how many times, to begin with; then as it has been


class Solved(NamedTuple):
    """What one process found of one run."""

    case: str
    solver: str
    status: str
    steps: int
    motion: str  # digest of the trajectory
    measured: str  # digest of the record's numbers and the series
    cpu: float  # [s]


class Planned(NamedTuple):
    """A run to solve."""

    suite: str
    number: int  # in the suite
    cpu: float  # [s] here


class Processor(NamedTuple):
    """What one process found of its processor."""

    llvm: str  # the name that LLVM reads from CPUID
    deviations: list[str]  # from the pin
    code: str  # digest of a kernel compiled here and now


def main(words: Sequence[str]) -> int:
    """Compare; 0 if all bits are equal, 1 if not, 2 if nothing can be emulated here."""
    parser = argparse.ArgumentParser(description="Compare bits of runs here and on emulated processors.")
    parser.add_argument("--processors", nargs="+", default=["Haswell"], choices=TAKEN_FOR, help="models of qemu")
    parser.add_argument("--suites", nargs="+", default=["families"], help="families, or suites of mbsbench")
    parser.add_argument("--budget", type=float, default=1000.0, metavar="S", help="CPU time for each processor (1000)")
    parser.add_argument("--check", action="store_true", help="only say whether processors can be emulated here")
    parser.add_argument("--solve", action="store_true", help=argparse.SUPPRESS)  # the process that solves
    given = parser.parse_args(words)
    if given.solve:
        solve_all(json.loads(sys.stdin.read()), given.budget)
        return 0
    qemu, missing = find_emulator()
    if missing:
        sys.stderr.write(f"error: no processor can be emulated: {missing}\n")
    if missing or given.check:
        return 2 if missing else 0
    cases = [(suite, n) for suite in given.suites for n in range(len(read_suite(suite)))]
    here, solved = _collect([], [Planned(s, n, 0.0) for s, n in cases], float("inf"))
    _say(f"here: {describe(here)}, {len(solved)} runs, {_cpu(solved):.0f} s of CPU")
    plan = put_in_order([(*case, s) for case, s in zip(cases, solved, strict=True)])
    return max([_compare([qemu, "-cpu", name], here, solved, plan, given.budget) for name in given.processors])


def find_emulator() -> tuple[str, str]:
    """Return the path of qemu-x86_64, and what is missing: nothing where one is there that emulates AVX2 rightly."""
    qemu = str(FETCHED) if FETCHED.exists() else shutil.which("qemu-x86_64")
    if platform.machine() != "x86_64" or not qemu:
        return "", "qemu-x86_64 is missing (Debian's package qemu-user)" if not qemu else "this is no x86-64"
    words = (qemu, "-cpu", "Haswell", sys.executable, "-c", SORTS)
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return qemu, "" if done.returncode == 0 else f"{qemu} sorts wrongly with AVX2 (version 7.2 does): get a newer one"


def _compare(emulator: list[str], here: Processor, solved: list[Solved], plan: list[Planned], budget: float) -> int:
    began, name = time.monotonic(), emulator[-1]
    there, emulated = _collect(emulator, plan, budget)
    wrong = find_differences(solved, emulated)
    if there.llvm != TAKEN_FOR[name]:
        wrong.append(f"LLVM takes the emulated processor for {there.llvm}, not for {TAKEN_FOR[name]}")
    if there.code != here.code:
        wrong.append("a kernel compiled there has other bytes")
    wrong += there.deviations
    counts = Counter(s.solver for s in emulated)
    _say(
        f"{name}: {describe(there)}, {len(emulated)} of {len(plan)} runs of {len(counts)} solvers, "
        f"{len(emulated) - len(find_differences(solved, emulated))} equal in every bit, "
        f"{_cpu(emulated):.0f} s of CPU, {time.monotonic() - began:.0f} s"
    )
    for line in wrong:
        _say(f"  {line}")
    return 1 if wrong or not emulated else 0


def describe(processor: Processor) -> str:
    """Name a processor, and what of the pin is not in force there."""
    return "; ".join([processor.llvm, *processor.deviations])


def find_differences(here: Sequence[Solved], there: Sequence[Solved]) -> list[str]:
    """Name the runs that differ, with what of them."""
    of = {s.case: s for s in here}
    compared = ("status", "steps", "motion", "measured")
    wrong = []
    for s in there:
        parts = [n for n in compared if getattr(s, n) != getattr(of[s.case], n)]
        if parts:
            values = "; ".join(f"{n} {getattr(of[s.case], n)} here, {getattr(s, n)} there" for n in parts)
            wrong.append(f"{s.case}: {values}")
    return wrong


def put_in_order(solved: Sequence[tuple[str, int, Solved]]) -> list[Planned]:
    """Order runs, given as suite, number and outcome: of each solver its cheapest, then of each its second, ..."""
    counted = Counter[str]()
    ranked = []
    for suite, number, s in sorted(solved, key=lambda entry: entry[2].cpu):
        ranked.append((counted[s.solver], s.cpu, suite, number))
        counted[s.solver] += 1
    return [Planned(suite, number, cpu) for _, cpu, suite, number in sorted(ranked)]


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _cpu(solved: Sequence[Solved]) -> float:
    return sum(s.cpu for s in solved)


def _collect(first: list[str], plan: Sequence[Planned], budget: float) -> tuple[Processor, list[Solved]]:
    """Solve in a process of its own, started by the words ``first``; on a terminal, print how many runs are done."""
    words = [*first, sys.executable, str(HERE), "--solve", "--budget", str(budget)]
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True) as job,
    ):
        job.stdin.write(json.dumps(plan))
        job.stdin.close()
        lines = []
        for line in job.stdout:
            lines.append(json.loads(line))
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{len(lines) - 1} of {len(plan)} ")
        job.wait()
        errors.seek(0)
        if job.returncode:
            name = " ".join(first) or "python"
            sys.exit(f"error: {name} ended with {job.returncode} after {len(lines)} lines:\n{errors.read()[-2000:]}")
    return Processor(*lines[0]), [Solved(*line) for line in lines[1:]]


def read_suite(name: str):
    """Return the runs of a suite, by its name or as the file of that name beside this one."""
    from mbsbench.harness.suites.suite import load_suite

    beside = HERE.with_name(f"{name}.toml")
    return load_suite(str(beside) if beside.exists() else name).specs


def solve_all(plan: Sequence[Planned], budget: float) -> None:
    """Print what is found of this processor and of each run of the plan, one JSON line each."""
    os.environ.update(machine.THREADS)
    suites = {suite: read_suite(suite) for suite in dict.fromkeys(s for s, _, _ in plan)}
    import llvmlite.binding as llvm

    _say(json.dumps(Processor(llvm.get_host_cpu_name(), machine.find_deviations(), compile_kernel())))
    began, native, spent = time.process_time(), 0.0, 0.0
    for suite, number, cpu in plan:
        slower = spent / native if native else SLOWER
        if time.process_time() - began + slower * cpu > budget:
            continue
        solved = solve(suites[suite][number])
        native, spent = native + cpu, spent + solved.cpu
        _say(json.dumps(solved))


def solve(spec) -> Solved:
    """Solve one run, measure it, and digest all bytes of both."""
    import mbsbench
    from mbsbench.harness.results.comparison import METRICS

    began = time.process_time()
    given = {k: v for k in ("dt", "rtol", "max_step") if (v := getattr(spec.control, k)) is not None}
    run = mbsbench.solve(mbsbench.make_problem(spec.problem, spec.parameters), spec.solver, **given, **spec.options)
    return Solved(
        spec.case, spec.solver, run.record.status, run.record.steps,
        digest(motion_of(run)), digest(measured_of(run, METRICS)), time.process_time() - began,
    )  # fmt: skip


def motion_of(run) -> Iterator[bytes]:
    """Yield all bytes of a trajectory; none of a run that was refused."""
    if run.trajectory is not None:
        states = run.trajectory.states
        arrays = (run.trajectory.t, states.r, states.R, states.v, states.Omega, run.trajectory.reaction)
        yield from (b"none" if a is None else a.tobytes() for a in arrays)


def measured_of(run, metrics: Sequence[str]) -> Iterator[bytes]:
    """Yield all bytes of the record's numbers, of its message and of the series."""
    yield repr([getattr(run.record, name) for name in metrics]).encode()
    yield run.record.message.encode()
    if run.series is not None:
        for name, array in sorted(run.series.arrays.items()):
            yield name.encode()
            yield array.tobytes()


def digest(parts: Iterator[bytes]) -> str:
    """Return the digest of bytes."""
    summed = hashlib.sha256()
    for part in parts:
        summed.update(part)
    return summed.hexdigest()[:16]


def compile_kernel() -> str:
    """Compile a small kernel, kept nowhere, and return the digest of its machine code."""
    import casadi

    from mbsbench.solvers.formulations.generated import code

    q = casadi.SX.sym("q", 6)
    pose = casadi.vertcat(*(casadi.sin(x) * y + casadi.sqrt(x * x + y) / y for x in q.nz for y in q.nz))
    printed = code.print_functions({"pose": ([q], [pose])})
    return digest(iter([code._compile(printed, code._machine())]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
