"""``gate``: run the short suite and hold it against the committed thresholds."""

import argparse
import difflib
import math
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness import store
from harness.commands.progress import progress
from harness.commands.run import add_running, existing, jobs
from harness.commands.terms import UsageError, check_writable, load_plugins
from harness.gate import State, Verdict, has_moved, judge, tightened
from harness.gate_files import junit, markdown
from harness.proposal import proposed
from harness.runner import Request, new_folder, run_suite
from harness.suites import Suite, load_suite
from harness.thresholds import FOLDER, Thresholds, read_thresholds, write_thresholds

STYLE = {State.FAIL: "bold red", State.XPASS: "yellow", State.XFAIL: "cyan", State.PASS: "green"}


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("gate", help="run a suite and compare with committed thresholds; 0 open, 1 closed")
    p.add_argument("--suite", default="ci", help="name or TOML file (default: ci)")
    p.add_argument("--thresholds", metavar="FILE", help="default: results/baselines/<suite>.toml")
    p.add_argument("--run", metavar="DIR", dest="folder", help="judge this run folder instead of running")
    p.add_argument("--update", action="store_true", help="print a diff that tightens thresholds and adds missing ones")
    p.add_argument("--loosen", action="store_true", help="with --update: propose wider bounds too")
    p.add_argument("--write", action="store_true", help="with --update: write the file instead of printing the diff")
    p.add_argument("--all", action="store_true", help="show every threshold, not only what failed or moved")
    p.add_argument("--junit", metavar="FILE", help="write the verdict as JUnit XML")
    p.add_argument("--markdown", metavar="FILE", help="write what failed or moved as Markdown")
    add_running(p)
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 if nothing failed and something was judged, else 1."""
    suite = load_suite(arguments.suite, load_plugins(arguments.plugin))
    path = Path(arguments.thresholds) if arguments.thresholds else FOLDER / f"{suite.name}.toml"
    for given, other in (("junit", "update"), ("markdown", "update"), ("loosen", ""), ("write", "")):
        if getattr(arguments, given) and (arguments.update if other else not arguments.update):
            raise UsageError(f"--{given} goes {'without' if other else 'with'} --update")
    for file in filter(None, (arguments.junit, arguments.markdown)):
        check_writable(Path(file))
    thresholds = Thresholds(suite.name, (), {})
    if path.exists() or not arguments.update:
        thresholds = read_thresholds(path)
    loaded = _loaded(arguments, suite)
    if arguments.update:
        return _update(path, thresholds, loaded, loosen=arguments.loosen, write=arguments.write)
    verdict = judge(suite.cells, loaded.records, thresholds)
    _print(verdict, everything=arguments.all)
    for file, made in ((arguments.junit, junit), (arguments.markdown, markdown)):
        if file:
            store.write_text(Path(file), made(verdict, suite.name))
    return 0 if verdict.is_open else 1


def _loaded(arguments: argparse.Namespace, suite: Suite) -> store.Loaded:
    if arguments.folder:
        return store.load(existing(arguments.folder))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(arguments.out) if arguments.out else Path(place) / new_folder(suite.name).name
        with progress() as watcher:
            loaded = run_suite(Request(suite, folder, jobs(arguments.jobs)), watcher)
    return loaded


def _print(verdict: Verdict, *, everything: bool) -> None:
    out = Console()
    if not out.is_terminal:
        out = Console(width=220)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("state", "case", "metric", "measured", "was", "bound", "unit", "why"):
        table.add_column(name, overflow="fold")
    shown = [f for f in verdict.findings if everything or f.state is not State.PASS or has_moved(f)]
    for f in shown:
        was = "" if math.isnan(f.value) else f"{f.value:.3g} ({_moved(f.measured, f.value)})"
        measured = "" if math.isnan(f.measured) else f"{f.measured:.4g}"
        words = f.words if f.state is not State.PASS else ""
        table.add_row(
            Text(f.state.name, STYLE[f.state]), Text(f.case), f.what, measured, was, f.bound, Text(f.unit), Text(words)
        )
    if shown:
        out.print(table)
    if len(shown) < len(verdict.findings):
        out.print(f"{len(verdict.findings) - len(shown)} more pass and have not moved by 1 % (--all shows them)")
    counts = {s: sum(f.state is s for f in verdict.findings) for s in sorted(State, reverse=True)}
    words = ", ".join(f"{n} {s.name}" for s, n in counts.items() if n) or "nothing was judged"
    out.print(Text(f"gate {'open' if verdict.is_open else 'CLOSED'}: {words}", STYLE[verdict.state]))


def _moved(measured: float, value: float) -> str:
    if math.isnan(measured):
        return "missing"
    return f"x {measured / value:.3g}" if value else f"{measured:+.3g}"


def _update(path: Path, old: Thresholds, loaded: store.Loaded, *, loosen: bool, write: bool) -> int:
    new = write_thresholds(tightened(old, loaded.records, proposed(loaded.records), loosen=loosen))
    before = path.read_text(encoding="utf-8") if path.exists() else ""
    out = Console(highlight=False, markup=False, soft_wrap=True)
    if write:
        store.write_text(path, new)
        out.print(f"written: {path}")
        return 0
    for line in difflib.unified_diff(before.splitlines(), new.splitlines(), str(path), "proposed", lineterm=""):
        out.print(line)
    return 0
