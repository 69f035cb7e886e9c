"""CPU times on empty caches beside warm ones: ``python -m mbsbench.tests.benchmarks.cold_and_warm [SOLVER ...]``.

Each solver of the suite ``ci`` runs the first settings of up to two problems, each time in a new process that has the
code of no other: once with an empty cache, then five times with what that has left there. The exit code is 1 where a
cold time is farther above the warm ones than these are from each other, and stays so when it is taken again.
"""

import json
import os
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from mbsbench.harness.base.code_meter import CODE_LIMIT, listen_to_numba
from mbsbench.harness.base.forked_process import ForkedProcess
from mbsbench.harness.base.generated import code
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.run import worker

PROBLEMS, REPEATS = 2, 5
AGAIN = 2  # times that a cold run which stands out is made again: code would stand out each time
TIMES = ("cpu_median_s", "cpu_call_s", "cpu_refuses_s")
FINE = 5e-4  # [s]: what a system that interrupts a process adds to a time now and then
LIMIT, MEMORY = 300.0, 4000.0  # [s], [MB]


def main(names: Sequence[str]) -> int:
    """Print a table; the number of settings whose cold times stand out."""
    listen_to_numba()
    registry.problems(), registry.solvers()  # all modules are loaded here, no code is
    line = "{:<22} {:<20} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8}  {}\n"
    sys.stdout.write(line.format("solver", "problem", "cold", "least", "median", "most", "call", "code", "warm", ""))
    failed = 0
    for spec in choose_runs(names):
        with tempfile.TemporaryDirectory() as place:
            cold, *warm = (time_apart(spec, Path(place)) for _ in range(1 + REPEATS))
        outside = find_outside(cold, warm)
        for _ in range(AGAIN):
            if not outside:
                break
            with tempfile.TemporaryDirectory() as place:
                cold = time_apart(spec, Path(place))
            outside = [name for name in find_outside(cold, warm) if name in outside]
        failed += bool(outside)
        times = sorted(w["cpu_median_s"] for w in warm)
        numbers = [
            f"{x:.5f}" for x in (cold["cpu_median_s"], times[0], times[REPEATS // 2], times[-1], cold["cpu_call_s"])
        ]
        codes = f"{cold['code_s']:.2f}", f"{max(w['code_s'] for w in warm):.2f}"
        sys.stdout.write(line.format(spec.solver, spec.problem, *numbers, *codes, " ".join(outside) or "same"))
        sys.stdout.flush()
    return failed


def choose_runs(names: Sequence[str]) -> list[RunSpec]:
    """The first settings of each solver on up to ``PROBLEMS`` problems."""
    chosen: dict[str, dict[str, RunSpec]] = {}
    for spec in load_suite("ci").specs:
        if spec.solver in (names or (spec.solver,)) and registry.is_own_problem(spec.problem):
            own = chosen.setdefault(spec.solver, {})
            if len(own) < PROBLEMS:
                own.setdefault(spec.problem, spec)
    return [spec for own in chosen.values() for spec in own.values()]


def time_apart(spec: RunSpec, folder: Path) -> dict[str, float]:
    """Times of one call in a process of its own that keeps its code in ``folder``."""

    def target(send: Callable[[str], None]) -> None:
        os.environ["MBSBENCH_CACHE"] = str(folder)
        code.FOLDER = folder / "generated"
        problem = registry.make_problem(spec.problem, spec.parameters)
        handed = worker.solve(problem, registry.make_solver(spec.solver, spec.options), spec.control)
        send(json.dumps(handed.report.cost))

    ended = ForkedProcess(target, limit=LIMIT, memory=MEMORY, code=CODE_LIMIT).wait()
    if ended.code != 0:
        raise RuntimeError(f"{spec.case} {ended.words}")
    return {name: float(value) for name, value in json.loads(ended.sent).items()}


def find_outside(cold: Mapping[str, float], warm: Sequence[Mapping[str, float]]) -> list[str]:
    """Times that are farther above all warm ones than these are from each other."""
    found = []
    for name in TIMES:
        of_warm = [w[name] for w in warm]
        if cold[name] > max(of_warm) + max(max(of_warm) - min(of_warm), FINE):
            found.append(name)
    return found


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1:]), 1))
