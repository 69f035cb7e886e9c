"""Show how two results folders differ, and which of their inputs do (``diff``)."""

import argparse
import dataclasses

from rich.text import Text

from ..harness.results import store
from ..harness.results.comparison import Comparison, compare, measure_change, read_change
from ..harness.results.findings import Finding
from ..harness.results.provenance import describe_differences, find_differences, read_environment
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
CHANGED, ROUNDING = ("changed", "bold red"), ("rounding", "yellow")  # likeness of two numbers, and its style


def run(arguments: argparse.Namespace) -> int:
    """Print how the runs of two folders differ; return 0 if they hold the same runs and bits, else 1."""
    folders = [arguments.before, arguments.after]
    loaded = [store.load(f) for f in folders]
    if not any(part.records for part in loaded):
        raise UsageError(f"nothing to compare: neither {folders[0]} nor {folders[1]} holds a result")
    found = compare(*(part.records for part in loaded))
    inputs = find_differences(*map(read_environment, folders))
    show_comparison(found, inputs, arguments.limit, json=arguments.json)
    print_unreadable({path: why for part in loaded for path, why in part.unreadable.items()})
    return 0 if found.is_identical else 1


def show_comparison(found: Comparison, inputs: list[Finding], limit: int = CHANGES, *, json: bool = False) -> None:
    """Print the changes, at most ``limit``, the largest first, and the inputs that differ; or all of them as JSON."""
    if json:
        plain = {"same": found.is_identical, "alike": found.alike, **dataclasses.asdict(found)}
        differ = [{"what": d.quantity, "before": d.required, "after": d.words, "detail": d.why} for d in inputs]
        print_json({**plain, "inputs": differ, "changes": list(map(_flatten_change, found.changes))})
        return
    rows: list[tuple[Text | str, ...]] = []
    for c in found.changes[:limit]:
        values = [v if isinstance(v, str) else f"{v:.6g}" for v in read_change(c)]
        likeness = Text(*(ROUNDING if c.holds else CHANGED))
        rows.append((likeness, c.subject, c.quantity, *values, f"{measure_change(c):.2g}"))
    below = [f"only before: {case}" for case in found.only_before]
    below += [f"only after: {case}" for case in found.only_after]
    if len(found.changes) > limit:
        below.insert(0, f"{len(found.changes) - limit} smaller changes are not shown (--limit)")
    changed = len({c.subject for c in found.changes})
    below.append(f"{plural(found.compared, 'run')} in both, {found.compared - changed} of them bit for bit identical")
    if inputs or not found.is_identical:
        below.append(f"possible causes: {describe_differences(inputs)}")
    print_table(COLUMNS, rows, *below)


def _flatten_change(c: Finding) -> dict[str, float | str]:
    """Return a change as plain values by name, for ``--json``."""
    before, after = read_change(c)
    likeness, _ = ROUNDING if c.holds else CHANGED
    return {"case": c.subject, "metric": c.quantity, "before": before, "after": after, "likeness": likeness}
