"""Parse the command line; every wrong call is answered in one line."""

import argparse
import re
from typing import Any, NoReturn

from ..harness.base.hints import suggest_name

TITLE, METAVAR = "commands", "COMMAND"
WORDS = "Benchmark of integrators for constrained multibody dynamics: run, measure, judge, report."
GROUPS = {  # groups of commands, in the order of --help
    "run": "solve run advise ensemble",
    "inspect": "list show report figures history",
    "add your own": "check try fuzz referee shadow export submit ladder",
    "judge": "judge claim gate remeasure",
    "manage results": "verify diff merge bundle clean",
    "set up": "completion",
}
MORE = "mbsbench COMMAND --help explains a command; docs/glossary.md explains the terms."


class UsageError(ValueError):
    """A wrong call, reported in one line with exit code 2."""


class Parser(argparse.ArgumentParser):
    """An argparse parser with errors in one line; for an unknown option it names the nearest one of the command.

    Options cannot be abbreviated: ``--native`` is looked for before there is a parser.
    """

    def __init__(self, *arguments: Any, **given: Any) -> None:
        """Create the parser with abbreviated options switched off."""
        super().__init__(*arguments, **{"allow_abbrev": False, **given})
        self.color = False  # Python 3.14 would write escapes around the headings

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Return the parsed arguments and the unknown positional ones; raise UsageError for an unknown option."""
        found, left = super().parse_known_args(args, namespace)
        for name in (word.partition("=")[0] for word in left if word.startswith("--")):
            known = ["--help", *re.findall(r"--[\w-]+", self.format_usage())]
            self.error(f"unknown option {name}{suggest_name(name, known)}")
        return found, left

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Convert the text of an argument; put its name before an error message that starts with ``must``."""
        if not callable(action.type):
            return super()._get_value(action, arg_string)  # type: ignore[misc]
        try:
            return action.type(arg_string)
        except UsageError as error:
            name = action.option_strings[0] if action.option_strings else action.metavar
            raise UsageError(f"{name} {error}" if str(error).startswith("must") else str(error)) from None

    def error(self, message: str) -> NoReturn:
        """Raise UsageError in place of printing the usage and ending the process."""
        raise UsageError(f"{message} (see {self.prog} --help)")


def list_commands(commands: Any) -> list[str]:
    """Return the names of all commands added to ``commands``, in the order of --help."""
    grouped = " ".join(GROUPS.values()).split()
    return [n for n in grouped if n in commands.choices] + [n for n in commands.choices if n not in grouped]


class MainParser(Parser):
    """The parser of ``mbsbench``, whose help lists the commands under the headings of ``GROUPS``."""

    def format_help(self) -> str:
        """Return the help of argparse with its list of commands regrouped; commands of no group come last."""
        head, _, rest = super().format_help().partition(f"{TITLE}:\n  {METAVAR}\n")
        listed, end, tail = rest.partition("\n\n")
        entries = {entry.split()[0]: entry for entry in re.split(r"\n(?=    \S)", listed)}  # indented by four: a name
        grouped = {group: [n for n in names.split() if n in entries] for group, names in GROUPS.items()}
        grouped["more"] = [n for n in entries if not any(n in own for own in grouped.values())]
        lines = [line for group, own in grouped.items() if own for line in (f"  {group}:", *(entries[n] for n in own))]
        return "\n".join((f"{head}{TITLE}:", *lines)) + end + tail


def make_parser() -> tuple[Parser, Any]:
    """Return the parser of ``mbsbench``, and the object that commands are added to."""
    parser = MainParser(prog="mbsbench", description=WORDS, epilog=MORE)
    parser.add_argument(
        "--version", action="store_true", help="print the version, and what a report of a fault needs to say"
    )
    parser.add_argument("--verbose", action="store_true", help="with --version: also the places of caches and results")
    return parser, parser.add_subparsers(title=TITLE, metavar=METAVAR, required=True, parser_class=Parser)
