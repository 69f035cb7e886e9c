"""Write the tables of docs/engines.md: results of suites ``engine_defaults`` and ``frontier``, elements of engines.

python docs/list_engines.py RESULTS        # of either suite: writes results/published/engines and the page
python docs/list_engines.py                # writes the page from published data and declarations of adapters
"""

import json
import math
import re
import sys
from pathlib import Path
from textwrap import fill
from typing import Any

from mbsbench.harness.catalogue.registry import engines, make_solver
from mbsbench.harness.mechanics.joints import KINDS
from mbsbench.reports.model.catalogue import is_engine
from mbsbench.reports.model.frontier import (
    EQUAL,
    Frontier,
    classify_doubt,
    find_frontiers,
    select_broad,
    sort_engines_first,
)
from mbsbench.reports.model.results import StoredRun, read_results
from mbsbench.reports.pages.judged.engines import TARGET, Contest, describe_budget, list_contests, list_packages
from mbsbench.solvers.engines.export.engine import LOADS, SPRINGS, TORSIONS, VARYING, SupportedElements

HERE = Path(__file__).resolve().parent
PAGE, FOLDER = HERE / "engines.md", HERE.parent / "results" / "published" / "engines"
PUBLISHED, COSTS = FOLDER / "contests.json", FOLDER / "frontier.json"
TABLES, FRONTIER, ELEMENTS = (
    re.compile(rf"(?<=<!-- made from {source} by list_engines\.py -->\n).*?(?=<!-- end -->)", re.DOTALL)
    for source in (
        r"results/published/engines/contests\.json",
        r"results/published/engines/frontier\.json",
        "solvers/engines",
    )
)
SHOWN = (1e-3, 1e-6, 1e-9, 1e-11)  # errors of the frontier on the page
SAME = {"drake_adaptive": "drake"}  # one column for both


def publish(folder: Path) -> None:
    """Write the published data of results: both runs of every contestant, or the frontier, with commit and machine.

    Exit with an error if the results are of several commits or of changed code.
    """
    results = read_results(folder)
    e = results.environment
    commits = {run.record.commit for run in results.runs}
    if e.get("dirty") or len(commits) != 1:
        raise SystemExit(f"error: {folder} is not of one commit without changes: nothing is published")
    text = {"commit": e["commit"], "cpu": e.get("cpu"), "runs": len(results.runs)}
    text["packages"] = list_packages(results.runs)
    if found := list_contests(results):
        text |= {
            "budget": describe_budget(found),
            "target": TARGET,
            "contests": [_make_contest(contest) for contest in found],
        }
    else:
        text["rows"] = [
            _make_frontier_row(f) for f in sort_engines_first(select_broad(results, find_frontiers(results)))
        ]
    (PUBLISHED if found else COSTS).write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")


def _make_frontier_row(f: Frontier) -> dict[str, Any]:
    """Return a row of the published frontier: the cheapest code for an error, its cost, and the best engine."""
    first = f.places[0]
    engine = next(((p.run.record.solver, p.factor) for p in f.places if is_engine(p.run.record.solver)), None)
    return {
        "variant": f.variant,
        "error": f.target,
        "unit": f.unit,
        "below_reference": f.is_below_reference,
        "cheapest": first.run.record.solver,
        "settings": first.run.settings(),
        "cpu_s": first.cpu_s,
        "spread": first.spread,
        "repeats": first.run.record.repeats,
        "next": f.places[1].factor,
        "engine": engine,
        "reach": len(f.places),
    }


def _make_contest(contest: Contest) -> dict[str, Any]:
    """Return the published data of a contest: both runs of each contestant, by name, and the settings tried."""
    pairs = {
        pair.who: {"shipped": _make_run(contest, pair.shipped), "best": _make_run(contest, pair.best)}
        for pair in contest.pairs
    }
    made = [run for run in contest.variant.runs if run.status != "refused"]
    return {
        "problem": contest.variant.runs[0].record.problem,
        "unit": contest.measure.unit,
        "pairs": pairs,
        "settings": sorted({f"{run.record.solver} {json.dumps(run.options)}" for run in made}),
    }


def _make_run(contest: Contest, run: StoredRun | None) -> dict[str, Any] | None:
    """Return the published numbers of a run, with None for NaN; None without a run."""
    if run is None:
        return None
    numbers = {
        "error": contest.error(run),
        "energy_J": run.record.energy_drift_max_J,
        "gap": run.record.phi_max,
        "cpu_s": run.record.cpu_median_s,
    }
    return {
        "settings": run.settings(),
        "status": run.status,
        **{name: None if math.isnan(value) else value for name, value in numbers.items()},
    }


def format_contests() -> str:
    """Return the tables of contests: how many reach the target, errors by contestant, the cheapest codes."""
    if not PUBLISHED.exists():
        return "No run of this code is published; `python docs/list_engines.py RESULTS` writes its tables here.\n"
    found = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    every = found["contests"]
    problems = [one["problem"] for one in every]
    target = found["target"]
    shipped, tuned = (_total(every, which, target) for which in ("shipped", "best"))
    lines = [
        fill(
            f"Commit {found['commit'][:8]}, {found['runs']} runs, {found['budget']}. Within {target:g} m or rad over "
            f"one second: **{shipped[0]} of {shipped[1]} as shipped, {tuned[0]} of {tuned[1]} tuned**."
            f"{_made_by(found)}",
            98,
        ),
        "",
        "Largest error [m, rad] as shipped, and of the best of the budget; CPU time of the latter.",
        "",
        "| | " + " | ".join(problems) + " |",
        "|---" * (1 + len(problems)) + "|",
    ]
    names = sorted({who for one in every for who in one["pairs"]})
    lines += [f"| `{who}` | " + " | ".join(_cell(one["pairs"].get(who)) for one in every) + " |" for who in names]
    words = (
        f"The cheapest runs within {target:g}, each contestant with the best of its settings. ≈: the next takes less "
    )
    lines += ["", fill(f"{words}than {EQUAL:g} times as long: which is cheaper is not decided.", 98), ""]
    lines += ["| problem | cheapest | next | cheapest engine |", "|---|---|---|---|"]
    for one in every:
        best = {who: pair["best"] for who, pair in one["pairs"].items() if _within(pair["best"], target)}
        order = sorted((run["cpu_s"], who) for who, run in best.items())
        engine = next((pair for pair in order if pair[1] not in OURS), None)
        shown = [*order[:2], *[None] * (2 - len(order[:2])), engine]
        tie = " ≈" * (len(order) > 1 and order[1][0] < EQUAL * order[0][0])
        cells = [_cost(shown[0]) + tie, *(_cost(pair) for pair in shown[1:])]
        lines.append(f"| {one['problem']} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _made_by(found: dict[str, Any]) -> str:
    """Return a sentence that names the packages of the runs; empty if none are recorded."""
    return f" Made by {', '.join(found['packages'])}." if found.get("packages") else ""


def format_frontier() -> str:
    """Return the table of the frontier: a row per variant with the cheapest code at each error.

    Variants on which an engine leads come first.
    """
    lead = "**The frontier** (`mbsbench run frontier`)"
    if not COSTS.exists():
        return f"{lead}: no run of it is published; `python docs/list_engines.py RESULTS` writes its table here.\n"
    found = json.loads(COSTS.read_text(encoding="utf-8"))
    at = {(row["variant"], row["error"]): row for row in found["rows"]}
    words = (
        f"{lead}, commit {found['commit'][:8]}, {found['runs']} runs: the cheapest code for an error [m, rad] with its "
        "CPU time and the spread (upper over lower quartile) of its repeats; over that, the next code and the cheapest "
        "of MuJoCo, Exudyn and Pinocchio. In bold: one of these leads. –: fewer than two codes, or no engine. "
        f"≈: the spread exceeds the lead, which is not decided: a tie if the lead is below {EQUAL:g}, else because of "
        f"the spread. †: below the stated error of the reference.{_made_by(found)}"
    )
    heads = [f"{error:.0e}".replace("e-0", "e-") for error in SHOWN]
    lines = [fill(words, 98), "", "| | " + " | ".join(heads) + " |", "|---" * (1 + len(SHOWN)) + "|"]
    for variant in dict.fromkeys(row["variant"] for row in found["rows"]):
        lines.append(
            f"| {variant} | " + " | ".join(_format_frontier_cell(at.get((variant, error))) for error in SHOWN) + " |"
        )
    return "\n".join(lines) + "\n"


def _format_frontier_cell(row: dict[str, Any] | None) -> str:
    """Format one cell of the frontier's table; a dash without a row."""
    if row is None:
        return "–"
    engine = f"{row['engine'][1]:.2g}" if row["engine"] else "–"
    bold = "**" if row["engine"] and row["engine"][1] <= 1.0 else ""
    words = f"{bold}`{row['cheapest']}`{bold} {_time(row['cpu_s'])}, {row['spread']:.2g}; {row['next']:.2g}, {engine}"
    doubt = classify_doubt(row["spread"], row["next"])
    marks = (f"≈ {doubt}", doubt), ("†", row["below_reference"])
    return " ".join((words, *(mark for mark, holds in marks if holds)))


def format_elements() -> str:
    """Return the table of the elements that each engine supports, and the reasons why it lacks others."""
    takes: dict[str, SupportedElements] = {
        name: taken
        for name in engines()
        if name not in SAME and (taken := getattr(type(make_solver(name)), "takes", None))
    }
    names = [*map(str, KINDS), SPRINGS, TORSIONS, LOADS, VARYING]
    lines = ["| | " + " | ".join(f"`{who}`" for who in takes) + " |", "|---" * (1 + len(takes)) + "|"]
    lines += [
        f"| {name} | " + " | ".join("yes" if name in of.elements else "–" for of in takes.values()) + " |"
        for name in names
    ]
    lines += ["", "Not taken; an element without a reason does not exist there.", ""]
    for who, of in takes.items():
        reasons: dict[str, list[str]] = {}
        for name in names:
            if name not in of.elements and name in of.lacks:
                reasons.setdefault(of.lacks[name], []).append(name)
        said = "; ".join(f"{', '.join(what)} ({why})" for why, what in reasons.items())
        lines.append(fill(f"- `{who}`: {said}.", 100, subsequent_indent="  "))
    return "\n".join(lines) + "\n"


OURS = ("rattle", "gc_composed", "rkmk_dop853", "dop853_joint")


def _within(run: dict[str, Any] | None, target: float) -> bool:
    """Return whether a run exists and its error is within ``target``."""
    return run is not None and run["error"] is not None and run["error"] <= target


def _reached(contest: dict[str, Any], which: str, target: float) -> tuple[int, int]:
    """Count the runs of a contest within ``target``, and those that were made and not refused."""
    runs = [pair[which] for pair in contest["pairs"].values()]
    made = [run for run in runs if run is not None and run["status"] != "refused"]
    return sum(_within(run, target) for run in made), len(made)


def _total(every: list[dict[str, Any]], which: str, target: float) -> tuple[int, int]:
    """Return the sums of ``_reached`` over all contests."""
    reached, made = zip(*(_reached(one, which, target) for one in every), strict=True)
    return sum(reached), sum(made)


def _cell(pair: dict[str, Any] | None) -> str:
    """Format the errors of a contestant on a problem, as shipped and at best, and the CPU time of the best."""
    if pair is None or pair["best"]["status"] == "refused":
        return "refused"
    best = pair["best"]
    cost = "" if best["error"] is None else f", {_time(best['cpu_s'])}"
    return f"{_error(pair['shipped'])} → {_error(best)}{cost}"


def _error(run: dict[str, Any] | None) -> str:
    """Format the error of a run; its status if it has none, a dash without a run."""
    if run is None:
        return "–"
    return run["status"] if run["error"] is None else f"{run['error']:.0e}".replace("e-0", "e-").replace("e+0", "e")


def _cost(pair: tuple[float, str] | None) -> str:
    """Format a contestant and its CPU time, from the pair of both; a dash without one."""
    return "–" if pair is None else f"`{pair[1]}` {_time(pair[0])}"


def _time(seconds: float) -> str:
    """Format a CPU time with its unit."""
    return f"{1e3 * seconds:.2g} ms" if seconds < 0.0995 else f"{seconds:.2g} s"


if __name__ == "__main__":
    if sys.argv[1:]:
        publish(Path(sys.argv[1]))
    page = TABLES.sub(lambda _: format_contests(), PAGE.read_text(encoding="utf-8"), count=1)
    page = FRONTIER.sub(lambda _: format_frontier(), page, count=1)
    PAGE.write_text(ELEMENTS.sub(lambda _: format_elements(), page, count=1), encoding="utf-8")
