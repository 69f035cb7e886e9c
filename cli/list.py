"""List problems, solvers and suites, all of one kind, or one entry with its options (``list``)."""

import argparse
import contextlib
import dataclasses
import hashlib
import sys
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..harness.base.cache import ROOT, make_cache_folder, read_sealed_file, write_sealed_file
from ..harness.base.files import FileError, parse_json, to_json
from ..harness.base.hints import suggest_name
from ..harness.base.naming import format_exactly
from .arguments import load_plugins
from .parser import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from ..harness.catalogue.options import Parameter

REFERENCE = {
    "proved": "its own exact motion, with a proved error",
    "formula": "its own exact motion, its rounding estimated",
    "own": "its own exact motion, none from this start",
    "hinged": "the closed form of one body on a fixed hinge, its error from that of data within their rounding",
    "certified": "its own certified integration: two routes, their difference bounds it",
    "computed": "computed by two formulations until they agree",
    "none": "none, the system is too large to compute one",
}
STEP = {
    "dt": "dt [s] (fixed step, default: the problem's)",
    "rtol": "rtol (default {rtol:g}), max_step [s] (default: none)",
}
LIMITS = "max_steps (default 10000000); cpu_limit [s] (default: none)"
LARGEST = 2**26  # [bytes] of the cached catalogue, which takes less than a hundredth
SHAPING = ("problems", "solvers", "harness")  # folders whose code defines the catalogue
Entry = Mapping[str, Any]


def run(arguments: argparse.Namespace) -> int:
    """Print an overview, all entries of one kind, or one entry; raise UsageError for an unknown name."""
    load_plugins(arguments.plugin)
    catalogue = describe_catalogue(plugins=True) if arguments.plugin else load_catalogue()
    name = arguments.name
    if name in KINDS:
        catalogue = {**catalogue, **{kind: [] for kind in KINDS if kind != name}}
    elif name is not None:
        known = [*KINDS, *(e["name"] for kind in KINDS for e in catalogue[kind])]
        catalogue = {**catalogue, **{kind: [e for e in catalogue[kind] if e["name"] == name] for kind in KINDS}}
        if not any(catalogue[kind] for kind in KINDS):
            raise UsageError(f"no problem or solver is called {name!r}{suggest_name(name, known)}")
    from .terminal import make_table_console, print_json  # imported here: JSON and a wrong name need no tables

    if arguments.json:
        print_json({k: v for k, v in catalogue.items() if k in (*KINDS, "suites")})
    elif name in KINDS:
        print_kind(catalogue, name)
    elif name is not None:
        print_entry(catalogue, make_table_console())
    else:
        print_overview(catalogue, make_table_console())
    return 0


KINDS = ("problems", "solvers")
CONTROLS = {"dt": "Solvers with a fixed step dt", "rtol": "Solvers with a tolerance rtol"}
WIDTH = 80  # largest width of the overview


def print_overview(catalogue: Entry, out: "Console") -> None:
    """Print the names of problems, solvers and suites, and which problems test what, on one screen."""
    groups = {"Problems": [p["name"] for p in catalogue["problems"]]}
    groups |= {words: [s["name"] for s in catalogue["solvers"] if s["control"] == k] for k, words in CONTROLS.items()}
    groups["Suites"] = catalogue["suites"]
    width = min(out.width, WIDTH)
    for title, names in groups.items():
        out.print(f"[bold]{title}[/bold] ({len(names)})")
        out.print(textwrap.fill(", ".join(names), width, initial_indent="  ", subsequent_indent="  "), markup=False)
    out.print("[bold]What problems test[/bold]")
    for trait in catalogue["traits"]:
        tested = ", ".join(p["name"] for p in catalogue["problems"] if trait in p["tests"])
        lines = textwrap.fill(f"{trait}: {tested}", width, initial_indent="  ", subsequent_indent="    ")
        out.print(lines, markup=False)
    out.print("more: list problems, list solvers; list NAME has options, units and defaults", style="dim")


def print_kind(catalogue: Entry, kind: str) -> None:
    """Print a table of all problems or of all solvers, as ``kind`` says, with their summaries."""
    from .terminal import Column, print_table

    summary = Column("", right=False, fold=True)
    columns: tuple[Column, ...]
    rows: list[tuple[str, ...]]
    if kind == "problems":
        columns = (Column("problem", right=False), Column("T [s]", rank=1), summary)
        rows = [(p["name"], f"{p['t_end_s']:g}" if p["t_end_s"] else "", p["doc"]) for p in catalogue[kind]]
    else:
        columns = (
            Column("solver", right=False),
            Column("step", right=False),
            Column("order", rank=1),
            summary,
        )
        rows = [
            (s["name"], s["control"], "" if s["order"] is None else f"{s['order']:g}", s["doc"])
            for s in catalogue[kind]
        ]
    print_table(columns, rows)


def print_entry(catalogue: Entry, out: "Console") -> None:
    """Print the only entry of ``catalogue`` with its options; for a problem also the parameters of every problem."""
    for p in catalogue["problems"]:
        _print_problem(p, catalogue, out)
        out.print("parameters of every problem", style="dim")
        _print_options(out, catalogue["every_problem"])
    for s in catalogue["solvers"]:
        _print_solver(s, catalogue, out)
    name, word = (
        (catalogue["problems"] or catalogue["solvers"])[0]["name"],
        "--problem-set" if catalogue["problems"] else "--set",
    )
    call = f"{name} SOLVER" if catalogue["problems"] else f"PROBLEM {name}"
    out.print(f"to change one: mbsbench solve {call} {word} name=value", style="dim", markup=False)


def _print_problem(p: Entry, catalogue: Entry, out: "Console") -> None:
    """Print a problem: what it tests, its source, its end time, its reference and its own parameters."""
    from rich.markup import escape

    tests = f"  tests: {', '.join(p['tests'])}" if p["tests"] else ""
    out.print(f"[bold cyan]{p['name']}[/bold cyan]  {escape(p['doc'])}[dim]{tests}[/dim]")
    facts = [
        f"source: {p['section']}{' of the paper' * p['section'].startswith('Sect.')}" if p["section"] else "",
        f"simulated time: {p['t_end_s']:g} s" if p["t_end_s"] else "",
        f"reference: {REFERENCE[p['reference']]}" if p["reference"] else "",
    ]
    if any(facts):
        out.print(escape(f"  {'; '.join(filter(None, facts))}"), style="dim")
    common = {o["name"] for o in catalogue["every_problem"]}
    _print_options(out, [o for o in p["parameters"] if o["name"] not in common])


def _print_solver(s: Entry, catalogue: Entry, out: "Console") -> None:
    """Print a solver: its name in the paper, its order, its step control and its options."""
    from rich.markup import escape

    label = escape(f"[{s['paper_label']}]  ") if s["paper_label"] else ""
    out.print(f"[bold green]{s['name']}[/bold green]  {label}{escape(s['doc'])}")
    order = f"order {s['order']:g}; " if s["order"] is not None else ""
    out.print(escape(f"  {order}{STEP[s['control']].format(rtol=catalogue['rtol'])}; {LIMITS}"), style="dim")
    _print_options(out, s["options"])


def _print_options(out: "Console", options: Sequence[Entry]) -> None:
    """Print a table of options or parameters: name, default, unit and meaning with the choices."""
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for column in ("  name", "default", "unit", "meaning"):
        table.add_column(column, overflow="fold", no_wrap=column != "meaning")
    for o in options:
        unit = escape(f"[{o['unit']}]") if o.get("unit") else ""
        choices = f": {' | '.join(map(str, o['choices']))}" if o.get("choices") else ""
        table.add_row(f"  {o['name']}", escape(format_exactly(o["default"])), unit, escape(o["doc"] + choices))
    if table.row_count:
        out.print(table)
    out.print()


def load_catalogue() -> dict[str, Any]:
    """Return the catalogue without plugins, as ``describe_catalogue`` does, from a file until its code changes.

    The file saves the imports, which take seconds; it is written again if it is missing or damaged.
    """
    path = make_cache_folder("catalogue", ROOT / "results" / "local") / f"{_digest_code()}.json"
    with contextlib.suppress(OSError, ValueError, FileError):  # missing or damaged: made anew
        found: dict[str, Any] = parse_json(read_sealed_file(path, LARGEST).decode(), str(path))
        return found
    found = describe_catalogue(plugins=False)
    with contextlib.suppress(OSError):
        for old in path.parent.glob("*.json"):
            old.unlink(missing_ok=True)
    write_sealed_file(path, to_json(found).encode())
    return found


def _digest_code() -> str:
    """Return the digest of the code behind the catalogue, of the names of suites and of the interpreter's version."""
    digest = hashlib.sha256(sys.version.encode())
    for folder in SHAPING:
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
    for path in sorted((ROOT / "harness" / "catalogue" / "suites").glob("*.toml")):
        digest.update(f"{path.name}\0".encode())
    return digest.hexdigest()[:24]


def describe_catalogue(*, plugins: bool) -> dict[str, Any]:
    """Describe problems, solvers and suites as plain data; ``plugins`` adds those of loaded plugins."""
    from ..harness.catalogue import registry
    from ..harness.catalogue.suites.includes import list_suites
    from ..harness.catalogue.suites.spec import DEFAULT_RTOL
    from ..harness.mechanics.types import Trait

    problems = [
        {
            "name": p.name,
            "doc": p.doc,
            "tests": list(p.tests),
            **_describe_problem(p.name),
            "parameters": _describe_options(p.parameters),
        }
        for p in registry.problems().values()
        if plugins or registry.is_own_problem(p.name)
    ]
    solvers = [
        {
            **{k: getattr(s, k) for k in ("name", "paper_label", "doc", "control")},
            "order": _read_order(s.name),
            "options": _describe_options(s.parameters),
        }
        for s in registry.solvers().values()
        if plugins or registry.is_own_solver(s.name)
    ]
    return {
        "problems": problems,
        "solvers": solvers,
        "suites": list_suites(),
        "traits": list(Trait),
        "every_problem": _describe_options(registry.COMMON_PARAMETERS),
        "rtol": DEFAULT_RTOL,
    }


def _describe_problem(name: str) -> dict[str, Any]:
    """Return section, end time [s] and kind of reference of the problem called ``name``, with its default parameters.

    If the problem cannot be made, the section is empty and the others are None; ``check`` reports why.
    """
    from ..harness.catalogue import registry
    from ..harness.mechanics.types import classify_reference
    from ..harness.reference.computation import Source, describe_source

    with contextlib.suppress(Exception):
        problem = registry.make_problem(name)
        source = describe_source(problem)
        own = problem.reference() if source is Source.OWN else None
        kind = source if own is None else classify_reference(own)
        return {"section": problem.section, "t_end_s": problem.t_end, "reference": str(kind)}
    return {"section": "", "t_end_s": None, "reference": None}


def _read_order(name: str) -> float | None:
    """Return the order that a solver declares at its default options; None if it declares none."""
    from ..harness.catalogue import registry

    order = registry.read_declaration(registry.make_solver(name))[1]
    return order if order == order else None  # NaN: none is declared


def _describe_options(parameters: "Mapping[str, tuple[Any, Parameter]]") -> list[dict[str, Any]]:
    """Return options as plain data: name and default, and unit, meaning and choices as far as they are declared."""
    return [
        {"name": k, "default": default, **{n: v for n, v in dataclasses.asdict(p).items() if v not in (None, ())}}
        for k, (default, p) in parameters.items()
    ]
