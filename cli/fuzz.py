"""``fuzz``: random mechanisms in several forms; what a code answers differently or wrongly is shrunk and written."""

import argparse
import shlex
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path

from ..harness.catalogue import registry
from ..harness.execution.runner import new_folder
from ..harness.fuzz.campaign import run_campaign
from ..harness.fuzz.cases import NONE, read_case, write_cases
from ..harness.fuzz.oracle import FINDINGS, SHOWN, Kind, Outcome
from ..harness.fuzz.report import choose, describe
from .arguments import UsageError, count_jobs, load_plugins, parse_assignments
from .terminal import Column, console, error_console, plural, print_json, print_table


def run(arguments: argparse.Namespace) -> int:
    """Print the counts and the findings; return 1 if a deviation is confirmed, else 0."""
    load_plugins(arguments.plugin)
    for name in arguments.solvers:
        registry.entry_of("solver", name, registry.solvers())
    if arguments.repeat:
        return _repeat(arguments)
    options = parse_assignments(arguments.set, "--set")
    solvers = dict.fromkeys(arguments.solvers)
    for name in solvers:
        registry.make_solver(name, options)  # says no to what it does not take
    pairs = [(n, s) for n in range(arguments.first, arguments.first + arguments.mechanisms) for s in solvers]
    outcomes: list[Outcome] = []
    for outcome in run_campaign(arguments.seed, pairs, count_jobs(arguments.jobs), arguments.floor, options):
        outcomes.append(outcome)
        if outcome.kind in SHOWN and not arguments.json:
            error_console().print(describe(outcome))
    counts: dict[str, Counter[Kind]] = defaultdict(Counter)
    for o in outcomes:
        counts[o.solver][o.kind] += 1
    cases = choose(arguments.seed, outcomes, arguments.shrink, arguments.floor, options)
    folder = Path(arguments.out) if arguments.out else new_folder("fuzz")
    command = shlex.join(["mbsbench", "fuzz", *solvers, "--mechanisms", str(arguments.mechanisms), "--seed",
                          str(arguments.seed), *(f"--set={k}={v}" for k, v in options.items())])  # fmt: skip
    write_cases(folder, cases, counts, f"`{command}`")
    found = sum(c.outcome.kind in FINDINGS and bool(c.evidence) for c in cases)
    if arguments.json:
        print_json({"counts": counts, "cases": [c.name for c in cases], "confirmed": found, "out": str(folder)})
        return 1 if found else 0
    kinds = [k for k in Kind if any(of[k] for of in counts.values())]
    rows = [[name, *(str(of[k]) for k in kinds)] for name, of in sorted(counts.items())]
    print_table([Column("solver", right=False), *(Column(str(k)) for k in kinds)], rows)
    for case in cases:
        console().print(f"{describe(case.outcome)}; bodies: {len(case.mechanism.bodies)}; {case.evidence or NONE}")
    console().print(f"{plural(found, 'confirmed deviation')}: {folder / 'README.md'}")
    return 1 if found else 0


def _repeat(arguments: argparse.Namespace) -> int:
    """Examine a case again; 1 if the deviation is still there."""
    case = read_case(Path(arguments.repeat))
    if len(arguments.solvers) != 1:
        raise UsageError(f"--repeat takes one solver (got {', '.join(arguments.solvers)})")
    (name,) = arguments.solvers
    solver = registry.make_solver(name, case.options | parse_assignments(arguments.set, "--set"))
    found = replace(case.oracle.examine(name, solver), number=case.outcome.number)
    evidence = case.oracle.confirm(name, solver) if found.kind in FINDINGS else ""
    if arguments.json:
        print_json({"kind": found.kind, "deviation": found.deviation, "own": found.own, "evidence": evidence})
    else:
        console().print("\n".join(filter(None, (describe(found), evidence))))
    return 1 if found.kind in FINDINGS else 0
