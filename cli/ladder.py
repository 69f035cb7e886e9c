"""``ladder``: a page of all bundles of submissions in a folder."""

import argparse
from pathlib import Path

from ..harness.files import parse_toml, read_text
from ..harness.ladder.bundling import read_entry, require_checker
from ..harness.ladder.ranking import INDEPENDENT, LABELS, rank_entries
from .arguments import UsageError
from .terminal import console

LABEL_FILE = "labels.toml"


def run(arguments: argparse.Namespace) -> int:
    """Write the page; return 1 if an entry was removed, else 0."""
    require_checker()
    folder = Path(arguments.folder)
    files = sorted(folder.glob("*.zip"))
    if not files:
        raise UsageError(f"{folder} holds no bundle (*.zip); write one with mbsbench submit")
    labels = _read_labels(folder / LABEL_FILE)
    rows = rank_entries([(read_entry(file), labels.get(file.name, INDEPENDENT)) for file in files])
    from ..reports.ladder import write_page  # here: it takes a second to load

    write_page(folder / "index.html", rows)
    for r in rows:
        words = f"removed: {r.forged[0]}" if r.forged else f"{r.points} points, {r.cost.value:.2g} s"
        console().print(f"{r.rank or '-'}  {r.solver} ({r.label}): {words}")
    console().print(f"page: {folder / 'index.html'}")
    return 1 if any(r.forged for r in rows) else 0


def _read_labels(path: Path) -> dict[str, str]:
    """The label of each file; without the file, none."""
    if not path.exists():
        return {}
    labels = parse_toml(read_text(path, "labels"), LABEL_FILE)
    for name, label in labels.items():
        if label not in LABELS:
            raise UsageError(f"{LABEL_FILE}: the label of {name} must be one of {', '.join(LABELS)} (got {label!r})")
    return labels
