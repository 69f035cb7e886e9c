"""How runs ended, counted."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .accuracy import drifts, measure_for
from .results import Results, Run, Variant, by_solver
from .variants import broadest, themselves
from .words import join_words, mark, truncate

KINDS = {  # of marks, in words
    "good": "succeeded", "inaccurate": "inaccurate", "wrong": "wrong", "failed": "stopped", "refused": "refused"
}  # fmt: skip
REASON = 90  # characters of a reason


@dataclass(frozen=True)
class Score:
    """Numbers of runs that finished here; ``bounded`` and ``drifting``: successes whose energy error tells."""

    succeeded: int
    inaccurate: int
    wrong: int
    stopped: int
    refused: int
    bounded: int
    drifting: int

    @property
    def runs(self) -> int:
        return sum(getattr(self, name) for name in KINDS.values())

    @property
    def began(self) -> int:
        """Refusals left out: how many might have stopped."""
        return self.runs - self.refused

    @property
    def shares(self) -> list[tuple[str, int, float]]:
        """Kind, count and percent of all, for a bar."""
        return [(kind, n, 100.0 * n / self.runs) for kind, name in KINDS.items() if (n := getattr(self, name))]

    @property
    def words(self) -> str:
        """``5 succeeded, 1 wrong``."""
        return join_words([f"{n} {name}" for name in KINDS.values() if (n := getattr(self, name))]) or "no run"


def score(runs: Iterable[Run]) -> Score:
    """Score of any runs."""
    own = list(runs)
    kinds = Counter(mark(c.status).kind for c in own)
    energy = Counter(drifts(c) for c in own if c.is_success)
    ended = {name: kinds[kind] for kind, name in KINDS.items()}
    return Score(**ended, bounded=energy[False], drifting=energy[True])


def standings(results: Results) -> list[dict[str, Any]]:
    """Outcomes of each solver's finest settings on the problems of the plain comparison, and of all its runs.

    Whose finest settings succeed on most problems is first; equals by name.
    """
    label, out = broadest(results), list[dict[str, Any]]()
    variants = themselves(results, label)
    for solver, own in by_solver(results.runs).items():
        stands = [(p, h) for p in variants if (h := finest(p, solver, label)) is not None]
        heads = [h for _, h in stands]
        failures = [(p, c) for p, c in stands if not (c.is_success or c.is_unfinished)]
        out.append({
            "solver": solver, "paper_label": ", ".join(dict.fromkeys(r.record.paper_label for r in heads or own[:1])),
            "finest": score(heads), "everything": score(own),
            "breaks_on": [(c, truncate(c.reasons[0], REASON) + _finer(p, c)) for p, c in failures],
        })  # fmt: skip
    out.sort(key=lambda v: (-v["finest"].succeeded / max(v["finest"].runs, 1), not v["finest"].runs, v["solver"]))
    return out


def finest(variant: Variant, solver: str, label: str) -> Run | None:
    """The run that stands for a solver on a problem: the smallest step or tolerance, fewest options."""
    own = [c for c in variant.runs if c.record.solver == solver and c.record.label == label]
    return min(own, key=lambda c: c.finest_first, default=None)


def _finer(variant: Variant, run: Run) -> str:
    """Words for a finer step or tolerance at which the same settings succeed, in whatever group that was run."""
    own = [c for c in variant.runs if c.method == run.method and c.is_success]
    finer = [c for c in own if c.step_or_tolerance < run.step_or_tolerance]
    best = max(finer, key=lambda c: c.step_or_tolerance, default=None)
    return f"; succeeds at {best.step_words}" if best else ""


def unpredictable(results: Results) -> str:
    """On what problems of the plain comparison errors are judged over a part of the time only."""
    variants = themselves(results, broadest(results))
    found = [(p, m.until) for p in variants if (m := measure_for(p.runs)) and m.until is not None]
    parts = [f"{p.title} to {until:.2g} of {max(c.record.t_end_s for c in p.runs):g} s" for p, until in found]
    return f"Errors are judged while the motion is predictable: {join_words(parts)}." if parts else ""
