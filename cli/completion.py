"""Print the script by which a shell completes commands, options and names (``completion``)."""

import argparse
import shlex
from typing import Any

from .commands import add_commands
from .list import load_catalogue
from .parser import make_parser
from .terminal import make_console

PLACES = {  # where each shell looks for the script
    "bash": "mbsbench completion bash > ~/.local/share/bash-completion/completions/mbsbench",
    "zsh": "mbsbench completion zsh > FOLDER/_mbsbench, with fpath+=FOLDER before compinit in ~/.zshrc",
    "fish": "mbsbench completion fish > ~/.config/fish/completions/mbsbench.fish",
}
FILES = ("FILE", "FILE.py", "FILE.py|ENGINE", "FILE.toml", "FILE.jsonl", "RUN.npz", "RUN|FILE", "B.zip", "CASE.json")
FOLDERS = ("DIR", "OUT")
RESULTS = ("RESULTS", "BEFORE", "AFTER")
ENTRIES = ("problem", "solver", "truth")  # options whose NAME is a problem or solver


def run(arguments: argparse.Namespace) -> int:
    """Print the completion script for a shell, with a comment in its first lines on where to save it; return 0.

    It holds the names of problems, solvers and suites; results folders are listed when the shell completes one.
    """
    import shtab

    parser, commands = make_parser()
    add_commands(commands)
    catalogue = load_catalogue()
    names = {kind: [str(entry["name"]) for entry in catalogue[kind]] for kind in ("problems", "solvers")}
    results = shtab.cmd("ls results/local 2>/dev/null; ls -d -- */ 2>/dev/null")
    by_metavar = {
        **dict.fromkeys(FILES, shtab.FILE),
        **dict.fromkeys(FOLDERS, shtab.DIRECTORY),
        **dict.fromkeys(RESULTS, results),
        "PROBLEM": _complete_names_or_files(names["problems"]),
        "SOLVER": _complete_names_or_files(names["solvers"]),
        "SUITE": _complete_names_or_files(catalogue["suites"]),
        "NAME": _complete_names_or_files(["problems", "solvers", *names["problems"], *names["solvers"]]),
    }
    for command in commands.choices.values():
        for action in command._actions:
            named = action.metavar != "NAME" or not action.option_strings or action.dest in ENTRIES
            if action.metavar in by_metavar and named and not action.choices:
                action.complete = by_metavar[action.metavar]  # type: ignore[attr-defined]
    script = shtab.complete(parser, arguments.shell)
    first, _, rest = script.partition("\n")
    note = f"# {PLACES[arguments.shell]}\n"
    make_console().print(f"{first}\n{note}{rest}" if first.startswith("#") else f"{note}{script}", end="\n")
    return 0


def _complete_names_or_files(names: list[str]) -> dict[str, Any]:
    """Return the completion of an argument by ``names`` and by files in the current folder, such as a suite."""
    import shtab

    return dict(shtab.cmd(f"printf '%s\\n' {shlex.join(names)}; ls 2>/dev/null"))
