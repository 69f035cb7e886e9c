"""Compare the clouds of solvers' motions with the true cloud (``ensemble``)."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, replace

from rich.text import Text

from ...harness.catalogue.suites.spec import RunSpec
from ...harness.catalogue.trial import make_problem
from ...harness.lab.ensemble.clouds import Cloud, configure_solver, configure_truth, make_ensemble, run_cloud
from ...harness.lab.ensemble.verdict import ALL_C, NO_DIFFERENCE, CloudComparison, compare_clouds, judge_comparisons
from ...harness.run.costs import expect_solves
from ..arguments import UsageError, count_jobs, load_problem, parse_assignments, parse_positive_float
from ..commands import CONTROL
from ..terminal import Column, make_error_console, number, plural, print_json, print_table

TRUE_RTOL = 1e-10
PERFECT = "truth"  # the reference solver with other members: the score of a perfect solver
SHOWN = 3  # most failures printed
COLUMNS = (
    Column("t [s]"),
    Column("solver", right=False),
    Column("quantity", right=False),
    Column("score"),
    Column("excess"),
    Column("by chance"),
    Column("p"),
    Column("flatness", rank=1),
    Column("p(ranks)"),
    Column("spread"),
    Column("error/spread", rank=2),
    Column("bias", rank=1),
    Column("+-", rank=1),
    Column("error"),
    Column("missing"),
)


def run(arguments: argparse.Namespace) -> int:
    """Run the clouds of motions of each solver and of the truth, and print the scores, with --html also as a page.

    Return 0 if no solver differs from the truth or misses a member, else 1.
    """
    name, parameters, _ = load_problem(arguments)
    problem = make_problem(name, parameters)
    given = parse_assignments(arguments.set, "--set")
    if unknown := [k for k in given if k not in CONTROL]:
        raise UsageError(f"--set takes {', '.join(CONTROL)} (got {', '.join(unknown)})")
    codes = [configure_solver(problem, solver, given) for solver in arguments.solvers]
    truth = configure_truth(problem, arguments.truth, TRUE_RTOL)
    if truth.control.rtol is None:
        raise UsageError(f"--truth must be controlled by rtol ({arguments.truth} is controlled by dt)")
    times = [parse_positive_float(t, "--at") for t in arguments.at.split(",")] if arguments.at else []
    e = make_ensemble(problem, arguments.spread, arguments.seed, times or (0.5 * problem.t_end, problem.t_end))
    n, jobs = arguments.starts, count_jobs(arguments.jobs)
    if not arguments.json:
        specs = [RunSpec(problem.name, c.name, c.control, dict(problem.parameters)) for c in (truth, *codes)]
        time = expect_solves([(s, n if k else 2 * n) for k, s in enumerate(specs)], jobs).words
        make_error_console().print(f"{plural(n, 'start')} of {plural(len(codes), 'solver')}, {jobs} at a time: {time}")
    clouds = []
    for code, first in ((truth, 0), (truth, n), *((code, 0) for code in codes)):
        clouds.append(run_cloud(e, code, range(first, first + n), jobs))
        if len(clouds) == 1 and len(clouds[0].failures) == n:
            raise UsageError(f"no true motion by {code.name}: {clouds[0].failures[0]}; give another --truth")
        _print_cloud(clouds[-1])
    same, other, *clouds = clouds
    perfect = [replace(c, solver=PERFECT) for c in compare_clouds(e, same, same, other)]
    found = [perfect, *(compare_clouds(e, cloud, same, other) for cloud in clouds)]
    verdicts = [judge_comparisons(rows) for rows in found]
    _print_scores(found, verdicts, as_json=arguments.json)
    if arguments.html:
        from ...reports.lab.ensemble import write_page

        title = f"{name}: {plural(n, 'start')}, spread {arguments.spread:g}"
        scored = list(zip(clouds, found[1:], verdicts[1:], strict=True))
        write_page(arguments.html, title, e, (same, other), scored, perfect)
        make_error_console().print(f"page: {arguments.html}")
    return 1 if any(v != NO_DIFFERENCE for v in verdicts[1:]) else 0


def _print_cloud(cloud: Cloud) -> None:
    """Print the CPU time of a cloud per member, its first ``SHOWN`` failures, and their number if there are more."""
    out, members = make_error_console(), len(cloud.C)
    each = cloud.cpu_s / members
    out.print(f"{cloud.label}: {plural(members, 'member')}, {each:.3g} s of CPU time each")
    for line in cloud.failures[:SHOWN]:
        out.print(f"  {line}")
    if len(cloud.failures) > SHOWN:
        out.print(f"  {len(cloud.failures)} members did not reach the end")


def _print_scores(found: Sequence[list[CloudComparison]], verdicts: Sequence[str], *, as_json: bool) -> None:
    """Print the comparison of each cloud with the true one by time and quantity, and the verdict on each solver.

    With ``as_json`` print one object per comparison, without the verdicts. ``found`` has one list per solver.
    """
    rows = []
    for c in sorted((c for own in found for c in own), key=lambda c: (c.t_s, c.quantity != ALL_C, c.quantity)):
        if as_json:
            plain = asdict(c) | {"ranks": c.ranks and c.ranks._asdict() | {"counts": c.ranks.counts.tolist()}}
            print_json(plain)
        flatness, p_ranks = (c.ranks.statistic, c.ranks.p) if c.ranks else (float("nan"), float("nan"))
        numbers = (
            c.score,
            c.excess,
            c.chance,
            c.p_score,
            flatness,
            p_ranks,
            c.spread,
            c.error_of_mean,
            c.bias,
            c.bias_error,
            c.error,
        )
        head = (f"{c.t_s:g}", f"{c.solver} {c.setting}", f"{c.quantity} [{c.unit}]")
        rows.append((*head, *(number(x) for x in numbers), str(c.missing or "")))
    if not as_json:
        below = [f"{own[0].solver} {own[0].setting}: {v}" for own, v in zip(found, verdicts, strict=True)]
        print_table(COLUMNS, [(Text(r[0]), *r[1:]) for r in rows], *below)
