"""Define the subcommands and their arguments, in the order of --help; a command's own file is loaded when it runs."""

import argparse
import importlib
import pkgutil
import sys
from pathlib import Path
from typing import Any

from ..harness.results.rows import METRICS
from .arguments import (
    RESULTS,
    add_file,
    add_jobs,
    add_plugin,
    add_problem,
    add_results,
    add_run_options,
    add_set,
    find_results,
    parse_duration,
    parse_positive_float,
    parse_positive_int,
)

CONTROL = ("dt", "rtol", "max_step", "max_steps", "cpu_limit")
FILTERS = ("problem", "solver", "status", "label")
SORTS = {"drift": "energy_drift_max_J", "error": "position_error", "phi": "phi_max", "cpu": "cpu_min_s"}
NATIVE = "compute as this processor does it fastest; else the same bits on every processor with AVX2"
CHANGES = 40  # changes shown by diff
SEED = 1  # a fixed default, so that samples repeat
SHELLS = ("bash", "zsh", "fish")


def add_commands(commands: Any) -> None:
    """Add the parser of every subcommand to ``commands``, the object that ``make_parser`` returns for it."""
    for add in (
        _add_list,
        _add_solve,
        _add_run,
        _add_show,
        _add_report,
        _add_check,
        _add_try,
        _add_advise,
        _add_export,
        _add_judge,
        _add_claim,
        _add_gate,
        _add_verify,
        _add_diff,
        _add_merge,
        _add_remeasure,
        _add_clean,
        _add_history,
        _add_figures,
        _add_completion,
    ):
        add(commands)
    for room in pkgutil.iter_modules(sys.modules[__package__].__path__):
        if room.ispkg:  # commands that a copy may lack
            importlib.import_module(f".{room.name}.commands", __package__).add_commands(commands)


def add_subcommand(
    commands: Any, name: str, summary: str, json: str = "", native: bool = False, room: str = ""
) -> argparse.ArgumentParser:
    """Add the parser of a command and return it.

    ``summary`` describes the command; the list of commands shows it up to its first semicolon. ``json`` says what
    --json prints; if empty, there is no --json. With ``native`` it takes --native: it computes. ``room`` is the folder
    of the command's file, if it is a folder in this one.
    """
    description = f"{summary[0].upper()}{summary[1:]}."
    p: argparse.ArgumentParser = commands.add_parser(name, help=summary.partition(";")[0], description=description)
    p.set_defaults(command=name, module=f"{room}.{name}" if room else name)
    if native:
        p.add_argument("--native", action="store_true", help=NATIVE)
    if json:
        p.add_argument("--json", action="store_true", help=f"print JSON: {json}")
    return p


def _add_list(commands: Any) -> None:
    """Add the parser of the command ``list``."""
    words = "list problems, solvers and suites, or explain one of them with options, units and defaults"
    p = add_subcommand(commands, "list", words, "one object")
    p.add_argument("name", nargs="?", metavar="NAME", help="problems, solvers, or the name of one of these")
    add_plugin(p)


def _add_solve(commands: Any) -> None:
    """Add the parser of the command ``solve``."""
    words = "run one solver on one problem; write motion and measurements"
    p = add_subcommand(commands, "solve", words, "one object", native=True)
    add_problem(p)
    p.add_argument("solver", metavar="SOLVER", help="name of a solver (see mbsbench list)")
    add_set(p, "--set", f"{', '.join(CONTROL)}, or a solver option")
    p.add_argument("--out", metavar="RUN.npz", help="file to write (default: PROBLEM-SOLVER.npz, then -2, -3, ...)")
    add_plugin(p)


def _add_run(commands: Any) -> None:
    """Add the parser of the command ``run``."""
    p = add_subcommand(commands, "run", "run a suite and write a results folder", "one object at the end", native=True)
    p.add_argument("suite", metavar="SUITE", help="name of a suite (see mbsbench list), or a TOML file")
    add_run_options(p)
    p.add_argument("--resume", action="store_true", help="continue --out, or the newest results of the suite")
    p.add_argument(
        "--dry-run", action="store_true", help="print the runs and how long they will take here; run nothing"
    )
    p.add_argument("--only", metavar="SUITE", help="only the runs of this suite, which SUITE includes; see --resume")
    p.add_argument("--limit", type=parse_positive_int, metavar="N", help="only the first N runs")
    p.add_argument("--shard", metavar="K/N", help="only every N-th run from the K-th on, for N machines; see merge")
    turns = "then time the runs of each problem N times in turns, in one process: for ratios of CPU times"
    p.add_argument("--in-turns", type=parse_positive_int, metavar="N", help=turns)
    lossless = "keep every step with its states, not envelopes: nothing has to be solved again for a bundle"
    p.add_argument("--lossless", action="store_true", help=lossless)
    p.add_argument("--cluster", metavar="ADDRESS", help="run on a Dask cluster: tcp://host:port or a scheduler file")


def _add_show(commands: Any) -> None:
    """Add the parser of the command ``show``."""
    words = "show a results folder as a table, or one run in detail"
    p = add_subcommand(commands, "show", words, "one record per line")
    add_results(p)
    p.add_argument("run_name", metavar="RUN", nargs="?", help="show one run: run_id (or its first digits) or case")
    for name in FILTERS:
        p.add_argument(f"--{name}", metavar="A,B", help=f"only runs with this {name}, or one of these")
    p.add_argument("--sort", metavar="KEY", help=f"largest first, by {', '.join(SORTS)} or any numeric column")
    p.add_argument("--limit", type=parse_positive_int, metavar="N", help="only the first N runs")
    steps = "print every step of RUN as CSV, solved again where the results lack it"
    p.add_argument("--steps", action="store_true", help=steps)
    add_plugin(p, "with --steps: plugin that the results were made with")


def _add_report(commands: Any) -> None:
    """Add the parser of the command ``report``."""
    p = add_subcommand(commands, "report", "write the report of a results folder, or compare two")
    results = f"{RESULTS} (default: the newest); two of them are compared"
    p.add_argument("results", nargs="*", default=["latest"], metavar="RESULTS", help=results)
    out = "where to write a comparison (default: report/ in the second)"
    p.add_argument("--out", type=Path, metavar="DIR", help=out)
    p.add_argument("--judge", action="store_true", help="also do what judge --partial does, beside the pages of runs")


def _add_check(commands: Any) -> None:
    """Add the parser of the command ``check``."""
    words = "test the requirements on a solver or problem, with the number measured; exit code 1 if one is not met"
    p = add_subcommand(commands, "check", words, "one object per requirement", native=True)
    p.add_argument("plugin", metavar="FILE.py", help="Python file, entry point, or name of a solver or problem")
    add_jobs(p)


def _add_try(commands: Any) -> None:
    """Add the parser of the command ``try``."""
    words = "run a solver on problems, ladders, loops and chains; exit code 1 where it falls short or runs are left out"
    p = add_subcommand(commands, "try", words, "one object a finding", native=True)
    p.add_argument("file", metavar="FILE.py", help="Python file, entry point, or name of a solver")
    budget = "CPU time of all runs without compilation [s] (default: 180)"
    p.add_argument("--budget", type=parse_positive_float, default=180.0, metavar="S", help=budget)
    p.add_argument("--out", metavar="DIR", help="results folder to write (default: results/local/try-<solver>-<time>)")
    add_file(p, "--html", words="also write all lines and charts to one HTML page")
    p.add_argument("--no-report", action="store_true", help="leave out the page")
    add_plugin(p, "file whose problems are run too")
    add_jobs(p)


def _add_advise(commands: Any) -> None:
    """Add the parser of the command ``advise``."""
    words = "find the cheapest solver and setting that meet an error on a problem; exit code 1 if none does"
    p = add_subcommand(commands, "advise", words, "one object a solver, the cheapest first", native=True)
    add_problem(p)
    p.add_argument(
        "--error", required=True, type=parse_positive_float, metavar="X", help="largest motion error allowed [m]"
    )
    budget = "CPU time for all runs, checked after each round of runs, about [s] (default: 120)"
    p.add_argument("--budget", type=parse_positive_float, default=120.0, metavar="S", help=budget)
    p.add_argument("--solver", action="append", default=[], metavar="NAME", help="only this solver; may be repeated")
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="option of the one --solver")
    kept = f"read the runs of this {RESULTS}; run nothing"
    p.add_argument("--from", dest="results", type=find_results, metavar="RESULTS", help=kept)
    add_plugin(p)
    add_jobs(p)


def _add_export(commands: Any) -> None:
    """Add the parser of the command ``export``."""
    p = add_subcommand(commands, "export", "print a problem with all its numbers, for any other code")
    add_problem(p)
    p.add_argument("--format", choices=("json",), default="json", help="see docs/your-own-solver.md (default: json)")
    add_file(p, "--out", words="file to write (default: print)")
    add_plugin(p)


def _add_judge(commands: Any) -> None:
    """Add the parser of the command ``judge``."""
    words = (
        "judge the paper's claims; exit code 1 if a verdict differs from the published, or the code is newer than "
        "these; orders are only shown"
    )
    p = add_subcommand(commands, "judge", words, "schema, digests of the code, the claims and the orders in dt")
    add_results(p)
    p.add_argument("--partial", action="store_true", help="judge only the claims covered by these results")
    p.add_argument("--publish", action="store_true", help="write the verdicts of a whole run to results/published/ too")
    p.add_argument("--claims", metavar="FILE.toml", help="register of claims (default: results/claims.toml)")
    p.add_argument("--published", metavar="DIR", help="published verdicts (default: results/published/)")


def _add_claim(commands: Any) -> None:
    """Add the parser of the command ``claim``."""
    words = (
        "list the paper's claims with their verdicts, or show one: why and where it was tried; or make its runs and "
        "judge it"
    )
    p = add_subcommand(commands, "claim", words, "the claim, or without ID all of them", native=True)
    p.add_argument("claim", nargs="?", metavar="ID", help="its id (default: list those of abstract and conclusions)")
    judged = f"{RESULTS}, judged (default: as published)"
    p.add_argument("results", nargs="?", metavar="RESULTS", help=judged)
    p.add_argument("--run", dest="make", action="store_true", help="make the runs of its map alone, and judge these")
    p.add_argument("--rows", action="store_true", help="also list every setting: number, holds or not, and its command")
    p.add_argument("--all", action="store_true", help="without ID: list every claim")
    p.add_argument("--out", metavar="DIR", help="with --run: results folder (default: results/local/claim-ID-<time>)")
    add_jobs(p)


def _add_gate(commands: Any) -> None:
    """Add the parser of the command ``gate``."""
    words = "run a suite and compare it with thresholds; exit code 0 if the gate is open, 1 if closed"
    p = add_subcommand(commands, "gate", words, "one object", native=True)
    p.add_argument("--suite", metavar="SUITE", help="name or TOML file (default: ci; with --results of files, those)")
    p.add_argument("--thresholds", metavar="FILE", help="default: results/baselines/<suite>.toml")
    p.add_argument("--results", metavar="RESULTS", help=f"judge this {RESULTS}, instead of running the suite")
    p.add_argument("--any-code", action="store_true", help="with --results: accept results of other code too")
    without = "judge without the runs that need this package, where it is not installed; once for each"
    p.add_argument("--without", metavar="PACKAGE", action="append", default=[], help=without)
    p.add_argument("--update", action="store_true", help="print a diff that tightens thresholds and adds missing ones")
    p.add_argument("--loosen", action="store_true", help="with --update: also propose wider bounds")
    spread = "with --update: repeat each run N times, changed by rounding alone, and widen bounds by that"
    p.add_argument("--spread", type=int, metavar="N", help=spread)
    p.add_argument("--write", action="store_true", help="with --update: write the file instead of printing the diff")
    p.add_argument("--all", action="store_true", help="show every threshold, not only those that failed or moved")
    add_file(p, "--junit", words="write the result as JUnit XML")
    add_file(p, "--markdown", words="write failed and moved thresholds as Markdown")
    add_run_options(p)


def _add_verify(commands: Any) -> None:
    """Add the parser of the command ``verify``."""
    words = "repeat a sample of finished runs and compare; exit code 0 if they agree, 1 if not"
    p = add_subcommand(commands, "verify", words, "one object, as diff prints it")
    p.add_argument("results", type=find_results, metavar="RESULTS", help=RESULTS)
    p.add_argument(
        "--sample", type=parse_positive_int, metavar="N", default=5, help="number of runs to repeat (default: 5)"
    )
    p.add_argument(
        "--seed", type=parse_positive_int, metavar="K", default=SEED, help=f"seed of the sample (default: {SEED})"
    )
    add_jobs(p)
    add_plugin(p, "plugin that the results were made with")


def _add_diff(commands: Any) -> None:
    """Add the parser of the command ``diff``."""
    words = "compare two results folders; exit code 0 if identical, 1 if not"
    p = add_subcommand(commands, "diff", words, "one object")
    p.add_argument("before", type=find_results, metavar="BEFORE", help=RESULTS)
    p.add_argument("after", type=find_results, metavar="AFTER", help=RESULTS)
    limit = f"changes shown, largest first (default: {CHANGES})"
    p.add_argument("--limit", type=parse_positive_int, metavar="N", default=CHANGES, help=limit)


def _add_merge(commands: Any) -> None:
    """Add the parser of the command ``merge``."""
    p = add_subcommand(commands, "merge", "merge results folders into one; the sources are not changed", "one object")
    p.add_argument("out", metavar="OUT", help="results folder to create or to add to")
    p.add_argument("sources", type=find_results, metavar="RESULTS", nargs="+", help="results folders to merge")


def _add_remeasure(commands: Any) -> None:
    """Add the parser of the command ``remeasure``."""
    words = (
        "measure finished runs again by the laws of this code: solved again they must have the same bits; costs stay; "
        "exit code 1 if a run could not be measured again"
    )
    p = add_subcommand(commands, "remeasure", words, "one object")
    add_results(p)
    add_plugin(p, "plugin that the results were made with")
    add_jobs(p)


def _add_clean(commands: Any) -> None:
    """Add the parser of the command ``clean``."""
    words = (
        "remove old results in results/local/ and unused files of caches; never results that a command is writing, "
        "that latest points to, or that have a name of your own"
    )
    p = add_subcommand(commands, "clean", words)
    keep = "number of newest results of each suite to keep (default: 1)"
    p.add_argument("--keep", type=parse_positive_int, default=1, metavar="N", help=keep)
    older = "only results unchanged, and files of caches unused (default: 30d), for this time, for example 12h"
    p.add_argument("--older-than", type=parse_duration, metavar="7d", help=older)
    p.add_argument("--dry-run", action="store_true", help="say what would be removed, and remove nothing")


def _add_history(commands: Any) -> None:
    """Add the parser of the command ``history``."""
    p = add_subcommand(commands, "history", "show each run's results over time and commits", "one object per row")
    p.add_argument("source", nargs="*", help="results folders and .jsonl files (default: all there are)")
    p.add_argument("--metric", default="energy_drift_max_J", metavar="NAME", help=f"one of {', '.join(METRICS)}")
    p.add_argument("--problem", metavar="NAME", help="only this problem")
    p.add_argument("--solver", metavar="NAME", help="only this solver")
    add_file(p, "--write", words="write the rows to a file, e.g. in results/history/", metavar="FILE.jsonl")


def _add_figures(commands: Any) -> None:
    """Add the parser of the command ``figures``."""
    p = add_subcommand(commands, "figures", "write vector figures and tables for a publication")
    add_results(p)
    p.add_argument("--paper", action="store_true", help="write figures 1 to 12 of the paper instead, with notes")
    only = "only this problem, or with --paper this figure, e.g. fig05; may be repeated"
    p.add_argument("--only", action="append", default=[], metavar="NAME", help=only)
    called = "name of a solver in figures and tables, e.g. gc_weak_form=ODE-GC; may be repeated"
    p.add_argument("--name", action="append", default=[], metavar="SOLVER=TEXT", help=called)
    words = "installed font family of text and mathematics, or latex: that of LaTeX documents (default: DejaVu Sans)"
    p.add_argument("--font", default="", metavar="FAMILY", help=words)
    size = "size of titles and labels [pt]; ticks and legends are 7/8 of it (default: 8)"
    p.add_argument("--font-size", type=parse_positive_float, metavar="PT", help=size)


def _add_completion(commands: Any) -> None:
    """Add the parser of the command ``completion``."""
    words = "print the script by which a shell completes commands, options and names; its first lines say where it goes"
    p = add_subcommand(commands, "completion", words)
    p.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))
