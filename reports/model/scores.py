"""Count how runs ended."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .accuracy import choose_measure, is_drifting
from .results import StoredResults, StoredRun, Variant, group_by_solver
from .variants import find_plain_label, select_variants
from .words import join_words, mark_status, truncate

KINDS = {  # kinds of marks in words
    "good": "succeeded",
    "inaccurate": "inaccurate",
    "wrong": "wrong",
    "failed": "stopped",
    "refused": "refused",
}
REASON = 90  # most characters of a reason


@dataclass(frozen=True)
class SolverScore:
    """The numbers of runs by outcome, and how the energy error of the successes behaves.

    A success whose record does not decide between oscillation and drift is in neither ``bounded`` nor ``drifting``.
    """

    succeeded: int
    inaccurate: int
    wrong: int
    stopped: int
    refused: int
    bounded: int  # successes whose energy error oscillates
    drifting: int  # successes whose energy error drifts

    @property
    def runs(self) -> int:
        """The number of runs, without unfinished ones."""
        return sum(getattr(self, name) for name in KINDS.values())

    @property
    def began(self) -> int:
        """The number of runs that were not refused, so that they could stop."""
        return self.runs - self.refused

    @property
    def shares(self) -> list[tuple[str, int, float]]:
        """The kind, count and percentage of each outcome, for a bar."""
        return [(kind, n, 100.0 * n / self.runs) for kind, name in KINDS.items() if (n := getattr(self, name))]

    @property
    def words(self) -> str:
        """The counts in words: ``5 succeeded, 1 wrong``."""
        return join_words([f"{n} {name}" for name in KINDS.values() if (n := getattr(self, name))]) or "no run"


def count_outcomes(runs: Iterable[StoredRun]) -> SolverScore:
    """Count how runs ended, and the successes whose energy error is bounded or drifts.

    Unfinished runs are not counted: a limit of the harness ended them, which is not held against their solver.
    """
    given = list(runs)
    kinds = Counter(mark_status(run.status).kind for run in given)
    drifts = Counter(is_drifting(run) for run in given if run.is_success)  # None where undecided
    outcomes = {name: kinds[kind] for kind, name in KINDS.items()}
    return SolverScore(**outcomes, bounded=drifts[False], drifting=drifts[True])


def rank_solvers(results: StoredResults) -> list[dict[str, Any]]:
    """Return each solver's outcomes: its finest settings in the plain comparison with failures, and all its runs.

    The solver whose finest settings succeed on most problems is first; ties are sorted by name.
    """
    label, out = find_plain_label(results), list[dict[str, Any]]()
    variants = select_variants(results, label)
    for solver, own in group_by_solver(results.runs).items():
        pairs = [(p, run) for p in variants if (run := find_finest(p, solver, label)) is not None]
        finest = [run for _, run in pairs]
        failures = [(p, c) for p, c in pairs if not (c.is_success or c.is_unfinished)]
        out.append(
            {
                "solver": solver,
                "paper_label": ", ".join(dict.fromkeys(r.record.paper_label for r in finest or own[:1])),
                "finest": count_outcomes(finest),
                "everything": count_outcomes(own),
                "breaks_on": [(c, truncate(c.reasons[0], REASON) + _describe_finer(p, c)) for p, c in failures],
            }
        )
    out.sort(key=lambda v: (-v["finest"].succeeded / max(v["finest"].runs, 1), not v["finest"].runs, v["solver"]))
    return out


def find_finest(variant: Variant, solver: str, label: str) -> StoredRun | None:
    """Return a solver's run under ``label`` of smallest step or tolerance, then fewest options; None without one."""
    own = [c for c in variant.runs if c.record.solver == solver and c.record.label == label]
    return min(own, key=lambda c: c.finest_first, default=None)


def _describe_finer(variant: Variant, run: StoredRun) -> str:
    """Name the next finer step or tolerance at which the same settings succeed, under any label; empty if none does."""
    own = [c for c in variant.runs if c.method == run.method and c.is_success]
    finer = [c for c in own if c.step_or_tolerance < run.step_or_tolerance]
    best = max(finer, key=lambda c: c.step_or_tolerance, default=None)
    return f"; succeeds at {best.step_words}" if best else ""


def name_unpredictable(results: StoredResults) -> str:
    """Return a sentence on the problems of the plain comparison whose errors are judged over a part of the time only.

    It is empty if there is none.
    """
    variants = select_variants(results, find_plain_label(results))
    found = [(p, m.until) for p in variants if (m := choose_measure(p.runs)) and m.until is not None]
    parts = [f"{p.title} to {until:.2g} of {max(c.record.t_end_s for c in p.runs):g} s" for p, until in found]
    return f"Errors are judged while the motion is predictable: {join_words(parts)}." if parts else ""
