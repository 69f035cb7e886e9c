"""The parser of the command line; names and summaries of the commands are read from their files, without importing."""

import argparse
import ast
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NoReturn

from ..harness.catalogue.options import nearest

FIRST = (
    "list", "solve", "run", "show", "report", "check", "try", "advise", "referee", "export", "judge", "claim", "gate",
    "verify", "diff", "merge", "history",
)  # fmt: skip
WORDS = "Benchmark of integrators for constrained multibody dynamics: run, measure, judge, report."
MORE = "mbsbench COMMAND --help explains a command; docs/glossary.md explains the terms."


class UsageError(ValueError):
    """A wrong call: one line, exit code 2."""


class Parser(argparse.ArgumentParser):
    """argparse with its errors in one line; an unknown option is answered with the nearest one of its command."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        found, left = super().parse_known_args(args, namespace)
        for name in (word.partition("=")[0] for word in left if word.startswith("--")):
            self.error(f"unknown option {name}{nearest(name, list(self._option_string_actions))}")
        return found, left

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """The value of an argument; what its type complains about begins with the argument where it says ``must``."""
        if not callable(action.type):
            return super()._get_value(action, arg_string)  # type: ignore[misc]
        try:
            return action.type(arg_string)
        except UsageError as error:
            name = action.option_strings[0] if action.option_strings else action.metavar
            raise UsageError(f"{name} {error}" if str(error).startswith("must") else str(error)) from None

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


def top_parser() -> tuple[Parser, Any]:
    """The parser of ``mbsbench``, and what its commands are added to."""
    parser = Parser(prog="mbsbench", description=WORDS, epilog=MORE)
    parser.add_argument("--version", action="store_true", help="print the version")
    return parser, parser.add_subparsers(metavar="COMMAND", required=True, parser_class=Parser)


def subcommand(
    commands: Any, name: str, run: Callable[[argparse.Namespace], int], summary: str, json: str = ""
) -> argparse.ArgumentParser:
    """A parser that shows ``summary`` in the list of commands and in its own help; ``json``: what --json prints.

    ``name`` and ``summary`` are text or a variable of the same function: ``read_summaries`` reads the source.
    """
    description = f"{summary[0].upper()}{summary[1:]}."
    p: argparse.ArgumentParser = commands.add_parser(name, help=summary, description=description)
    p.set_defaults(run=run)
    if json:
        p.add_argument("--json", action="store_true", help=f"print JSON: {json}")
    return p


def read_summaries() -> Mapping[str, tuple[str, str]]:
    """Module and summary of each command, in the order of ``FIRST``, then by name."""
    found: dict[str, tuple[str, str]] = {}
    for path in Path(__file__).parent.glob("*.py"):
        source = path.read_bytes()
        if b"subcommand(" not in source or path == Path(__file__):
            continue
        for function in ast.parse(source).body:
            if isinstance(function, ast.FunctionDef) and function.name == "add":
                name, summary = _read_declaration(function)
                found[name] = path.stem, summary
    return dict(sorted(found.items(), key=lambda k: (FIRST.index(k[0]) if k[0] in FIRST else len(FIRST), k[0])))


def _read_declaration(function: ast.FunctionDef) -> tuple[str, str]:
    """Name and summary in the call of ``subcommand``."""
    texts: dict[str, str] = {}
    for statement in function.body:
        for node in ast.walk(statement):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "subcommand":
                name, summary = (
                    texts[a.id] if isinstance(a, ast.Name) else ast.literal_eval(a)
                    for a in (node.args[1], node.args[3])
                )
                return str(name), str(summary)
        if isinstance(statement, ast.Assign) and isinstance(statement.value, ast.Constant):
            texts |= {t.id: str(statement.value.value) for t in statement.targets if isinstance(t, ast.Name)}
    raise TypeError(f"add calls no subcommand (line {function.lineno})")
