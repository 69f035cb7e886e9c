"""``diff``: what changed between two run folders, and which inputs did."""

import argparse
import dataclasses
import json
from typing import Any

from rich.text import Text

from ..results import store
from ..results.comparison import Change, Comparison, Likeness, compare
from ..results.provenance import Difference, differences, stamp_of, why
from .run import existing, whole
from .screen import Column, errors, fitted, lines, screen
from .terms import UsageError

COLUMNS = (
    Column("likeness", right=False), Column("case", right=False, fold=True),
    Column("metric", right=False, fold=True, least=12), Column("before", rank=1), Column("after"),
    Column("relative", rank=2),
)  # fmt: skip
STYLE = {Likeness.CHANGED: "bold red", Likeness.ROUNDING: "yellow", Likeness.SAME: "green"}


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("diff", help="what changed between two run folders and why it may have; 0 same, 1 not")
    p.add_argument("before", help="run folder")
    p.add_argument("after", help="run folder")
    p.add_argument("--limit", metavar="N", default="40", help="changes shown, the largest first (default: 40)")
    p.add_argument("--json", action="store_true", help="one JSON object, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0 when all runs are there and the same bit for bit, else 1."""
    limit = whole(arguments.limit, "--limit")
    folders = [existing(f) for f in (arguments.before, arguments.after)]
    loaded = [store.load(f) for f in folders]
    if not any(part.records for part in loaded):
        raise UsageError(f"neither {folders[0]} nor {folders[1]} has a result to compare")
    found = compare(*(part.records for part in loaded))
    inputs = differences(*map(stamp_of, folders))
    if arguments.json:
        lines().print(as_json(found, inputs))
    else:
        show(found, inputs, limit)
    for item in (u for part in loaded for u in part.unreadable):
        errors().print(f"not read: {item.path}: {item.why}")
    return 0 if found.same else 1


def as_json(found: Comparison, inputs: list[Difference]) -> str:
    """Numbers that are not finite as strings, like in records."""
    plain = {
        "same": found.same,
        "alike": found.alike,
        "compared": found.compared,
        "only_before": found.only_before,
        "only_after": found.only_after,
        "inputs": [dataclasses.asdict(d) for d in inputs],
        "changes": [_plain(c) for c in found.changes],
    }
    return json.dumps(plain, ensure_ascii=False, allow_nan=False)


def show(found: Comparison, inputs: list[Difference], limit: int) -> None:
    """The table of changes, then the inputs."""
    out = screen()
    rows: list[tuple[Text | str, ...]] = []
    for c in found.changes[:limit]:
        values = [v if isinstance(v, str) else f"{v:.6g}" for v in (c.before, c.after)]
        rows.append((Text(c.likeness, STYLE[c.likeness]), c.case, c.metric, *values, f"{c.size:.2g}"))
    if rows:
        out.print(fitted(COLUMNS, rows, out.width))
    if len(found.changes) > limit:
        out.print(f"{len(found.changes) - limit} smaller changes are not shown (--limit)")
    for words, cases in (("only before", found.only_before), ("only after", found.only_after)):
        for case in cases:
            out.print(Text(f"{words}: {case}"))
    specs = len({c.case for c in found.changes})
    out.print(f"{found.compared} runs in both, {found.compared - specs} of them the same bit for bit")
    if inputs or not found.same:
        out.print(Text(f"why it may be: {why(inputs)}"))


def _plain(c: Change) -> dict[str, Any]:
    numbers = {k: v if isinstance(v, str) or abs(v) < float("inf") else str(v) for k, v in _values(c).items()}
    return {"case": c.case, "metric": c.metric, **numbers, "likeness": str(c.likeness)}


def _values(c: Change) -> dict[str, float | str]:
    return {"before": c.before, "after": c.after}
