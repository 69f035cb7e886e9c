"""Run solvers on random mechanisms in several forms; shrink and write confirmed deviations (``fuzz``)."""

import argparse
from dataclasses import replace
from pathlib import Path

from ...harness.catalogue import registry
from ...harness.lab.fuzz.campaign import choose_settings
from ...harness.lab.fuzz.cases import NONE, read_case
from ...harness.lab.fuzz.log import COLUMNS, CONFIRMED, list_untried_pairs, run_trials
from ...harness.lab.fuzz.oracle import FINDINGS, describe_outcome
from ...harness.lab.fuzz.report import write_findings
from ...harness.run.costs import describe_command
from ...harness.run.runner import name_new_folder
from ..arguments import UsageError, count_jobs, load_plugins, parse_assignments
from ..progress import announce_suite
from ..terminal import Column, make_console, make_error_console, plural, print_json, print_table


def run(arguments: argparse.Namespace) -> int:
    """Run the trials that the folder lacks, shrink and write the deviations, and print the outcomes by solver.

    With --repeat, examine one stored case instead. Return 1 if a deviation is confirmed, else 0.
    """
    load_plugins(arguments.plugin)
    for name in arguments.solvers:
        registry.find_entry("solver", name, registry.solvers())
    if arguments.repeat:
        return _repeat_case(arguments)
    options = parse_assignments(arguments.set, "--set")
    names = list(dict.fromkeys(arguments.solvers))
    for name in names:
        registry.make_solver(name, options)  # raises for options that it does not take
    form = parse_assignments(arguments.form, "--form") if arguments.form else None
    settings = choose_settings(arguments.seed, arguments.floor, options, form)
    folder = Path(arguments.out) if arguments.out else name_new_folder("fuzz")
    numbers = range(arguments.first, arguments.first + arguments.mechanisms)
    pairs = [(n, s) for n in numbers for s in ([names[n % len(names)]] if arguments.in_turns else names)]
    left = list_untried_pairs(folder, settings, pairs)
    jobs, before = count_jobs(arguments.jobs), len(pairs) - len(left)
    kept = f", {before} already done" if before else ""
    time_needed = f": {describe_command('fuzz', len(left), jobs)}, and what has to be compiled" if left else ""
    announce_suite(f"{plural(len(pairs), 'trial')}{kept}, {jobs} at a time{time_needed}", make_error_console())
    run_trials(folder, settings, left, jobs, (lambda _: None) if arguments.json else make_error_console().print)
    counts, cases = write_findings(folder, arguments.shrink)
    confirmed = counts["all"][CONFIRMED]
    if arguments.json:
        print_json({"counts": counts, "cases": [c.name for c in cases], "confirmed": confirmed, "out": str(folder)})
        return 1 if confirmed else 0
    shown = [n for n in COLUMNS if counts["all"][n]]
    print_table(
        [Column("solver", right=False), *map(Column, shown)],
        [[name, *(str(count[n]) for n in shown)] for name, count in counts.items()],
    )
    for case in cases:
        make_console().print(
            f"{describe_outcome(case.outcome)}; bodies: {len(case.mechanism.bodies)}; {case.evidence or NONE}"
        )
    make_console().print(f"{plural(confirmed, 'confirmed deviation')}: {folder / 'README.md'}")
    return 1 if confirmed else 0


def _repeat_case(arguments: argparse.Namespace) -> int:
    """Examine the one solver on the case stored in --repeat and print the outcome; return 1 if it deviates, else 0."""
    case = read_case(Path(arguments.repeat))
    if len(arguments.solvers) != 1:
        raise UsageError(f"--repeat takes one solver (got {', '.join(arguments.solvers)})")
    (name,) = arguments.solvers
    solver = registry.make_solver(name, case.options | parse_assignments(arguments.set, "--set"))
    found = replace(case.oracle.examine(name, solver), number=case.outcome.number)
    evidence = case.oracle.decide(name, solver)[1] if found.kind in FINDINGS else ""
    if arguments.json:
        print_json({"kind": found.kind, "deviation": found.deviation, "own": found.own, "evidence": evidence})
    else:
        make_console().print("\n".join(filter(None, (describe_outcome(found), evidence))))
    return 1 if found.kind in FINDINGS else 0
