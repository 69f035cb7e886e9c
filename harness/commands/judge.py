"""``judge``: the verdicts on the paper's claims from a run, and what changed against the published ones."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...reports.model import claim_words
from ..referee.claims.register import PRESENTATION, REGISTER, read_register
from ..referee.judge import FOLDER, PUBLISHED, Change, as_text, changes, judgements, read_claims, write
from ..results import store
from ..results.judgements import Claim, Verdict
from .run import existing
from .terms import check_ours

STYLE = {
    Verdict.SUPPORTED: "green", Verdict.CONDITIONAL: "yellow", Verdict.REFUTED: "bold red", Verdict.UNTESTABLE: "dim",
}  # fmt: skip


def add(commands: Any) -> None:
    """The subcommand's arguments."""
    p = commands.add_parser("judge", help="verdicts on the paper's claims; 1 where they differ from the published")
    p.add_argument("folder", nargs="?", default="latest", metavar="RUN", help="run folder (default: the newest)")
    p.add_argument("--publish", action="store_true", help="write them to results/published/ as well")
    p.add_argument("--claims", metavar="FILE.toml", help="another register than results/claims.toml")
    p.add_argument("--published", metavar="DIR", help="another folder than results/published")
    p.add_argument("--json", action="store_true", help="the claims as JSON, for machines")
    p.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """0, or 1 where a verdict differs from the published one and is not published now."""
    register = read_register(Path(arguments.claims) if arguments.claims else REGISTER)
    folder = existing(arguments.folder)
    published = Path(arguments.published) if arguments.published else PUBLISHED
    if arguments.publish:
        check_ours(published, "--published DIR")
    told = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    before = None if arguments.publish else read_claims(published)
    unreadable = store.load(folder, check_series=False).unreadable
    for item in unreadable:
        told.print(f"not read: {item.path}: {item.why}")
    judged = judgements(folder, register, lambda part: told.print(f"judging: {part}"))
    write(folder / FOLDER, judged)
    changed = changes(before, judged["claims"]) if before is not None else []
    if arguments.json:
        Console(highlight=False, markup=False, soft_wrap=True).print(as_text(judged["claims"]), end="")
    else:
        show(judged["claims"], changed, before is not None, arguments.publish)
    if arguments.publish:
        write(published, judged)
        told.print(f"published: {published}")
    return 1 if changed else 0


def show(claims: Sequence[Claim], changed: list[Change], compared: bool, publishing: bool) -> None:
    """The table of verdicts, how many of each, and the changes."""
    out = Console()
    if not out.is_terminal:
        out = Console(width=160)
    table = Table(box=None, padding=(0, 2, 0, 0))
    for name in ("claim", "figure", "verdict", "measured", "band", "holds in"):
        table.add_column(name, overflow="fold")
    for c in claims:
        first = c.tests[0] if c.tests else None
        numbers = (claim_words.measured(first), claim_words.band(first)) if first else ("", "")
        tried = claim_words.missing(c) or f"{c.because.holds} of {c.because.settings}"
        cells = (c.id, claim_words.figures(c), Text(c.verdict, STYLE[c.verdict]), *numbers, tried)
        table.add_row(*(x if isinstance(x, Text) else Text(x) for x in cells))
    out.print(table)
    out.print(Text(tally(claims)))
    for change in changed:
        words = f"{change.before or 'not published'} -> {change.after or 'no longer judged'}"
        out.print(Text(f"changed: {change.id}: {words}"))
    if not compared and not publishing:
        out.print("nothing is published yet; --publish does it")
    elif compared:
        out.print(f"{len(changed)} verdicts differ from the published ones" if changed else "as published")


def tally(claims: Sequence[Claim]) -> str:
    """How many of each verdict among the results; checks of the presentation of the problems beside them."""
    results = [c for c in claims if c.kind != PRESENTATION]
    words = ", ".join(f"{sum(c.verdict == v for c in results)} {v}" for v in STYLE)
    checks = [c for c in claims if c.kind == PRESENTATION]
    good = sum(c.verdict == Verdict.SUPPORTED for c in checks)
    return f"{words}; and checks of the presentation: {good} of {len(checks)} SUPPORTED" if checks else words
