"""Test the requirements on a solver or problem, of a plugin or of the catalogue (``check``)."""

import argparse
import tempfile
from pathlib import Path

from rich.text import Text

from ..harness.base.hints import suggest_name
from ..harness.catalogue import plugins, registry
from ..harness.judge.conformance.problem import check_problem
from ..harness.judge.conformance.solver import check_solver, make_suite
from ..harness.results.findings import Finding
from ..harness.run.runner import Request
from .arguments import UsageError, count_jobs, load_plugins
from .findings import print_findings
from .progress import run_watched
from .terminal import make_console


def run(arguments: argparse.Namespace) -> int:
    """Check each solver or problem that is named or that a plugin adds, and print the findings.

    Return 0 if every requirement is met, else 1.
    """
    size = count_jobs(arguments.jobs)
    loaded, names = resolve_entries(arguments.plugin)
    findings: list[Finding] = []
    for name in names:
        is_problem = name in registry.problems()
        own = check_problem(name, loaded) if is_problem else _check_solver(name, loaded, size, quiet=arguments.json)
        findings += own
        if arguments.json:
            print_findings(own, json=True)
        else:
            _print_findings(own, name)
    return 0 if all(f.holds for f in findings) else 1


def _print_findings(findings: list[Finding], name: str) -> None:
    """Print the findings on one entry as a table, the reason and remedy of each failure, and the number met."""
    out = make_console()
    out.print(Text(name, "bold"))
    print_findings(findings)
    broken = [f for f in findings if not f.holds]
    for f in broken:
        out.print(Text(f"FAIL  {f.quantity}", "bold red"))
        out.print(f"      why:    {f.why}\n      remedy: {f.remedy}")
    untested = sum(not f.is_tested for f in findings)
    met = f"{len(findings) - len(broken) - untested} of {len(findings)} requirements met"
    out.print(met + (f", {untested} not tested" if untested else ""))


def resolve_entries(given: str) -> tuple[tuple[str, ...], list[str]]:
    """Return the loaded plugins, and the names of the problems and solvers that ``given`` stands for, problems first.

    The name of a catalogue entry stands for itself and loads nothing. A plugin (a file or an entry point) is loaded and
    stands for what it adds. Raise UsageError if it adds nothing or is unknown.
    """
    before = {*registry.problems(), *registry.solvers()}
    if given in before:
        return (), [given]
    if not plugins.is_path(given) and given not in (points := plugins.entry_points()):
        known = [*sorted(before), *points, *(p.name for p in Path().glob("*.py"))]
        raise UsageError(f"unknown solver, problem or plugin {given!r}{suggest_name(given, known)}")
    loaded = load_plugins([given])
    names = [n for n in (*sorted(registry.problems()), *sorted(registry.solvers())) if n not in before]
    if not names:
        raise UsageError(f"{given} adds no problem or solver{suggest_name(given, sorted(before))}")
    return loaded, names


def _check_solver(name: str, plugins: tuple[str, ...], size: int, *, quiet: bool) -> list[Finding]:
    """Run the suite that tests a solver, ``size`` runs at a time, in a temporary folder; return the findings."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        loaded, _ = run_watched(Request(make_suite(name, plugins), folder, size), quiet=quiet, resumable=False)
        return check_solver(name, folder, loaded.records)
