"""Calls of solvers in a process that keeps no code yet: what they make outside the meter, by the compilers' own events.

``python -m mbsbench.tests.harness.run.cold_calls CALL ...`` with ``MBSBENCH_CACHE`` set to an empty folder writes
a line of JSON for each. A call is ``SOLVER[:PROBLEM[:T_END[:DT]]]``, with all options of the suites; with ``!`` behind
it pivots of code in joint coordinates count as poor, so that it is made anew.
"""

import contextlib
import dataclasses
import inspect
import json
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import llvmlite.binding as llvm

from mbsbench.harness.base.clock import cpu_seconds
from mbsbench.harness.base.code_meter import code_seconds, is_making_code, listen_to_numba
from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.mechanics.types import Problem
from mbsbench.harness.run.worker import solve
from mbsbench.solvers.formulations.compiled import host
from mbsbench.solvers.formulations.joint_coordinates import marching, symplectic

OF_LLVM = (  # all machine code goes through these: ours, and numba's
    (llvm, "parse_assembly"),
    (llvm, "parse_bitcode"),
    (llvm, "create_mcjit_compiler"),
    (llvm.TargetMachine, "emit_object"),
    (llvm.ExecutionEngine, "add_object_file"),
    (llvm.ExecutionEngine, "add_module"),
    (llvm.ExecutionEngine, "finalize_object"),
)
OF_CASADI = ((ca, "jacobian"), (ca, "substitute"), (ca, "jtimes"), (ca.SX, "sym"), (ca.Function, "__init__"))
SAFE = marching.LEAST_PIVOT, symplectic.POOR_PIVOT
POOR = 0.999  # of its start: a pivot below it is poor
LIMIT = 1.0  # [s] of CPU: ten times what any call takes, a tenth of what its code does
SHORT = 1e-2  # [s]: some steps of error-controlled solvers


class Events:
    """What compilers did and Python imported while ``watched``, in the open and within the meter."""

    def __init__(self) -> None:
        self.metered, self.unmetered, self._thread = Counter[str](), Counter[str](), 0
        for owner, name in (*OF_LLVM, *OF_CASADI):
            whole = f"{getattr(owner, '__name__', owner)}.{name}"
            plain = inspect.getattr_static(owner, name)
            static = isinstance(plain, staticmethod | classmethod)
            setattr(
                owner,
                name,
                staticmethod(self._tell(whole, getattr(owner, name))) if static else self._tell(whole, plain),
            )
        sys.addaudithook(self._hear)

    @contextlib.contextmanager
    def watched(self) -> Iterator[None]:
        """Count from zero within."""
        self.metered.clear()
        self.unmetered.clear()
        self._thread = threading.get_ident()
        try:
            yield
        finally:
            self._thread = 0

    def _tell(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def told(*given: Any, **named: Any) -> Any:
            self._count(name)
            return function(*given, **named)

        return told

    def _hear(self, event: str, given: tuple[Any, ...]) -> None:
        if event == "import":
            self._count(f"import of {given[0]}")

    def _count(self, name: str) -> None:
        if self._thread == threading.get_ident():
            (self.metered if is_making_code() else self.unmetered)[name] += 1


def shorten(spec: RunSpec, t_end: float | None) -> Problem:
    """The problem of a run until ``t_end`` [s], or for some steps."""
    problem = registry.make_problem(spec.problem, spec.parameters)
    t_end = t_end or (4.0 * spec.control.dt if spec.control.dt else SHORT)
    return dataclasses.replace(problem, t_end=min(problem.t_end, t_end))


def call(events: Events, spec: RunSpec, t_end: float | None = None) -> dict[str, Any]:
    """One call as a worker times it, and what was made in it."""
    problem, solver = shorten(spec, t_end), registry.make_solver(spec.solver, spec.options)
    before, code = cpu_seconds(), code_seconds()
    with events.watched(), marchers_counted() as marchers:
        handed = solve(problem, solver, dataclasses.replace(spec.control, cpu_limit=LIMIT))
    spent, made = cpu_seconds() - before, code_seconds() - code
    cost = {name: float(value) for name, value in handed.report.cost.items()}
    notes, own = (t.notes, t.cpu_time) if (t := handed.trajectory) else ((), 0.0)
    return {
        "solver": spec.solver,
        "problem": spec.problem,
        "options": dict(spec.options),
        "t_end": t_end,
        "status": str(handed.report.claimed),
        "notes": notes,
        "marchers": len(marchers),
        "metered": dict(events.metered),
        "unmetered": dict(events.unmetered),
        "spent": spent,
        "made": made,
        "cost": cost,
        "own": own,
    }


@contextlib.contextmanager
def marchers_counted() -> Iterator[list[object]]:
    """Every method at work on a kernel: a second one is a second route."""
    found, plain = list[object](), host.Marcher.__init__

    def counted(self: host.Marcher, *given: Any) -> None:
        found.append(self)
        plain(self, *given)

    host.Marcher.__init__ = counted  # type: ignore[method-assign]
    try:
        yield found
    finally:
        host.Marcher.__init__ = plain  # type: ignore[method-assign]


def cases_of_suites(suites: Sequence[str]) -> list[RunSpec]:
    """The first run of each solver with the same options on each problem; tolerances and gains aside."""
    first: dict[str, RunSpec] = {}
    for suite in suites:
        for spec in load_suite(suite).specs:
            if registry.is_own_solver(spec.solver) and registry.is_own_problem(spec.problem):
                options = {k: v != 0.0 if isinstance(v, float) else v for k, v in spec.options.items()}
                key = json.dumps([spec.problem, spec.solver, options], sort_keys=True, default=list)
                first.setdefault(key, spec)
    return list(first.values())


def main(chosen: Sequence[str]) -> None:
    """Write what comes of the calls that are named."""
    listen_to_numba()
    host.EVALUATIONS_THAT_PAY = 0  # runs change to code of the mechanism at once
    events = Events()
    specs = cases_of_suites(("ci", "bench", "paper", "library", "long"))
    for name in chosen:
        solver, problem, t_end, dt = (*name.rstrip("!").split(":"), "", "", "")[:4]
        marching.LEAST_PIVOT, symplectic.POOR_PIVOT = (POOR, POOR) if name.endswith("!") else SAFE
        for spec in specs:
            if spec.solver == solver and problem in ("", spec.problem):
                steps = dataclasses.replace(spec.control, dt=float(dt)) if dt else spec.control
                found = call(events, dataclasses.replace(spec, control=steps), float(t_end) if t_end else None)
                sys.stdout.write(json.dumps(found, default=list) + "\n")
                sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
