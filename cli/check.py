"""``check``: solver and problem requirements, tested on a plugin or on an entry of the catalogue."""

import argparse
import tempfile
from pathlib import Path

from rich.text import Text

from ..harness.catalogue import plugins, registry
from ..harness.catalogue.options import nearest
from ..harness.conformance.problem import check_problem
from ..harness.conformance.solver import check_solver, suite_of
from ..harness.execution.runner import Request
from ..harness.results.findings import Finding
from .arguments import UsageError, count_jobs, load_plugins
from .findings import print_findings
from .progress import run_watched
from .terminal import console


def run(arguments: argparse.Namespace) -> int:
    """Print the findings on each entry; return 0 if every requirement is met, else 1."""
    size = count_jobs(arguments.jobs)
    loaded, names = resolve_entries(arguments.plugin)
    findings: list[Finding] = []
    for name in names:
        of_problem = name in registry.problems()
        own = check_problem(name, loaded) if of_problem else _check_solver(name, loaded, size, quiet=arguments.json)
        findings += own
        if arguments.json:
            print_findings(own, json=True)
        else:
            _print(own, name)
    return 0 if all(f.holds for f in findings) else 1


def _print(findings: list[Finding], name: str) -> None:
    out = console()
    out.print(Text(name, "bold"))
    print_findings(findings)
    broken = [f for f in findings if not f.holds]
    for f in broken:
        out.print(Text(f"FAIL  {f.measured.quantity}", "bold red"))
        out.print(f"      why:    {f.required.why}\n      remedy: {f.required.remedy}")
    untested = sum(not f.is_tested for f in findings)
    met = f"{len(findings) - len(broken) - untested} of {len(findings)} requirements met"
    out.print(met + (f", {untested} not tested" if untested else ""))


def resolve_entries(given: str) -> tuple[tuple[str, ...], list[str]]:
    """The plugin and the problems and solvers it adds, problems first; or the catalogue's entry of that name."""
    before = {*registry.problems(), *registry.solvers()}
    if given in before:
        return (), [given]
    if not plugins.is_file(given) and given not in (points := plugins.entry_points()):
        known = [*sorted(before), *points, *(p.name for p in Path().glob("*.py"))]
        raise UsageError(f"unknown solver, problem or plugin {given!r}{nearest(given, known)}")
    loaded = load_plugins([given])
    names = [n for n in (*sorted(registry.problems()), *sorted(registry.solvers())) if n not in before]
    if not names:
        raise UsageError(f"{given} adds no problem or solver{nearest(given, sorted(before))}")
    return loaded, names


def _check_solver(name: str, plugins: tuple[str, ...], size: int, *, quiet: bool) -> list[Finding]:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        loaded, _ = run_watched(Request(suite_of(name, plugins), folder, size), quiet=quiet, resumable=False)
        return check_solver(name, folder, loaded.records)
