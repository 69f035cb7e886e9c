"""The paper's figures from this run, each beside what the paper says, where ``figures --paper`` has made them."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..model.results import Results, Run
from .base import Page, Site

SUFFIXES = (".svg", ".pdf")


@dataclass(frozen=True)
class Shown:
    """A figure with its files in the report folder, its notes, and its runs as this run has them."""

    name: str
    heading: str
    variant: str
    title: str
    files: Mapping[str, str]  # suffix: path from the page
    note: tuple[str, ...]
    differs: frozenset[str]
    runs: tuple[tuple[str, str, Run | None, str], ...]  # role, settings, the run, or how it ended


def write(results: Results, site: Site) -> Page | None:
    """``paper.html``."""
    figures = [s for f in _captions(results.folder) if (s := _shown(results, site, f)) is not None]
    if not figures:
        return None
    return site.write(Page("Paper", "paper.html", nav=True, order=45), "paper.html", figures=figures)


def _captions(folder: Path) -> list[dict[str, Any]]:
    try:
        found = json.loads((folder / "paper" / "captions.json").read_text(encoding="utf-8"))["figures"]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    return [f for f in found if isinstance(f, dict) and f.get("name")] if isinstance(found, list) else []


def _shown(results: Results, site: Site, figure: dict[str, Any]) -> Shown | None:
    name = Path(str(figure["name"])).name  # a name, never a path out of the folder
    files = {}
    for suffix in SUFFIXES:
        source = results.folder / "paper" / f"{name}{suffix}"
        if source.is_file():
            site.figures.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source, site.figures / f"paper-{name}{suffix}")
            files[suffix] = f"figures/paper-{name}{suffix}"
    if ".svg" not in files:
        return None
    known = {c.record.run_id: c for c in results.runs}
    runs = tuple(
        (str(c.get("role", "")), str(c.get("asked", "")), known.get(str(c.get("run"))), str(c.get("status", "")))
        for c in figure.get("runs", [])
        if isinstance(c, dict)
    )
    texts = {key: [str(t) for t in figure.get(key) or []] for key in ("note", "differs")}
    heading = f"Fig. {figure.get('number', '?')}"
    return Shown(name, heading, str(figure.get("variant", "")), str(figure.get("title", "")), files,
                 tuple(texts["note"]), frozenset(texts["differs"]), runs)  # fmt: skip
