"""Choose deviations of a campaign to write: a few of each sort, shrunk, with the evidence of independent solutions."""

import json
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import msgspec

from ...catalogue import registry
from .campaign import CampaignSettings, run_apart
from .cases import Case, write_cases, write_page
from .log import Trial, read_trials, write_summary
from .oracle import OracleOutcome, OracleVerdict
from .presenting import Form
from .shrinking import shrink_outcome

CPU = 300.0  # [s] to shrink a case


def write_findings(folder: Path, most: int) -> tuple[Mapping[str, Mapping[str, int]], list[Case]]:
    """Write summary, cases and page of the trials in ``folder``; return the counts by solver, and the cases.

    The cases are confirmed deviations, at most ``most`` of each sort.
    """
    trials = read_trials(folder)
    counts, cases = write_summary(folder, trials), choose_cases(trials, most)
    write_cases(folder, cases)
    write_page(folder)
    return counts, cases


def choose_cases(trials: Iterable[Trial], most: int) -> list[Case]:
    """Return confirmed deviations as shrunk cases to write: up to ``most`` of each sort, the clearest first.

    Deviations of one sort have the same solver, behaviour and changes of the form.
    """
    counted, cases = Counter[str](), []
    confirmed = (t for t in trials if t.verdict is OracleVerdict.CONFIRMED)
    for trial in sorted(confirmed, key=lambda t: (t.outcome.solver, -t.outcome.strength, t.outcome.number)):
        found = trial.outcome
        sort = f"{found.solver} {found.kind} {_name_changes(found.form)}"
        counted[sort] += 1
        if counted[sort] <= most:
            cases.append(make_case(trial.settings, found))
    return cases


def make_case(settings: CampaignSettings, found: OracleOutcome) -> Case:
    """Shrink and confirm a deviation in a separate process, and return the case; not shrunk if that process fails."""
    first, options, floor = settings.make_oracle(found.number), settings.options, settings.floor

    def shrink() -> str:
        """Shrink the deviation, confirm it, and return the case as JSON."""
        solver = registry.make_solver(found.solver, options)
        smallest, outcome = shrink_outcome(first, found, lambda o: o.examine(found.solver, solver))
        verdict, evidence = smallest.decide(found.solver, solver)
        ends, notes = smallest.collect_answers(solver)
        case = Case(outcome, smallest.mechanism, smallest.form, verdict, evidence, options, floor, "", ends, notes)
        return msgspec.json.encode(case).decode()

    if sent := run_apart(shrink, CPU):
        return msgspec.json.decode(sent, type=Case)
    return Case(found, first.mechanism, first.form, None, "", options, floor)


def _name_changes(form: Form) -> str:
    """Return the sorted kinds of changes that a form makes, as JSON such as ``["rotation", "unit"]``."""
    given = [w.partition("=")[0] for w in str(form).split()]
    return json.dumps(sorted({w.partition("_")[0] for w in given}))
