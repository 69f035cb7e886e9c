"""Show how two results folders differ, and which of their inputs do (``diff``)."""

import argparse
import dataclasses

from rich.text import Text

from ..harness.results import store
from ..harness.results.comparison import Comparison, Likeness, compare
from ..harness.results.provenance import Difference, describe_differences, find_differences, read_environment
from .arguments import UsageError
from .commands import CHANGES
from .terminal import Column, plural, print_json, print_table, print_unreadable

COLUMNS = (
    Column("likeness", right=False),
    Column("case", fold=True),
    Column("metric", fold=True, least=12),
    Column("before", rank=1),
    Column("after"),
    Column("relative", rank=2),
)
STYLE = {Likeness.CHANGED: "bold red", Likeness.ROUNDING: "yellow", Likeness.SAME: "green"}


def run(arguments: argparse.Namespace) -> int:
    """Print the changes; return 0 if both folders hold the same runs with the same numbers, bit for bit, else 1."""
    folders = [arguments.before, arguments.after]
    loaded = [store.load(f) for f in folders]
    if not any(part.records for part in loaded):
        raise UsageError(f"nothing to compare: neither {folders[0]} nor {folders[1]} holds a result")
    found = compare(*(part.records for part in loaded))
    inputs = find_differences(*map(read_environment, folders))
    show_comparison(found, inputs, arguments.limit, json=arguments.json)
    print_unreadable(u for part in loaded for u in part.unreadable)
    return 0 if found.is_identical else 1


def show_comparison(found: Comparison, inputs: list[Difference], limit: int = CHANGES, *, json: bool = False) -> None:
    """Print the changes, at most ``limit``, the largest first, and the inputs that differ; or all of them as JSON."""
    if json:
        changes = [{**dataclasses.asdict(c), "likeness": str(c.likeness)} for c in found.changes]
        plain = {"same": found.is_identical, "alike": found.alike, **dataclasses.asdict(found)}
        print_json({**plain, "inputs": [dataclasses.asdict(d) for d in inputs], "changes": changes})
        return
    rows: list[tuple[Text | str, ...]] = []
    for c in found.changes[:limit]:
        values = [v if isinstance(v, str) else f"{v:.6g}" for v in (c.before, c.after)]
        rows.append((Text(c.likeness, STYLE[c.likeness]), c.case, c.metric, *values, f"{c.size:.2g}"))
    below = [f"only before: {case}" for case in found.only_before]
    below += [f"only after: {case}" for case in found.only_after]
    if len(found.changes) > limit:
        below.insert(0, f"{len(found.changes) - limit} smaller changes are not shown (--limit)")
    changed = len({c.case for c in found.changes})
    below.append(f"{plural(found.compared, 'run')} in both, {found.compared - changed} of them bit for bit identical")
    if inputs or not found.is_identical:
        below.append(f"possible causes: {describe_differences(inputs)}")
    print_table(COLUMNS, rows, *below)
