"""``list``: problems, solvers and suites, each option with its unit and default."""

import argparse
import contextlib
import dataclasses
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..catalogue import registry
from ..catalogue.options import Parameter
from ..reference.computed import Source, source_of
from ..results.naming import text_of
from ..suites.includes import suite_names
from ..suites.spec import DEFAULT_RTOL
from ..types import Trait
from .screen import print_json, screen
from .terms import add_plugin, load_plugins, subcommand

REFERENCE = {
    Source.OWN: "its own exact motion", Source.COMPUTED: "computed by two formulations until they agree",
    Source.NONE: "none, the system is too large to compute one",
}  # fmt: skip
STEP = {
    "dt": "dt [s] (fixed step, default: the problem's)",
    "rtol": f"rtol (default {DEFAULT_RTOL:g}), max_step [s] (default: none)",
}


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    words = "list problems, solvers and suites, with options, units and defaults"
    add_plugin(subcommand(commands, "list", run, words, "one object"))


def run(arguments: argparse.Namespace) -> int:
    """Print the catalogues."""
    load_plugins(arguments.plugin)
    if arguments.json:
        print_json(as_plain())
        return 0
    out = screen()
    out.print("[bold]Problems[/bold]   --problem-set name=value\n")
    for problem in registry.problems().values():
        own = {k: v for k, v in problem.parameters.items() if k not in registry.COMMON_PARAMETERS}
        tests = f"  tests: {', '.join(problem.tests)}" if problem.tests else ""
        out.print(f"[bold cyan]{problem.name}[/bold cyan]  {escape(problem.doc)}[dim]{tests}[/dim]")
        if source := _source(problem.name):
            out.print(f"  reference: {REFERENCE[source]}", style="dim")
        _options(out, own)
    out.print("[bold cyan]every problem[/bold cyan]  has these too")
    _options(out, registry.COMMON_PARAMETERS)
    out.print("[bold]Problems by what they test[/bold]")
    for trait in Trait:
        out.print(f"  {trait}: {', '.join(p.name for p in registry.problems().values() if trait in p.tests)}")
    out.print()
    out.print("[bold]Solvers[/bold]   --set name=value\n")
    for solver in registry.solvers().values():
        step = STEP[solver.control]
        label = escape(f"[{solver.paper_label}]  ") if solver.paper_label else ""
        out.print(f"[bold green]{solver.name}[/bold green]  {label}{escape(solver.doc)}")
        limits = "max_steps (default 10000000); cpu_limit [s] (default: none)"
        out.print(escape(f"  {step}; {limits}"), style="dim")
        _options(out, solver.parameters)
    out.print("[bold]Suites[/bold]   " + ", ".join(suite_names()))
    return 0


def as_plain() -> dict[str, Any]:
    """JSON-able: problems, solvers, suites."""
    problems = [
        {
            "name": p.name,
            "doc": p.doc,
            "tests": p.tests,
            "reference": _source(p.name),
            "parameters": _plain(p.parameters),
        }
        for p in registry.problems().values()
    ]
    solvers = [
        {**{k: getattr(s, k) for k in ("name", "paper_label", "doc", "control")}, "options": _plain(s.parameters)}
        for s in registry.solvers().values()
    ]
    return {"problems": problems, "solvers": solvers, "suites": suite_names()}


def _source(name: str) -> Source | None:
    """Of the problem with its defaults; None if it cannot be made, which is for ``check`` to say."""
    with contextlib.suppress(Exception):
        return source_of(registry.make_problem(name))
    return None


def _plain(parameters: Mapping[str, tuple[Any, Parameter]]) -> list[dict[str, Any]]:
    return [
        {"name": k, "default": default, **{n: v for n, v in dataclasses.asdict(p).items() if v not in (None, ())}}
        for k, (default, p) in parameters.items()
    ]


def _options(out: Console, parameters: Mapping[str, tuple[Any, Parameter]]) -> None:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    for column in ("name", "default", "unit", "meaning"):
        table.add_column(column, overflow="fold", no_wrap=column != "meaning")
    for name, (default, parameter) in parameters.items():
        unit = parameter.unit and escape(f"[{parameter.unit}]")
        choices = f": {' | '.join(map(str, parameter.choices))}" if parameter.choices else ""
        table.add_row(f"  {name}", text_of(default), unit, escape(parameter.doc + choices))
    if table.row_count:
        out.print(table)
    out.print()
