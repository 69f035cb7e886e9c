"""Define the arguments of the lab's commands, and what the lab adds to other commands."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...harness.lab.ladder.closing import TRIAL
from ..arguments import (
    RESULTS,
    add_file,
    add_jobs,
    add_plugin,
    add_problem,
    add_results,
    add_set,
    parse_positive_float,
    parse_positive_int,
)
from ..commands import CONTROL, SEED, add_subcommand
from ..formats.commands import add_reading_options

if TYPE_CHECKING:  # it loads NumPy, which a list of commands does not need
    from ...harness.mechanics.types import Problem

ROOM = "lab"  # this folder
TRUTH = "rkmk_dop853"  # its code is compiled once for all starts


def add_commands(commands: Any) -> None:
    """Add the parser of every command of the lab, and ``--shadow`` to ``solve``."""
    for add in (_add_ensemble, _add_fuzz, _add_shadow, _add_bundle, _add_submit, _add_ladder):
        add(commands)
    words = "also find the nearest true motion, as the command shadow does"
    commands.choices["solve"].add_argument("--shadow", action="store_const", const=_find_nearest, help=words)


def _find_nearest(problem: "Problem", path: Path) -> dict[str, Any]:
    """Describe the true motion nearest to the computed motion in the NPZ file ``path``, in words and numbers."""
    from .shadow import find_nearest  # here: it takes a second to load

    return find_nearest(problem, path)


def _add_ensemble(commands: Any) -> None:
    """Add the parser of the command ``ensemble``."""
    words = (
        "compare the motions of solvers from many starts with the true ones, as weather forecasts are scored; exit "
        "code 1 where they differ or members are missing"
    )
    p = add_subcommand(commands, "ensemble", words, "one object a solver, quantity and time", native=True, room=ROOM)
    add_problem(p)
    p.add_argument("solvers", nargs="+", metavar="SOLVER", help="name of a solver (see mbsbench list)")
    p.add_argument(
        "--starts", type=parse_positive_int, default=1000, metavar="N", help="number of starts (default: 1000)"
    )
    spread = "size of their changes: x 1 rad, x the largest arm of a joint, x the speed of a fall by it (default: 1e-3)"
    p.add_argument("--spread", type=parse_positive_float, default=1e-3, metavar="X", help=spread)
    p.add_argument("--at", metavar="T,T", help="times of scores [s] (default: half of the simulated time, and its end)")
    p.add_argument("--seed", type=parse_positive_int, default=SEED, metavar="K", help=f"random seed (default: {SEED})")
    add_set(p, "--set", f"{', '.join(CONTROL)} of the solvers that take it")
    p.add_argument("--truth", default=TRUTH, metavar="NAME", help=f"error-controlled true solver (default: {TRUTH})")
    add_file(p, "--html", words="also write scores, clouds and rank histograms to one HTML page")
    add_plugin(p)
    add_jobs(p)


def _add_fuzz(commands: Any) -> None:
    """Add the parser of the command ``fuzz``."""
    words = (
        "examine solvers on random mechanisms, each in two forms (turned, renumbered, mirrored, a body split, a joint "
        "repeated, other units), against each other and the truth; exit code 1 where a deviation is confirmed"
    )
    p = add_subcommand(commands, "fuzz", words, "one object", native=True, room=ROOM)
    p.add_argument("solvers", nargs="+", metavar="SOLVER", help="name of a solver (see mbsbench list)")
    p.add_argument("--mechanisms", type=parse_positive_int, default=100, metavar="N", help="how many (default: 100)")
    p.add_argument("--seed", type=parse_positive_int, default=SEED, metavar="S", help=f"random seed (default: {SEED})")
    p.add_argument("--first", type=int, default=0, metavar="K", help="number of the first (default: 0)")
    floor = "smallest deviation that counts, of the size of the mechanism (default: 1e-7; 1e-3 suits float32)"
    p.add_argument("--floor", type=parse_positive_float, default=1e-7, metavar="X", help=floor)
    shrink = "findings of a sort that are shrunk and written (default: 2)"
    p.add_argument("--shrink", type=parse_positive_int, default=2, metavar="N", help=shrink)
    add_set(p, "--set", "option of the solvers")
    p.add_argument("--repeat", metavar="CASE.json", help="examine this written case again, and no others")
    add_set(
        p, "--form", "form in which all mechanisms are presented, as split=1 or rotation=0.3,-0.5,0.7 (default: drawn)"
    )
    turns = "give each mechanism to one of the solvers, in turns, not to all"
    p.add_argument("--in-turns", action="store_true", help=turns)
    words = "folder to write (default: results/local/fuzz-<time>); a campaign that is there is continued"
    p.add_argument("--out", metavar="DIR", help=words)
    add_plugin(p)
    add_jobs(p)


def _add_shadow(commands: Any) -> None:
    """Add the parser of the command ``shadow``."""
    words = (
        "find the true motion nearest to a computed one, and the modified energy of a fixed step; exit code 1 where "
        "none is found within a tenth of the reach"
    )
    p = add_subcommand(commands, "shadow", words, "one object a finding", native=True, room=ROOM)
    p.add_argument("motion", metavar="RUN|FILE", help="run of --results, .npz of solve, or any file that referee reads")
    p.add_argument("--problem", metavar="PROBLEM", help="problem of a file that does not come from solve")
    add_set(p, "--problem-set", "its parameter")
    p.add_argument("--t-end", type=parse_positive_float, metavar="T", help="look no farther than this time [s]")
    results = f"{RESULTS} with the run, which is repeated (default: the newest)"
    p.add_argument("--results", default="latest", metavar="RESULTS", help=results)
    add_file(p, "--html", words="also write findings and distances over time to one HTML page")
    add_reading_options(p)
    add_plugin(p)


def _add_bundle(commands: Any) -> None:
    """Add the parser of the command ``bundle``."""
    words = "write results to one file that anybody can check without this package; exit code 1 if a record is damaged"
    p = add_subcommand(commands, "bundle", words, "one object", room=ROOM)
    add_results(p)
    add_file(p, "-o", "--out", words="file to write, as docs/bundle.md says", metavar="B.zip", required=True)
    lossless = "every step, solved again where the results lack it, not only the states that decide on the status"
    p.add_argument("--lossless", action="store_true", help=lossless)
    add_plugin(p, "plugin that the results were made with")
    add_jobs(p)


def _add_submit(commands: Any) -> None:
    """Add the parser of the command ``submit``."""
    words = (
        "run a solver on hidden instances and bundle the results; exit code 1 if nothing is solved or a success false"
    )
    p = add_subcommand(commands, "submit", words, "one object", native=True, room=ROOM)
    p.add_argument("submission", metavar="FILE.py|ENGINE", help="file with one solver, or name of a solver")
    value = "value that the ladder published after its entries were closed (default: a trial, which no ladder ranks)"
    p.add_argument("--value", default=TRIAL, metavar="TEXT", help=value)
    digest = "print the digest to enter before the value is published; run nothing"
    p.add_argument("--digest", action="store_true", help=digest)
    p.add_argument("-o", "--out", metavar="B.zip", help="bundle to write (default: <solver>.zip)")


def _add_ladder(commands: Any) -> None:
    """Add the parser of the command ``ladder``."""
    summary = "rank the bundles of submissions in a folder; exit code 1 if one was removed"
    p = add_subcommand(commands, "ladder", summary, "one object an entry, the best first", room=ROOM)
    words = (
        "folder of bundles; its ladder.toml states the value and the digests entered before it (without: a trial); "
        "its labels.toml may call bundles independent (default), ours or re-run by us"
    )
    p.add_argument("folder", metavar="DIR", help=words)
