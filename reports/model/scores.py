"""How runs ended, counted: what a bar of the overview and a line of a solver's page show."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .accuracy import drifts, measure_for
from .results import Results, Run, Variant, by_solver
from .variants import broadest, themselves
from .words import cut, listed, mark, number, plural, time

KINDS = {  # of marks, in words
    "good": "succeeded", "inaccurate": "inaccurate", "wrong": "wrong", "failed": "stopped", "refused": "refused"
}  # fmt: skip
NAMED = 3  # variants named for a solver in an answer; more are counted
REASON = 90  # characters of a reason


@dataclass(frozen=True)
class Score:
    """Numbers of runs; ``bounded`` and ``drifting`` count successes whose energy error tells."""

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
    def shares(self) -> list[tuple[str, int, float]]:
        """Kind, count and percent of all, for a bar."""
        return [(kind, n, 100.0 * n / self.runs) for kind, name in KINDS.items() if (n := getattr(self, name))]

    @property
    def words(self) -> str:
        """``5 succeeded, 1 wrong``."""
        return listed([f"{n} {name}" for name in KINDS.values() if (n := getattr(self, name))]) or "no run"


def score(runs: Iterable[Run]) -> Score:
    """Of any runs."""
    own = list(runs)
    kinds = Counter(mark(c.status).kind for c in own)
    energy = Counter(drifts(c) for c in own if c.succeeded)
    ended = {name: kinds[kind] for kind, name in KINDS.items()}
    return Score(**ended, bounded=energy[False], drifting=energy[True])


@dataclass(frozen=True)
class Standing:
    """What became of a solver's finest settings on the problems of the plain comparison, and of all else."""

    solver: str
    paper_label: str
    finest: Score
    everything: Score
    drifts_on: tuple[Run, ...]
    breaks_on: tuple[tuple[Run, str], ...]  # with why, in a few words
    swings_on: tuple[Run, ...] = ()


def standings(results: Results) -> list[Standing]:
    """One a solver, whose finest settings succeed on most problems first; equals by name."""
    label = broadest(results)
    variants = themselves(results, label)
    out = []
    for solver, own in by_solver(results.runs).items():
        stands = [(p, h) for p in variants if (h := finest(p, solver, label)) is not None]
        heads = [h for _, h in stands]
        out.append(Standing(
            solver, ", ".join(dict.fromkeys(r.record.paper_label for r in heads or own[:1])), score(heads), score(own),
            tuple(c for c in heads if c.succeeded and drifts(c)),
            tuple((c, cut(c.reasons[0], REASON) + _finer(p, c)) for p, c in stands if not c.succeeded),
            tuple(c for c in heads if c.succeeded and drifts(c) is False),
        ))  # fmt: skip
    return sorted(out, key=lambda v: (-(v.finest.succeeded / v.finest.runs if v.finest.runs else -1.0), v.solver))


def finest(variant: Variant, solver: str, label: str) -> Run | None:
    """The run that stands for a solver on a problem: the smallest step or tolerance, fewest options."""
    own = [c for c in variant.runs if c.record.solver == solver and c.record.label == label]
    return min(own, key=lambda c: c.finest_first, default=None)


def _finer(variant: Variant, run: Run) -> str:
    """Words for a finer step or tolerance at which the same settings succeed, in whatever group that was run."""
    own = [c for c in variant.runs if c.method == run.method and c.succeeded]
    finer = [c for c in own if c.step_or_tolerance < run.step_or_tolerance]
    best = max(finer, key=lambda c: c.step_or_tolerance, default=None)
    return f"; succeeds at {best.step_words}" if best else ""


def unpredictable(results: Results) -> str:
    """On what problems of the plain comparison errors are judged over a part of the time only."""
    variants = themselves(results, broadest(results))
    found = [(p, m.until) for p in variants if (m := measure_for(p.runs)) and m.until is not None]
    parts = [f"{p.title} to {until:.2g} of {max(c.record.t_end_s for c in p.runs):g} s" for p, until in found]
    judged = f" Errors are judged while the motion is predictable: {listed(parts)}; then only energy and constraints."
    return judged if parts else ""


def _ended(run: Run) -> str:
    r = run.record
    tells = run.stopped and r.t_reached_s == r.t_reached_s
    return mark(run.status).word + (f" at {time(r.t_reached_s)} of {time(r.t_end_s)} s" if tells else "")


@dataclass(frozen=True)
class Answer:
    """To one question: a sentence, then a line a solver, those to be read first at the top."""

    kind: str
    question: str
    words: str
    lines: tuple[tuple[str, str], ...]


def headline(found: Sequence[Standing], label: str, judged: str = "") -> list[Answer]:
    """Which solvers succeed, drift and fail; ``judged`` says how far errors are."""
    ran = [v for v in found if v.finest.runs]
    settings = f"each at its finest step or tolerance in “{label}”" if label else "each at its finest step or tolerance"
    whole = sum(v.finest.succeeded == v.finest.runs for v in ran)
    holds = f"{whole} of {plural(len(ran), 'solver')} on every problem it was given ({settings}).{judged}"
    succeeded = tuple((v.solver, f"{v.finest.succeeded} of {v.finest.runs}") for v in ran)
    swings = "The energy error of every success oscillates and returns."
    wanders = "The mean energy error of these successes shifts from the first to the last quarter of the run."
    still = [c for v in ran for c in v.swings_on]
    far = max(still, key=lambda c: c.record.energy_drift_max_J, default=None)
    if far and any(far.record.energy_drift_max_J > c.record.energy_drift_max_J for v in ran for c in v.drifts_on):
        size = f"{number(far.record.energy_drift_max_J)} J ({far.record.solver}, {far.variant})"
        wanders += f" A bounded error may be larger: {size}."
    drifting = sorted((v for v in ran if v.drifts_on), key=lambda v: (-len(v.drifts_on), v.solver))
    drift = tuple((v.solver, f"{len(v.drifts_on)} of {v.finest.succeeded}: {_sizes(v)}") for v in drifting)
    breaking = sorted((v for v in ran if v.breaks_on), key=lambda v: (-len(v.breaks_on), v.solver))
    runs, wrong, stopped = (sum(getattr(v.everything, k) for v in found) for k in ("runs", "wrong", "stopped"))
    breaks = "None at its finest setting." if not breaking else f"At that setting, {len(breaking)} of {len(ran)}."
    if wrong + stopped:
        parts = [f"{plural(wrong, 'false success', 'false successes')}"] if wrong else []
        parts += [f"{stopped} stopped early"] if stopped else []
        breaks += f" Among all {plural(runs, 'run')} (every setting and variant): {' and '.join(parts)}."
    return [
        Answer("good", "Which solvers succeed", holds, succeeded),
        Answer("plain", "Which solvers drift", wanders if drift else swings, drift),
        Answer("wrong" if wrong else "failed", "Which solvers fail, and why", breaks,
               tuple((v.solver, _breaks(v)) for v in breaking)),
    ]  # fmt: skip


def _breaks(v: Standing) -> str:
    """On what, how, and the first reason."""
    parts = [f"{c.variant} at {c.step_words}: {_ended(c)}: {reason}" for c, reason in v.breaks_on[:NAMED]]
    more = len(v.breaks_on) - NAMED
    return "; ".join(parts) + (f"; and {more} more" if more > 0 else "")


def _sizes(v: Standing) -> str:
    """Where it drifts, the largest first, with how far."""
    worst = sorted(v.drifts_on, key=lambda c: -c.record.energy_drift_max_J)
    return listed([f"{c.variant} {number(c.record.energy_drift_max_J)} J" for c in worst], NAMED)
