"""Solve the same runs here and on an emulated processor, and compare all bytes of what comes out.

    .venv/bin/python -m mbsbench.tests.processors.compare_bits --processors Haswell EPYC-Rome Skylake-Client
    .venv/bin/python -m mbsbench.tests.processors.compare_bits --suites families ci

`qemu-x86_64 -cpu NAME` (Debian's qemu-user) translates every instruction of a process, for a processor with no more
than the named one has; /proc/cpuinfo stays the machine's. Its version 7.2 sorts wrongly with AVX2, as
``--check`` finds out.
Each run is solved in one process here and in one there: two digests, of all bytes of the trajectory (times, poses,
velocities, reactions), and of all that is measured of it (the record's numbers, the series). A process that an emulated
one starts is not emulated, so runs are solved in the process itself.

Runs that would exceed ``--budget`` [s of CPU, for each processor] are left out and counted; one of each family has to
be there. Machine code that was compiled here and kept is read there, since the pin makes both compile for one target;
one kernel is compiled again there, and its bytes are compared too.

With ``--there WORD ...`` the other side is a Python of another architecture, started by these words (arm64.sh). Runs
are shortened, their motions alone are compared, and a difference is explained where other people's code computes in the
loop of a solver and it is no larger than the errors that the solver's tolerance allows to both.
"""

import argparse
import json
import math
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from mbsbench.harness.base import machine

from .runs import FAMILIES, TELLING, Planned, Solved, digest, put_in_order, read_suite, solve, solve_shortened

MODULE = "mbsbench.tests.processors.compare_bits"
FETCHED = Path(sys.prefix) / "qemu" / "usr" / "bin" / "qemu-x86_64"  # by `make qemu`, where apt's own errs
SORTS = "import numpy as np; x = np.random.default_rng(0).permutation(64); assert (x[np.argsort(x)] == range(64)).all()"
TAKEN_FOR = {"Haswell": "haswell", "EPYC-Rome": "znver2", "Skylake-Client": "skylake"}  # LLVM's names of qemu's models
SLOWER = 30.0  # how many times, to begin with; then as it has been
SCIPY = "scipy.integrate sums stages by BLAS (numpy.dot), and LAPACK factorises A M^-1 A^T (dpbtrf)"
SCIPY_DAE = "scipy_dae sums by BLAS, and LAPACK factorises Newton's matrix (dgetrf, dgbtrf)"
REASONS = {  # solvers in whose loop other people's code computes, which only a pin of its processor holds still
    "rk45_strong_form": SCIPY,
    "scipy_strong_form": SCIPY,
    "ndf_index1": SCIPY_DAE,
    "radau_index1": SCIPY_DAE,
}


class Processor(NamedTuple):
    """A processor, as one process sees it."""

    llvm: str  # the name that LLVM reads from CPUID
    deviations: list[str]  # from the pin
    code: str  # digest of a kernel compiled here and now


class Row(NamedTuple):
    """A run on two architectures, whether it is equal or differs by a known reason, and the words of the table."""

    case: str
    explained: bool
    words: str


def main(words: Sequence[str]) -> int:
    """Compare; 0 if all bits are equal, 1 if not, 2 if nothing can be emulated here."""
    parser = argparse.ArgumentParser(description="Compare bits of runs here and on emulated processors.")
    parser.add_argument("--processors", nargs="+", default=["Haswell"], choices=TAKEN_FOR, help="models of qemu")
    parser.add_argument("--suites", nargs="+", default=[FAMILIES], help=f"{FAMILIES}, or suites of mbsbench")
    parser.add_argument("--solvers", nargs="+", default=[], help="only the runs of these")
    parser.add_argument("--budget", type=float, default=1000.0, metavar="S", help="CPU time for each processor (1000)")
    parser.add_argument("--check", action="store_true", help="only say whether processors can be emulated here")
    parser.add_argument("--there", nargs=argparse.REMAINDER, help="words that start a Python of another architecture")
    parser.add_argument("--solve", action="store_true", help=argparse.SUPPRESS)  # the process that solves
    parser.add_argument("--shortened", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(words)
    if given.solve:
        solve_all(json.loads(sys.stdin.read()), given.budget, shortened=given.shortened)
        return 0
    qemu, missing = ("", "") if given.there else find_emulator()
    if missing:
        sys.stderr.write(f"error: no processor can be emulated: {missing}\n")
    if missing or given.check:
        return 2 if missing else 0
    cases = [
        (suite, n)
        for suite in given.suites
        for n, spec in enumerate(read_suite(suite))
        if not given.solvers or spec.solver in given.solvers
    ]
    first, shortened = [sys.executable], bool(given.there)
    here, solved = _collect(first, [Planned(s, n, 0.0) for s, n in cases], math.inf, shortened=shortened)
    _say(f"here: {describe(here)}, {len(solved)} runs, {_cpu(solved):.0f} s of CPU")
    outcomes = [(*case, s) for case, s in zip(cases, solved, strict=True)]
    if given.there:
        there, emulated = _collect(given.there, put_in_order(outcomes, TELLING), given.budget, shortened=True)
        _say(f"there: {describe(there)}, {_cpu(emulated):.0f} s of CPU")
        return judge_architectures(solved, emulated)
    plan = put_in_order(outcomes)
    needed = [s.case for suite, _, s in outcomes if suite == FAMILIES]
    return max([_compare([qemu, "-cpu", name], here, solved, plan, needed, given.budget) for name in given.processors])


def find_emulator() -> tuple[str, str]:
    """Return the path of qemu-x86_64, and what is missing: nothing where one is there that emulates AVX2 rightly."""
    qemu = str(FETCHED) if FETCHED.exists() else shutil.which("qemu-x86_64")
    if platform.machine() != "x86_64" or not qemu:
        return "", "qemu-x86_64 is missing (Debian's package qemu-user)" if not qemu else "this is no x86-64"
    words = (qemu, "-cpu", "Haswell", sys.executable, "-c", SORTS)
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return qemu, "" if done.returncode == 0 else f"{qemu} sorts wrongly with AVX2 (version 7.2 does): get a newer one"


def _compare(
    emulator: list[str], here: Processor, solved: list[Solved], plan: list[Planned], needed: list[str], budget: float
) -> int:
    began, name = time.monotonic(), emulator[-1]
    there, emulated = _collect([*emulator, sys.executable], plan, budget)
    wrong = judge_processor(name, here, there, solved, emulated, needed)
    counts = Counter(s.solver for s in emulated)
    _say(
        f"{name}: {describe(there)}, {len(emulated)} of {len(plan)} runs of {len(counts)} solvers, "
        f"{len(emulated) - len(find_differences(solved, emulated))} equal in every bit, "
        f"{_cpu(emulated):.0f} s of CPU, {time.monotonic() - began:.0f} s"
    )
    for line in wrong:
        _say(f"  {line}")
    return 1 if wrong else 0


def judge_processor(
    name: str,
    here: Processor,
    there: Processor,
    solved: Sequence[Solved],
    emulated: Sequence[Solved],
    needed: Sequence[str],
) -> list[str]:
    """Name what is wrong on a model of qemu: runs that differ, ``needed`` ones that are not there, and its pin."""
    wrong = find_differences(solved, emulated)
    wrong += [f"{case}: not compared" for case in needed if case not in {s.case for s in emulated}]
    if not emulated:
        wrong.append("no run was compared")
    if there.llvm != TAKEN_FOR[name]:
        wrong.append(f"LLVM takes the emulated processor for {there.llvm}, not for {TAKEN_FOR[name]}")
    if there.code != here.code:
        wrong.append("a kernel compiled there has other bytes")
    return wrong + there.deviations


def describe(processor: Processor) -> str:
    """Name a processor, and what of the pin is not in force there."""
    return "; ".join([processor.llvm, *processor.deviations])


def find_differences(here: Sequence[Solved], there: Sequence[Solved]) -> list[str]:
    """Name the runs that differ, with what of them."""
    by_case = {s.case: s for s in here}
    compared = ("status", "steps", "motion", "measured")
    wrong = []
    for s in there:
        parts = [n for n in compared if getattr(s, n) != getattr(by_case[s.case], n)]
        if parts:
            values = "; ".join(f"{n} {getattr(by_case[s.case], n)} here, {getattr(s, n)} there" for n in parts)
            wrong.append(f"{s.case}: {values}")
    return wrong


def judge_architectures(here: Sequence[Solved], there: Sequence[Solved]) -> int:
    """Print a row for each run, the unexplained first; return 1 if there is one, or no motion that was compared."""
    by_case = {s.case: s for s in here}
    rows = [compare_motions(by_case[s.case], s) for s in there]
    for row in sorted(rows, key=lambda row: row.explained):
        _say(f"{row.case:84} {row.words}")
    equal, unexplained = sum(row.words == "equal" for row in rows), sum(not row.explained for row in rows)
    _say(
        f"{equal} of {len(rows)} runs equal, {unexplained} unexplained; "
        f"{len(here) - len(rows)} of {len(here)} not run for want of time"
    )
    return 0 if equal and not unexplained else 1


def compare_motions(x: Solved, y: Solved) -> Row:
    """Compare a shortened run here with that there."""
    if "is not installed" in y.message:
        return Row(x.case, True, f"not there: {y.message.partition(':')[0]}")
    if x.status != y.status:
        return Row(x.case, False, f"{x.status}, there {y.status} {y.message}")
    if x.status == "refused":
        return Row(x.case, True, "refused by both")
    if (x.steps, x.motion) == (y.steps, y.motion):
        return Row(x.case, True, "equal")
    theirs = y.parts or {}
    parts = " ".join(k for k, bits in (x.parts or {}).items() if bits != theirs.get(k))
    distance, allowed, why = measure_distance(x, y), allow_distance(x, y), REASONS.get(x.solver, "")
    size = f"{x.steps} and {y.steps} steps; {parts}; last by {distance:.1e}, allowed {allowed:.1e}"
    explained = bool(why) and distance <= allowed
    return Row(x.case, explained, f"other bits ({size}): {why if explained else 'NOT EXPLAINED'}")


def measure_distance(x: Solved, y: Solved) -> float:
    """Return the largest difference of the last states and reactions, beside 1 + the largest number of each array."""
    worst = 0.0
    for name, of_x in (x.last or {}).items():
        of_y = (y.last or {}).get(name, [])
        if len(of_x) != len(of_y):
            return math.inf
        size = 1.0 + max(map(abs, of_x), default=0.0)
        gaps = [abs(p - q) / size for p, q in zip(of_x, of_y, strict=True)]
        worst = max([worst, *(gap if math.isfinite(gap) else math.inf for gap in gaps)])
    return worst


def allow_distance(x: Solved, y: Solved) -> float:
    """Return the largest distance that rounding explains: rounding may choose other steps, each errs by rtol at most.

    So do all steps of the two runs together, over an interval in which no motion diverges; a term with a wrong sign
    moves a body by 1e-2 in it.
    """
    return (x.steps + y.steps) * x.rtol


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def _cpu(solved: Sequence[Solved]) -> float:
    return sum(s.cpu for s in solved)


def _collect(
    first: list[str], plan: Sequence[Planned], budget: float, *, shortened: bool = False
) -> tuple[Processor, list[Solved]]:
    """Solve in a process of its own, started by the words ``first``; on a terminal, print how many runs are done."""
    words = [*first, "-m", MODULE, "--solve", "--budget", str(budget), *(["--shortened"] if shortened else [])]
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
            name = " ".join(first)
            sys.exit(f"error: {name} ended with {job.returncode} after {len(lines)} lines:\n{errors.read()[-2000:]}")
    return Processor(*lines[0]), [Solved(*line) for line in lines[1:]]


def solve_all(plan: Sequence[Planned], budget: float, *, shortened: bool) -> None:
    """Print what is found of this processor and of each run of the plan, one JSON line each.

    Shortened runs go on until the budget is used, since another architecture first compiles all kernels; others are
    left out where they would exceed it.
    """
    os.environ.update(machine.THREADS)
    suites = {suite: read_suite(suite) for suite in dict.fromkeys(s for s, _, _ in plan)}
    one: Callable[..., Solved] = solve_shortened if shortened else solve
    import llvmlite.binding as llvm

    _say(json.dumps(Processor(llvm.get_host_cpu_name(), machine.find_deviations(), compile_kernel())))
    began, native, spent = time.process_time(), 0.0, 0.0
    for suite, number, cpu in plan:
        slower = spent / native if native else SLOWER
        expected = 0.0 if shortened else slower * cpu
        if time.process_time() - began + expected > budget:
            continue
        solved = one(suites[suite][number])
        native, spent = native + cpu, spent + solved.cpu
        _say(json.dumps(solved))


def compile_kernel() -> str:
    """Compile a small kernel, kept nowhere, and return the digest of its machine code."""
    import casadi

    from mbsbench.harness.base.generated import code

    q = casadi.SX.sym("q", 6)
    pose = casadi.vertcat(*(casadi.sin(x) * y + casadi.sqrt(x * x + y) / y for x in q.nz for y in q.nz))
    printed = code.print_functions({"pose": ([q], [pose])})
    return digest([code._compile(printed, code._make_target_machine())])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
