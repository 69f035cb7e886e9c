"""Which runs are shown: those asked for, or of each solver its best."""

from collections.abc import Sequence
from pathlib import Path

from ....harness.results import store
from ...model.results import Run

MOST = 6  # mechanisms that one picture has room for


def runs_of(folder: Path) -> list[Run]:
    """All runs of a run that kept a series."""
    return [Run(r) for r in store.load(folder, check_series=False).records if r.series]


def choose(runs: Sequence[Run], problem: str, asked: Sequence[str]) -> list[Run]:
    """Runs of one variant, in the order asked for."""
    posed = _posed(runs, problem)
    if not asked:
        return [_best(posed, s) for s in dict.fromkeys(c.record.solver for c in posed)][:MOST]
    if len(asked) > MOST:
        raise ValueError(f"at most {MOST} runs have room in a picture (got {len(asked)})")
    return [_one(posed, text) for text in asked]


def _posed(runs: Sequence[Run], problem: str) -> list[Run]:
    found = [c for c in runs if c.variant == problem]
    if found:
        return found
    variants = sorted({c.variant for c in runs if c.record.problem == problem})
    if len(variants) == 1:
        return [c for c in runs if c.variant == variants[0]]
    known = variants or sorted({c.variant for c in runs})
    if not known:
        raise ValueError("no run of this run kept a motion")
    raise ValueError(f"no motion of {problem!r} in this run; there are {', '.join(known)}")


def _one(runs: Sequence[Run], text: str) -> Run:
    if any(c.record.solver == text for c in runs):
        return _best(runs, text)
    found = [c for c in runs if c.record.run_id.startswith(text)]
    if len(found) != 1:
        names = ", ".join(sorted({c.record.solver for c in runs}))
        what = "is no run of this problem" if not found else f"begins the names of {len(found)} runs"
        raise ValueError(f"{text!r} {what}; solvers are {names}, runs are named by their 16 digits")
    return found[0]


def _best(runs: Sequence[Run], solver: str) -> Run:
    """A success if there is one, else the one that came furthest; then recommended, then finest."""
    own = [c for c in runs if c.record.solver == solver]
    return min(own, key=lambda c: (not c.succeeded, -c.record.t_reached_s, len(c.options), c.fineness, c.record.case))
