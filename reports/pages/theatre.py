"""The mechanism theatre: ``theatre-<slug>.html`` for each problem as posed that has poses to show."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..mechanism.theatre.cast import RULE
from ..mechanism.theatre.scene import BODY_BYTES, POSE_BYTES, players, scene
from ..model.posings import moves_alike
from ..model.reading import Cell, Posing, Run
from .base import Page, Site

ALL_BYTES = 5_000_000  # of the data files of all theatres
ROUNDS = 3  # of making a page smaller: its size does not fall evenly with its poses
SCRIPTS = (
    "assets/three.bundle.min.js", "assets/theatre-poses.js", "assets/theatre-view.js", "assets/theatre-solid.js",
    "assets/theatre-flat.js", "assets/theatre-strips.js", "assets/theatre.js",
)  # fmt: skip


def write(run: Run, site: Site) -> Page | None:
    """Write every theatre; the first page, or None if no cell has poses."""
    told = {p.slug: t for p in _shown(run) if (t := _stage(run, site, p, POSE_BYTES)) is not None}
    level = fair([t.size for t in told.values()], ALL_BYTES)
    pages = []
    for posing in run.posings:
        own = told.get(posing.slug)
        poses = POSE_BYTES if own is None else min(POSE_BYTES, own.pose_bytes)
        for _ in range(ROUNDS):
            if own is not None and own.size > level:
                poses *= 0.97 * level / own.size
                own = _stage(run, site, posing, poses)
        if own is not None:
            page = Page(
                f"Theatre: {posing.title}", f"theatre-{posing.slug}.html", order=60, about=posing.slug, brief=True
            )
            pages.append(site.write(page, "theatre.html", [*SCRIPTS[:-1], own.path, SCRIPTS[-1]], **_said(own)))
    return pages[0] if pages else None


def _shown(run: Run) -> list[Posing]:
    """All posings, but not those that show the motion of another one once more."""
    plain = {p.problem for p in run.posings if not moves_alike(p)}
    return [p for p in run.posings if not moves_alike(p) or p.problem not in plain]


@dataclass(frozen=True)
class Stage:
    """A data file that was written, and what the page says without it."""

    posing: Posing
    name: str
    path: str
    size: int
    play: Mapping[str, Any]
    players: tuple[Cell, ...]
    left_out: tuple[Cell, ...]

    @property
    def pose_bytes(self) -> float:
        """What its poses take before compression, each cell's as much as the longest's."""
        players = self.play["players"]
        return float(BODY_BYTES * self.play["bodies"] * len(players) * max(p["frames"] for p in players))


def _said(own: Stage) -> dict[str, Any]:
    players = own.play["players"]
    worst = {f"worst_{k}": max(p[f"off_{k}"] for p in players) for k in ("m", "rad")}
    return {"own": own, "rule": RULE, **worst}


def _stage(run: Run, site: Site, posing: Posing, pose_bytes: float) -> Stage | None:
    cast, left_out = players(run, posing)
    if not cast:
        return None
    play = scene(posing, cast, site.looks, pose_bytes)
    name = f"theatre-{posing.slug}"
    path = site.data(name, play)
    return Stage(posing, name, path, (site.folder / path).stat().st_size, play, tuple(p.cell for p in cast), left_out)


def fair(sizes: Sequence[int], whole: float) -> float:
    """The level to which the largest are cut so that all fit into ``whole``; infinite if they do as they are."""
    left, ordered = whole, sorted(sizes)
    for k, size in enumerate(ordered):
        share = left / (len(ordered) - k)
        if size > share:
            return share
        left -= size
    return float("inf")
