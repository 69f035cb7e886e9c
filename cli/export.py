"""Print a problem with all its numbers, for another code to solve (``export``)."""

import argparse

from ..harness.base.files import to_json, write_text
from ..harness.catalogue.description import describe_problem
from ..harness.catalogue.trial import make_problem
from .arguments import load_problem
from .terminal import make_console


def run(arguments: argparse.Namespace) -> int:
    """Print the problem as JSON, or write it to the file of --out; return 0."""
    name, parameters, _ = load_problem(arguments)
    text = to_json(describe_problem(make_problem(name, parameters)), indent=1)
    if arguments.out is None:
        make_console().print(text)
        return 0
    write_text(arguments.out, text + "\n")
    return 0
