"""Parse the command line; every wrong call is answered in one line."""

import argparse
from typing import Any, NoReturn

from ..harness.base.hints import suggest_name

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


class GroupedHelp(argparse.HelpFormatter):
    """A help formatter that lists the commands under the headings of ``GROUPS``, each with its summary."""

    def _format_action(self, action: argparse.Action) -> str:
        """Return the help on one argument, where commands are listed by group and those of no group last."""
        if not isinstance(action, argparse._SubParsersAction):
            return super()._format_action(action)
        entries = {a.dest: a for a in action._get_subactions()}
        grouped = {title: names.split() for title, names in GROUPS.items()}
        rest = [name for name in entries if not any(name in own for own in grouped.values())]
        parts = [(title, [n for n in own if n in entries]) for title, own in [*grouped.items(), ("more", rest)]]
        self._indent()
        lines = [
            line
            for title, own in parts
            if own
            for line in (f"  {title}:\n", *(self._format_action(entries[n]) for n in own))
        ]
        self._dedent()
        return "".join(lines)


class Parser(argparse.ArgumentParser):
    """An argparse parser with errors in one line; for an unknown option it names the nearest one of the command.

    Options cannot be abbreviated: ``--native`` is looked for before there is a parser.
    """

    def __init__(self, *arguments: Any, **given: Any) -> None:
        """Create the parser with abbreviated options switched off."""
        super().__init__(*arguments, **{"allow_abbrev": False, **given})

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse the arguments; raise UsageError for an unknown option, with the nearest known one."""
        found, left = super().parse_known_args(args, namespace)
        for name in (word.partition("=")[0] for word in left if word.startswith("--")):
            self.error(f"unknown option {name}{suggest_name(name, list(self._option_string_actions))}")
        return found, left

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the converted value; an error that begins with ``must`` is prefixed with the argument's name."""
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


def make_parser() -> tuple[Parser, Any]:
    """Return the parser of ``mbsbench``, and the object that commands are added to."""
    parser = Parser(prog="mbsbench", description=WORDS, epilog=MORE, formatter_class=GroupedHelp)
    parser.add_argument(
        "--version", action="store_true", help="print the version, and what a report of a fault needs to say"
    )
    parser.add_argument("--verbose", action="store_true", help="with --version: also the places of caches and results")
    return parser, parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=Parser)
