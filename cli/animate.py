"""``animate``: a mechanism in motion, as GIF or MP4."""

import argparse
from pathlib import Path
from typing import Any

from .screen import lines
from .terms import add_results, check_writable, existing, subcommand


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = subcommand(commands, "animate", run, "write an animation of a mechanism as GIF or MP4, from stored poses")
    add_results(p)
    p.add_argument("--problem", required=True, metavar="NAME", help="problem or variant, e.g. 'chain[t_end=2]'")
    names = "run_id (or its first digits) or solver; may be repeated (default: one run per solver)"
    p.add_argument("--run", action="append", default=[], metavar="RUN", dest="run_name", help=names)
    p.add_argument("--out", required=True, metavar="FILE", help="file.gif, or file.mp4 (needs ffmpeg)")
    p.add_argument("--ghosts", action="store_true", help="overlay the runs (default: side by side)")
    p.add_argument("--frames", type=int, default=150, metavar="N", help="number of frames (default: 150)")
    p.add_argument("--fps", type=int, default=25, metavar="N", help="frames per second (default: 25)")
    p.add_argument("--start", type=float, default=None, metavar="T", help="first simulated time [s]")
    p.add_argument("--end", type=float, default=None, metavar="T", help="last simulated time [s]")


def run(arguments: argparse.Namespace) -> int:
    """Write the file and print its size."""
    folder, out = existing(arguments.results), Path(arguments.out)
    from ..reports.mechanism import animation  # here: it takes a second to load

    check_writable(out)
    window = (arguments.start, arguments.end)
    made = animation.animate(folder, arguments.problem, arguments.run_name, out, ghosts=arguments.ghosts,
                          frames=arguments.frames, fps=arguments.fps, window=window)  # fmt: skip
    lines().print(f"animation: {out} ({made})")
    return 0
