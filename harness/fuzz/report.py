"""Which outcomes of a campaign are shown: a few of each sort, shrunk, with the evidence of other routes."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import msgspec

from ..catalogue import registry
from ..sandbox.apart import Apart
from .campaign import MEMORY, make_oracle
from .cases import Case
from .oracle import FINDINGS, FLOOR, SHOWN, Kind, Outcome
from .presenting import Form
from .shrinking import shrink_outcome

CPU = 300.0  # [s] to shrink a case


def choose(
    seed: int, outcomes: Sequence[Outcome], most: int, floor: float = FLOOR, options: Mapping[str, str] | None = None
) -> list[Case]:
    """Up to ``most`` cases of a sort (solver, kind, changes of the form), the clearest first, shrunk."""
    counted, cases = Counter[str](), []
    for found in sorted((o for o in outcomes if o.kind in SHOWN), key=lambda o: (o.solver, -o.strength, o.number)):
        sort = f"{found.solver} {found.kind} {_changes(found.form)}"
        counted[sort] += 1
        if counted[sort] <= most:
            cases.append(make_case(seed, found, floor, dict(options or {})))
    return cases


def make_case(seed: int, found: Outcome, floor: float, options: dict[str, str]) -> Case:
    """``found`` shrunk and confirmed, in a process of its own; as it was where that one ends early."""
    first = make_oracle(seed, found.number, floor)

    def target(send: Callable[[str], None]) -> None:
        solver = registry.make_solver(found.solver, options)
        smallest, outcome = shrink_outcome(first, found, lambda o: o.examine(found.solver, solver))
        evidence = smallest.confirm(found.solver, solver) if outcome.kind in FINDINGS else ""
        case = Case(outcome, smallest.mechanism, smallest.form, evidence, options, floor)
        send(msgspec.json.encode(case).decode())

    crashed = found.kind is Kind.CRASHED
    sent = "" if crashed else Apart(target, limit=CPU, memory=MEMORY).wait().sent
    if sent:
        return msgspec.json.decode(sent, type=Case)
    return Case(found, first.mechanism, first.form, "", options, floor)


def describe(o: Outcome) -> str:
    """An outcome in a line."""
    numbers = f"{min(o.deviation):.2g} m, own error {o.own:.2g} m" if o.limit else o.words
    return f"{o.solver}, mechanism {o.number}: {o.kind} ({o.form}): {numbers}"


def _changes(form: Form) -> str:
    given = [w.partition("=")[0] for w in str(form).split()]
    return json.dumps(sorted({w.partition("_")[0] for w in given}))
