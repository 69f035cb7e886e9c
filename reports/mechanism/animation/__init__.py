"""A mechanism in motion from stored poses, as GIF or MP4: solvers side by side or as ghosts, with their energy."""

from collections.abc import Sequence
from pathlib import Path

from ....harness.results import store
from ...model.results import Run, by_solver
from .files import check_kind, write
from .stage import Stage, actors_of

MOST = 6  # mechanisms that one picture has room for
MOST_FRAMES = 2000  # as many poses as a series file has


def runs_of(folder: Path) -> list[Run]:
    """All runs that kept a series."""
    return [Run(r) for r in store.load(folder, check_series=False).records if r.series]


def choose(runs: Sequence[Run], problem: str, asked: Sequence[str]) -> list[Run]:
    """Runs of one variant, in the order asked for."""
    runs = _of_variant(runs, problem)
    if not asked:
        return [_best(own) for own in by_solver(runs).values()][:MOST]
    if len(asked) > MOST:
        raise ValueError(f"at most {MOST} runs fit into a picture (got {len(asked)})")
    return [_one(runs, text) for text in asked]


def _of_variant(runs: Sequence[Run], problem: str) -> list[Run]:
    found = [c for c in runs if c.variant == problem]
    if found:
        return found
    variants = sorted({c.variant for c in runs if c.record.problem == problem})
    if len(variants) == 1:
        return [c for c in runs if c.variant == variants[0]]
    known = variants or sorted({c.variant for c in runs})
    if not known:
        raise ValueError("no run in these results stored its motion")
    raise ValueError(f"no stored motion of {problem!r} in these results; there are {', '.join(known)}")


def _one(runs: Sequence[Run], text: str) -> Run:
    if text in by_solver(runs):
        return _best(by_solver(runs)[text])
    found = [c for c in runs if c.record.run_id.startswith(text)]
    if len(found) != 1:
        names = ", ".join(sorted({c.record.solver for c in runs}))
        what = f"begins the run_id of {len(found)} runs" if found else "is no run of this problem"
        raise ValueError(f"{text!r} {what}; give the run_id of a run, or one of the solvers {names}")
    return found[0]


def _best(runs: Sequence[Run]) -> Run:
    """A success if there is one, else the one that came furthest; then recommended, then finest."""
    return min(
        runs,
        key=lambda c: (not c.succeeded, -c.record.t_reached_s, len(c.options), c.step_or_tolerance, c.record.case),
    )


def animate(
    folder: Path, problem: str, asked: Sequence[str], out: Path, *, ghosts: bool = False, frames: int = 150,
    fps: int = 25, window: tuple[float | None, float | None] = (None, None),
) -> str:  # fmt: skip
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
