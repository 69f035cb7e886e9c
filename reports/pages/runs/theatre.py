"""Write the mechanism theatre: ``theatre-<slug>.html`` for each variant with stored poses."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...mechanism.theatre.scene import BODY_BYTES, POSE_BYTES, RULE, collect_players, make_scene
from ...model.results import StoredResults, Variant
from ...model.variants import find_plain_label, has_same_motion, select_variants
from ..base import Page, Site

RANK = -1  # first: it reads poses too, and the others find what it has read in memory
ALL_BYTES = 12_000_000  # bytes of the data files of all theatres
MOST = 24  # most theatres of a report, unless the plain comparison has more variants
ROUNDS = 3  # rounds of shrinking a page: its size is not proportional to its poses
SCRIPTS = (
    "assets/three.bundle.min.js",
    "assets/theatre-poses.js",
    "assets/theatre-view.js",
    "assets/theatre-solid.js",
    "assets/theatre-flat.js",
    "assets/theatre-strips.js",
    "assets/theatre.js",
)


def write_variant(results: StoredResults, site: Site, variant: Variant) -> dict[str, Any] | None:
    """Write the data file of a variant's theatre and return what its page needs; None if it gets no theatre."""
    shown = any(p.slug == variant.slug for p in _list_variants(results))
    return _write_theatre(results, site, variant, POSE_BYTES) if shown else None


def write(results: StoredResults, site: Site) -> Page | None:
    """Add the theatre of each variant to the site, a page beside the data file that ``write_variant`` wrote.

    Data files above their part of ``ALL_BYTES`` are written again with fewer poses. Return the first page, or None if
    no run has poses.
    """
    stages = {slug: own for slug, own in site.parts.get(__name__, {}).items() if own is not None}
    level = find_size_limit([t["size"] for t in stages.values()], ALL_BYTES)
    pages = []
    for variant, own in ((p, stages[p.slug]) for p in results.variants if p.slug in stages):
        play = own["play"]
        most = max(p["frames"] for p in play["players"])  # as if each run had as many poses as the longest
        poses = min(float(POSE_BYTES), float(BODY_BYTES * play["bodies"] * len(play["players"]) * most))
        for _ in range(ROUNDS):
            if own["size"] > level:
                poses *= 0.97 * level / own["size"]
                own = _write_theatre(results, site, variant, poses) or own
        page = Page(f"Theatre: {variant.title}", f"{own['name']}.html", order=60, about=variant.slug, brief=True)
        worst = {f"worst_{k}": max(p[f"off_{k}"] for p in own["play"]["players"]) for k in ("m", "rad")}
        pages.append(
            site.write(page, "theatre.html", [*SCRIPTS[:-1], own["path"], SCRIPTS[-1]], own=own, rule=RULE, **worst)
        )
    return pages[0] if pages else None


def _list_variants(results: StoredResults) -> list[Variant]:
    """List the variants that get a theatre, those of the plain comparison first, at most ``MOST`` unless it has more.

    Variants that repeat the motion of another one are left out.
    """
    plain = {p.problem for p in results.variants if not has_same_motion(p)}
    found = [p for p in results.variants if not has_same_motion(p) or p.problem not in plain]
    first = {p.slug for p in select_variants(results, find_plain_label(results))}
    return sorted(found, key=lambda p: p.slug not in first)[: max(MOST, len(first))]


def _write_theatre(results: StoredResults, site: Site, variant: Variant, pose_bytes: float) -> dict[str, Any] | None:
    """Write the data file of a theatre with about ``pose_bytes`` of poses; return what its page shows and needs.

    Runs that a visitor may add are written to files of their own. None is returned if no run stored poses.
    """
    cast, more, left_out = collect_players(results, variant)
    if not cast:
        return None
    play, added = make_scene(variant, cast, site.looks, pose_bytes, more)
    name = f"theatre-{variant.slug}"
    for player in added:
        site.write_bundle(f"{name}-{player['run']}", player)
    path = site.write_bundle(name, play)
    return {
        "variant": variant,
        "name": name,
        "path": path,
        "size": (site.folder / path).size(),
        "play": _drop_arrays(play),  # the arrays are in the data file
        "players": [p.run for p in cast],
        "left_out": left_out,
        "addable": [p.run for p in more],
    }


def _drop_arrays(value: Any) -> Any:
    """Return nested data without the NumPy arrays in its dictionaries; tuples become lists."""
    if isinstance(value, dict):
        return {k: _drop_arrays(v) for k, v in value.items() if not isinstance(v, np.ndarray)}
    return [_drop_arrays(v) for v in value] if isinstance(value, list | tuple) else value


def find_size_limit(sizes: Sequence[int], whole: float) -> float:
    """Return the size to which the largest files must shrink so that all fit into ``whole``; infinite if all fit."""
    left, ordered = whole, sorted(sizes)
    for k, size in enumerate(ordered):
        share = left / (len(ordered) - k)
        if size > share:
            return share
        left -= size
    return float("inf")
