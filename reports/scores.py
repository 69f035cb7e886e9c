"""How cells ended, counted: what a bar of the overview and a line of a solver's page show."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from harness.types import Status
from reports.accuracy import drifts
from reports.reading import Cell, Posing, Run
from reports.words import listed, mark, plural, time


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
    """What became of a solver's finest settings on the problems it took under the broadest label, and of all else."""

    solver: str
    paper_label: str
    finest: Score
    everything: Score
    drifts_on: tuple[Cell, ...]
    breaks_on: tuple[tuple[Cell, str], ...]  # with why, in a few words


def verdicts(run: Run) -> list[Verdict]:
    """One a solver, whose finest settings hold on most problems first; no order among equals but the name's."""
    label = broadest(run)
    out = []
    for solver in run.solvers:
        own = [c for c in run.cells if c.record.solver == solver]
        heads = [h for p in run.posings if (h := finest(p, solver, label)) is not None]
        out.append(Verdict(
            solver, own[0].record.paper_label, score(heads), score(own),
            tuple(c for c in heads if c.succeeded and drifts(c)),
            tuple((c, why(c)) for c in heads if not c.succeeded),
        ))  # fmt: skip
    return sorted(out, key=lambda v: (-(v.finest.held / v.finest.cells if v.finest.cells else -1.0), v.solver))


def broadest(run: Run) -> str:
    """The label under which most pairs of problem and solver were run."""
    pairs = {
        label: {(c.posing, c.record.solver) for c in run.cells if c.record.label == label} for label in run.labels()
    }
    return max(pairs, key=lambda label: len(pairs[label]), default="")


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


def headline(found: Sequence[Verdict], label: str) -> list[tuple[str, str, str]]:
    """Who holds, who drifts, who breaks: kind, question and answer, for reading first."""
    whole = [v.solver for v in found if v.finest.cells and v.finest.held == v.finest.cells]
    partly = [v for v in found if 0 < v.finest.held < v.finest.cells]
    never = [v.solver for v in found if v.finest.cells and not v.finest.held]
    drifting = [v for v in found if v.drifts_on]
    what = f"finest settings, “{label}”" if label else "finest settings"
    holds = (
        f"On every problem it took ({what}): {listed(whole, 12)}." if whole else f"No solver on every problem ({what})."
    )
    if partly:
        holds += " On some: " + listed([f"{v.solver} ({v.finest.held} of {v.finest.cells})" for v in partly], 12) + "."
    if never:
        holds += f" On none: {listed(never, 12)}."
    drift = "The energy error of successes swings and comes back everywhere." if not drifting else (
        "The energy error of a success wanders off rather than swings: "
        + listed([f"{v.solver} on {len(v.drifts_on)} of {v.finest.held}" for v in drifting], 12)
        + ". A drift may be small and a swing large: sizes are below."
    )  # fmt: skip
    wrong = sum(v.everything.wrong for v in found)
    breaks = _breaks(found)
    if wrong:
        breaks += f" Of all settings {plural(wrong, 'cell')} claimed success and {'is' if wrong == 1 else 'are'} wrong."
    kind = "wrong" if wrong else "failed"
    return [("good", "Who holds", holds), ("plain", "Who drifts", drift), (kind, "Who breaks, and why", breaks)]


def _breaks(found: Sequence[Verdict]) -> str:
    """Stopped or wrong, with the first reason; refusals apart: they are said beforehand."""
    told = []
    for v in found:
        own = [(c, reason) for c, reason in v.breaks_on if c.status != Status.REFUSED]
        told += [f"{v.solver} on {c.posing} ({reason})" for c, reason in own[:2]]
        told += [f"{v.solver} on {len(own) - 2} more"] if len(own) > 2 else []
    refusals = [f"{v.solver} {c.posing}" for v in found for c, _ in v.breaks_on if c.status == Status.REFUSED]
    words = f"{'; '.join(told[:5])}{'; …' if len(told) > 5 else ''}." if told else "None at its finest settings."
    return words + (f" Refused beforehand: {listed(refusals, 4)}." if refusals else "")
