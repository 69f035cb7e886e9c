"""A colour and a marker for each solver, a dash for each of its settings: the same in every figure and table.

A colour follows from the solver's name, not from who else took part, so that it is the same in every run.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

# Okabe and Ito's set for colour-blind readers, without the yellow and black that vanish on white and on dark pages
COLOURS = ("#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7", "#999933", "#8A8A8A")
MARKERS = ("o", "P", "s", "^", "v", "D", "h", "p")
DASHES: tuple[tuple[float, Sequence[float]], ...] = ((0, ()), (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
SALT = "611531"  # one for which the catalogue's solvers fall on colours of their own


@dataclass(frozen=True)
class Look:
    """Of a solver."""

    colour: str
    marker: str


def looks(solvers: Iterable[str]) -> dict[str, Look]:
    """A look for every solver; two solvers share one only when there are more than eight."""
    taken: dict[str, int] = {}
    for name in sorted(solvers):
        slot = hashlib.sha256(f"{SALT} {name}".encode()).digest()[0] % len(COLOURS)
        if len(taken) < len(COLOURS):
            while slot in taken.values():
                slot = (slot + 1) % len(COLOURS)
        taken[name] = slot
    return {name: Look(COLOURS[k], MARKERS[k]) for name, k in taken.items()}
