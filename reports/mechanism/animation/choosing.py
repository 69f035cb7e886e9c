"""Which runs are shown: those asked for, or of each solver its best."""

from collections.abc import Sequence
from pathlib import Path

from ....harness.results import store
from ...model.results import Run, by_solver

MOST = 6  # mechanisms that one picture has room for


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
