"""Define arguments that subcommands share, and convert their values."""

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..harness.base.cache import ROOT, is_checkout
from .parser import UsageError as UsageError

RESULTS = "results folder: a path, or a name in results/local/"


def add_results(p: argparse.ArgumentParser) -> None:
    """Add the argument RESULTS."""
    words = f"{RESULTS} (default: the newest)"
    p.add_argument("results", nargs="?", default="latest", type=find_results, metavar="RESULTS", help=words)


def add_jobs(p: argparse.ArgumentParser) -> None:
    """Add the option --jobs."""
    words = "parallel processes (default: all cores; use 1 for reliable timings)"
    p.add_argument("--jobs", type=parse_positive_int, metavar="N", help=words)


def add_plugin(p: argparse.ArgumentParser, words: str = "file that adds problems or solvers") -> None:
    """Add the option --plugin."""
    p.add_argument("--plugin", action="append", default=[], metavar="FILE.py", help=f"{words}; may be repeated")


def add_file(p: argparse.ArgumentParser, *names: str, words: str, metavar: str = "FILE", **how: Any) -> None:
    """Add an option that names a file to write; ``words`` are its help, ``how`` further arguments of argparse."""
    p.add_argument(*names, type=check_writable, metavar=metavar, help=words, **how)


def add_problem(p: argparse.ArgumentParser) -> None:
    """Add the argument PROBLEM, and the options --problem-set and --t-end."""
    words = "name of a problem (see mbsbench list), or an MJCF, URDF, SDFormat or USD file (docs/your-own-problem.md)"
    p.add_argument("problem", metavar="PROBLEM", help=words)
    add_set(p, "--problem-set", "problem parameter")
    p.add_argument("--t-end", type=parse_positive_float, metavar="T", help="simulated time [s]")


def add_set(p: argparse.ArgumentParser, option: str, words: str) -> None:
    """Add the option ``option``, which takes an assignment K=V and may be repeated; ``words`` are its help."""
    p.add_argument(option, action="append", default=[], metavar="K=V", help=f"{words}; may be repeated")


def parse_assignments(given: Sequence[str], what: str) -> dict[str, str]:
    """Parse ``["k=v", ...]`` into a dict; raise UsageError for any other text and for a repeated key.

    ``what`` names the option in the message.
    """
    out: dict[str, str] = {}
    for text in given:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key or not value.strip():
            raise UsageError(f"{what} takes key=value (got {text!r})")
        if key in out:
            raise UsageError(f"{what} {key} is given twice")
        out[key] = value.strip()
    return out


def load_plugins(paths: Sequence[str]) -> tuple[str, ...]:
    """Load the named plugins, each first in a process of its own that may crash; return their full names.

    For the file of a mechanism, what was read from it is printed on standard error.
    """
    if not paths:
        return ()
    from ..harness.catalogue import mechanism, plugins, registry  # here, as below: --help needs none of them
    from ..harness.catalogue.trial import try_in_process
    from .terminal import make_error_console

    for path in paths:
        try_in_process(f"plugin {path}", lambda path=path: registry.load_plugin(path))  # type: ignore[misc]
        if mechanism.is_mechanism(path):
            make_error_console().print(registry.problems()[mechanism.choose_name(path)].doc)
    return tuple(plugins.resolve_plugin(p) for p in paths)


def load_problem(arguments: argparse.Namespace) -> tuple[str, dict[str, Any], tuple[str, ...]]:
    """Load the plugins; return the problem's name, its parameters as given and the plugins' full names.

    The problem may be the file of a mechanism, which is loaded as a plugin.
    """
    from ..harness.catalogue import mechanism

    given, file = arguments.problem, mechanism.is_mechanism(arguments.problem)
    loaded = load_plugins([*arguments.plugin, *([given] if file else [])])
    parameters: dict[str, Any] = parse_assignments(arguments.problem_set, "--problem-set")
    if arguments.t_end is not None:
        if "t_end" in parameters:
            raise UsageError("t_end is given twice, by --t-end and --problem-set")
        parameters["t_end"] = arguments.t_end
    return mechanism.choose_name(given) if file else given, parameters, loaded


def check_not_installed(path: Path, option: str) -> None:
    """Raise UsageError if ``path`` is a file of an installed package, which must not change."""
    if path.resolve().is_relative_to(ROOT) and not is_checkout():
        raise UsageError(f"{path.name} is part of the installed package; give another place with {option}")


def add_run_options(p: argparse.ArgumentParser) -> None:
    """Add the options that commands share which run a suite: --jobs, --out and --plugin."""
    add_jobs(p)
    p.add_argument("--out", metavar="DIR", help="results folder to write (default: results/local/<suite>-<time>)")
    add_plugin(p)


def find_results(name: str) -> Path:
    """Return the results folder at a path, or of that name in results/local/; raise UsageError if there is none."""
    from ..harness.results import store

    for path in (Path(name), store.LOCAL / name):
        if store.is_results(path):
            return path
        store.refuse_older(path)
    if name == "latest":
        remedy = "run a suite first (mbsbench run paper) or give a results folder"
        raise UsageError(f"no results in {store.LOCAL}; {remedy}")
    raise UsageError(f"{name} is not a results folder: expected a path, or the name of a folder in {store.LOCAL}")


def parse_positive_int(text: str) -> int:
    """Parse a whole number > 0 from the command line."""
    if not text.isdecimal() or int(text) < 1:
        raise UsageError(f"must be a whole number > 0 (got {text!r})")
    return int(text)


def parse_positive_float(text: str, name: str = "") -> float:
    """Parse a finite number > 0; ``name`` begins the error message of a value that is not one option's alone."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise UsageError(f"{name} must be a finite number > 0 (got {text!r})".strip())
    return value


def parse_duration(text: str) -> float:
    """Return a duration such as ``12h``, ``7d`` or ``2w`` from the command line in seconds."""
    hours = {"h": 1.0, "d": 24.0, "w": 168.0}.get(text[-1:], 0.0)
    number = text[:-1]
    if not hours or not number.isdecimal() or len(number) > 6:
        raise UsageError(f"must be a whole number of hours, days or weeks, as 12h, 7d or 2w (got {text!r})")
    return 3600.0 * hours * int(number)


def count_jobs(given: int | None) -> int:
    """Return the number of parallel processes: as given, else one per core that this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return given or cores


def check_writable(given: str) -> Path:
    """Return the path ``given`` if a file can be written there, else raise UsageError before anything runs.

    A temporary file beside it is created and removed to find out; a file that exists is not touched.
    """
    out = Path(given)
    probe = out.parent / f".{out.name}.{os.getpid()}.probe"
    try:
        if out.is_dir():
            raise UsageError(f"cannot write {out}: it is a folder")
        with probe.open("xb"):
            pass
        probe.unlink()
    except OSError as error:
        raise UsageError(f"cannot write {out}: {error.strerror or error}") from None
    return out
