"""``python -m mbsbench.tests.exam [FOLDER]``: the exam of verdicts (``make exam``).

Runs or continues the sweep, computes or reads the true motions, judges every verdict, falsifies every motion, and asks
the same of the records of other results folders (``--results``). Exit code 1 where a verdict is false or a run crashed.
``--judge`` judges what is there of the sweep, ``--only WORD`` mechanisms with that word. ``--half 1`` runs and
judges the first eight mechanisms, ``--half 2`` runs what is left and judges the others. Interrupted, it goes on.
"""

import argparse
import math
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mbsbench.harness.catalogue import registry
from mbsbench.harness.catalogue.suites.spec import RunSpec
from mbsbench.harness.catalogue.suites.suite import load_suite
from mbsbench.harness.columns.identity import compute_fingerprint
from mbsbench.harness.results import store
from mbsbench.harness.results.records import RunRecord

from .building import DECLARED
from .falsified import falsify
from .judging import Finding, Sizes, is_right, judge_run
from .misleading import print_table
from .motion import true_motion

HERE = Path(__file__).parent
SUITE = HERE / "exam.toml"
PLUGINS = (HERE / "open_mechanisms.py", HERE / "own_mechanisms.py")
PLURAL = {"false alarm": "false alarms", "false success": "false successes"}
FALSE = tuple(PLURAL)
# endings expected of a method at such a step, in the words of their messages
LIMITS = "its matrix leaves out springs and dampers", "turns by more than half a turn in this step"


def say(words: str) -> None:
    """Tell how far it is, on stderr."""
    print(words, file=sys.stderr, flush=True)


def main() -> int:
    """Run the sweep and judge its verdicts."""
    parser = argparse.ArgumentParser("python -m mbsbench.tests.exam", description="The exam of verdicts.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("results/local/exam"), help="results of the sweep")
    parser.add_argument("--judge", action="store_true", help="run nothing, judge what is there")
    parser.add_argument("--jobs", default="2", help="parallel runs (default: 2)")
    parser.add_argument("--only", default="", metavar="WORD", help="judge mechanisms with this word in their names")
    parser.add_argument("--half", type=int, choices=(1, 2), help="run and judge one half of the mechanisms")
    parser.add_argument("--results", nargs="*", type=Path, default=(), help="results folders to ask the same")
    given = parser.parse_args()
    specs = load_suite(str(SUITE)).specs
    every = list(dict.fromkeys(s.problem for s in specs))
    first, last = every[: len(every) // 2], every[len(every) // 2 :]
    asked = {None: every, 1: first, 2: last}[given.half]
    if not given.judge:
        say("736 runs, about 45 minutes on one core; then their verdicts and 144 motions told, about 15 minutes more")
        say("an interruption loses the runs in progress alone: the same command goes on")
        more = ["--resume"] if (given.folder / "runs").is_dir() else []
        more += ["--limit", str(sum(s.problem in first for s in specs))] if given.half == 1 else []
        command = ["run", str(SUITE), "--out", str(given.folder), "--lossless", "--jobs", given.jobs, *more]
        ended = subprocess.run([sys.executable, "-m", "mbsbench", *command], check=False).returncode
        if ended not in (0, 1):
            return ended
    for plugin in PLUGINS:
        registry.load_plugin(plugin)
    names = [name for name in asked if given.only in name]
    if not names:
        parser.error(f"argument --only: expected a word in a name of a mechanism of the exam (got {given.only!r})")
    records: dict[str, list[RunRecord]] = {name: [] for name in names}
    if (given.folder / "runs").is_dir():
        for record in store.select_newest(store.load(given.folder, check_series=False).records):
            records.get(record.problem, []).append(record)
    found, told = {}, {}
    for name in sorted(names):
        found[name] = judge_mechanism(name, given.folder, records[name], told)
    faults = report(found, told)
    if not given.judge:
        faults += report_missing(names, records, specs)
    for folder in given.results:
        faults += print_table(folder)
    return int(faults > 0)


def judge_mechanism(
    name: str, folder: Path, records: list[RunRecord], told: dict[str, dict[str, str]]
) -> list[Finding]:
    """Findings of a mechanism's runs; adds those of its falsified motions to ``told``."""
    began = time.monotonic()
    problem = registry.make_problem(name)
    truth = true_motion(name, DECLARED[name], folder.with_name(folder.name + "-truth"))
    sizes = Sizes(truth, DECLARED[name])
    told[name] = falsify(sizes, problem)
    out = []
    for record in records:
        if record.steps and record.problem_fingerprint != compute_fingerprint(problem):
            raise SystemExit(f"error: {record.case} has other numbers than {name} has now: remove {folder}")
        out.append(judge_run(sizes, problem, record, store.read_run_series(folder, record)))
    say(f"{name}: {len(records)} runs judged in {time.monotonic() - began:.0f} s")
    return out


def report_missing(names: list[str], records: dict[str, list[RunRecord]], specs: Sequence[RunSpec]) -> int:
    """Print which runs of the suite have no record, and return how many: what was not run is not passed."""
    done = Counter(r.settings_id for name in names for r in records[name])
    lacking = [s.case for s in specs if s.problem in names and not done[s.settings_id]]
    print(f"runs without a record: {len(lacking)}" + "".join(f"\n  {case}" for case in lacking))
    return len(lacking)


def report(by_name: dict[str, list[Finding]], told: dict[str, dict[str, str]]) -> int:
    """Print the tables; return the number of false verdicts and of crashes, which no mechanism excuses."""
    found = [f for those in by_name.values() for f in those]
    print(f"{len(found)} runs of {len(told)} mechanisms by status")
    for status, n in Counter(f.status for f in found).most_common():
        print(f"  {status:16}{n:5}")
    faults = 0
    for kind in FALSE:
        those = [f for f in found if f.fault == kind]
        faults += len(those)
        print(f"{PLURAL[kind]}: {len(those)}" + "".join(f"\n  {f}" for f in those))
    crashed = [f"{f.case}: {f.because}" for f in found if f.status == "crashed"]
    faults += len(crashed)
    print(f"crashes: {len(crashed)}" + "".join(f"\n  {case}" for case in crashed))
    refused = [f"{f.case}: {f.because}" for f in found if f.status == "refused"]
    print(f"refusals: {len(refused)}" + "".join(f"\n  {case}" for case in refused))
    early = [f for f in found if f.because and f.status not in ("crashed", "refused", "success", "inaccurate", "wrong")]
    by_words = [f for f in early if any(words in f.because for words in LIMITS)]
    print(f"ended before t_end by a limit of the method that the message names: {len(by_words)}")
    others = [f"{f.case}: {f.status}, {f.because}" for f in early if f not in by_words]
    print(f"ended before t_end otherwise: {len(others)}" + "".join(f"\n  {case}" for case in others))
    called = [f for f in found if f.status in ("wrong", "inaccurate") and f.fault not in FALSE]
    by_reactions = [f for f in called if is_right({**f.shares, "reactions": math.nan})]
    others = [f for f in called if f not in by_reactions]
    print(f"accused, right but for their reactions: {len(by_reactions)}" + "".join(f"\n  {f}" for f in by_reactions))
    print(f"accused, and off by the truth: {len(others)}" + "".join(f"\n  {f}" for f in others))
    believed = [f for f in found if f.status == "success" and f.shares and not is_right(f.shares) and not f.fault]
    print(
        f"successes off by more than a hundredth, as they may be: {len(believed)}"
        + "".join(f"\n  {f}" for f in believed)
    )
    counts = Counter(verdict.split(":")[0] for kinds in told.values() for verdict in kinds.values())
    print("exact and falsified motions told: " + ", ".join(f"{n} {words}" for words, n in counts.items()))
    for name, kinds in told.items():
        for kind, verdict in kinds.items():
            if verdict.split(":")[0] in ("missed", "false alarm"):
                faults += 1
                print(f"  {name}, {kind}: {verdict}")
    print_counts(by_name, told)
    return faults


def print_counts(found: dict[str, list[Finding]], told: dict[str, dict[str, str]]) -> None:
    """Print a table of the counts, a mechanism a row, the falsified ones of those that are other motions."""
    print(
        "\n| mechanism | runs | false alarms | false successes | falsified caught | exact right |",
        "|---" * 6 + "|",
        sep="\n",
    )
    total = np.zeros(6, dtype=int)
    for name, those in found.items():
        faults, falsified = Counter(f.fault for f in those), Counter(v for k, v in told[name].items() if k != "exact")
        caught, missed = falsified["caught"], falsified["missed"]
        row = len(those), *(faults[kind] for kind in FALSE), caught, caught + missed, told[name]["exact"] == "right"
        total += row
        print("| {} | {} | {} | {} | {} of {} | {} |".format(name, *row[:-1], "yes" if row[-1] else "no"))
    print("| all | {} | {} | {} | {} of {} | {} of {} |".format(*total, len(found)))


if __name__ == "__main__":
    sys.exit(main())
