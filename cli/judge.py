"""Judge the paper's claims from a results folder, and show what changed since publication (``judge``)."""

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from ..harness.base.confined_paths import ConfinedPath
from ..harness.catalogue.suites.spec import RunSpec
from ..harness.judge.referee import judge as judging
from ..harness.judge.referee.carried import is_current_or_carried
from ..harness.judge.referee.certificates.orders import select_motion
from ..harness.judge.referee.claims.register import PRESENTATION, REGISTER, read_register
from ..harness.judge.referee.currency import code_now, describe_older, find_older_runs
from ..harness.judge.referee.judge import VerdictChange, find_changes, judge_results, write_judgements
from ..harness.results import store
from ..harness.results.judgements.claims import SCHEMA, ClaimFinding, ClaimGap, ClaimVerdict, JudgedClaim
from ..harness.results.judgements.files import (
    FOLDER,
    ORDERS,
    PUBLISHED,
    add_code,
    format_judgement,
    read_claims,
    shorten_claims,
)
from ..harness.results.judgements.runs import Order
from ..harness.results.provenance import read_environment
from ..harness.run.costs import describe_command
from ..reports.model import claim_words
from .arguments import UsageError, check_not_installed
from .findings import print_findings
from .progress import announce_suite
from .terminal import Column, make_console, make_error_console, plural, print_table, print_unreadable

STYLE = {
    ClaimVerdict.REPRODUCED: "green",
    ClaimVerdict.REPRODUCED_IF: "yellow",
    ClaimVerdict.NOT_REPRODUCED: "bold red",
    ClaimVerdict.CANNOT_BE_TOLD: "dim",
}
AGAIN = f"mbsbench run {judging.WHOLE} --resume"
COLUMNS = (
    Column("claim", fold=True),
    Column("figure", rank=2, right=False),
    Column("at the paper's settings", right=False, fold=True, least=12),
    Column("beyond them", right=False, fold=True, least=12),
    Column("distinct of rows", rank=3, fold=True, least=8),
    Column("measured", fold=True, least=12, rank=1),
    Column("band", rank=2, fold=True, least=12),
)


def run(arguments: argparse.Namespace) -> int:
    """Judge and print the claims; return 1 if the published verdicts differ or are of older code, else 0."""
    register = read_register(Path(arguments.claims) if arguments.claims else REGISTER)
    folder = arguments.results
    published = ConfinedPath(Path(arguments.published)) if arguments.published else PUBLISHED
    loaded = store.load(folder, check_series=False)
    print_unreadable(loaded.unreadable)
    if arguments.publish:
        check_not_installed(published.path, "--published DIR")
        _require_runs(folder, judging.list_published_runs(), "that verdicts are published from")
    elif not arguments.partial:
        _require_runs(
            folder, judging.select_needed(register), "that the claims are tried on", ", or judge these: --partial"
        )
    older = find_older_runs(loaded.records, [str(p) for p in read_environment(folder).get("plugins") or ()])
    if old := [r for r in older if not is_current_or_carried(r.problem, r.solver, r.code)]:
        raise UsageError(describe_older(old, str(folder)))
    before = None if arguments.publish else read_claims(published)
    if before is None and arguments.published and not arguments.publish:
        raise UsageError(f"--published {published} holds no verdicts (claims.json); --publish writes these there")
    size = len(loaded.records)
    announce_suite(f"{plural(size, 'run')} to be judged: {describe_command('judge', size)}", make_error_console())
    with store.hold_folder(folder):
        judged = judge_results(folder, register, lambda part: make_error_console().print(f"judging: {part}"))
        code = code_now(register, judging.list_published_runs())
        write_judgements(ConfinedPath(folder) / FOLDER, judged, code)
    lacking = {c.id for c in judged["claims"] if any(m.gap is ClaimGap.RUNS for m in c.missing)}
    here = {r.settings_id for r in loaded.records}
    whole = [c for c in judged["claims"] if c.id not in lacking and here.intersection(c.settings_ids)]
    compares = before is not None and bool(whole)
    stale = judging.describe_outdated(published, code) if compares else ""
    changed = [c for c in find_changes(before, judged["claims"]) if c.id not in lacking] if before is not None else []
    orders = select_motion(judged.get(ORDERS.name, ()))
    if arguments.json:
        told = add_code(judged["claims"], code)
        plain = {"schema": SCHEMA, "code": code, "claims": told.claims, "commands": told.commands, "orders": orders}
        make_console().print(format_judgement(plain), end="")
    else:
        known = whole if arguments.partial else judged["claims"]
        if known:
            show_claims(known, changed, before is not None, arguments.publish)
        show_orders(orders)
        if others := len(judged["claims"]) - len(known):
            compared = "were not" if known else "nothing was"
            make_console().print(
                f"{others} of {len(judged['claims'])} claims lack runs and {compared} compared with the "
                f"published verdicts; make them: {AGAIN}",
                soft_wrap=True,
            )
    if arguments.publish:
        published.root.mkdir(parents=True, exist_ok=True)
        write_judgements(published, {**judged, "claims": shorten_claims(judged["claims"])}, code)
        make_error_console().print(f"published: {published}")
    if stale:
        make_error_console().print(stale)
    return 1 if changed or stale else 0


def _require_runs(folder: Path, specs: Sequence[RunSpec], what: str, remedy: str = "") -> None:
    """Raise UsageError if the results lack any of the runs ``specs``; ``what`` and ``remedy`` complete its sentence."""
    if missing := judging.find_missing(folder, specs):
        raise UsageError(
            f"{folder} lacks {len(missing)} of {len(specs)} runs {what} (the first: {missing[0].case}); "
            f"make them: {AGAIN}{remedy}"
        )


def show_claims(claims: Sequence[JudgedClaim], changed: list[VerdictChange], compared: bool, publishing: bool) -> None:
    """Print the table of verdicts, the count of each, and the changes from the published ones.

    ``compared`` states that published verdicts exist; ``publishing``, that these will be published, so that no remedy
    is named.
    """
    rows = []
    for c in claims:
        first = c.tests[0] if c.tests else None
        numbers = (claim_words.format_measured(first), claim_words.format_band(first)) if first else ("", "")
        count = f"{sum(f.settings for f in c.findings)} of {sum(f.rows for f in c.findings)}"
        rows.append(
            (
                c.id,
                claim_words.join_figures(c),
                format_verdict(c.paper),
                format_verdict(c.beyond),
                count,
                claim_words.describe_missing(c) or numbers[0],
                numbers[1],
            )
        )
    below = [count_verdicts(claims)]
    below += [f"changed: {c.id}: {c.before or 'not published'} -> {c.after or 'no longer judged'}" for c in changed]
    if compared:
        below.append(f"{len(changed)} claims differ from the published ones" if changed else "as published")
    elif not publishing:
        below.append("nothing is published yet; use --publish to do so")
    print_table(COLUMNS, rows, *below)


def show_orders(orders: Sequence[Order]) -> None:
    """Print every ladder of fixed steps that does not show the declared order, with the reason, and the counts."""
    from ..reports.pages.judged.orders import describe_order

    counts = ", ".join(f"{n} {verdict}" for verdict, n in Counter(o.verdict for o in orders).most_common())
    found = [o.as_finding(f"{o.verdict}: {describe_order(o)}") for o in orders if o.verdict != "certified"]
    print_findings(found, *([f"orders: {counts}"] if orders else []))


def format_verdict(f: ClaimFinding | None) -> Text:
    """Format a verdict and how many settings hold, in its colour; a dash if there is none."""
    words = "; ".join(filter(None, (claim_words.format_verdict(f), claim_words.format_share(f)))) if f else "–"
    return Text(words, STYLE[f.verdict] if f else "dim")


def count_verdicts(claims: Sequence[JudgedClaim]) -> str:
    """Count each verdict; checks of the problems' presentation are counted separately."""
    results = [c for c in claims if c.kind != PRESENTATION]
    out = []
    for k, where in enumerate(claim_words.WHERE):
        found = Counter(f.verdict for c in results if (f := (c.paper, c.beyond)[k]))
        out.append(f"{where}: " + ", ".join(f"{found[v]} {v}" for v in STYLE))
    checks = [c for c in claims if c.kind == PRESENTATION]
    good = sum(c.verdict == ClaimVerdict.REPRODUCED for c in checks)
    out += [f"checks of the presentation: {good} of {len(checks)} reproduced"] if checks else []
    return "\n".join(out)
