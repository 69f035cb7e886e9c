"""Run ``mbsbench``, the command line; exit code 0: done, 1: a run or gate failed, 2: wrong call (one line)."""

import argparse
import contextlib
import io
import os
import signal
import sys
from functools import cache
from importlib import import_module
from typing import Any, NoReturn

if not hasattr(os, "fork"):  # before the imports below fail one by one on modules that Windows lacks
    sys.exit("error: mbsbench runs solvers in forked processes, which Windows does not have: use WSL")

from ..harness.base import machine
from ..harness.base.hints import suggest_name
from ..harness.base.isolation import end_with_parent
from .commands import add_commands
from .parser import UsageError, list_commands, make_parser

INTERRUPTED = {
    "run": "interrupted; finished runs are kept (--resume continues)",
    "gate": "interrupted; nothing was judged",
}
OWN_MESSAGE = ("solve",)  # commands that print their own message when they are interrupted
JUDGING = ("gate",)  # commands whose exit code 0 is a verdict

os.environ.update(machine.THREADS)  # before NumPy is loaded, which reads them once


def main(arguments: list[str] | None = None) -> int:
    """Parse and run a subcommand; return its exit code, 130 if interrupted, 141 if the output pipe was closed.

    Errors of the user or the machine are printed in one line; others are raised. Without a subcommand, or with --help,
    the list of commands is printed and 0 returned.
    """
    words = sys.argv[1:] if arguments is None else arguments
    command = ""
    if "--native" in words:  # before a command loads NumPy, which reads its environment once
        machine.unpin_arithmetic()
    try:
        parser, commands = _make_commands()
        if not words or words[0] in ("-h", "--help"):
            sys.stdout.write(parser.format_help())
            return 0
        if words[0] == "--version":
            from .version import describe_version  # here, as what a command alone needs

            sys.stdout.write(describe_version(words[1:]))
            return 0
        if words[0] not in commands.choices:
            raise UsageError(f"no command is called {words[0]!r}{suggest_name(words[0], list_commands(commands))}")
        try:
            parsed = parser.parse_args(words)
        except SystemExit:  # argparse has printed the help of a command
            return 0
        command = parsed.command
        return int(import_module(f".{parsed.module}", __package__).run(parsed))
    except KeyboardInterrupt:
        if command not in OWN_MESSAGE:
            sys.stderr.write(f"{INTERRUPTED.get(command, 'interrupted')}\n")
        return 130
    except BrokenPipeError:  # the output pipe is closed (head, less): part of the output is lost, so no success
        return _leave_pipe()
    except (ValueError, OSError, RuntimeError) as error:
        code, explanation = _explain_error(error)
        sys.stderr.write(f"error: {' '.join(explanation.split())}\n")
        return code


@cache
def _make_commands() -> tuple[argparse.ArgumentParser, Any]:
    """Return the parser and its commands, which are made in the first call only."""
    parser, commands = make_parser()
    add_commands(commands)
    return parser, commands


def _explain_error(error: Exception) -> tuple[int, str]:
    """Return the exit code and the message of an error caused by the user or the machine; raise any other error."""
    if isinstance(error, ValueError):  # UsageError, FileError, and errors of the registry
        return 2, str(error)
    if isinstance(error, OSError):  # a full disk, a read-only folder, a name too long, a link in results
        where = f"{error.filename}: " if error.filename is not None else ""
        return 2, f"{where}{error.strerror or error}"
    if isinstance(error, RecursionError):
        return 2, "a file is nested too deeply to be read"
    from ..harness.base.forked_process import NotBegunError
    from ..harness.run.pool import PoolError  # here: it takes half a second, which --help does not need

    if isinstance(error, PoolError | NotBegunError):
        return 1, str(error)
    raise error


def _exit_on_signal(number: int, frame: object) -> NoReturn:
    """Raise SystemExit with the exit code that a shell gives for a signal."""
    raise SystemExit(128 + number)  # runs every ``finally``: child processes end, no file stays half-written


def command_line() -> NoReturn:
    """Run the command ``mbsbench`` and exit with its code; a command of ``JUDGING`` runs in a child process.

    SIGTERM ends the command in order, and output is UTF-8 whatever the locale.
    """
    signal.signal(signal.SIGTERM, _exit_on_signal)
    _open_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # sparklines in the C locale of a batch system
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # an inherited SIG_IGN would make waitpid fail
    sys.exit(_run_in_child() if sys.argv[1:2] in ([name] for name in JUDGING) else _run_main())


def _run_main() -> int:
    """Run ``main`` and flush its output; return its exit code, or that of a closed pipe if the reader has gone."""
    code = main()
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        code = _leave_pipe()
    return code


def _run_in_child() -> int:
    """Run the command in a child process and return the exit code that the child reports through a pipe.

    Plugin code that the command loads may call ``os._exit(0)``, which would otherwise pass for a verdict: a child that
    ends with 0 and no report gives 1. Any other child without a report gives its own code, or 128 plus its signal.
    """
    sys.stdout.flush()
    read, write = os.pipe()
    parent = os.getpid()
    child = os.fork()
    if not child:
        os.close(read)
        end_with_parent(parent, signal.SIGTERM)
        os.write(write, bytes([_run_main() & 255]))  # before handlers registered for the end of the process
        return 0
    os.close(write)
    os.set_blocking(read, False)  # a process left behind may hold the other end
    for name in (signal.SIGINT, signal.SIGTERM):  # a terminal sends SIGINT to the child, too, which ends in order
        signal.signal(name, lambda number, frame: _forward_signal(child, number))
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with contextlib.suppress(BlockingIOError):
        if verdict := os.read(read, 1):
            return verdict[0]
    if status == 0:
        sys.stderr.write("error: the command ended before its verdict: a file that it loaded ended its process\n")
        return 1
    return status if status > 0 else 128 - status  # a negative status is that of a signal


def _forward_signal(child: int, number: int) -> None:
    """Send a SIGTERM on to the process with id ``child``; a SIGINT of the terminal reaches it without help."""
    if number == signal.SIGTERM:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, number)


def _open_streams() -> None:
    """Open the null device for a closed stdin, stdout or stderr, so that no file takes its descriptor."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor
            os.set_inheritable(opened, True)
            setattr(sys, name, os.fdopen(opened, "r" if descriptor == 0 else "w", closefd=False))


def _leave_pipe() -> int:
    """Redirect standard output from the closed pipe to the null device; return the exit code of a closed pipe."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return 128 + signal.SIGPIPE


if __name__ == "__main__":
    command_line()
