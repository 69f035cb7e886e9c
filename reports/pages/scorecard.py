"""The metamorphic scorecard: solver by check, the worst outcome in each box and every outcome beneath."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from ..model.words import Mark, number, unit
from .judgement import Entry
from .links import Links

MARKS = {
    "holds": Mark("✓", "holds", "good"),
    "broken": Mark("✗", "broken", "wrong"),
    "failed": Mark("★", "the run failed", "failed"),
    "undecided": Mark("○", "not decided", "refused"),
    "refused": Mark("⊘", "refused", "refused"),
    "not applicable": Mark("–", "not applicable", "none"),
}
WORST_FIRST = ("broken", "failed", "undecided", "refused", "holds", "not applicable")


@dataclass(frozen=True)
class Outcome:
    """One check of one solver on one problem."""

    variant: str
    mark: Mark
    deviation: str
    bound: str
    words: str
    runs: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Box:
    """A solver and a check; ``mark`` is that of the worst outcome."""

    mark: Mark
    tally: str
    outcomes: tuple[Outcome, ...]


@dataclass(frozen=True)
class Card:
    """The grid; a box is None where nothing was tried."""

    checks: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Box | None, ...]], ...]


def card(rows: Sequence[Entry], links: Links) -> Card:
    """Solvers down, checks across, in the order of their names and of their appearance."""
    checks = tuple(dict.fromkeys(e.text("check") for e in rows))
    solvers = sorted({e.text("solver") for e in rows})
    grid = tuple(
        (s, tuple(_box([e for e in rows if (e.text("solver"), e.text("check")) == (s, c)], links) for c in checks))
        for s in solvers
    )
    return Card(checks, grid)


def mark_of(word: str) -> Mark:
    """One we do not know counts as a failure."""
    return MARKS.get(word, Mark("★", word or "no verdict", "failed"))


def _box(rows: Sequence[Entry], links: Links) -> Box | None:
    if not rows:
        return None
    count = Counter(e.text("verdict") for e in rows)
    worst = next((w for w in WORST_FIRST if count[w]), rows[0].text("verdict"))
    if any(w not in MARKS for w in count):
        worst = next(w for w in count if w not in MARKS)
    told = sum(n for w, n in count.items() if w != "not applicable")
    tally = f"{count['holds']} of {told}" if told else ""
    return Box(mark_of(worst), tally, tuple(_outcome(e, links) for e in rows))


def _outcome(e: Entry, links: Links) -> Outcome:
    measure = unit(e.text("unit"))
    return Outcome(
        e.text("variant") or e.text("problem"),
        mark_of(e.text("verdict")),
        f"{number(e.number('deviation'))} {measure}".strip(),
        f"{number(e.number('bound'))} {measure}".strip(),
        e.text("words"),
        tuple((links.words(k), links.page(k)) for k in e.texts("runs")),
    )
