"""``python -m mbsbench.tests.benchmarks.fit_costs RESULTS`` prints harness/run/costs.toml from runs of a suite.

RESULTS are of suite ``bench_engines``, made on a quiet machine with warm caches. For each solver and each of three
sizes (one body, the chain, the grid) the table has the medians of its runs. Times of compilation are measured here with
``--compile``, solver by solver on empty caches, else kept.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import fmean, median

import numpy as np
from scipy.optimize import nnls

from mbsbench.harness.catalogue import registry
from mbsbench.harness.results import store
from mbsbench.harness.results.records import RunRecord
from mbsbench.harness.run.contract import SHORT
from mbsbench.harness.run.costs import (
    SIZES,
    TOLERANCE,
    count_bodies_and_rows,
    find_nearest_size,
    measure_loop,
    read_costs,
)

STEPS = 50  # of a run that counts: less is timed too coarsely
COMPILE = """
import sys, resource
from mbsbench.harness.catalogue import registry
from mbsbench.harness.run.warmup import list_runs_to_warm, warm_up
from mbsbench.harness.judge.metrics import passes
from mbsbench.harness.catalogue.suites.spec import make_spec
tuple(registry.problems().values())
def used(): return sum(resource.getrusage(who).ru_utime for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
specs = list_runs_to_warm([make_spec(registry.make_problem("chain"), sys.argv[1])]) if sys.argv[1:] else []
tuple(registry.solvers().values())
before = used()
warm_up(specs) if specs else passes.load()
print(used() - before)
"""


def fit(records: Iterable[RunRecord], compiled: dict[str, float]) -> str:
    """Return the text of the table; what is not in ``records`` stays as it was."""
    kept = read_costs()
    good = [(r, *describe(r)) for r in records if r.steps > STEPS and r.cpu_median_s > 0.0]
    measuring = fit_measuring(good)
    once = [r for r, *_ in good if r.code_s < 1.0 and r.cpu_median_s >= SHORT]  # in no loop
    rest = [r.wall_s - r.measure_s - r.setup_s - r.repeats * r.cpu_median_s for r in once]
    out = [
        "# Made by tests/benchmarks/fit_costs.py: see there, and costs.py for the meaning.",
        f"loop_s = {min(measure_loop() for _ in range(20)):.3g}",
        f"process_s = {fmean(rest):.3g}",
        f"store_s = {kept.store_s:.3g}",
        f"load_s = {kept.load_s:.3g}",
        f"laws_s = {compiled['']:.3g}",
        f"reference_s = {kept.reference_s:.3g}",
        f"measure_s = [{', '.join(f'{x:.3g}' for x in measuring[:3])}]",
        f"measure_us = [{', '.join(f'{1e6 * x:.3g}' for x in measuring[3:])}]",
        "",
        "[commands]",
        *(f"{name} = [{start:.3g}, {each:.3g}]" for name, (start, each) in kept.commands.items()),
        "",
    ]
    for name in sorted({r.solver for r, *_ in good}):
        own = [row for row in good if row[0].solver == name]
        out += [
            f"[solvers.{name}]",
            f"compile_s = {compiled.get(name, 0.0):.3g}",
            f"setup_s = {by_size(own, lambda r: r.setup_s)}",
            f"step_us = {by_size(own, lambda r: 1e6 * r.cpu_median_s / r.steps)}",
        ]
        if own[0][0].control == "rtol":
            power = fit_power(own)
            unit = [r.steps * dt / r.t_reached_s * (r.rtol / TOLERANCE) ** power for r, _, dt in own]
            out += [f"steps = {median(unit):.3g}", f"power = {power:.3g}"]
        if any(made := kept.solvers[name].generate_s if name in kept.solvers else ()):
            out.append(f"generate_s = [{', '.join(f'{x:.3g}' for x in made)}]")
        out.append("")
    return "\n".join(out)


def describe(r: RunRecord) -> tuple[int, float]:
    """Return which of ``SIZES`` the problem of a run is nearest to, and its own step [s]."""
    problem = registry.make_problem(r.problem, json.loads(r.problem_parameters))
    return find_nearest_size(count_bodies_and_rows(problem.system)), problem.dt


def by_size(rows: Sequence[tuple[RunRecord, int, float]], cost: Callable[[RunRecord], float]) -> str:
    """Return medians at each size; where none was run, -1."""
    own = [[cost(r) for r, size, _ in rows if size == k] for k in range(len(SIZES))]
    return f"[{', '.join(f'{median(x):.3g}' if x else '-1' for x in own)}]"


def fit_measuring(rows: Sequence[tuple[RunRecord, int, float]]) -> list[float]:
    """Return the times to measure a run at each size [s], and for each step more [s], of least relative squares."""
    A = np.array([[n if size == k else 0.0 for n in (1.0, r.steps) for k in range(len(SIZES))] for r, size, _ in rows])
    b = np.array([r.measure_s for r, *_ in rows])
    weight = 1.0 / np.sqrt(b)  # between equal shares and equal seconds
    return [float(x) for x in nnls(A * weight[:, None], b * weight)[0]]


def fit_power(rows: Sequence[tuple[RunRecord, int, float]]) -> float:
    """Return the median power of the number of steps in 1 / rtol, over problems with three tolerances."""
    found = []
    by_problem: dict[tuple[str, str], list[RunRecord]] = {}
    for r, *_ in rows:
        by_problem.setdefault((r.problem, r.problem_parameters), []).append(r)
    for own in by_problem.values():
        if len({r.rtol for r in own}) > 2:
            rates = [math.log(r.steps / r.t_reached_s) for r in own]
            found.append(-float(np.polyfit([math.log(r.rtol) for r in own], rates, 1)[0]))
    return median(found) if found else 0.15


def compile_times() -> dict[str, float]:
    """Return the CPU time [s] of the first warm-up of each solver on empty caches, and of the laws ("")."""
    out = {}
    for name in ("", *(s for s in registry.solvers())):
        with tempfile.TemporaryDirectory() as place:
            environment = {**os.environ, "MBSBENCH_CACHE": place}
            line = [sys.executable, "-c", COMPILE, *([name] if name else [])]
            done = subprocess.run(line, env=environment, capture_output=True, text=True, check=True)
            out[name] = float(done.stdout.split()[-1])
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--compile", action="store_true")
    given = parser.parse_args()
    if given.compile:
        times = compile_times()
    else:
        kept = read_costs()
        times = {"": kept.laws_s, **{name: s.compile_s for name, s in kept.solvers.items()}}
    sys.stdout.write(fit(store.load(given.results, check_series=False).records, times))
