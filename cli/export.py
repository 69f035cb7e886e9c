"""``export``: a problem with all its numbers, for a code that is to solve it."""

import argparse
from pathlib import Path
from typing import Any

from ..harness.files import to_json, write_text
from ..harness.foreign.description import describe_problem
from ..harness.sandbox.trial import make_problem
from .arguments import add_plugin, add_problem, check_writable, load_problem, subcommand
from .terminal import console


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = subcommand(commands, "export", run, "print a problem with all its numbers, for any other code")
    add_problem(p)
    p.add_argument("--format", choices=("json",), default="json", help="see docs/your-own-solver.md (default: json)")
    p.add_argument("--out", metavar="FILE", help="file to write (default: print)")
    add_plugin(p)


def run(arguments: argparse.Namespace) -> int:
    """0."""
    name, parameters, _ = load_problem(arguments)
    text = to_json(describe_problem(make_problem(name, parameters)), indent=1)
    if arguments.out is None:
        console().print(text)
        return 0
    check_writable(Path(arguments.out))
    write_text(Path(arguments.out), text + "\n")
    return 0
