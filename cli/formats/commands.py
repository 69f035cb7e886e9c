"""Define the arguments of the command that judges motions of other programs."""

import argparse
from typing import Any

from ...harness.formats.motions.conventions import CHOICES, UNSAID, USUAL
from ..arguments import add_plugin, add_problem, parse_positive_float
from ..commands import add_subcommand

MEANING = {
    "euler": "axes of Euler angles (phi, theta, psi or roll, pitch, yaw) in the order of their columns; small: fixed; "
    "none: leave them out",
    "length": "unit of positions, and of velocities per second",
    "time": "unit of t",
    "angle": "unit of Euler angles, and of angular velocities per second",
    "quaternion": "order of quaternions without letters",
    "rotation": "what quaternions and matrices take to what",
    "omega": "frame of angular velocities",
}


def add_commands(commands: Any) -> None:
    """Add the parser of the command ``referee``."""
    _add_referee(commands)


def _add_referee(commands: Any) -> None:
    """Add the parser of the command ``referee``."""
    words = (
        "judge the motion in a file (text, Parquet, NPZ, MAT, FMU) that any other code computed; exit code 0: all are "
        "successes, 3: laws hold, but a motion is inaccurate, 1: one is wrong or cut short, 2: a file cannot be judged"
    )
    p = add_subcommand(commands, "referee", words, "one object a file", native=True, room="formats")
    add_problem(p)
    p.add_argument("files", nargs="+", metavar="FILE", help="file, or folder of files: docs/your-own-solver.md")
    p.add_argument("--name", metavar="NAME", help="name of the code in tables (default: that of the file or folder)")
    add_reading_options(p)
    for name in ("dt", "rtol"):
        help_ = f"{name} the other code used, for tables (default: dt, the spacing of the rows)"
        p.add_argument(f"--{name}", type=parse_positive_float, metavar="X", help=help_)
    p.add_argument("--into", metavar="RESULTS", help="results folder to add to, for tables and report; made if missing")
    add_plugin(p)


def add_reading_options(p: argparse.ArgumentParser) -> None:
    """Add the options that define how the columns of a file are read."""
    p.add_argument(
        "--columns", metavar="OURS=THEIRS,...", help="names of columns; for a file without a header, OURS in order"
    )
    for name, choices in CHOICES.items():
        usual = USUAL[name]
        words = f"{MEANING[name]} (default: {'not stated' if usual == UNSAID else usual})"
        p.add_argument(f"--{name}", choices=choices, default=usual, help=words)
    tolerance = "difference allowed at the start, in SI units (default: by the digits printed)"
    p.add_argument("--start-tolerance", type=parse_positive_float, metavar="X", help=tolerance)
