"""``mbsbench``, the command line. Exit code 0: done, 1: a run or gate failed, 2: wrong call (one line)."""

import contextlib
import io
import os
import signal
import sys
from importlib import import_module
from typing import NoReturn

if not hasattr(os, "fork"):  # before the imports below fail, one by one, on what Windows does not have
    sys.exit("error: mbsbench runs solvers in forked processes, which Windows does not have: use WSL")

from ..harness import machine
from ..harness.catalogue.options import nearest
from ..harness.sandbox.isolation import end_with
from .commands import add_commands
from .parser import UsageError, top_parser

INTERRUPTED = {
    "run": "interrupted; finished runs are kept (--resume continues)",
    "gate": "interrupted; nothing was judged",
}
OWN_MESSAGE = ("solve",)
JUDGING = ("gate",)  # whose exit code 0 is a verdict

os.environ.update(machine.THREADS)  # before NumPy is loaded, which reads them once


def main(arguments: list[str] | None = None) -> int:
    """Parse and run a subcommand; returns the exit code. Without one, or with --help, the list of commands: 0."""
    words = sys.argv[1:] if arguments is None else arguments
    command = ""
    if "--native" in words:  # now: NumPy reads its environment when a command loads it
        machine.unpin()
    try:
        parser, commands = top_parser()
        add_commands(commands)
        if not words or words[0] in ("-h", "--help"):
            sys.stdout.write(parser.format_help())
            return 0
        if words[0] == "--version":
            from .version import describe_version  # here, as what a command alone needs

            sys.stdout.write(describe_version(words[1:]))
            return 0
        if words[0] not in commands.choices:
            raise UsageError(f"no command is called {words[0]!r}{nearest(words[0], list(commands.choices))}")
        parsed = parser.parse_args(words)
        command = parsed.command
        return int(import_module(f".{command}", __package__).run(parsed))
    except KeyboardInterrupt:
        if command not in OWN_MESSAGE:
            sys.stderr.write(f"{INTERRUPTED.get(command, 'interrupted')}\n")
        return 130
    except BrokenPipeError:  # the output pipe is closed (head, less): part of the output is lost, so no success
        return _leave_pipe()
    except (ValueError, OSError, RuntimeError) as error:
        code, explanation = _explain(error)
        sys.stderr.write(f"error: {' '.join(explanation.split())}\n")
        return code


def _explain(error: Exception) -> tuple[int, str]:
    """Exit code and words of an error that is the user's, or the machine's; any other is raised."""
    if isinstance(error, ValueError):  # UsageError, FileError, and those of the registry
        return 2, str(error)
    if isinstance(error, OSError):  # a full disk, a folder that may only be read, a name too long, a link in results
        where = f"{error.filename}: " if error.filename is not None else ""
        return 2, f"{where}{error.strerror or error}"
    if isinstance(error, RecursionError):
        return 2, "a file is nested too deeply to be read"
    from ..harness.execution.pool import PoolError  # here: it takes half a second, which --help does not need
    from ..harness.sandbox.apart import NotBegunError

    if isinstance(error, PoolError | NotBegunError):
        return 1, str(error)
    raise error


def _exit_on_signal(number: int, frame: object) -> NoReturn:
    raise SystemExit(128 + number)  # through every ``finally``: child processes end, no file is left half-written


def command_line() -> NoReturn:
    """The command ``mbsbench``."""
    signal.signal(signal.SIGTERM, _exit_on_signal)
    _open_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # sparklines in the C locale of a batch system
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # an inherited SIG_IGN would make waitpid fail
    sys.exit(_judge_apart() if sys.argv[1:2] in ([name] for name in JUDGING) else _run_main())


def _run_main() -> int:
    code = main()
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        code = _leave_pipe()
    return code


def _judge_apart() -> int:
    """Run the command in a child: what it loads of others may leave by ``os._exit(0)``, which is no verdict."""
    sys.stdout.flush()
    read, write = os.pipe()
    parent = os.getpid()
    child = os.fork()
    if not child:
        os.close(read)
        end_with(parent, signal.SIGTERM)
        os.write(write, bytes([_run_main() & 255]))  # what is registered for the end of the process comes after it
        return 0
    os.close(write)
    os.set_blocking(read, False)  # a process that it left may hold the other end
    for name in (signal.SIGINT, signal.SIGTERM):  # a terminal sends the first to the child, too, which ends in order
        signal.signal(name, lambda number, frame: _pass_on(child, number))
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with contextlib.suppress(BlockingIOError):
        if verdict := os.read(read, 1):
            return verdict[0]
    if status == 0:
        sys.stderr.write("error: the command ended before its verdict: a file that it loaded ended its process\n")
    return 1 if status == 0 else status if status > 0 else 128 - status


def _pass_on(child: int, number: int) -> None:
    if number == signal.SIGTERM:
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, number)


def _open_streams() -> None:
    """Open what a caller has closed of standard input, output and error, so that no file of ours takes their place."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)  # the lowest that is free
            os.set_inheritable(opened, True)
            setattr(sys, name, os.fdopen(opened, "r" if descriptor == 0 else "w", closefd=False))


def _leave_pipe() -> int:
    """Let nothing more be written into the pipe whose reader is gone; return the exit code of a closed pipe."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return 128 + signal.SIGPIPE


if __name__ == "__main__":
    command_line()
