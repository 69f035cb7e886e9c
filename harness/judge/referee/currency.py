"""Check that runs and verdicts are of the present code: each records digests of the code it was computed from.

A run is out of date if its solver, its problem or what runs them has changed, and is made again. If what measures its
motion has changed, or the function of a column, the motion stays, and is measured again; a column that is added makes
nothing out of date. Verdicts are out of date with their runs, and if the rules of judging, the register or the suites
have changed; then judging again suffices, except for new runs.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from ...catalogue import codes
from ...catalogue.suites.spec import RunSpec
from ...columns.digests import ColumnDigests
from ...results.column_digests import find_stale_columns
from ...results.judgements.claims import CodeDigests
from ...results.records import RunRecord
from ...results.reproduce import REFEREED
from .claims.register import Register

JUDGING = (  # what judges claims, with the measures that it looks up by name
    "harness/judge/referee/claims/judging",
    "harness/judge/referee/claims/metrics",
    "harness/judge/referee/claims/equations",
    "harness/results/work",
)
WORDS = ("quote", "caveats", "section", "figure", "claim")  # keys of a claim that no verdict depends on
MOST = 6  # most names that a line lists


def digest_code_and_claims(register: Register, specs: Iterable[RunSpec]) -> CodeDigests:
    """Return the digests that verdicts on the runs ``specs`` would record now: of code, register and suites."""
    runs, here = tuple(specs), codes.package_sources()
    claims = [{k: v for k, v in msgspec.to_builtins(c).items() if k not in WORDS} for c in register.claims]
    text = json.dumps([sorted(s.settings_id for s in runs), claims], sort_keys=True)
    return CodeDigests(
        {s: here.solvers.get(s, "") for s in sorted({r.solver for r in runs})},
        {p: here.problems.get(p, "") for p in sorted({r.problem for r in runs})},
        here.measuring,
        here.digest_modules(*JUDGING),
        hashlib.sha256(text.encode()).hexdigest()[:16],
        here.running,
        here.columns.columns,
    )


def find_older_runs(records: Iterable[RunRecord], plugins: Sequence[str] = ()) -> tuple[RunRecord, ...]:
    """Return the runs that were made by other code than the present one.

    Runs of problems or solvers from plugins, and motions from files, are left out. ``plugins`` are those of the
    results, which are part of a run's digest.
    """
    here = codes.package_sources()
    ours = [r for r in records if r.solver in here.solvers and r.problem in here.problems and r.suite != REFEREED]
    now = {k: codes.digest_run_code(*k, plugins) for k in {(r.problem, r.solver) for r in ours}}
    return tuple(r for r in ours if r.code != now[r.problem, r.solver])


def find_stale_runs(
    records: Iterable[RunRecord], known: Mapping[str, ColumnDigests]
) -> dict[RunRecord, tuple[str, ...]]:
    """Return the runs that the present code would measure in another way, each with the columns concerned.

    ``known`` has the digests of the code that measured them, as stored in their folder, by the digest in a record.
    Motions from files are left out.
    """
    here = codes.read_column_digests()
    found = {r: find_stale_columns(r, known, here) for r in records if r.suite != REFEREED}
    return {r: stale for r, stale in found.items() if stale}


def describe_stale_runs(stale: Mapping[RunRecord, Sequence[str]], folder: str) -> str:
    """Describe in one line how many runs in ``folder`` other code measured, in which columns, and what to do.

    ``stale`` has these runs with their columns, at least one.
    """
    columns = _join_names({name for names in stale.values() for name in names})
    runs = f"{len(stale)} {'run' if len(stale) == 1 else 'runs'} in {folder}"
    was = "was" if len(stale) == 1 else "were"
    return f"{runs} {was} measured by other code ({columns}): mbsbench remeasure {folder}"


def describe_older_runs(old: Sequence[RunRecord], folder: str) -> str:
    """Describe in one line how many runs in ``folder`` are out of date, by which solvers, and how to repeat them.

    ``old`` are these runs.
    """
    suites = sorted({r.suite for r in old})
    again = " and ".join(f"mbsbench run {s or 'SUITE'} --resume --out {folder}" for s in suites)
    return f"{len(old)} runs in {folder} are older than the code of {_join_names({r.solver for r in old})}: {again}"


def describe_changes(published: CodeDigests, now: CodeDigests, suite: str) -> str:
    """Describe in one line what has changed since verdicts were published, with the commands that renew them.

    It is the first change that needs the most: runs, then measuring, then judging; empty if nothing has changed.
    ``suite`` is the one that has the runs of the claims.
    """
    solvers, problems = (_find_changed(getattr(published, k), getattr(now, k)) for k in ("solvers", "problems"))
    judge = "mbsbench judge --publish"
    run = f"mbsbench run {suite} --resume, then {judge}"
    again = f"mbsbench remeasure RESULTS, then {judge}"
    columns = [k for k, v in published.columns.items() if now.columns.get(k) != v]
    every = " (all)" if len(solvers) == len(now.solvers) > 1 else ""
    parts: tuple[tuple[object, str, str], ...] = (
        (solvers, f"the code of {_join_names(solvers)}{every}", run),
        (problems, f"the problem {_join_names(problems)}", run),
        (published.running != now.running, "what runs solvers and counts their cost", run),
        (published.measuring != now.measuring, "what measures motions, of every solver", again),
        (columns, f"the columns {_join_names(columns)}", again),
        (published.runs != now.runs, "the register or the suites", run),
        (published.judging != now.judging, "the rules of judging", judge),
    )
    return next((f"published verdicts are older than {what}: {then}" for differs, what, then in parts if differs), "")


def _find_changed(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Return the sorted names whose digest now differs from the one before."""
    return sorted(k for k, v in now.items() if before.get(k) != v)


def _join_names(found: Iterable[str]) -> str:
    """Return the sorted names joined by commas, at most ``MOST`` of them, with the number of the others."""
    names = sorted(found)
    return ", ".join(names[:MOST]) + (f" and {len(names) - MOST} more" if len(names) > MOST else "")
