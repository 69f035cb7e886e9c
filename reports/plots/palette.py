"""A colour for each family of methods, a marker for each solver of it, a dash for each of its settings, everywhere.

Both follow from the solver's name and the catalogue, not from who else took part. Colours of two families are at least
15 apart in CIEDE2000 as seen with protanopia, deuteranopia and tritanopia, and stand out on white and on dark pages.
"""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ..model.results import group_by

FAMILIES = {  # colour, and how the names of its solvers begin
    "ODE-GC": ("#3D62C7", ("gc_",)),
    "geometric": ("#62AF96", ("gauss_", "rattle", "lie_", "energy_momentum")),
    "explicit": ("#E08906", ("rk", "dop853_", "half_explicit", "scipy_")),
    "implicit": ("#BB3939", ("ida_", "ndf_", "radau_", "generalized_alpha", "al_index3")),
}
ENGINES, PLUGINS = "engines", "others"
OTHERS = {ENGINES: "#A499CF", PLUGINS: "#7C6071"}
MARKERS = ("o", "s", "^", "D", "v", "P", "h", "p")
ENGINE = "<"  # the marker of engines
DASHES: tuple[tuple[float, Sequence[float]], ...] = ((0, ()), (0, (5, 1.6)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
CATALOGUE = Path(__file__).resolve().parents[2] / "solvers"
MOST = 7  # solvers in colour


@dataclass(frozen=True)
class Look:
    """Look of a solver."""

    colour: str
    marker: str
    family: str = ""


@cache
def shipped_looks() -> dict[str, Look]:
    """The catalogue's and its engines."""
    out: dict[str, Look] = {}
    names = {p.stem for p in CATALOGUE.glob("[!_]*.py")}
    for family, (colour, begins) in FAMILIES.items():
        own = sorted(n for n in names if n.startswith(begins))
        out |= {name: Look(colour, MARKERS[k % len(MARKERS)], family) for k, name in enumerate(own)}
    out |= {n: _other(n) for n in sorted(names - set(out))}
    engines = sorted(p.stem for p in (CATALOGUE / "engines").glob("[!_]*.py"))
    return out | {name: Look(OTHERS[ENGINES], ENGINE, ENGINES) for name in engines}


def looks(solvers: Iterable[str]) -> dict[str, Look]:
    """A look for every solver; those of plug-ins share a colour."""
    return {name: shipped_looks().get(name) or _other(name) for name in sorted(set(solvers))}


def _other(name: str) -> Look:
    return Look(OTHERS[PLUGINS], MARKERS[hashlib.sha256(name.encode()).digest()[0] % len(MARKERS)], PLUGINS)


def families(found: dict[str, Look]) -> dict[str, list[str]]:
    """Solvers by family, in the order of the families."""
    order = [*FAMILIES, ENGINES, PLUGINS]
    by_family = {f: [name for name, look in found.items() if look.family == f] for f in order}
    return {f: names for f, names in by_family.items() if names}


def choose_focus(best_first: Iterable[str]) -> tuple[str, ...]:
    """The best and the worst solver, then the best of every family, then the next best: those that a chart colours."""
    order = list(dict.fromkeys(best_first))
    firsts = [names[0] for names in group_by(order, lambda name: looks([name])[name].family).values()]
    return tuple(dict.fromkeys([*order[:1], *order[-1:], *firsts, *order]))[:MOST]
