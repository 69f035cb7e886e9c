"""``python -m harness``: the command line. 0 done, 1 a run or gate failed, 2 a wrong call (one line, no traceback)."""

import os
import sys

from harness.environment import THREADS

os.environ.update(THREADS)  # before numpy is loaded, which reads them once


def main(arguments: list[str] | None = None) -> int:
    """Parse and run a subcommand; returns the exit code."""
    from harness.commands import catalogue, check, diff, gate, kernels, merge, peers, report, run, show, solve, verify
    from harness.commands.terms import Parser
    from harness.pool import PoolError

    parser = Parser(prog="python -m harness", description="The referee of constrained multibody dynamics.")
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)
    for command in (catalogue, solve, run, show, report, gate, check, verify, diff, merge, kernels, peers):
        command.add(commands)
    try:
        parsed = parser.parse_args(arguments)
        return int(parsed.run(parsed))
    except (ValueError, PoolError) as error:  # UsageError, SuiteError, StoreError, and what the registry says
        sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
        return 1 if isinstance(error, PoolError) else 2
    except KeyboardInterrupt:
        sys.stderr.write("interrupted; finished cells are kept (--resume goes on)\n")
        return 130
    except BrokenPipeError:  # the reader (head, less) has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return 0


if __name__ == "__main__":
    sys.exit(main())
