"""A colour and a marker for each solver, a dash for each of its settings: the same in every figure and table.

A colour follows from the solver's name and the catalogue, not from who else took part, so that it is the same in every
run. Solvers from plug-ins have colours that no shipped one has; engines of others share a marker that no solver has.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

# Okabe and Ito's set for colour-blind readers, without the yellow and black that vanish on white and on dark pages
PAPER = {
    "gc_weak_form": "#0072B2", "gc_augmented_lagrangian": "#56B4E9", "rk45_strong_form": "#009E73",
    "ndf_index1": "#E69F00", "ida_index1": "#D55E00", "ida_index3": "#CC79A7",
}  # fmt: skip
# Each as far in Oklab from all before it as a contrast of 2.6 on white and of 2.9 on dark pages allows
OTHERS = (
    "#999933", "#8A8A8A", "#9600FF", "#FF0FFF", "#C30096", "#7878FF", "#FF1E69", "#78691E", "#875A96", "#005AFF",
    "#D278FF", "#00B400", "#B43C4B", "#007800", "#C33CE1", "#1E7869", "#FF5AC3", "#A596E1",
)  # fmt: skip
ENGINES = ("#698700", "#6978C3", "#D24B87", "#F000A5", "#FF6987", "#696978")
PLUGINS = ("#1E96B4", "#FF784B", "#784BD2", "#C39678", "#0096FF", "#E10000", "#A5695A", "#A569D2")
MARKERS = ("o", "P", "s", "^", "v", "D", "h", "p")
ENGINE = "<"  # the marker of engines
DASHES: tuple[tuple[float, Sequence[float]], ...] = ((0, ()), (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
CATALOGUE = Path(__file__).resolve().parents[2] / "solvers"


@dataclass(frozen=True)
class Look:
    """Of a solver."""

    colour: str
    marker: str


@cache
def shipped() -> dict[str, Look]:
    """The catalogue's: the paper's solvers first, then the others by name; and its engines."""
    others = sorted({p.stem for p in CATALOGUE.glob("[!_]*.py")} - set(PAPER))
    colours = {**PAPER, **{name: OTHERS[k % len(OTHERS)] for k, name in enumerate(others)}}
    own = {name: Look(colour, MARKERS[k % len(MARKERS)]) for k, (name, colour) in enumerate(colours.items())}
    engines = sorted(p.stem for p in (CATALOGUE / "engines").glob("[!_]*.py"))
    return own | {name: Look(ENGINES[k % len(ENGINES)], ENGINE) for k, name in enumerate(engines)}


def looks(solvers: Iterable[str]) -> dict[str, Look]:
    """A look for every solver; two of plug-ins share one only when there are more than eight."""
    names, taken = sorted(set(solvers)), dict[str, int]()
    for name in (n for n in names if n not in shipped()):
        slot = hashlib.sha256(name.encode()).digest()[0] % len(PLUGINS)
        if len(taken) < len(PLUGINS):
            while slot in taken.values():
                slot = (slot + 1) % len(PLUGINS)
        taken[name] = slot
    own = {name: Look(PLUGINS[k], MARKERS[k]) for name, k in taken.items()}
    return {name: shipped().get(name) or own[name] for name in names}
