"""Which posings are the problems themselves, and which tell one of them otherwise or vary it."""

from collections.abc import Sequence
from dataclasses import dataclass

from .reading import Cell, Posing, Run

HEADLINE = ("soundest", "default")  # labels of a suite's plain comparison
TOLD = {
    "yaw": "turned about the vertical",
    "rotation": "turned in space",
    "mirror": "as a mirror image",
    "renumber": "with bodies and joints renumbered",
    "duplicate": "with a joint written twice",
    "unit_length": "in another unit of length",
    "unit_mass": "in another unit of mass",
    "unit_time": "in another unit of time",
    "retrace": "run back from the end",
    "perturb": "from a start changed by little",
}  # parameters that every problem has and that change no motion, or hardly
SAME = (
    "mirror",
    "renumber",
    "duplicate",
    "unit_length",
    "unit_mass",
    "unit_time",
    "retrace",
)  # the motion is as before
SECOND = "other times, sizes and releases"


@dataclass(frozen=True)
class Variants:
    """Posings that differ from the problems in the same way."""

    words: str
    posings: tuple[Posing, ...]

    @property
    def cells(self) -> tuple[Cell, ...]:
        return tuple(c for p in self.posings for c in p.cells)


def told(posing: Posing) -> str:
    """How the problem is told otherwise; empty where it stands as it is."""
    return next((words for key, words in TOLD.items() if key in posing.cells[0].parameters), "")


def moves_alike(posing: Posing) -> bool:
    """The motion is that of another posing: only what the solver is told differs, and is undone before measuring."""
    return any(key in posing.cells[0].parameters for key in SAME)


def broadest(run: Run) -> str:
    """The label of the plain comparison, else the one under which most pairs of a problem as it is and a solver ran."""
    labels = run.labels()
    for name in HEADLINE:
        if name in labels:
            return name
    pairs: dict[str, set[tuple[str, str]]] = {label: set() for label in labels}
    for p in run.posings:
        for c in p.cells if not told(p) else ():
            pairs[c.record.label].add((p.title, c.record.solver))
    return max(pairs, key=lambda label: len(pairs[label]), default="")


def themselves(run: Run, label: str) -> tuple[Posing, ...]:
    """The posings of ``label``; of a problem that has none there, all that are told as they are."""
    own = {p.title: p for p in run.posings if any(c.record.label == label for c in p.cells)}
    there = {p.problem for p in own.values()}
    return tuple(p for p in run.posings if p.title in own or (p.problem not in there and not told(p)))


def variants(run: Run, label: str) -> tuple[Variants, ...]:
    """All others, by how they differ; the same problems at other times and sizes first."""
    apart: dict[str, list[Posing]] = {SECOND: []}
    here = {p.title for p in themselves(run, label)}
    for p in run.posings:
        if p.title not in here:
            apart.setdefault(told(p) or SECOND, []).append(p)
    order = {words: k for k, words in enumerate((SECOND, *TOLD.values()))}
    return tuple(Variants(w, tuple(apart[w])) for w in sorted(apart, key=order.__getitem__) if apart[w])


def groups_of(posing: Posing, label: str) -> dict[str, tuple[Cell, ...]]:
    """The cells by label: those of the plain comparison first, then the largest group."""
    found = posing.labels()
    return {k: found[k] for k in sorted(found, key=lambda name: name != label)}


def plain_cells(posing: Posing, label: str) -> tuple[Cell, ...]:
    """Those that speak for a problem: of ``label``, else those at default options, else all."""
    own = tuple(c for c in posing.cells if c.record.label == label)
    return own or tuple(c for c in posing.cells if not c.options) or posing.cells


def of_parts(parts: Sequence[Variants]) -> tuple[Cell, ...]:
    """All their cells."""
    return tuple(c for v in parts for c in v.cells)
