"""How cells ended, counted: what a bar of the overview and a line of a solver's page show."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from reports.accuracy import drifts
from reports.posings import broadest, themselves
from reports.reading import Cell, Posing, Run
from reports.words import listed, mark, plural, time

NAMED = 3  # posings named for a solver in an answer; more are counted


@dataclass(frozen=True)
class Score:
    """Numbers of cells; ``bounded`` and ``drifting`` count successes whose energy error tells."""

    held: int
    wrong: int
    stopped: int
    refused: int
    bounded: int
    drifting: int

    @property
    def cells(self) -> int:
        return self.held + self.wrong + self.stopped + self.refused

    @property
    def shares(self) -> list[tuple[str, int, float]]:
        """Kind, count and percent of all, for a bar."""
        parts = (("good", self.held), ("wrong", self.wrong), ("failed", self.stopped), ("refused", self.refused))
        return [(kind, n, 100.0 * n / self.cells) for kind, n in parts if n]

    @property
    def words(self) -> str:
        """``5 hold, 1 wrong``."""
        parts = ((self.held, "held"), (self.wrong, "wrong"), (self.stopped, "stopped"), (self.refused, "refused"))
        return listed([f"{n} {word}" for n, word in parts if n]) or "no cell"


def score(cells: Iterable[Cell]) -> Score:
    """Of any cells."""
    kinds = {"good": 0, "wrong": 0, "failed": 0, "refused": 0}
    told = {True: 0, False: 0}
    for c in cells:
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
    drifts_on: tuple[Cell, ...]
    breaks_on: tuple[tuple[Cell, str], ...]  # with why, in a few words


def verdicts(run: Run) -> list[Verdict]:
    """One a solver, whose finest settings hold on most problems first; no order among equals but the name's."""
    label = broadest(run)
    posings = themselves(run, label)
    out = []
    for solver in run.solvers:
        own = [c for c in run.cells if c.record.solver == solver]
        heads = [h for p in posings if (h := finest(p, solver, label)) is not None]
        out.append(Verdict(
            solver, own[0].record.paper_label, score(heads), score(own),
            tuple(c for c in heads if c.succeeded and drifts(c)),
            tuple((c, why(c)) for c in heads if not c.succeeded),
        ))  # fmt: skip
    return sorted(out, key=lambda v: (-(v.finest.held / v.finest.cells if v.finest.cells else -1.0), v.solver))


def finest(posing: Posing, solver: str, label: str) -> Cell | None:
    """The cell that stands for a solver on a problem: the smallest step or tolerance, fewest options."""
    own = [c for c in posing.cells if c.record.solver == solver and c.record.label == label]
    return min(own, key=lambda c: (c.fineness, len(c.options), c.record.case), default=None)


def why(cell: Cell, most: int = 90) -> str:
    """How it ended and the first reason, short."""
    r = cell.record
    where = (
        f" at {time(r.t_reached_s)} of {time(r.t_end_s)} s" if cell.stopped and r.t_reached_s == r.t_reached_s else ""
    )
    reason = " ".join(cell.reasons[0].split())
    return f"{mark(cell.status).word}{where}: {reason if len(reason) <= most else reason[: most - 1] + '…'}"


@dataclass(frozen=True)
class Answer:
    """To one question: a sentence, then a line a solver, those to be read first at the top."""

    kind: str
    question: str
    words: str
    lines: tuple[tuple[str, str], ...]


def headline(found: Sequence[Verdict], label: str) -> list[Answer]:
    """Who holds, who drifts, who breaks."""
    told = [v for v in found if v.finest.cells]
    settings = f"finest settings, “{label}”" if label else "finest settings"
    whole = sum(v.finest.held == v.finest.cells for v in told)
    holds = f"{whole} of {plural(len(told), 'solver')} on every problem it was given ({settings})."
    held = tuple((v.solver, f"{v.finest.held} of {v.finest.cells}") for v in told)
    swings = "The energy error of every success swings and comes back."
    wanders = "The energy error of a success wanders off rather than swings; how far is in the table below."
    drifting = sorted((v for v in told if v.drifts_on), key=lambda v: (-len(v.drifts_on), v.solver))
    drift = tuple(
        (v.solver, f"{len(v.drifts_on)} of {v.finest.held}: {listed([c.posing for c in v.drifts_on], NAMED)}")
        for v in drifting
    )
    breaking = sorted((v for v in told if v.breaks_on), key=lambda v: (-len(v.breaks_on), v.solver))
    cells, wrong, stopped = (sum(getattr(v.everything, k) for v in found) for k in ("cells", "wrong", "stopped"))
    breaks = "None at its finest settings." if not breaking else f"At those settings, {len(breaking)} of {len(told)}."
    if wrong + stopped:
        parts = [f"{wrong} claimed success and {'is' if wrong == 1 else 'are'} wrong"] if wrong else []
        parts += [f"{stopped} stopped early"] if stopped else []
        breaks += f" Of all {plural(cells, 'cell')}, every setting and variant, {' and '.join(parts)}."
    return [
        Answer("good", "Who holds", holds, held),
        Answer("plain", "Who drifts", wanders if drift else swings, drift),
        Answer("wrong" if wrong else "failed", "Who breaks, and why", breaks,
               tuple((v.solver, _breaks(v)) for v in breaking)),
    ]  # fmt: skip


def _breaks(v: Verdict) -> str:
    """On what, how, and the first reason; what is refused is said so."""
    told = [f"{c.posing} {why(c, most=100)}" for c, _ in v.breaks_on[:NAMED]]
    more = len(v.breaks_on) - NAMED
    return "; ".join(told) + (f"; and {more} more" if more > 0 else "")
