"""``list``: problems, solvers and suites, each option with its unit and default."""

import argparse
import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..catalogue import registry
from ..catalogue.options import Parameter
from ..results.naming import text_of
from ..suites.includes import suite_names
from ..suites.spec import DEFAULT_RTOL
from .screen import lines, screen
from .terms import load_plugins


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("list", help="problems, solvers, their options with units and defaults, suites")
    p.add_argument("--plugin", action="append", default=[], metavar="FILE.py", help="also those of this file")
    p.add_argument("--json", action="store_true", help="one JSON object, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the catalogues."""
    load_plugins(arguments.plugin)
    if arguments.json:
        lines().print(json.dumps(as_plain(), ensure_ascii=False))
        return 0
    out = screen()
    out.print("[bold]Problems[/bold]   --problem-set name=value\n")
    for problem in registry.problems().values():
        own = {k: v for k, v in problem.parameters.items() if k not in registry.COMMON_PARAMETERS}
        out.print(f"[bold cyan]{problem.name}[/bold cyan]  {escape(problem.doc)}")
        _options(out, own)
    out.print("[bold cyan]every problem[/bold cyan]  takes these too")
    _options(out, registry.COMMON_PARAMETERS)
    out.print("[bold]Solvers[/bold]   --set name=value\n")
    for solver in registry.solvers().values():
        step = (
            "dt [s] (fixed step, default: the problem's)"
            if solver.control == "dt"
            else f"rtol (default {DEFAULT_RTOL:g}), max_step [s] (default: none)"
        )
        out.print(f"[bold green]{solver.name}[/bold green]  [{escape(solver.paper_label)}]  {escape(solver.doc)}")
        limits = "max_steps (default 10000000); wall_limit [s] (default: none)"
        out.print(escape(f"  control: {step}; {limits}"), style="dim")
        _options(out, solver.parameters)
    out.print("[bold]Suites[/bold]   " + ", ".join(suite_names()))
    return 0


def as_plain() -> dict[str, Any]:
    """JSON-able: problems, solvers, suites."""
    problems = [
        {"name": p.name, "doc": p.doc, "parameters": _plain(p.parameters)} for p in registry.problems().values()
    ]
    solvers = [
        {
            "name": s.name,
            "paper_label": s.paper_label,
            "doc": s.doc,
            "control": s.control,
            "options": _plain(s.parameters),
        }
        for s in registry.solvers().values()
    ]
    return {"problems": problems, "solvers": solvers, "suites": suite_names()}


def _plain(parameters: Mapping[str, tuple[Any, Parameter]]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "default": default,
            **{k: v for k, v in dataclasses.asdict(meaning).items() if v not in (None, ())},
        }
        for name, (default, meaning) in parameters.items()
    ]


def _options(out: Console, parameters: Mapping[str, tuple[Any, Parameter]]) -> None:
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    for column in ("name", "default", "unit", "meaning"):
        table.add_column(column, overflow="fold", no_wrap=column != "meaning")
    for name, (default, parameter) in parameters.items():
        table.add_row(
            f"  {name}", text_of(default), parameter.unit and escape(f"[{parameter.unit}]"), escape(_meaning(parameter))
        )
    if table.row_count:
        out.print(table)
    out.print()


def _meaning(p: Parameter) -> str:
    return p.doc + (f": {' | '.join(map(str, p.choices))}" if p.choices else "")
