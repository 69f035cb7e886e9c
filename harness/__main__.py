"""``mbsbench``, the command line. Exit code 0: done, 1: a run or gate failed, 2: wrong call (one line)."""

import importlib
import io
import os
import pkgutil
import signal
import sys
from types import ModuleType
from typing import NoReturn

from . import commands as command_modules
from .results.environment import THREADS

FIRST = (
    "catalogue", "solve", "run", "show", "report", "check", "try", "advise", "referee", "export", "judge", "claim",
    "gate", "verify", "diff", "merge", "history",
)  # fmt: skip

INTERRUPTED = {
    "run": "interrupted; finished runs are kept (--resume continues)",
    "gate": "interrupted; nothing was judged",
}
OWN_MESSAGE = ("solve",)

os.environ.update(THREADS)  # before numpy is loaded, which reads them once


def main(arguments: list[str] | None = None) -> int:
    """Parse and run a subcommand; returns the exit code."""
    from .commands.terms import Parser
    from .execution.pool import PoolError

    words = "Benchmark of integrators for constrained multibody dynamics: run, measure, judge, report."
    more = "mbsbench COMMAND --help explains a command; docs/glossary.md explains the terms."
    parser = Parser(prog="mbsbench", description=words, epilog=more)
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    given = sys.argv[1:] if arguments is None else arguments
    for command in _commands(given[0] if given else ""):
        command.add(commands)
    parsed = None
    try:
        parsed = parser.parse_args(given)
        return int(parsed.run(parsed))
    except (ValueError, PoolError) as error:  # UsageError, SuiteError, StoreError, and what the registry says
        sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
        return 1 if isinstance(error, PoolError) else 2
    except KeyboardInterrupt:
        asked = str(parsed.run.__module__).rpartition(".")[2] if parsed is not None else ""
        if asked not in OWN_MESSAGE:
            sys.stderr.write(f"{INTERRUPTED.get(asked, 'interrupted')}\n")
        return 130
    except BrokenPipeError:  # the output pipe is closed (head, less): part of the output is lost, so no success
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 128 + signal.SIGPIPE
    except OSError as error:  # a full disk, a folder that may only be read, a name too long
        where = f"{error.filename}: " if error.filename is not None else ""
        sys.stderr.write(f"error: {where}{' '.join(str(error.strerror or error).split())}\n")
        return 2
    except RecursionError:
        sys.stderr.write("error: a file is nested too deeply to be read\n")
        return 2


def _commands(asked: str = "") -> list[ModuleType]:
    """The modules of ``harness/commands/`` that add a subcommand, in the order of ``FIRST``; or the one asked for.

    Their imports together take a second.
    """
    names = [m.name for m in pkgutil.iter_modules(command_modules.__path__)]
    names = [n for n in names if n == {"list": "catalogue"}.get(asked, asked)] or names
    ordered = sorted(names, key=lambda n: (FIRST.index(n) if n in FIRST else len(FIRST), n))
    modules = [importlib.import_module(f".{name}", command_modules.__name__) for name in ordered]
    return [m for m in modules if hasattr(m, "add")]


def _terminated(number: int, frame: object) -> NoReturn:
    raise SystemExit(128 + number)  # through every ``finally``: child processes end, no file is left half-written


def command_line() -> NoReturn:
    """The command ``mbsbench``."""
    signal.signal(signal.SIGTERM, _terminated)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # sparklines in the C locale of a batch system
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # a parent that ignores it would have us wait for nobody
    sys.exit(main())


if __name__ == "__main__":
    command_line()
