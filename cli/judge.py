"""Judge the claims of the paper and of the field from a results folder, and show what changed since publication."""

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.text import Text

from ..harness.base.confined_paths import ConfinedPath
from ..harness.judge.referee import judge as judging
from ..harness.judge.referee.carried import is_current_or_carried, is_measuring_carried
from ..harness.judge.referee.certificates.orders import select_motion
from ..harness.judge.referee.claims.register import PRESENTATION
from ..harness.judge.referee.currency import (
    describe_older_runs,
    describe_stale_runs,
    find_older_runs,
    find_stale_runs,
)
from ..harness.judge.referee.judge import find_changes, judge_results, write_judgements
from ..harness.judge.referee.registers import FIELD, PAPER, RegisterPlace
from ..harness.results import store
from ..harness.results.column_digests import read_stored_digests
from ..harness.results.judgements.claims import (
    SCHEMA,
    ClaimFinding,
    ClaimGap,
    ClaimVerdict,
    CodeDigests,
    JudgedClaim,
)
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
from ..harness.results.records import RunRecord
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
SIDES = (
    Column("at the paper's settings", right=False, fold=True, least=12),
    Column("beyond them", right=False, fold=True, least=12),
)
NUMBERS = (
    Column("distinct of rows", rank=3, fold=True, least=8),
    Column("measured", fold=True, least=12, rank=1),
    Column("band", rank=2, fold=True, least=12),
)


@dataclass(frozen=True)
class _Verdicts:
    """The verdicts on one register, beside those that are published."""

    place: RegisterPlace
    claims: tuple[JudgedClaim, ...]
    code: CodeDigests
    before: tuple[JudgedClaim, ...] | None  # as published; None if nothing is, or is to be published now
    whole: tuple[JudgedClaim, ...]  # claims that lack no run, and have one in these results
    changed: list[tuple[str, str, str]]  # id, verdicts before and now
    stale: str  # what changed in the code since publication; empty if nothing did, or nothing is compared


def refuse_other_code(folder: Path, records: Sequence[RunRecord]) -> None:
    """Raise UsageError if ``records`` of a results folder are of other code, or were measured by other code."""
    older = find_older_runs(records, [str(p) for p in read_environment(folder).get("plugins") or ()])
    if old := [r for r in older if not is_current_or_carried(r.problem, r.solver, r.code)]:
        raise UsageError(describe_older_runs(old, str(folder)))
    states = read_stored_digests(folder)
    carried = {d for d in {r.measured_by for r in records} if is_measuring_carried(d, states)}
    uncarried = [r for r in records if r.measured_by not in carried]
    if changed_columns := find_stale_runs(uncarried, states):
        raise UsageError(describe_stale_runs(changed_columns, str(folder)))


def run(arguments: argparse.Namespace) -> int:
    """Judge the claims of both registers from a results folder, write the judgements into it and print them.

    With --publish they are also written to the folder of published verdicts; else they are compared with these. Return
    1 if a verdict differs from the published one, or if the published ones are of older code, else 0.
    """
    paper = replace(PAPER, path=Path(arguments.claims)) if arguments.claims else PAPER
    places = (paper, FIELD)
    for place in places:
        place.read()  # raises FileError before anything is judged
    folder = arguments.results
    published = ConfinedPath(Path(arguments.published)) if arguments.published else PUBLISHED
    loaded = store.load(folder, check_series=False)
    print_unreadable(loaded.unreadable)
    if arguments.publish:
        check_not_installed(published.path, "--published DIR")
    asked = _choose_registers(arguments, places, loaded.records)
    refuse_other_code(folder, loaded.records)
    before = {p: None if arguments.publish else read_claims(published, p.file) for p in places}
    if before[paper] is None and arguments.published and not arguments.publish:
        raise UsageError(f"--published {published} holds no verdicts (claims.json); --publish writes these there")
    size = len(loaded.records)
    announce_suite(f"{plural(size, 'run')} to be judged: {describe_command('judge', size)}", make_error_console())
    with store.hold_folder(folder):
        judged = judge_results(folder, places, lambda part: make_error_console().print(f"judging: {part}"))
        codes = {p.file.name: judging.digest_code(p) for p in places}
        write_judgements(ConfinedPath(folder) / FOLDER, judged, codes)
    here = {r.settings_id for r in loaded.records}
    found = [_compare_verdicts(p, judged[p.file.name], codes[p.file.name], before[p], here, published) for p in places]
    orders = select_motion(judged.get(ORDERS.name, ()))
    if arguments.json:
        make_console().print(format_judgement(_collect_plain(found, orders)), end="")
    else:
        for v in found:
            _print_verdicts(v, v.claims if v.place in asked and not arguments.partial else v.whole, arguments.publish)
            if v.place is paper:
                show_orders(orders)
    if arguments.publish:
        published.root.mkdir(parents=True, exist_ok=True)
        write_judgements(published, _select_published(judged, asked), codes)
        make_error_console().print(f"published: {published}")
    for v in found:
        if v.stale:
            make_error_console().print(v.stale)
    return 1 if any(v.changed or v.stale for v in found) else 0


def _choose_registers(
    arguments: argparse.Namespace, places: Sequence[RegisterPlace], records: Sequence[RunRecord]
) -> list[RegisterPlace]:
    """Return the registers whose claims lack no run in ``records``; raise UsageError if there is none.

    With --publish, these are the registers whose verdicts may be published. With --partial alone, none is returned:
    only the claims covered by the results are shown.
    """
    if arguments.partial and not arguments.publish:
        return []
    wanted = {p: judging.list_published_runs(p) if arguments.publish else judging.select_needed_runs(p) for p in places}
    missing = {p: judging.find_missing(records, specs) for p, specs in wanted.items()}
    if whole := [p for p in places if wanted[p] and not missing[p]]:
        return whole
    what = "that verdicts are published from" if arguments.publish else "that the claims are tried on"
    remedy = "" if arguments.publish else ", or judge these: --partial"
    asked, absent = wanted[places[0]], missing[places[0]]
    raise UsageError(
        f"{arguments.results} lacks {len(absent)} of {len(asked)} runs {what} (the first: {absent[0].case}); "
        f"make them: {_make_remedy(PAPER)}{remedy}"
    )


def _make_remedy(place: RegisterPlace) -> str:
    """Return the command that makes the runs of a register's claims."""
    return f"mbsbench run {place.whole} --resume"


def _compare_verdicts(
    place: RegisterPlace,
    claims: tuple[JudgedClaim, ...],
    code: CodeDigests,
    before: tuple[JudgedClaim, ...] | None,
    here: set[str],
    published: ConfinedPath,
) -> _Verdicts:
    """Return the verdicts on one register, with what changed, in verdicts and in code, since others were published.

    ``before`` are the published claims, None if there is nothing to compare with. ``here`` are the settings_ids of the
    results, ``code`` are the digests of the present code; claims that lack runs are not compared.
    """
    lacking = {c.id for c in claims if any(m.gap is ClaimGap.RUNS for m in c.missing)}
    whole = tuple(c for c in claims if c.id not in lacking and here.intersection(c.settings_ids))
    if before is None:
        return _Verdicts(place, claims, code, None, whole, [], "")
    changed = [c for c in find_changes(before, claims) if c[0] not in lacking]
    stale = judging.describe_outdated(published, place, code) if whole else ""
    return _Verdicts(place, claims, code, before, whole, changed, stale)


def _collect_plain(found: Sequence[_Verdicts], orders: Sequence[Order]) -> dict[str, Any]:
    """Return both registers' claims and the orders as plain data: the paper's claims at the top, then the field's."""
    files = {v.place.name: add_code(v.claims, v.code) for v in found}
    parts = {p: {"code": f.code, "claims": f.claims, "commands": f.commands} for p, f in files.items()}
    return {"schema": SCHEMA, **parts[PAPER.name], FIELD.file.name: parts[FIELD.name], "orders": orders}


def _select_published(judged: Mapping[str, Any], places: Sequence[RegisterPlace]) -> dict[str, Any]:
    """Return the judgements to publish: the shortened claims of ``places``, and with the paper's all other files."""
    own = {p.file.name: shorten_claims(judged[p.file.name]) for p in places}
    registers = {PAPER.file.name, FIELD.file.name}
    others = {k: v for k, v in judged.items() if k not in registers} if PAPER.name in [p.name for p in places] else {}
    return {**own, **others}


def _print_verdicts(v: _Verdicts, known: Sequence[JudgedClaim], publishing: bool) -> None:
    """Print the verdicts on the claims ``known`` of a register, then how many others lack runs and how to make these.

    ``publishing`` states that the verdicts will be published.
    """
    if known:
        show_claims(known, v.changed, v.before is not None, publishing, v.place)
    if others := len(v.claims) - len(known):
        compared = "were not" if known else "nothing was"
        whose = "" if v.place.name == PAPER.name else f" {v.place.whose}"
        make_console().print(
            f"{others} of {len(v.claims)} claims{whose} lack runs and {compared} compared with the "
            f"published verdicts; make them: {_make_remedy(v.place)}",
            soft_wrap=True,
        )


def show_claims(
    claims: Sequence[JudgedClaim],
    changed: Sequence[tuple[str, str, str]],
    compared: bool,
    publishing: bool,
    place: RegisterPlace = PAPER,
) -> None:
    """Print the table of verdicts, the count of each, and the changes from the published ones.

    ``changed`` holds the id of a claim and its verdicts before and now. ``compared`` states that published verdicts
    exist; ``publishing``, that these will be published, so that no remedy is named. A claim of the field has one
    verdict, one of the paper two, and figures.
    """
    rows = []
    for c in claims:
        first = c.tests[0] if c.tests else None
        numbers = (claim_words.format_measured(first), claim_words.format_band(first)) if first else ("", "")
        count = f"{sum(f.settings for f in c.findings)} of {sum(f.rows for f in c.findings)}"
        sides = (claim_words.join_figures(c), format_verdict(c.paper)) if place.name == PAPER.name else ()
        measured = claim_words.describe_missing(c) or numbers[0]
        rows.append((c.id, *sides, format_verdict(c.beyond), count, measured, numbers[1]))
    below = [count_verdicts(claims, place)]
    below += [f"changed: {k}: {old or 'not published'} -> {new or 'no longer judged'}" for k, old, new in changed]
    if compared:
        below.append(f"{len(changed)} claims differ from the published ones" if changed else "as published")
    elif not publishing:
        below.append("nothing is published yet; use --publish to do so")
    figure = Column("figure", rank=2, right=False)
    verdicts = (figure, *SIDES) if place.name == PAPER.name else (Column("verdict", right=False, fold=True, least=12),)
    print_table((Column("claim", fold=True), *verdicts, *NUMBERS), rows, *below)


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


def count_verdicts(claims: Sequence[JudgedClaim], place: RegisterPlace = PAPER) -> str:
    """Return lines with the count of each verdict; checks of the set-up have a line of their own.

    Such checks are theorems about a problem and say nothing of solvers.
    """
    results = [c for c in claims if c.kind != PRESENTATION]
    sides = tuple(zip(claim_words.WHERE, ("paper", "beyond"), strict=True))
    out = []
    for where, side in sides if place.name == PAPER.name else ((f"claims {place.whose}", "beyond"),):
        found = Counter(f.verdict for c in results if (f := getattr(c, side)))
        out.append(f"{where}: " + ", ".join(f"{found[v]} {v}" for v in STYLE))
    checks = [c for c in claims if c.kind == PRESENTATION]
    good = sum(c.verdict == ClaimVerdict.REPRODUCED for c in checks)
    out += [f"checks of the set-up: {good} of {len(checks)} reproduced"] if checks else []
    return "\n".join(out)
