"""A mechanism in motion from stored poses, as GIF or MP4: solvers side by side or as ghosts, with their energy."""

from collections.abc import Sequence
from pathlib import Path

from .choosing import choose, runs_of
from .files import check_kind, write
from .stage import Stage, actors_of

MOST_FRAMES = 2000  # as many poses as a series file has


def animate(
    folder: Path,
    problem: str,
    asked: Sequence[str],
    out: Path,
    *,
    ghosts: bool = False,
    frames: int = 150,
    fps: int = 25,
    window: tuple[float | None, float | None] = (None, None),
) -> str:
    """Write ``out``; what it shows in words. A wrong call is a ValueError in one line."""
    check_kind(out)
    if not 2 <= frames <= MOST_FRAMES:
        raise ValueError(f"frames must be from 2 to {MOST_FRAMES} (got {frames})")
    if not 1 <= fps <= 60:
        raise ValueError(f"fps must be from 1 to 60 (got {fps})")
    chosen = choose(runs_of(folder), problem, asked)
    stage = Stage(actors_of(folder, chosen), ghosts=ghosts, frames=frames, window=window)
    write(stage.pictures(), out, fps)
    names = ", ".join(c.record.solver for c in chosen)
    return f"{names}; {frames} pictures, {stage.t[0]:g} to {stage.t[-1]:g} s, {out.stat().st_size / 1e6:.2g} MB"
