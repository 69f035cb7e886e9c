"""Which deviations of a campaign are written: a few of each sort, shrunk, with the evidence of other routes."""

import json
from collections import Counter
from collections.abc import Callable, Iterable

import msgspec

from ..catalogue import registry
from ..code_meter import CODE_LIMIT
from ..sandbox.apart import Apart
from .campaign import MEMORY, Settings
from .cases import Case
from .log import Trial
from .oracle import Outcome, Verdict
from .presenting import Form
from .shrinking import shrink_outcome

CPU = 300.0  # [s] to shrink a case


def choose(trials: Iterable[Trial], most: int) -> list[Case]:
    """Up to ``most`` confirmed deviations of a sort (solver, kind, changes of the form), the clearest first, shrunk."""
    counted, cases = Counter[str](), []
    confirmed = (t for t in trials if t.verdict is Verdict.CONFIRMED)
    for trial in sorted(confirmed, key=lambda t: (t.outcome.solver, -t.outcome.strength, t.outcome.number)):
        found = trial.outcome
        sort = f"{found.solver} {found.kind} {_changes(found.form)}"
        counted[sort] += 1
        if counted[sort] <= most:
            cases.append(make_case(trial.settings, found))
    return cases


def make_case(settings: Settings, found: Outcome) -> Case:
    """``found`` shrunk and confirmed, in a process of its own; as it was where that one ends early."""
    first, options, floor = settings.oracle(found.number), settings.options, settings.floor

    def target(send: Callable[[str], None]) -> None:
        solver = registry.make_solver(found.solver, options)
        smallest, outcome = shrink_outcome(first, found, lambda o: o.examine(found.solver, solver))
        verdict, evidence = smallest.decide(found.solver, solver)
        ends, notes = smallest.answers(solver)
        case = Case(outcome, smallest.mechanism, smallest.form, verdict, evidence, options, floor, "", ends, notes)
        send(msgspec.json.encode(case).decode())

    if sent := Apart(target, limit=CPU, memory=MEMORY, code=CODE_LIMIT).wait().sent:
        return msgspec.json.decode(sent, type=Case)
    return Case(found, first.mechanism, first.form, None, "", options, floor)


def describe(o: Outcome) -> str:
    """An outcome in a line."""
    numbers = f"{min(o.deviation):.2g} m, own error {o.own:.2g} m" if o.limit else o.words
    return f"{o.solver}, mechanism {o.number}: {o.kind} ({o.form}): {numbers}"


def _changes(form: Form) -> str:
    given = [w.partition("=")[0] for w in str(form).split()]
    return json.dumps(sorted({w.partition("_")[0] for w in given}))
