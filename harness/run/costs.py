"""Estimate how long runs will take on this machine, before any of them has begun, for every command that reports it.

A run with a record in one of the newest local results folders is expected to take as long as it did then. For any other
run the estimate (``predict_times``) comes from ``costs.toml``, which has set-up times and times per step by solver and
size of system on an idle machine, multiplied by how much slower a short loop runs here. Compilation and references
count only where the caches of this machine do not hold them (``WarmCaches``).
"""

import contextlib
import functools
import itertools
import json
import math
import os
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import psutil

from ..base.cache import IN_CHECKOUT, ROOT, make_cache_folder
from ..base.files import FileError, parse_json, parse_toml, read_text, to_json, write_text
from ..base.machine import find_llvm_target
from ..base.naming import format_name
from ..base.shapes import Shape, convert_shape
from ..catalogue import registry
from ..catalogue.codes import package_sources
from ..catalogue.suites.spec import RunSpec
from ..mechanics.system import MultibodySystem
from ..mechanics.types import Problem
from ..reference.computation import Source, describe_source
from ..results import store
from .contract import SHORT
from .remaining_time import QUICK, Expectation, format_duration, read_durations
from .warmup import ABREAST, list_runs_to_warm, select_run_per_motion

TABLE = Path(__file__).with_name("costs.toml")
# number of bodies plus constraint rows of the systems for which the table was measured: one body, the chain, the grid
SIZES = (4.0, 63.0, 455.0)
SOON = 3.0  # [s] most that a run may take to count as quick: other runs may wait for it
TOLERANCE = 1e-8  # rtol at which the table counts steps
SHARED = 6.2  # [s] of compilation that all solvers of index 1 share: the kernels of accelerations
LAWS = "laws"  # name of the compiled measuring code in ``WarmCaches``
# [s] simulated time and step assumed for a plugin's problem, which is not created here
UNKNOWN_T, UNKNOWN_STEP = 10.0, 1e-3


class SolverCost(Shape, frozen=True):
    """Hold the measured costs of one solver; triples have a value for each of ``SIZES``, -1 where none was measured."""

    compile_s: float  # [s] of CPU at the first use
    setup_s: tuple[float, float, float]  # [s] a run
    step_us: tuple[float, float, float]  # [us] a step
    steps: float = 0.0  # accepted steps at rtol = 1e-8 for each step of the problem's own size
    power: float = 0.0  # exponent of 1 / rtol in the number of steps
    generate_s: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [s] of CPU for code of a system, made at its first run


class Costs(Shape, frozen=True):
    """Hold the content of ``costs.toml``."""

    loop_s: float  # [s] of ``measure_loop`` on the machine of the table
    process_s: float  # [s] to start and end the processes of a run
    store_s: float  # [s] from its record to the next run in its place: to write its files and report it
    load_s: float  # [s] to load the package and compiled code, before the first run
    laws_s: float  # [s] of CPU to compile the measuring code
    reference_s: float  # [s] to compute a reference
    measure_s: tuple[float, float, float]  # [s] to measure a short run, at each of ``SIZES``
    measure_us: tuple[float, float, float]  # [us] for each further step
    commands: dict[str, tuple[float, float]]  # [s] of wall time of a command, and of each run, trial or step of a body
    solvers: dict[str, SolverCost]


@functools.cache
def read_costs(path: Path = TABLE) -> Costs:
    """Read the table of costs, once per process; raise FileError if it is invalid."""
    return convert_shape(parse_toml(read_text(path, "costs"), path.name), Costs, path.name)


def measure_loop() -> float:
    """Return the CPU time [s] of a short loop of Python and NumPy, the median of seven: how fast this core is."""
    import numpy as np

    times, A = [], np.eye(6)
    for _ in range(7):
        began = time.process_time()
        for k in range(4000):
            A = A @ A + float(k % 3) * 1e-9
            A /= A[0, 0]
        times.append(time.process_time() - began)
    return median(times)


@dataclass(frozen=True)
class Slowness:
    """Hold the factors by which work takes longer here than on the idle machine of the table.

    A faster core solves and compiles faster, but starts processes, stores and measures no faster: that is the work of
    the system and of memory. A slower one is slower in both.
    """

    solving: float
    other: float


TABLE_MACHINE = Slowness(1.0, 1.0)


@functools.cache
def measure_slowness(jobs: int) -> Slowness:
    """Return the factors by which runs, ``jobs`` in parallel, take longer here than on the idle machine of the table.

    They include a slower core and other processes that compete for the cores. They are measured once per process for
    each number of jobs, by a loop and by counting the processes that run.
    """
    core = measure_loop() / read_costs().loop_s
    rivals = max(1.0, (count_running_processes() + jobs) / (os.cpu_count() or 1))
    return Slowness(core * rivals, max(1.0, core) * rivals)


def count_running_processes() -> float:
    """Return the number of other processes that are running now, the median of five counts 20 ms apart.

    Children of this process do not count: they work for it. The load of the last minute is no substitute, as it may
    stem from what this program did just before.
    """
    counts = []
    for _ in range(5):
        found = (p for p in psutil.process_iter(["status", "ppid"]) if os.getpid() not in (p.pid, p.info["ppid"]))
        counts.append(sum(p.info["status"] == psutil.STATUS_RUNNING for p in found))
        time.sleep(0.02)
    return median(counts)


def count_bodies_and_rows(system: MultibodySystem) -> float:
    """Return the size of a system in the table of costs: the number of its bodies and constraint rows together."""
    return float(system.nb + system.nrows)


def find_nearest_size(size: float) -> int:
    """Return the index in ``SIZES`` of the nearest size, by ratio."""
    return min(range(len(SIZES)), key=lambda k: abs(math.log(size / SIZES[k])))


def interpolate_by_size(values: Sequence[float], size: float) -> float:
    """Interpolate ``values``, one for each of ``SIZES``, at ``size``, linearly in logarithms; 0 if none is known.

    Values that are not positive are unknown and ignored. Above the largest known size the result grows in proportion to
    ``size``, below the smallest it is constant.
    """
    known = [(s, v) for s, v in zip(SIZES, values, strict=True) if v > 0.0]
    if not known:
        return 0.0
    if size >= known[-1][0]:
        return known[-1][1] * size / known[-1][0]
    for (a, low), (b, high) in itertools.pairwise(known):
        if size <= b:
            fraction = math.log(max(size, a) / a) / math.log(b / a)
            return low * math.exp(fraction * math.log(high / low))
    return known[0][1]


@dataclass(frozen=True)
class CostFactors:
    """Hold the properties of a problem that determine the cost of its runs."""

    t_end: float  # [s]
    dt: float  # [s] its default step
    size: float  # number of bodies and constraint rows
    has_computed_reference: bool


def _find_factors(spec: RunSpec, known: dict[str, CostFactors]) -> CostFactors:
    """Return the cost factors of a spec's problem from the cache ``known``, by variant; compute and add missing ones.

    A problem of a plugin is not created here: it is assumed to be one body with a computed reference.
    """
    name = format_name(spec.problem, spec.parameters)
    if name not in known:
        known[name] = (
            _find_factors_of_problem(registry.share_problem(spec.problem, spec.parameters))
            if _has_own_problem(spec)
            else CostFactors(float(spec.parameters.get("t_end", UNKNOWN_T)), UNKNOWN_STEP, SIZES[0], True)
        )
    return known[name]


def _has_own_problem(spec: RunSpec) -> bool:
    """Return whether the problem is one of ``problems/``."""
    return registry.is_own_problem(spec.problem)


def _find_factors_of_problem(problem: Problem) -> CostFactors:
    """Return the properties of a problem that determine the costs of its runs: times, size and kind of reference."""
    computed = describe_source(problem) in (Source.CERTIFIED, Source.COMPUTED)
    return CostFactors(problem.t_end, problem.dt, count_bodies_and_rows(problem.system), computed)


def predict_run_cost(spec: RunSpec, facts: CostFactors, costs: Costs, slow: Slowness = TABLE_MACHINE) -> float:
    """Return the expected wall time [s] of a run: process, set-up, repeated solves and measuring.

    ``facts`` are the cost factors of its problem, ``costs`` the table. The time is that on the machine of the table, or
    on one that takes longer by the factors ``slow``. A short solve is repeated until ``spec.min_time``.
    """
    # rows are examined in smaller numbers where systems are larger
    measuring = interpolate_by_size(costs.measure_s, min(facts.size, SIZES[-1]))
    measuring += _count_steps(spec, facts, costs) * interpolate_by_size(costs.measure_us, facts.size) * 1e-6
    set_up = interpolate_by_size(_find_solver_cost(spec, costs).setup_s, facts.size)
    solve = predict_solve_cost(spec, facts, costs)
    loop = spec.min_time if solve < SHORT else 0.0
    solving = max(slow.other * set_up + slow.solving * spec.repeats * solve, loop)
    return slow.other * (costs.process_s + measuring) + solving


def predict_solve_cost(spec: RunSpec, facts: CostFactors, costs: Costs) -> float:
    """Return the expected CPU time [s] of one solve on the machine of the table, at most the run's limit."""
    step = interpolate_by_size(_find_solver_cost(spec, costs).step_us, facts.size) * 1e-6
    return min(_count_steps(spec, facts, costs) * step, spec.cpu_limit)


def _count_steps(spec: RunSpec, facts: CostFactors, costs: Costs) -> float:
    """Estimate the number of accepted steps of a run, at most its limit on steps.

    With a tolerance, it is the solver's number at ``TOLERANCE`` from the table, scaled by a power of the tolerance.
    """
    solver, control = _find_solver_cost(spec, costs), spec.control
    if control.dt is not None:
        return min(facts.t_end / control.dt, float(control.max_steps))
    steps = solver.steps * facts.t_end / facts.dt * ((control.rtol or TOLERANCE) / TOLERANCE) ** -solver.power
    return min(steps, float(control.max_steps))


@functools.cache
def _find_median_cost(names: tuple[str, ...]) -> SolverCost:
    """Return costs that are medians over the solvers ``names`` of the table, with no time to compile."""
    own = [s for name, s in read_costs().solvers.items() if name in names]

    def middle(values: Iterable[float]) -> float:
        """Return the median of the positive values, as others are unknown; 0 if there are none."""
        return median([v for v in values if v > 0.0] or [0.0])

    setup, step = ([middle(getattr(s, name)[k] for s in own) for k in range(3)] for name in ("setup_s", "step_us"))
    return SolverCost(
        0.0,
        (setup[0], setup[1], setup[2]),
        (step[0], step[1], step[2]),
        middle(s.steps for s in own),
        middle(s.power for s in own),
    )


def _find_solver_cost(spec: RunSpec, costs: Costs) -> SolverCost:
    """Return the costs of the spec's solver from the table.

    For a solver that the table lacks, they are medians over those that, like it, control the step or the error.
    """
    adaptive = spec.control.dt is None
    alike = tuple(name for name, s in costs.solvers.items() if (s.steps > 0.0) is adaptive)
    return costs.solvers.get(spec.solver) or _find_median_cost(alike)


def select_quick_solvers(specs: Sequence[RunSpec]) -> set[str]:
    """Return the names of the solvers of ``specs`` that have a run shorter than ``SOON`` and need no long compilation.

    Their code is cached, or compiled within ``QUICK``. Solvers that the table of costs lacks are left out.
    """
    prepared, costs, known = WarmCaches(), read_costs(), dict[str, CostFactors]()
    own = [s for s in specs if s.solver in costs.solvers and predict_run_cost(s, _find_factors(s, known), costs) < SOON]
    return {s.solver for s in own if costs.solvers[s.solver].compile_s < QUICK or prepared.contains(s.solver)}


def predict_times(specs: Sequence[RunSpec], jobs: int, suite: str = "", local: Path | None = None) -> Expectation:
    """Return the expected wall times of ``specs`` on this machine, ``jobs`` in parallel.

    Times recorded in the newest results folders in ``local`` (None: ``results/local``) take precedence over estimates,
    those of ``suite`` first. No run is executed; a short loop is timed and the running processes are counted.
    """
    if not specs:
        return Expectation({}, jobs=jobs)
    costs, slow = read_costs(), measure_slowness(jobs)
    earlier = read_durations(local or store.LOCAL, suite)
    known: dict[str, CostFactors] = {}
    own = {
        s.settings_id: earlier.get(s.settings_id) or predict_run_cost(s, _find_factors(s, known), costs, slow)
        for s in specs
    }
    runs = {settings: seconds + slow.other * costs.store_s for settings, seconds in own.items()}
    return Expectation(runs, slow.other * costs.load_s, slow.solving * _predict_shared_cost(specs, costs, known), jobs)


def describe_command(name: str, count: int, jobs: int = 1) -> str:
    """Return how long a command takes here for ``count`` runs, trials or steps, such as ``about 20 s``.

    ``name`` is one of the commands of ``costs.toml``; ``jobs`` runs, trials or steps are done in parallel.
    """
    return f"about {format_duration(max(1.0, predict_command(name, count, jobs)))}"


def predict_command(name: str, count: int, jobs: int = 1) -> float:
    """Return the expected wall time [s] of a command here; the arguments are those of ``describe_command``."""
    start, each = read_costs().commands[name]
    return measure_slowness(jobs).other * (start + each * count / jobs)


def predict_pages(count: int) -> float:
    """Return how long it takes here to judge ``count`` runs and to write their report, by ``report --judge`` [s]."""
    return predict_command("judged_report", count)


def expect_solves(counted: Sequence[tuple[RunSpec, int]], jobs: int) -> Expectation:
    """Return the expected times of solving specs repeatedly in ``jobs`` parallel processes.

    ``counted`` pairs each spec with its number of solves. Only solves, loading and compilation count: the solves need
    no process of their own, and nothing is measured.
    """
    costs, slow, known = read_costs(), measure_slowness(jobs), dict[str, CostFactors]()
    runs = {
        s.settings_id: slow.solving * n * predict_solve_cost(s, _find_factors(s, known), costs) / jobs
        for s, n in counted
    }
    once = slow.solving * _predict_shared_cost([s for s, _ in counted], costs, known)
    return Expectation(runs, slow.other * costs.load_s, once, 1)


def _predict_shared_cost(specs: Sequence[RunSpec], costs: Costs, known: dict[str, CostFactors]) -> float:
    """Return the wall time [s] to compile all code and compute all references that no cache holds, in parallel.

    ``known`` caches cost factors by variant. What all solvers of index 1 compile, ``SHARED``, counts once.
    """
    warm = WarmCaches()
    motions = [s for s in select_run_per_motion(specs) if _find_factors(s, known).has_computed_reference]
    named = (name_reference(format_name(s.problem, s.parameters)) for s in motions)
    references = sum(costs.reference_s for name in named if not warm.contains(name))
    cold = dict.fromkeys(s.solver for s in list_runs_to_warm(specs) if not warm.contains(s.solver))
    compiled = [costs.solvers[name].compile_s for name in cold if name in costs.solvers]
    shared = SHARED if max(compiled, default=0.0) > SHARED else 0.0
    own = sum(c - shared if c > shared else c for c in compiled)
    laws = 0.0 if warm.contains(LAWS) else costs.laws_s
    # code that is made for a system, by its first run
    firsts = {(s.solver, find_nearest_size(_find_factors(s, known).size)) for s in specs if s.solver in cold}
    own += sum(costs.solvers[name].generate_s[k] for name, k in firsts if name in costs.solvers)
    whole, longest = laws + references + shared + own, max([laws, min(references, costs.reference_s), *compiled])
    return max(whole / min(os.cpu_count() or 1, ABREAST), longest)


def name_reference(variant: str) -> str:
    """Return the name in ``WarmCaches`` of the reference of a ``variant``, a problem with its parameters."""
    return f"reference of {variant}"


class WarmCaches:
    """Record on disk which compiled code and references the caches of this machine hold.

    Each name has a digest of the code behind it. The file is read once, when the object is created.
    """

    def __init__(self) -> None:
        folder = make_cache_folder("warmed", ROOT / IN_CHECKOUT["warmed"])
        self.path = folder / "warmed.json"
        self.names: dict[str, Any] = {}
        with contextlib.suppress(FileError):
            found = parse_json(read_text(self.path, "what was compiled"), str(self.path))
            self.names = found if isinstance(found, dict) else {}

    def contains(self, name: str) -> bool:
        """Return whether ``name``, a solver, a reference or ``LAWS``, is recorded for this code and processor."""
        return self.names.get(name) == _digest_for(name)

    def add(self, names: Iterable[str]) -> None:
        """Record that the caches hold ``names``, here and on disk.

        If the file cannot be written, only the next estimate is too long.
        """
        new = {name: _digest_for(name) for name in names}
        if new.items() <= self.names.items():
            return
        self.names |= new
        with contextlib.suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_text(self.path, to_json(self.names))


def _digest_for(name: str) -> str:
    """Return a digest, as text, of the code behind a name of ``WarmCaches`` and of the processor it is compiled for."""
    sources = package_sources()
    problem = name.removeprefix("reference of ").partition("[")[0]
    own = sources.measuring if name == LAWS else sources.solvers.get(name) or sources.problems.get(problem, "")
    return json.dumps([own, *find_llvm_target()])
