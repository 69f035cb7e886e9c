"""Find the cheapest solver and setting that meet an error on a problem, from new or earlier runs (``advise``)."""

import argparse
import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rich.text import Text

from ..harness.base.naming import format_name
from ..harness.catalogue import registry
from ..harness.catalogue.mechanism import MechanismFile
from ..harness.catalogue.suites.spec import RunSpec
from ..harness.catalogue.suites.suite import Suite
from ..harness.catalogue.trial import make_problem
from ..harness.judge.cost import Candidate, compute_cost, rank_candidates
from ..harness.judge.distance import RESOLVED
from ..harness.mechanics.types import Problem
from ..harness.reference.computation import is_computable
from ..harness.results import store
from ..harness.results.records import RunRecord
from ..harness.results.words import qualify_status
from ..harness.run.costs import predict_times, select_quick_solvers
from ..harness.run.runner import Request
from .arguments import UsageError, count_jobs, load_problem, parse_assignments
from .commands import CONTROL
from .progress import announce_suite, run_watched
from .terminal import (
    Column,
    choose_status_style,
    make_error_console,
    make_table_console,
    number,
    plural,
    print_json,
    print_table,
)
from .version import ADD_ENGINES

# most settings tried of a solver. Of 389 searches on published ladders, interpolated, half leaves 3 without a setting
# that meets the error, and as many as now or twice none.
ROUNDS = 6
TYPICAL = 3  # typical number of settings, of at most ROUNDS, until a solver meets the error
LARGE = 0.1  # fraction of the reach: larger errors are called inaccurate
COLUMNS = (
    Column("solver", right=False),
    Column("setting", right=False),
    Column("motion error [m]"),
    Column("CPU [s]"),
    Column("factor"),
    Column("steps", rank=1),
    Column("why not", fold=True, rank=2),
)


def run(arguments: argparse.Namespace) -> int:
    """Find settings that meet the error by new runs, or with --from in earlier ones; print solvers, the cheapest first.

    Return 0 if a solver meets the error, else 1.
    """
    name, parameters, plugins = load_problem(arguments)
    error, budget = arguments.error, arguments.budget
    problem = make_problem(name, parameters)
    for solver in arguments.solver:
        registry.find_entry("solver", solver, registry.solvers())
    options = _read_options(arguments)
    if arguments.results:
        candidates = _read_candidates(arguments.results, problem, error, arguments.solver)
    else:
        names = arguments.solver or list(registry.solvers())
        limit = min(max(budget / 6.0, 1.0), 60.0)  # [s] of CPU time a run, so that one solver does not take all
        candidates = [Candidate(n, problem, error, limit, options=options) for n in names]
        _search_settings(candidates, plugins, budget, count_jobs(arguments.jobs), quiet=arguments.json)
    return _print_report(rank_candidates(candidates), error, as_json=arguments.json)


def _read_options(arguments: argparse.Namespace) -> dict[str, str]:
    """Return the solver options given by --set; raise UsageError unless the only --solver takes them."""
    options = parse_assignments(arguments.set, "--set")
    if options and (len(arguments.solver) != 1 or arguments.results):
        raise UsageError("--set is for the runs of one --solver: name it, and leave --from out")
    for key in CONTROL:
        if key in options:
            raise UsageError(f"--set {key}: the search chooses it; mbsbench solve runs one setting")
    if options:
        registry.make_solver(arguments.solver[0], options)
    return options


def _search_settings(
    candidates: list[Candidate], plugins: tuple[str, ...], budget: float, size: int, *, quiet: bool
) -> None:
    """Run one setting of every candidate per round, each choosing its next one, and add the runs to the candidates.

    If only some solvers need compilation, a round of the others goes first. The search ends when no candidate has a
    next setting, after ``ROUNDS`` rounds, or when the CPU time of all runs, divided by the number ``size`` of runs in
    parallel, exceeds ``budget`` [s]. Raise UsageError if the problem has no reference.
    """
    problem = candidates[0].problem
    is_known = not problem.literal_start and is_computable(problem.system)
    if not is_known and problem.reference() is None:  # evaluated last: a reference may take seconds to compute
        raise UsageError(f"{problem.name} has no reference: no error is known; compare solvers with mbsbench run")
    first = [s for c in candidates if (s := c.choose_next_spec()) is not None]
    quick = select_quick_solvers(first)
    early = [c for c in candidates if c.solver in quick]
    rounds = [*([early] if 0 < len(early) < len(candidates) else []), *[candidates] * ROUNDS]
    if not quiet:
        announce_suite(describe_plan(first, size), make_error_console())
    with tempfile.TemporaryDirectory() as place:
        for k, chosen in enumerate(rounds):
            asked = {s.settings_id: (c, s) for c in chosen if (s := c.choose_next_spec()) is not None}
            if not asked:
                break
            if k and not quiet:
                _print_progress(rank_candidates(candidates), len(candidates), first=k == 1)
            suite = Suite("advise", "", tuple(s for _, s in asked.values()), "", plugins)
            request = Request(suite, Path(place) / f"round{k}", size)
            loaded, _ = run_watched(request, quiet=quiet, resumable=False, announces=False)
            for r in loaded.records:
                asked[r.settings_id][0].runs.append(r)
            if sum(_compute_cpu_without_code(r) for c in candidates for r in c.runs) / size > budget:
                break


def describe_plan(first: Sequence[RunSpec], size: int) -> str:
    """Describe how many settings will be run, and about how long they take on this machine.

    ``first`` are the runs of the first round, of which ``size`` run at a time.
    """
    one = predict_times(first, size)
    whole = replace(one, loading=ROUNDS * one.loading, runs={k: TYPICAL * x for k, x in one.runs.items()})
    return f"{plural(len(first), 'solver')}, up to {ROUNDS} settings of each, {size} at a time: {whole.words}"


def _print_progress(ranked: list[Candidate], total: int, *, first: bool) -> None:
    """Print on standard error how many of ``total`` solvers meet the error, with a table of them or the cheapest.

    The table is printed the ``first`` time, if a solver meets the error; later the cheapest alone is named.
    """
    meeting = [c for c in ranked if c.best]
    words = f"so far {len(meeting)} of {plural(total, 'solver')} meet it"
    if first and meeting:
        print_table(COLUMNS[:-1], [row[:-1] for row in _list_rows(meeting)], words, out=make_table_console(stderr=True))
    else:
        best = f"; cheapest: {meeting[0].best.case}" if meeting and meeting[0].best else ""
        make_error_console().print(f"{words}{best}")


def _compute_cpu_without_code(r: RunRecord) -> float:
    """Return the CPU time of a run's process without compilation, which depends on the cache [s]."""
    return r.cpu_process_s - (0.0 if math.isnan(r.code_s) else r.code_s)


def _read_candidates(folder: Path, problem: Problem, error: float, solvers: list[str]) -> list[Candidate]:
    """Return a candidate, with its runs, for each solver with given options in the results ``folder``.

    Only runs of this problem with the same parameters count; ``solvers`` are the names considered, or all if the list
    is empty. ``error`` [m] is the required one. Raise UsageError if no run is found.
    """
    parameters = json.loads(json.dumps(dict(problem.parameters), default=list))
    found: dict[tuple[str, str], list[RunRecord]] = {}
    for r in store.select_newest(store.load(folder, check_series=False).records):
        same = r.problem == problem.name and r.parameters == parameters
        if same and (not solvers or r.solver in solvers):
            found.setdefault((r.solver, r.solver_options), []).append(r)
    if not found:
        raise UsageError(f"{folder} holds no run of {problem.name} with these parameters")
    return [Candidate(solver, problem, error, math.inf, runs) for (solver, _), runs in found.items()]


def _print_report(candidates: list[Candidate], error: float, *, as_json: bool) -> int:
    """Print the ranked candidates as a table or as JSON; return 0 if one meets the error [m], else 1.

    Raise UsageError if the error is too small to be judged by the reference.
    """
    own = max((r.reference_own_error_judged_m for c in candidates for r in c.runs if r.reference), default=0.0)
    if RESOLVED * own > error:
        raise UsageError(f"--error must be at least {RESOLVED * own:.2g} m: the reference's own is {own:.2g} m")
    best = candidates[0].best if candidates else None
    missing = [c.solver for c in candidates if all(r.missing_package for r in c.runs)]
    if as_json:
        for c in candidates:
            r = c.best or c.closest
            print_json(
                {
                    "solver": c.solver,
                    "case": r.case,
                    "meets": bool(c.best),
                    "status": r.status,
                    "qualifiers": qualify_status(r),
                    "dt_s": r.dt_s,
                    "rtol": r.rtol,
                    "motion_error_m": r.motion_error_judged_m,
                    "cpu_s": r.cpu_median_s,
                    "steps": r.steps,
                    "reach_m": r.length_scale_m,
                    "why_not": c.failure,
                }
            )
    else:
        below = [f"cheapest: {best.case}" if best else "no solver meets it", "factors of CPU time below 1.5 say little"]
        below += [*_describe_reach(candidates, error), *_describe_settings(candidates)]
        below += _list_missing([c for c in candidates if c.solver in missing])
        print_table(COLUMNS, _list_rows([c for c in candidates if c.solver not in missing]), *below)
    return 0 if best else 1


def _describe_reach(candidates: list[Candidate], error: float) -> list[str]:
    """Return a line with the error [m] as a percentage of the farthest motion of a body; empty if that is unknown.

    An error above ``LARGE`` times that motion gets a warning.
    """
    reach = max((r.length_scale_m for c in candidates for r in c.runs if r.length_scale_m > 0.0), default=0.0)
    if not reach:
        return []
    share = 100.0 * error / reach
    warning = ": ask for less, nearly any motion meets it" if error > LARGE * reach else ""
    return [f"the farthest that a body moves is {reach:.3g} m, of which {error:g} m is {share:.2g} %{warning}"]


def _describe_settings(candidates: list[Candidate]) -> list[str]:
    """Return a line on where an engine's settings come from, if the problem is the user's mechanism file; else none."""
    names = [c.solver for c in candidates if "settings" in registry.solvers()[c.solver].parameters]
    make = getattr(registry.problems().get(candidates[0].problem.name), "make", None) if candidates else None
    if not (names and isinstance(getattr(make, "__self__", None), MechanismFile)):  # a method of the loaded file
        return []
    asked = candidates[0].options.get("settings")
    if asked is not None:
        return [f"{names[0]} with settings={asked}"]
    (name, *_) = names
    return [
        f"{name} here has this project's settings, not your file's: --solver {name} --set settings=file takes "
        f"those, settings=default those it ships with; mbsbench list {name} explains them"
    ]


def _list_missing(candidates: list[Candidate]) -> list[str]:
    """Return one line for all engines that are not installed, and one for each package that other solvers lack.

    ``candidates`` are those whose runs all reported a missing package.
    """
    names = {c.solver: registry.solvers()[c.solver].make.__module__.split(".") for c in candidates}
    engines = [name for name, module in names.items() if "engines" in module]
    lines = [f"not installed: {', '.join(engines)}; {ADD_ENGINES}"] if engines else []
    others: dict[str, list[str]] = {}
    for c in candidates:
        if c.solver not in engines:
            others.setdefault(c.closest.message, []).append(c.solver)
    return lines + [f"{', '.join(own)}: {message}" for message, own in others.items()]


def _list_rows(candidates: list[Candidate]) -> list[tuple[Text | str, ...]]:
    """Return a row of ``COLUMNS`` for each candidate: its cheapest run that meets the error, else the closest to it.

    The factor is that of the CPU time to the first candidate's.
    """
    best = candidates[0].best if candidates else None
    rows: list[tuple[Text | str, ...]] = []
    for c in candidates:
        r = c.best or c.closest
        factor = number(compute_cost(r)[0] / compute_cost(best)[0], 2) if c.best and best else ""
        name = Text(format_name(c.solver, c.options), "" if c.best else choose_status_style(r.status))
        rows.append(
            (
                name,
                f"{c.control}={c.get_setting(r):g}",
                number(r.motion_error_judged_m),
                number(r.cpu_median_s, 2),
                factor,
                str(r.steps),
                c.failure,
            )
        )
    return rows
