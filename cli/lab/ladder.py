"""Write a page of all bundles of submissions in a folder (``ladder``)."""

import argparse
from pathlib import Path

from ...harness.base.files import parse_toml, read_text
from ...harness.base.hints import suggest_name
from ...harness.lab.ladder.bundling import read_entry, require_checker
from ...harness.lab.ladder.closing import FILE, read_closing
from ...harness.lab.ladder.ranking import INDEPENDENT, LABELS, RankedEntry, rank_entries
from ..arguments import UsageError
from ..terminal import make_console, print_json

LABEL_FILE = "labels.toml"


def run(arguments: argparse.Namespace) -> int:
    """Rank the bundles of a folder, print the ranking and write its page; return 1 if an entry was removed, else 0."""
    require_checker()
    folder = Path(arguments.folder)
    files = sorted(folder.glob("*.zip"))
    if not files:
        raise UsageError(f"{folder} holds no bundle (*.zip); write one with mbsbench submit")
    labels, closing = _read_labels(folder / LABEL_FILE, [file.name for file in files]), read_closing(folder)
    read = [(read_entry(file, closing=closing), labels.get(file.name, INDEPENDENT)) for file in files]
    rows = rank_entries(read)
    from ...reports.lab.ladder import write_page  # here: it takes a second to load

    write_page(folder / "index.html", rows, closing.value if closing else None)
    if arguments.json:
        for r in rows:
            print_json(_describe_entry(r, trial=closing is None))
        return 1 if any(r.forged for r in rows) else 0
    if closing is None:
        make_console().print(f"trial: {folder / FILE} states no value and no digests entered before it; any seed goes")
    for r in rows:
        words = f"removed: {r.forged[0]}" if r.forged else f"{r.points} points, {r.cost.value:.2g} s"
        unfenced = ", not fenced" * (not r.forged and not r.fenced)
        make_console().print(f"{r.rank or '-'}  {r.solver} ({r.label}{unfenced}): {words}")
    make_console().print(f"page: {folder / 'index.html'}")
    return 1 if any(r.forged for r in rows) else 0


def _describe_entry(r: RankedEntry, *, trial: bool) -> dict[str, object]:
    """Return an entry of the ranking as plain data for --json; ``trial`` is true if the ladder is not closed yet."""
    return {
        "file": r.file,
        "solver": r.solver,
        "label": r.label,
        "rank": r.rank or None,
        "points": r.points,
        "solved": r.solved,
        "false": r.false,
        "cpu_s": r.cost.value,
        "leads": r.leads,
        "fenced": r.fenced,
        "trial": trial,
        "removed": list(r.forged),
    }


def _read_labels(path: Path, bundles: list[str]) -> dict[str, str]:
    """Return the labels of bundles by file name, as the file at ``path`` states them; empty without that file.

    Raise UsageError for an unknown bundle or label.
    """
    if not path.exists():
        return {}
    labels = parse_toml(read_text(path, "labels"), LABEL_FILE)
    for name, label in labels.items():
        if name not in bundles:
            raise UsageError(f"{LABEL_FILE}: there is no bundle {name!r} in {path.parent}{suggest_name(name, bundles)}")
        if label not in LABELS:
            raise UsageError(f"{LABEL_FILE}: the label of {name} must be one of {', '.join(LABELS)} (got {label!r})")
    return labels
