"""How long runs will take on this machine, before any of them has begun: ``expect``, for every command that says so.

A run of which a results folder of this place has the record takes what it took then. Of any other the time comes from
``costs.toml``, what a step takes by solver and size of system on a quiet machine, times how much slower a short loop is
here. What is compiled or computed once is remembered beside the caches that hold it: with empty ones it counts again.
"""

import contextlib
import functools
import itertools
import json
import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import psutil

from ..cache import IN_CHECKOUT, ROOT, cache_folder
from ..catalogue import registry
from ..files import FileError, parse_json, parse_toml, read_text, to_json, write_text
from ..machine import llvm_target
from ..mechanics.system import MultibodySystem
from ..reference.computation import Source, source_of
from ..results import store
from ..results.codes import package_sources
from ..results.naming import format_name
from ..shapes import Shape, convert_shape
from ..suites.spec import RunSpec
from ..types import Problem
from .contract import SHORT
from .eta import durations, in_words, schedule_end
from .warmup import ABREAST, list_motions, runs_to_warm

TABLE = Path(__file__).with_name("costs.toml")
SIZES = (4.0, 63.0, 455.0)  # bodies and rows of one body, the chain and the grid, at which the table was measured
QUICK = 1.0  # [s] of compiling that nobody waits for
SOON = 3.0  # [s] a run, if others are to wait for it
TOLERANCE = 1e-8  # rtol at which the table counts steps
SHARED = 6.2  # [s] of compiling that all solvers of index 1 share: the kernels of accelerations
LAWS = "laws"  # the name under which compiled passes of measuring are remembered
UNKNOWN_T, UNKNOWN_STEP = 10.0, 1e-3  # [s] simulated time and step of a plugin's problem, which is not made here


class SolverCost(Shape, frozen=True):
    """The cost of a solver; three numbers are for the three ``SIZES``, -1 where it was not run."""

    compile_s: float  # [s] of CPU the first time
    setup_s: tuple[float, float, float]  # [s] a run
    step_us: tuple[float, float, float]  # [us] a step
    steps: float = 0.0  # accepted, for each step of the problem's own length, at rtol = 1e-8
    power: float = 0.0  # of 1 / rtol in the number of steps


class Costs(Shape, frozen=True):
    """The content of ``costs.toml``."""

    loop_s: float  # [s] of ``measure_loop`` on the machine of the table
    process_s: float  # [s] to start and end the processes of a run
    store_s: float  # [s] from its record to the next run in its place: its files are written, its news told
    load_s: float  # [s] to load the package and compiled code, before the first run
    laws_s: float  # [s] of CPU to compile what measures
    reference_s: float  # [s] to compute a reference
    measure_s: float  # [s] to measure a short run
    measure_us: tuple[float, float, float]  # [us] for each step more
    commands: dict[str, tuple[float, float]]  # [s] of wall time of a command, and for each run, trial, step of a body
    solvers: dict[str, SolverCost]


@functools.cache
def read_costs(path: Path = TABLE) -> Costs:
    """The table."""
    return convert_shape(parse_toml(read_text(path, "costs"), path.name), Costs, path.name)


def measure_loop() -> float:
    """Return the CPU time [s] of a short loop of Python and NumPy, the median of several: how fast a core is."""
    import numpy as np

    times, A = [], np.eye(6)
    for _ in range(7):
        began = time.process_time()
        for k in range(4000):
            A = A @ A + float(k % 3) * 1e-9
            A /= A[0, 0]
        times.append(time.process_time() - began)
    return median(times)


@functools.cache
def slowness(jobs: int) -> float:
    """How many times longer than on the idle machine of the table a run takes here, ``jobs`` at a time.

    A core may be slower, and other processes may want it.
    """
    cores = os.cpu_count() or 1
    return measure_loop() / read_costs().loop_s * max(1.0, (count_rivals() + jobs) / cores)


def count_rivals() -> float:
    """Return how many other processes want a core now, the median of five looks.

    Not the load of the last minute: after a first pass, or a build, that was our own.
    """
    looks = []
    for _ in range(5):
        states = ((p.pid, p.info["status"]) for p in psutil.process_iter(["status"]))
        looks.append(sum(status == psutil.STATUS_RUNNING for pid, status in states if pid != os.getpid()))
        time.sleep(0.02)
    return median(looks)


def size_of(system: MultibodySystem) -> float:
    """Bodies and rows."""
    return float(system.nb + system.nrows)


def nearest_size(size: float) -> int:
    """Which of ``SIZES`` is nearest, by ratio."""
    return min(range(len(SIZES)), key=lambda k: abs(math.log(size / SIZES[k])))


def at_size(values: Sequence[float], size: float) -> float:
    """Interpolate ``values`` at ``SIZES`` by powers; beyond the measured ones in proportion to the size."""
    known = [(s, v) for s, v in zip(SIZES, values, strict=True) if v > 0.0]
    if not known:
        return 0.0
    if size >= known[-1][0]:
        return known[-1][1] * size / known[-1][0]
    for (a, low), (b, high) in itertools.pairwise(known):
        if size <= b:
            share = math.log(max(size, a) / a) / math.log(b / a)
            return low * math.exp(share * math.log(high / low))
    return known[0][1]


@dataclass(frozen=True)
class Facts:
    """What of a problem decides on the cost of its runs."""

    t_end: float  # [s]
    dt: float  # [s] its own step
    size: float
    has_computed_reference: bool


def _facts(spec: RunSpec, known: dict[str, Facts]) -> Facts:
    name = format_name(spec.problem, spec.parameters)
    if name not in known:
        known[name] = _facts_of(registry.make_problem(spec.problem, spec.parameters)) if _is_own(spec) else Facts(
            float(spec.parameters.get("t_end", UNKNOWN_T)), UNKNOWN_STEP, SIZES[0], True
        )  # fmt: skip
    return known[name]


def _is_own(spec: RunSpec) -> bool:
    return registry.is_own_problem(spec.problem)


def _facts_of(problem: Problem) -> Facts:
    computed = source_of(problem) in (Source.CERTIFIED, Source.COMPUTED)
    return Facts(problem.t_end, problem.dt, size_of(problem.system), computed)


def cost_of_run(spec: RunSpec, facts: Facts, costs: Costs) -> float:
    """Return the wall time [s] of a run on the machine of the table: process, set-up, solver, measuring."""
    measuring = costs.measure_s + _count_steps(spec, facts, costs) * at_size(costs.measure_us, facts.size) * 1e-6
    set_up = at_size(_cost_of(spec, costs).setup_s, facts.size)
    solve = cost_of_solve(spec, facts, costs)
    loop = spec.min_time if solve < SHORT else 0.0
    return costs.process_s + max(set_up + spec.repeats * solve, loop) + measuring


def cost_of_solve(spec: RunSpec, facts: Facts, costs: Costs) -> float:
    """Return the CPU time [s] of the solver on the machine of the table."""
    step = at_size(_cost_of(spec, costs).step_us, facts.size) * 1e-6
    return min(_count_steps(spec, facts, costs) * step, spec.cpu_limit)


def _count_steps(spec: RunSpec, facts: Facts, costs: Costs) -> float:
    solver, control = _cost_of(spec, costs), spec.control
    if control.dt is not None:
        return min(facts.t_end / control.dt, float(control.max_steps))
    steps = solver.steps * facts.t_end / facts.dt * ((control.rtol or TOLERANCE) / TOLERANCE) ** -solver.power
    return min(steps, float(control.max_steps))


@functools.cache
def _middle_of(names: tuple[str, ...]) -> SolverCost:
    own = [s for name, s in read_costs().solvers.items() if name in names]

    def middle(values: Iterable[float]) -> float:
        return median([v for v in values if v > 0.0] or [0.0])

    setup, step = ([middle(getattr(s, name)[k] for s in own) for k in range(3)] for name in ("setup_s", "step_us"))
    return SolverCost(0.0, (setup[0], setup[1], setup[2]), (step[0], step[1], step[2]),
                      middle(s.steps for s in own), middle(s.power for s in own))  # fmt: skip


def _cost_of(spec: RunSpec, costs: Costs) -> SolverCost:
    """The solver's cost; of one that the table does not know, the medians of those that are controlled as it is."""
    adaptive = spec.control.dt is None
    alike = tuple(name for name, s in costs.solvers.items() if (s.steps > 0.0) is adaptive)
    return costs.solvers.get(spec.solver) or _middle_of(alike)


@dataclass(frozen=True)
class Expectation:
    """The wall times [s] that runs will take here, and what comes before the first."""

    runs: Mapping[str, float]  # by ``settings_id``
    loading: float
    once: float  # compiling kernels and computing references that no cache holds
    jobs: int  # at a time

    @property
    def seconds(self) -> float:
        """From the call to the last result."""
        return self.loading + self.once + schedule_end([], list(self.runs.values()), self.jobs)

    @property
    def words(self) -> str:
        """``about 9 min 20 s, of it 1 min 5 s to compile kernels and compute references, this once``."""
        once = f", of it {in_words(self.once)} to compile kernels and compute references, this once"
        return f"about {in_words(self.seconds)}{once * self.is_cold}"

    @property
    def is_cold(self) -> bool:
        """Whether something has to be compiled or computed that later calls find in the caches."""
        return self.once >= QUICK


def select_quick(specs: Sequence[RunSpec]) -> set[str]:
    """Name the solvers of ``specs`` that need no code compiled first, and whose runs are known not to take long."""
    prepared, costs, known = Prepared(), read_costs(), dict[str, Facts]()
    own = [s for s in specs if s.solver in costs.solvers and cost_of_run(s, _facts(s, known), costs) < SOON]
    return {s.solver for s in own if costs.solvers[s.solver].compile_s < QUICK or prepared.has(s.solver)}


def expect(specs: Sequence[RunSpec], jobs: int, suite: str = "", local: Path | None = None) -> Expectation:
    """Return what ``specs`` will take here, ``jobs`` at a time; nothing is run but a loop of some milliseconds."""
    costs, slow = read_costs(), slowness(jobs)
    earlier = durations(local or store.LOCAL, suite)
    known: dict[str, Facts] = {}
    own = {s.settings_id: earlier.get(s.settings_id) or slow * cost_of_run(s, _facts(s, known), costs) for s in specs}
    runs = {settings: seconds + slow * costs.store_s for settings, seconds in own.items()}
    if not specs:
        return Expectation(runs, 0.0, 0.0, jobs)
    return Expectation(runs, slow * costs.load_s, slow * _cost_of_once(specs, costs, known), jobs)


def describe_command(name: str, count: int, jobs: int = 1) -> str:
    """Return ``about 20 s``: what a command of the table takes here for ``count`` runs, trials or steps of bodies."""
    start, each = read_costs().commands[name]
    return f"about {in_words(max(1.0, slowness(jobs) * (start + each * count / jobs)))}"


def expect_solves(counted: Sequence[tuple[RunSpec, int]], jobs: int) -> Expectation:
    """Return the same for solving each spec a number of times, ``jobs`` at a time, without a process for each."""
    costs, slow, known = read_costs(), slowness(jobs), dict[str, Facts]()
    runs = {s.settings_id: slow * n * cost_of_solve(s, _facts(s, known), costs) / jobs for s, n in counted}
    return Expectation(runs, slow * costs.load_s, slow * _cost_of_once([s for s, _ in counted], costs, known), 1)


def _cost_of_once(specs: Sequence[RunSpec], costs: Costs, known: dict[str, Facts]) -> float:
    """Wall time [s] to compile and compute what is not remembered: laws, references and solvers abreast."""
    warm = Prepared()
    motions = [s for s in list_motions(specs) if _facts(s, known).has_computed_reference]
    named = (reference_name(format_name(s.problem, s.parameters)) for s in motions)
    references = sum(costs.reference_s for name in named if not warm.has(name))
    cold = dict.fromkeys(s.solver for s in runs_to_warm(specs) if not warm.has(s.solver))
    compiled = [costs.solvers[name].compile_s for name in cold if name in costs.solvers]
    shared = SHARED if max(compiled, default=0.0) > SHARED else 0.0
    own = sum(c - shared if c > shared else c for c in compiled)
    laws = 0.0 if warm.has(LAWS) else costs.laws_s
    whole, longest = laws + references + shared + own, max([laws, min(references, costs.reference_s), *compiled])
    return max(whole / min(os.cpu_count() or 1, ABREAST), longest)


def reference_name(variant: str) -> str:
    """The name under which the reference of a problem with its parameters is remembered."""
    return f"reference of {variant}"


class Prepared:
    """What the caches of this machine hold for this code, as far as was seen when it was made."""

    def __init__(self) -> None:
        folder = cache_folder("warmed", ROOT / IN_CHECKOUT["warmed"])
        self.path = folder / "warmed.json"
        self.names: dict[str, Any] = {}
        with contextlib.suppress(FileError):
            found = parse_json(read_text(self.path, "what was compiled"), str(self.path))
            self.names = found if isinstance(found, dict) else {}

    def has(self, name: str) -> bool:
        """Whether it was compiled or computed by the code of today."""
        return self.names.get(name) == _digest_for(name)

    def add(self, names: Iterable[str]) -> None:
        """Remember; where nothing can be written, the next estimate is too long, and that is all."""
        new = {name: _digest_for(name) for name in names}
        if new.items() <= self.names.items():
            return
        self.names |= new
        with contextlib.suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_text(self.path, to_json(self.names))


def _digest_for(name: str) -> str:
    """The code that is compiled under a name, and the processor that it is compiled for."""
    sources = package_sources()
    problem = name.removeprefix("reference of ").partition("[")[0]
    own = sources.measuring if name == LAWS else sources.solvers.get(name) or sources.problems.get(problem, "")
    return json.dumps([own, *llvm_target()])
