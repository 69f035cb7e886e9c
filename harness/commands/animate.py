"""``animate``: a mechanism of a run as GIF or MP4."""

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console

from .run import existing
from .terms import check_writable


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("animate", help="a mechanism in motion as GIF or MP4, from stored poses")
    p.add_argument("folder", nargs="?", default="latest", help="run folder (default: the newest)")
    p.add_argument("--problem", required=True, metavar="NAME", help="as posed, e.g. chain or 'chain[t_end=2]'")
    runs = "a run, or the start of its name, or a solver; may be given again (default: one a solver)"
    p.add_argument("--run", action="append", default=[], metavar="RUN", dest="run_name", help=runs)
    p.add_argument("--out", required=True, metavar="FILE", help="file.gif or file.mp4 (which needs ffmpeg)")
    p.add_argument("--ghosts", action="store_true", help="all in one picture (default: side by side)")
    p.add_argument("--frames", type=int, default=150, metavar="N", help="pictures (default: 150)")
    p.add_argument("--fps", type=int, default=25, metavar="N", help="pictures a second (default: 25)")
    p.add_argument("--start", type=float, default=None, metavar="T", help="from this simulated time [s]")
    p.add_argument("--end", type=float, default=None, metavar="T", help="to this simulated time [s]")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write it and say how large it is."""
    folder, out = existing(arguments.folder), Path(arguments.out)
    from ...reports.mechanism import animation  # here: it takes a second to load

    check_writable(out)
    window = (arguments.start, arguments.end)
    made = animation.animate(folder, arguments.problem, arguments.run_name, out, ghosts=arguments.ghosts,
                          frames=arguments.frames, fps=arguments.fps, window=window)  # fmt: skip
    Console(highlight=False, markup=False, soft_wrap=True).print(f"animation: {out} ({made})")
    return 0
