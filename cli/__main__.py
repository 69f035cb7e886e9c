"""``mbsbench``, the command line. Exit code 0: done, 1: a run or gate failed, 2: wrong call (one line)."""

import importlib
import io
import os
import signal
import sys
from types import ModuleType
from typing import NoReturn

from ..harness.results.environment import THREADS
from .parser import UsageError, read_summaries, top_parser

INTERRUPTED = {
    "run": "interrupted; finished runs are kept (--resume continues)",
    "gate": "interrupted; nothing was judged",
}
OWN_MESSAGE = ("solve",)

os.environ.update(THREADS)  # before numpy is loaded, which reads them once


def main(arguments: list[str] | None = None) -> int:
    """Parse and run a subcommand; returns the exit code. Without one, or with --help, the list of commands: 0."""
    given = sys.argv[1:] if arguments is None else arguments
    parsed = None
    try:
        if not given or given[0] in ("-h", "--help", "--version"):
            sys.stdout.write(f"mbsbench {_read_version()}\n" if given[:1] == ["--version"] else _format_overview())
            return 0
        parser, commands = top_parser()
        for command in import_commands(given[0]):
            command.add(commands)
        parsed = parser.parse_args(given)
        return int(parsed.run(parsed))
    except KeyboardInterrupt:
        asked = str(parsed.run.__module__).rpartition(".")[2] if parsed is not None else ""
        if asked not in OWN_MESSAGE:
            sys.stderr.write(f"{INTERRUPTED.get(asked, 'interrupted')}\n")
        return 130
    except BrokenPipeError:  # the output pipe is closed (head, less): part of the output is lost, so no success
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 128 + signal.SIGPIPE
    except (ValueError, OSError, RuntimeError) as error:
        code, words = _explain(error)
        sys.stderr.write(f"error: {' '.join(words.split())}\n")
        return code


def _explain(error: Exception) -> tuple[int, str]:
    """Exit code and words of an error that is the user's, or the machine's; any other is raised."""
    if isinstance(error, ValueError):  # UsageError, SuiteError, StoreError, and those of the registry
        return 2, str(error)
    if isinstance(error, OSError):  # a full disk, a folder that may only be read, a name too long, a link in results
        where = f"{error.filename}: " if error.filename is not None else ""
        return 2, f"{where}{error.strerror or error}"
    if isinstance(error, RecursionError):
        return 2, "a file is nested too deeply to be read"
    from ..harness.execution.pool import PoolError  # here: it takes half a second, which --help does not need

    if isinstance(error, PoolError):
        return 1, str(error)
    raise error


def _format_overview() -> str:
    """The text of --help; no command is imported for it."""
    parser, commands = top_parser()
    for name, (_, summary) in read_summaries().items():
        commands.add_parser(name, help=summary)
    return parser.format_help()


def _read_version() -> str:
    """Version of the installed package."""
    from importlib.metadata import version

    return version("mbsbench")


def import_commands(asked: str = "") -> list[ModuleType]:
    """The modules of all commands, or that of the one asked for."""
    known = read_summaries()
    if asked and asked not in known:
        names = ", ".join(known)
        raise UsageError(f"argument COMMAND: invalid choice: {asked!r} (choose from {names}; see mbsbench --help)")
    modules = [module for name, (module, _) in known.items() if asked in ("", name)]
    return [importlib.import_module(f".{module}", __package__) for module in modules]


def _exit_on_signal(number: int, frame: object) -> NoReturn:
    raise SystemExit(128 + number)  # through every ``finally``: child processes end, no file is left half-written


def command_line() -> NoReturn:
    """The command ``mbsbench``."""
    signal.signal(signal.SIGTERM, _exit_on_signal)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # sparklines in the C locale of a batch system
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # an inherited SIG_IGN would make waitpid fail
    sys.exit(main())


if __name__ == "__main__":
    command_line()
