"""Which figures a problem gets: one set for each label of the suite, with axes alike, and one of work for all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from reports.drawing import Drawn
from reports.figures.errors import errors
from reports.figures.laws import invariants, laws
from reports.figures.lines import Group
from reports.figures.observables import observables
from reports.figures.work import work
from reports.motion import Motion
from reports.palette import Look
from reports.reading import Posing, slug

MOST = 12  # lines in one figure; more are parted by solver


@dataclass(frozen=True)
class Chapter:
    """The figures of one group of cells."""

    title: str
    figures: tuple[Drawn, ...]


def chapters(
    posing: Posing, motions: Mapping[str, Motion], looks: Mapping[str, Look], *, brief: bool = False
) -> list[Chapter]:
    """In order: work of all cells, then one chapter a label; only the laws if ``brief``."""
    everyone = Group(tuple(motions[c.record.cell] for c in posing.cells), looks)
    taken: set[str] = set()
    all_work = work(slug(f"{posing.slug}-work", taken), f"{posing.title}: work against error", everyone)
    if brief:
        all_work = None
    out = [Chapter("Work against error", (all_work,))] if all_work else []
    for label, cells in posing.labels().items():
        parts = _parts(cells)
        for k, part in enumerate(parts):
            name = label or "all cells"
            title = f"{name} ({k + 1} of {len(parts)})" if len(parts) > 1 else name
            group = Group(tuple(motions[c.record.cell] for c in part), looks)
            base = slug(f"{posing.slug}-{title}", taken)
            head = f"{posing.title}, {title}"
            drawn: list[Drawn | None] = [laws(f"{base}-laws", f"{head}: laws and step", group, everyone)]
            if brief:
                out.append(Chapter(title, tuple(d for d in drawn if d is not None)))
                continue
            drawn.append(errors(f"{base}-errors", f"{head}: error against the reference", group, everyone))
            drawn += observables(f"{base}-observables", f"{head}: observables", group, everyone)
            drawn.append(invariants(f"{base}-invariants", f"{head}: invariants", group, everyone))
            out.append(Chapter(title, tuple(d for d in drawn if d is not None)))
    return out


def _parts(cells: Sequence) -> list[list]:  # type: ignore[type-arg]
    """Whole solvers together, at most ``MOST`` lines where one solver does not have more."""
    parts: list[list] = [[]]
    for solver in dict.fromkeys(c.record.solver for c in cells):
        own = [c for c in cells if c.record.solver == solver]
        if parts[-1] and len(parts[-1]) + len(own) > MOST:
            parts.append([])
        parts[-1] += own
    return parts
