"""List the claims of the paper and of the field, show one with its settings, or make and judge its runs (``claim``)."""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from ..harness.base.confined_paths import ConfinedPath
from ..harness.base.hints import suggest_name
from ..harness.catalogue.suites.suite import Suite
from ..harness.judge.referee import judge as judging
from ..harness.judge.referee.registers import PLACES, RegisterPlace
from ..harness.results import store
from ..harness.results.judgements.claims import JudgedClaim
from ..harness.results.judgements.files import FOLDER, PUBLISHED, format_judgement, read_claims
from ..harness.run.runner import Request, find_last_folder, name_new_folder
from ..reports.model import claim_groups, claim_words
from .arguments import UsageError, count_jobs, find_results
from .progress import run_watched
from .terminal import make_console, make_error_console, plural, print_json


def run(arguments: argparse.Namespace) -> int:
    """Print one claim as published, as judged in RESULTS, or with --run after making and judging its runs.

    Without an ID, list the claims. Return 1 if verdicts on runs made now differ from the published ones, else 0.
    """
    if arguments.claim is None:
        return _list_claims(arguments)
    if arguments.all:
        raise UsageError("--all lists every claim: leave out ID")
    known = {c.id: place for place in PLACES for c in place.read().claims}
    if arguments.claim not in known:
        raise UsageError(f"unknown claim {arguments.claim!r}{suggest_name(arguments.claim, list(known))}")
    place = known[arguments.claim]
    alone = replace(place, only=arguments.claim)
    for name in ("out", "jobs"):
        if getattr(arguments, name) and not arguments.make:
            raise UsageError(f"--{name} needs --run")
    if arguments.make and arguments.results:
        raise UsageError("--run makes results: give --out DIR, not RESULTS")
    published = {c.id: c for c in read_claims(PUBLISHED, place.file) or ()}.get(arguments.claim)
    changed = False
    if arguments.make:
        found = _run_claim(arguments, alone)
        changed = published is not None and published.verdicts != found.verdicts
    else:
        found = _read_claim(arguments, published, place)
    if arguments.json:
        make_console().print(format_judgement(found), end="")
        return int(changed)
    for line in _describe_claim(found, len(judging.select_needed_runs(alone))):
        make_console().print(line, markup=False, highlight=False)
    for line in claim_words.list_rows(found) if arguments.rows else ():
        make_console().print(line, markup=False, highlight=False, soft_wrap=True)
    if arguments.make and published:
        make_console().print(f"published: {published.verdicts}" if changed else "as published")
    elif not (arguments.make or arguments.results):
        _warn_if_outdated([place])
    return int(changed)


def _list_claims(arguments: argparse.Namespace) -> int:
    """Print the published claims by group, with verdicts, in the order of the page of claims; return 0.

    Without --all only the groups of ``claim_groups.FIRST`` are printed, and the others counted; --json has all.
    """
    for name in ("make", "rows", "out", "jobs"):
        if getattr(arguments, name):
            raise UsageError(f"--{name.replace('make', 'run')} needs the ID of a claim; mbsbench claim lists them")
    published = [c for place in PLACES for c in read_claims(PUBLISHED, place.file) or ()]
    if not published:
        raise UsageError("no verdicts are published; mbsbench judge RESULTS --publish does so")
    if arguments.json:
        print_json({"claims": [_summarise_claim(c) for c in claim_groups.order_claims(published)]})
        return 0
    out, groups = make_console(), claim_groups.group_claims(published)
    shown = groups if arguments.all else {k: v for k, v in groups.items() if k in claim_groups.FIRST}
    for k, (title, claims) in enumerate(shown.items()):
        if k:
            out.print()
        out.print(f"{title}:", markup=False, highlight=False, style="bold")
        for c in claims:
            out.print(f"{c.id}: {c.claim}", markup=False, highlight=False)
            number = claim_groups.describe_shown(c)
            words = f"{claim_words.describe_verdict(c)}{f' Shown: {number}.' if number else ''}"
            out.print(f"    {words}", markup=False, highlight=False)
    if others := len(published) - sum(map(len, shown.values())):
        words = f"{plural(others, 'more claim')}: mbsbench claim --all lists them"
        out.print(f"{words}; mbsbench claim ID shows one with its settings", markup=False, highlight=False)
    _warn_if_outdated(PLACES)
    return 0


def _warn_if_outdated(places: Sequence[RegisterPlace]) -> None:
    """Print, on standard error, what changed in the code since the verdicts on these registers were published."""
    for place in places:
        if read_claims(PUBLISHED, place.file) is not None and (words := judging.describe_outdated(PUBLISHED, place)):
            make_error_console().print(words, highlight=False)


def _summarise_claim(c: JudgedClaim) -> dict[str, object]:
    """Return a claim as plain data for --json; ``summary`` is true for one of the abstract or the conclusions."""
    sides = {"paper": c.paper, "beyond": c.beyond}
    return {
        "id": c.id,
        "register": c.register,
        "summary": c.summary,
        "kind": c.kind,
        "section": c.section,
        "figure": list(c.figure),
        "claim": c.claim,
        **{side: str(f.verdict) if f else None for side, f in sides.items()},
        "words": claim_words.describe_verdict(c),
    }


def _read_claim(arguments: argparse.Namespace, published: JudgedClaim | None, place: RegisterPlace) -> JudgedClaim:
    """Return the claim as judged in RESULTS, else as published; raise UsageError if there is no verdict."""
    again = f"mbsbench claim {arguments.claim} --run makes its runs"
    if not arguments.results:
        if published is None:
            raise UsageError(f"nothing is published on {arguments.claim}; {again}")
        return published
    folder = find_results(arguments.results)
    found = {c.id: c for c in read_claims(ConfinedPath(folder) / FOLDER, place.file) or ()}.get(arguments.claim)
    if found is None:
        raise UsageError(
            f"{folder} holds no verdict on {arguments.claim}: mbsbench judge {folder} --partial, or {again}"
        )
    return found


def _run_claim(arguments: argparse.Namespace, alone: RegisterPlace) -> JudgedClaim:
    """Run those runs of the claim's map that the results folder lacks, and return the verdict on the whole map.

    The folder is that of --out, else the newest of this claim, else a new one.
    """
    specs, name = judging.select_needed_runs(alone), f"claim-{arguments.claim}"
    folder = Path(arguments.out) if arguments.out else find_last_folder(name) or name_new_folder(name)
    request = Request(Suite(name, "the runs of one claim", specs, ""), folder, count_jobs(arguments.jobs), resume=True)
    if specs:
        loaded, watcher = run_watched(request, quiet=arguments.json)
        watcher.finish(folder, loaded)
    records = loaded.records if specs else ()
    return judging.judge_register(alone, records, partial(store.read_run_series, folder))[0]


def _describe_claim(c: JudgedClaim, runs: int) -> Iterator[str]:
    """Yield the lines that explain a judged claim; ``runs`` is the number of runs that its map selects."""
    yield f"{c.id}: {c.claim}"
    yield claim_words.describe_origin(c)
    for where, f in claim_words.list_sides(c):
        yield f"{where}: {'; '.join(filter(None, (claim_words.format_verdict(f), claim_words.format_share(f))))}"
    if words := claim_words.describe_control(c):
        yield f"control: {words}"
    if words := claim_words.format_by_solver(c):
        yield f"by solver: {words}"
    for k, t in enumerate(c.tests):
        number = f"{claim_words.format_measured(t)}; band: {claim_words.format_band(t)} ({claim_words.name_metric(t)})"
        yield f"{'and' if k else 'measured'}: {number}"
    if setting := claim_groups.name_shown_setting(c):
        yield f"{'these are' if len(c.tests) > 1 else 'this is'} of {setting}: {claim_groups.find_command(c)}"
    if c.missing:
        yield f"missing: {claim_words.describe_missing(c)}"
    if words := claim_words.explain_verdicts(c):
        yield f"why: {words}"
    for name, values in c.settings.items():
        shown = ", ".join(claim_words.format_value(name, v) for v in values)
        yield f"tried with {claim_words.spell_out(name)}: {shown}"
    judged = sum(1 + m.more for m in c.map if m.holds is not None)
    yield f"its runs: {runs}, of which {judged} are in settings that are judged" + (
        f"; to make and judge them: mbsbench claim {c.id} --run" if runs else ""
    )
