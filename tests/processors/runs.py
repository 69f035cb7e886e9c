"""Runs to compare between processors: which, in what order, how they are solved, and the digests of what comes out.

The order is a rule: the short runs of ``families.toml``, one for each family of solvers; then the cheapest run of each
solver, by the CPU time here, then the second of each, and so on.
"""

import dataclasses
import hashlib
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

HERE = Path(__file__).resolve()
FAMILIES = "families"
STEPS = 20  # of a shortened run at fixed size; a rounding that differs shows in the first
SHORT = 0.05  # [s] of simulated time of a shortened run under error control
TELLING = ("spherical_pendulum[omega_z=3", "chain", "four_bar_grid")  # spatial and loaded; long; redundant


class Solved(NamedTuple):
    """The outcome of one run in one process."""

    case: str
    solver: str
    status: str
    steps: int
    motion: str  # digest of the trajectory
    measured: str  # digest of the record's numbers and the series; empty of a shortened run
    cpu: float  # [s]
    message: str = ""
    rtol: float = 0.0
    parts: dict[str, str] | None = None  # digests of the arrays of a shortened run, by their names
    last: dict[str, list[float]] | None = None  # its last state and reaction, by the same names


class Planned(NamedTuple):
    """A run to solve."""

    suite: str
    number: int  # in the suite
    cpu: float  # [s] here


def read_suite(name: str) -> Sequence[Any]:
    """Return the runs of a suite, by its name or as the file of that name beside this one."""
    from mbsbench.harness.catalogue.suites.suite import load_suite

    beside = HERE.with_name(f"{name}.toml")
    return load_suite(str(beside) if beside.exists() else name).specs


def put_in_order(solved: Sequence[tuple[str, int, Solved]], telling: Sequence[str] = ()) -> list[Planned]:
    """Order runs, given as suite, number and outcome, by the rule above; those of ``telling`` problems are cheapest."""

    def rank(entry: tuple[str, int, Solved]) -> tuple[bool, list[bool], float]:
        suite, _, s = entry
        return suite != FAMILIES, [not s.case.startswith(name) for name in telling], s.cpu

    counted = Counter[str]()
    ranked = []
    for entry in sorted(solved, key=rank):
        suite, number, s = entry
        ranked.append((suite != FAMILIES, counted[s.solver], rank(entry), Planned(suite, number, s.cpu)))
        counted[s.solver] += suite != FAMILIES
    return [planned for *_, planned in sorted(ranked)]


def shorten(spec: Any) -> Any:
    """Return a run with its first steps, or the first instants of one under error control."""
    t_end = SHORT if spec.control.dt is None else STEPS * spec.control.dt
    return dataclasses.replace(spec, parameters={**spec.parameters, "t_end": t_end})


def solve(spec: Any) -> Solved:
    """Solve one run, measure it, and digest all bytes of both."""
    import mbsbench
    from mbsbench.harness.results.comparison import METRICS

    began = time.process_time()
    given = {k: v for k in ("dt", "rtol", "max_step") if (v := getattr(spec.control, k)) is not None}
    run = mbsbench.solve(mbsbench.make_problem(spec.problem, spec.parameters), spec.solver, **given, **spec.options)
    return Solved(
        spec.case,
        spec.solver,
        run.record.status,
        run.record.steps,
        digest(motion_of(run)),
        digest(measured_of(run, METRICS)),
        time.process_time() - began,
    )


def solve_shortened(spec: Any) -> Solved:
    """Solve the begin of one run, and digest its motion, in which a zero has no sign: equal numbers have equal bits."""
    from mbsbench.harness.catalogue import registry

    began, short = time.process_time(), shorten(spec)
    problem = registry.make_problem(short.problem, short.parameters)
    solver = registry.make_solver(short.solver, short.options)
    if (reason := solver.refuses(problem, short.control)) is not None:
        return Solved(spec.case, spec.solver, "refused", 0, "", "", time.process_time() - began, str(reason))
    trajectory = solver.solve(problem, short.control)
    arrays = {k: np.ascontiguousarray(a, dtype=float) + 0.0 for k, a in name_arrays(trajectory) if a is not None}
    return Solved(
        spec.case,
        spec.solver,
        str(trajectory.status),
        len(trajectory.t) - 1,
        digest(a.tobytes() for a in arrays.values()),
        "",
        time.process_time() - began,
        trajectory.message,
        short.control.rtol or 0.0,
        {k: digest([a.tobytes()]) for k, a in arrays.items()},
        {k: a[-1].ravel().tolist() for k, a in arrays.items()},
    )


def name_arrays(trajectory: Any) -> Iterator[tuple[str, Any]]:
    """Yield the arrays of a motion with their names."""
    yield "t", trajectory.t
    for name in ("r", "R", "v", "Omega"):
        yield name, getattr(trajectory.states, name)
    yield "reaction", trajectory.reaction


def motion_of(run: Any) -> Iterator[bytes]:
    """Yield all bytes of a trajectory; none of a run that was refused."""
    if run.trajectory is not None:
        yield from (b"none" if a is None else a.tobytes() for _, a in name_arrays(run.trajectory))


def measured_of(run: Any, metrics: Sequence[str]) -> Iterator[bytes]:
    """Yield all bytes of the record's numbers, of its message and of the series."""
    yield repr([getattr(run.record, name) for name in metrics]).encode()
    yield run.record.message.encode()
    if run.series is not None:
        for name, array in sorted(run.series.arrays.items()):
            yield name.encode()
            yield array.tobytes()


def digest(parts: Any) -> str:
    """Return the digest of bytes."""
    summed = hashlib.sha256()
    for part in parts:
        summed.update(part)
    return summed.hexdigest()[:16]
