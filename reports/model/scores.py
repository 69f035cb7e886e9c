"""How runs ended, counted: what a bar of the overview and a line of a solver's page show."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .accuracy import drifts, measure_for
from .results import Results, Run, Variant
from .variants import broadest, themselves
from .words import listed, mark, number, plural, time

NAMED = 3  # variants named for a solver in an answer; more are counted


@dataclass(frozen=True)
class Score:
    """Numbers of runs; ``bounded`` and ``drifting`` count successes whose energy error tells."""

    held: int
    wrong: int
    stopped: int
    refused: int
    bounded: int
    drifting: int

    @property
    def runs(self) -> int:
        return self.held + self.wrong + self.stopped + self.refused

    @property
    def shares(self) -> list[tuple[str, int, float]]:
        """Kind, count and percent of all, for a bar."""
        parts = (("good", self.held), ("wrong", self.wrong), ("failed", self.stopped), ("refused", self.refused))
        return [(kind, n, 100.0 * n / self.runs) for kind, n in parts if n]

    @property
    def words(self) -> str:
        """``5 hold, 1 wrong``."""
        parts = ((self.held, "held"), (self.wrong, "wrong"), (self.stopped, "stopped"), (self.refused, "refused"))
        return listed([f"{n} {word}" for n, word in parts if n]) or "no run"


def score(runs: Iterable[Run]) -> Score:
    """Of any runs."""
    kinds = {"good": 0, "wrong": 0, "failed": 0, "refused": 0}
    told = {True: 0, False: 0}
    for c in runs:
        kinds[mark(c.status).kind] += 1
        wanders = drifts(c) if c.succeeded else None
        if wanders is not None:
            told[wanders] += 1
    return Score(kinds["good"], kinds["wrong"], kinds["failed"], kinds["refused"], told[False], told[True])


@dataclass(frozen=True)
class Verdict:
    """What became of a solver's finest settings on the problems of the plain comparison, and of all else."""

    solver: str
    paper_label: str
    finest: Score
    everything: Score
    drifts_on: tuple[Run, ...]
    breaks_on: tuple[tuple[Run, str], ...]  # with why, in a few words
    swings_on: tuple[Run, ...] = ()


def verdicts(results: Results) -> list[Verdict]:
    """One a solver, whose finest settings hold on most problems first; no order among equals but the name's."""
    label = broadest(results)
    variants = themselves(results, label)
    out = []
    for solver in results.solvers:
        own = [c for c in results.runs if c.record.solver == solver]
        stands = [(p, h) for p in variants if (h := finest(p, solver, label)) is not None]
        heads = [h for _, h in stands]
        out.append(Verdict(
            solver, own[0].record.paper_label, score(heads), score(own),
            tuple(c for c in heads if c.succeeded and drifts(c)),
            tuple((c, _short(c) + _finer(p, c)) for p, c in stands if not c.succeeded),
            tuple(c for c in heads if c.succeeded and drifts(c) is False),
        ))  # fmt: skip
    return sorted(out, key=lambda v: (-(v.finest.held / v.finest.runs if v.finest.runs else -1.0), v.solver))


def finest(variant: Variant, solver: str, label: str) -> Run | None:
    """The run that stands for a solver on a problem: the smallest step or tolerance, fewest options."""
    own = [c for c in variant.runs if c.record.solver == solver and c.record.label == label]
    return min(own, key=lambda c: (c.fineness, len(c.options), c.record.case), default=None)


def _finer(variant: Variant, run: Run) -> str:
    """Said where the same settings hold at a finer step or tolerance, in whatever group that was run."""
    own = [c for c in variant.runs if c.method == run.method and c.succeeded and c.fineness < run.fineness]
    best = min(own, key=lambda c: -c.fineness, default=None)
    return f"; holds at {best.step_words}" if best else ""


def unpredictable(results: Results) -> str:
    """On what problems of the plain comparison errors are judged over a part of the time only."""
    found = [
        (p, m) for p in themselves(results, broadest(results)) if (m := measure_for(p.runs)) and m.until is not None
    ]
    if not found:
        return ""
    told = [f"{p.title} to {m.until:.2g} of {max(c.record.t_end_s for c in p.runs):g} s" for p, m in found]
    return f" Errors are judged while the motion is predictable: {listed(told)}; after that energy and joints alone."


def _ended(run: Run) -> str:
    """How it ended, and where it stopped."""
    r = run.record
    where = (
        f" at {time(r.t_reached_s)} of {time(r.t_end_s)} s" if run.stopped and r.t_reached_s == r.t_reached_s else ""
    )
    return f"{mark(run.status).word}{where}"


def _short(run: Run, most: int = 90) -> str:
    """The first reason."""
    reason = " ".join(run.reasons[0].split())
    return reason if len(reason) <= most else reason[: most - 1] + "…"


@dataclass(frozen=True)
class Answer:
    """To one question: a sentence, then a line a solver, those to be read first at the top."""

    kind: str
    question: str
    words: str
    lines: tuple[tuple[str, str], ...]


def headline(found: Sequence[Verdict], label: str, judged: str = "") -> list[Answer]:
    """Who holds, who drifts, who breaks; ``judged`` says how far errors are."""
    told = [v for v in found if v.finest.runs]
    settings = f"each at its finest step or tolerance in “{label}”" if label else "each at its finest step or tolerance"
    whole = sum(v.finest.held == v.finest.runs for v in told)
    holds = f"{whole} of {plural(len(told), 'solver')} on every problem it was given ({settings}).{judged}"
    held = tuple((v.solver, f"{v.finest.held} of {v.finest.runs}") for v in told)
    swings = "The energy error of every success swings and comes back."
    wanders = "The energy error of a success shifts from the first to the last quarter of its run rather than swings."
    still = [c for v in told for c in v.swings_on]
    far = max(still, key=lambda c: c.record.energy_drift_max_J, default=None)
    if far and any(far.record.energy_drift_max_J > c.record.energy_drift_max_J for v in told for c in v.drifts_on):
        wanders += (
            f" A swing may be larger: {number(far.record.energy_drift_max_J)} J ({far.record.solver}, {far.variant})."
        )
    drifting = sorted((v for v in told if v.drifts_on), key=lambda v: (-len(v.drifts_on), v.solver))
    drift = tuple((v.solver, f"{len(v.drifts_on)} of {v.finest.held}: {_sizes(v)}") for v in drifting)
    breaking = sorted((v for v in told if v.breaks_on), key=lambda v: (-len(v.breaks_on), v.solver))
    runs, wrong, stopped = (sum(getattr(v.everything, k) for v in found) for k in ("runs", "wrong", "stopped"))
    breaks = "None at its finest settings." if not breaking else f"At those settings, {len(breaking)} of {len(told)}."
    if wrong + stopped:
        parts = [f"{wrong} claimed success and {'is' if wrong == 1 else 'are'} wrong"] if wrong else []
        parts += [f"{stopped} stopped early"] if stopped else []
        breaks += f" Of all {plural(runs, 'run')}, every setting and variant, {' and '.join(parts)}."
    return [
        Answer("good", "Who holds", holds, held),
        Answer("plain", "Who drifts", wanders if drift else swings, drift),
        Answer("wrong" if wrong else "failed", "Who breaks, and why", breaks,
               tuple((v.solver, _breaks(v)) for v in breaking)),
    ]  # fmt: skip


def _breaks(v: Verdict) -> str:
    """On what, how, and the first reason; what is refused is said so."""
    told = [
        f"{c.variant}{f' at {c.step_words}' if c.step_words else ''}: {_ended(c)}: {reason}"
        for c, reason in v.breaks_on[:NAMED]
    ]
    more = len(v.breaks_on) - NAMED
    return "; ".join(told) + (f"; and {more} more" if more > 0 else "")


def _sizes(v: Verdict) -> str:
    """Where it drifts, the largest first, with how far."""
    worst = sorted(v.drifts_on, key=lambda c: -c.record.energy_drift_max_J)
    return listed([f"{c.variant} {number(c.record.energy_drift_max_J)} J" for c in worst], NAMED)
