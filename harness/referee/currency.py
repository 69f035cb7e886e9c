"""Whether runs and verdicts are of the present code: each records digests of what it was computed from.

A run is out of date when its solver, its problem or the measuring has changed, and is made again: its series do not
hold the states that numbers are measured from, so nothing can be measured again without it. Verdicts are out of date
with their runs, and when the rules of judging, the register or the suites have changed; then judging again is enough,
but for runs that are new.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence

import msgspec

from ..results import codes
from ..results.judgements.claims import Code
from ..results.records import RunRecord
from ..results.reproduce import REFEREED
from ..suites.spec import RunSpec
from .claims.register import Register

JUDGING = ("harness/referee/claims/count", "harness/referee/claims/steps", "harness/results/work")
WORDS = ("quote", "caveats", "section", "figure", "claim")  # of a claim: no verdict depends on them
MOST = 6  # names in a line


def code_now(register: Register, specs: Iterable[RunSpec]) -> Code:
    """Digests of what verdicts on these runs by this register are computed from."""
    runs, here = tuple(specs), codes.package_sources()
    claims = [{k: v for k, v in msgspec.to_builtins(c).items() if k not in WORDS} for c in register.claims]
    text = json.dumps([sorted(s.settings_id for s in runs), claims], sort_keys=True)
    return Code(
        {s: here.solvers.get(s, "") for s in sorted({r.solver for r in runs})},
        {p: here.problems.get(p, "") for p in sorted({r.problem for r in runs})},
        here.measuring, here.of(*JUDGING), hashlib.sha256(text.encode()).hexdigest()[:16],
    )  # fmt: skip


def find_older_runs(records: Iterable[RunRecord], plugins: Sequence[str] = ()) -> tuple[RunRecord, ...]:
    """Runs made by other code; those of other people's problems and solvers are not looked at."""
    here = codes.package_sources()
    ours = [r for r in records if r.solver in here.solvers and r.problem in here.problems and r.suite != REFEREED]
    now = {k: codes.code_of(*k, plugins) for k in {(r.problem, r.solver) for r in ours}}
    return tuple(r for r in ours if r.code != now[r.problem, r.solver])


def describe_older(old: Sequence[RunRecord], folder: str) -> str:
    """One line: whose code has changed, and the command that makes these runs anew."""
    suites = sorted({r.suite for r in old})
    again = " and ".join(f"mbsbench run {s or 'SUITE'} --resume --out {folder}" for s in suites)
    return f"{len(old)} runs in {folder} are older than the code of {_join_names({r.solver for r in old})}: {again}"


def describe_changes(published: Code, now: Code, suite: str) -> str:
    """One line on what has changed since verdicts were published, and the commands; empty if nothing has."""
    solvers, problems = (_find_changed(getattr(published, k), getattr(now, k)) for k in ("solvers", "problems"))
    judge = "mbsbench judge --publish"
    run = f"mbsbench run {suite} --resume, then {judge}"
    every = " (all)" if len(solvers) == len(now.solvers) > 1 else ""
    parts: tuple[tuple[object, str, str], ...] = (
        (solvers, f"the code of {_join_names(solvers)}{every}", run),
        (problems, f"the problem {_join_names(problems)}", run),
        (published.measuring != now.measuring, "what measures motions, of every solver", run),
        (published.runs != now.runs, "the register or the suites", run),
        (published.judging != now.judging, "the rules of judging", judge),
    )
    return next((f"published verdicts are older than {what}: {then}" for differs, what, then in parts if differs), "")


def _find_changed(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    return sorted(k for k, v in now.items() if before.get(k) != v)


def _join_names(found: Iterable[str]) -> str:
    names = sorted(found)
    return ", ".join(names[:MOST]) + (f" and {len(names) - MOST} more" if len(names) > MOST else "")
